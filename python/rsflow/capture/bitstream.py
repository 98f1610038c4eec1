"""The size of the picture that a packet of a video says, for the codecs that say it within the stream."""

from __future__ import annotations

import struct
from collections.abc import Callable

__all__ = ["hidden", "hides", "picture_size"]

# Bytes of a packet that are looked at: headers come first.
_HEAD = 65536


class _Bits:
    """Bits of a payload from the highest on."""

    def __init__(self, data: bytes) -> None:
        self._value = int.from_bytes(data, "big")
        self._left = 8 * len(data)

    def take(self, count: int) -> int:
        """Give the next bits as a number."""
        self._left -= count
        if self._left < 0:
            raise IndexError("the header is cut off")
        return self._value >> self._left & (1 << count) - 1

    def golomb(self) -> int:
        """Give a number in Exp-Golomb code."""
        zeros = 0
        while not self.take(1):
            zeros += 1
            if zeros > 32:
                raise IndexError("no number")
        return (1 << zeros) - 1 + self.take(zeros)

    def signed(self) -> int:
        """Give a signed number in Exp-Golomb code."""
        code = self.golomb()
        return (code + 1) // 2 if code % 2 else -(code // 2)


def picture_size(codec: int, packet: bytes) -> tuple[int, int] | None:
    """Give width and height that a packet says, as the stream counts them; None where it says none.

    Parameters
    ----------
    codec : int
        FOURCC, as OpenCV gives it.
    packet : bytes
        The packet; H.264 and HEVC with start codes.
    """
    reader = _READERS.get(_name(codec))
    if reader is None:
        return None
    try:
        size = reader(packet[:_HEAD])
    except (IndexError, struct.error):
        return None
    return size if size is not None and size[0] > 0 and size[1] > 0 else None


def hides(codec: int) -> bool:
    """Say whether a codec has packets that are not to be shown: VP8 keeps pictures to predict others from."""
    return _name(codec) in ("vp80", "vp08")


def hidden(codec: int, packet: bytes) -> bool:
    """Say whether a packet is not to be shown."""
    return hides(codec) and bool(packet) and not packet[0] & 0x10


def _name(codec: int) -> str:
    return (codec & 0xFFFFFFFF).to_bytes(4, "little").decode("latin-1").lower()


def _jpeg(data: bytes) -> tuple[int, int] | None:
    place = 2
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker = data[place + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, place + 5)
            return width, height
        place += 2 + int(struct.unpack_from(">H", data, place + 2)[0])
    return None


def _after(data: bytes, accepts: Callable[[int], bool]) -> bytes | None:
    """Give what follows the last start code whose byte is accepted, that byte first.

    The last, since FFmpeg puts the container's parameters before those of the packet itself.
    """
    found = None
    place = data.find(b"\0\0\1")
    while 0 <= place < len(data) - 3:
        if accepts(data[place + 3]):
            found = place + 3
        place = data.find(b"\0\0\1", place + 3)
    return None if found is None else data[found:]


def _payload(data: bytes) -> bytes:
    """Cut at the next start code, and take out the bytes that keep start codes from appearing."""
    ends = data.find(b"\0\0\1")
    return (data if ends < 0 else data[:ends]).replace(b"\0\0\3", b"\0\0")


def _mpeg4(data: bytes) -> tuple[int, int] | None:
    found = _after(data, lambda code: 0x20 <= code <= 0x2F)
    if found is None:
        return None
    bits = _Bits(found[1:64])
    bits.take(9)
    if bits.take(1):
        bits.take(7)
    if bits.take(4) == 15:
        bits.take(16)
    if bits.take(1):
        bits.take(3)
        if bits.take(1):
            bits.take(79)
    if bits.take(2):
        return None
    bits.take(1)
    steps = bits.take(16)
    bits.take(1)
    if bits.take(1):
        bits.take(max(1, (steps - 1).bit_length()))
    bits.take(1)
    width = bits.take(13)
    bits.take(1)
    return width, bits.take(13)


def _mpeg2(data: bytes) -> tuple[int, int] | None:
    found = _after(data, lambda code: code == 0xB3)
    if found is None:
        return None
    bits = _Bits(found[1:8])
    return bits.take(12), bits.take(12)


_CHROMA = (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135)


def _h264(data: bytes) -> tuple[int, int] | None:
    found = _after(data, lambda code: code & 0x1F == 7)
    if found is None:
        return None
    bits = _Bits(_payload(found)[1:512])
    profile = bits.take(8)
    bits.take(16)
    bits.golomb()
    chroma = 1
    if profile in _CHROMA:
        chroma = bits.golomb()
        if chroma == 3:
            bits.take(1)
        bits.golomb()
        bits.golomb()
        bits.take(1)
        if bits.take(1):
            for matrix in range(12 if chroma == 3 else 8):
                if bits.take(1):
                    _scaling(bits, 16 if matrix < 6 else 64)
    bits.golomb()
    order = bits.golomb()
    if order == 0:
        bits.golomb()
    elif order == 1:
        bits.take(1)
        bits.signed()
        bits.signed()
        for _ in range(min(255, bits.golomb())):
            bits.signed()
    bits.golomb()
    bits.take(1)
    width, height = 16 * (bits.golomb() + 1), 16 * (bits.golomb() + 1)
    frames = bits.take(1)
    height *= 2 - frames
    if not frames:
        bits.take(1)
    bits.take(1)
    if bits.take(1):
        left, right, top, below = (bits.golomb() for _ in range(4))
        across = 2 if chroma in (1, 2) else 1
        down = (2 if chroma == 1 else 1) * (2 - frames)
        width, height = width - across * (left + right), height - down * (top + below)
    return width, height


def _scaling(bits: _Bits, count: int) -> None:
    last = following = 8
    for _ in range(count):
        if following:
            following = (last + bits.signed()) % 256
        last = following or last


def _hevc(data: bytes) -> tuple[int, int] | None:
    found = _after(data, lambda code: code >> 1 & 0x3F == 33)
    if found is None:
        return None
    bits = _Bits(_payload(found)[2:512])
    bits.take(4)
    layers = bits.take(3)
    bits.take(1)
    bits.take(88)
    bits.take(8)
    present = [(bits.take(1), bits.take(1)) for _ in range(layers)]
    if layers:
        bits.take(2 * (8 - layers))
    for profile, level in present:
        bits.take(88 * profile + 8 * level)
    bits.golomb()
    chroma = bits.golomb()
    if chroma == 3:
        bits.take(1)
    width, height = bits.golomb(), bits.golomb()
    if bits.take(1):
        left, right, top, below = (bits.golomb() for _ in range(4))
        across, down = (2 if chroma in (1, 2) else 1), (2 if chroma == 1 else 1)
        width, height = width - across * (left + right), height - down * (top + below)
    return width, height


def _vp8(data: bytes) -> tuple[int, int] | None:
    if data[0] & 1 or data[3:6] != b"\x9d\x01\x2a":
        return None
    width, height = struct.unpack_from("<HH", data, 6)
    return width & 0x3FFF, height & 0x3FFF


def _vp9(data: bytes) -> tuple[int, int] | None:
    bits = _Bits(data[:32])
    if bits.take(2) != 2:
        return None
    profile = bits.take(1) | bits.take(1) << 1
    if profile == 3:
        bits.take(1)
    # A picture shown again, or one that is no key.
    if bits.take(1) or bits.take(1):
        return None
    bits.take(2)
    if bits.take(24) != 0x498342:
        return None
    if profile >= 2:
        bits.take(1)
    if bits.take(3) != 7:
        bits.take(1)
        if profile in (1, 3):
            bits.take(3)
    elif profile in (1, 3):
        bits.take(1)
    return bits.take(16) + 1, bits.take(16) + 1


_READERS: dict[str, Callable[[bytes], tuple[int, int] | None]] = {
    **dict.fromkeys(("mjpg", "jpeg", "mjpa", "avdj", "avrn"), _jpeg),
    **dict.fromkeys(("mp4v", "fmp4", "xvid", "divx", "dx50", "m4s2", "3iv2"), _mpeg4),
    **dict.fromkeys(("mpg1", "mpg2", "mpeg", "pim1", "mp2v", "mp1v", "em2v", "hdv3"), _mpeg2),
    **dict.fromkeys(("h264", "avc1", "avc3", "x264", "davc", "vssh"), _h264),
    **dict.fromkeys(("hevc", "hev1", "hvc1", "h265", "x265"), _hevc),
    **dict.fromkeys(("vp80", "vp08"), _vp8),
    **dict.fromkeys(("vp90", "vp09"), _vp9),
}
