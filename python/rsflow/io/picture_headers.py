"""Width and height that the header of a picture says, read before a decoder allocates for it.

Every format that OpenCV reads is known by its first bytes, as OpenCV knows it: a suffix may lie. A header that claims
what the file's length cannot hold raises `HeaderError`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["HeaderError", "PictureHeader", "picture_header", "picture_kind"]

# No deflate stream grows by more than this (zlib's technical notes).
_DEFLATE = 1032

# JPEG: a block of 64 pixels takes two bits at least, one for its mean and one for its end, and in a progressive one a
# single bit: 256 and 512 pixels a byte, and a little more.
_JPEG = 272
_JPEG_PROGRESSIVE = 544

# Pages of a TIFF that are looked at.
_MAX_PAGES = 65536


class HeaderError(ValueError):
    """The header of a picture is damaged, cut off, or claims what cannot be."""


@dataclass(frozen=True, slots=True)
class PictureHeader:
    """What a header says.

    Attributes
    ----------
    kind : str
        The format.
    width, height : int
        In pixels: the largest of all pages.
    pixel_bytes : int
        Bytes of a decoded pixel, at least.
    pages : tuple of int
        Numbers of the pages, or frames of an animation, that are pictures: reduced copies and masks are left out.
    animated : bool
        Whether they have times.
    """

    kind: str
    width: int
    height: int
    pixel_bytes: int
    pages: tuple[int, ...] = (0,)
    animated: bool = False


def picture_header(data: bytes) -> PictureHeader | None:
    """Read the header of a picture; None where the bytes start as no format that is known.

    Raises
    ------
    HeaderError
        If the header is damaged.
    """
    for starts, reader in _READERS:
        if starts(data):
            try:
                return reader(data)
            except (struct.error, IndexError):
                raise HeaderError(f"the header is cut off ({len(data)} bytes)") from None
    return None


def picture_kind(data: bytes) -> str:
    """Say what picture the first bytes begin, in one word; empty where they begin none that is known."""
    return next((reader.__name__.lstrip("_") for starts, reader in _READERS if starts(data)), "")


def _held(claim: int, most: int, data: bytes, width: int, height: int) -> None:
    if claim > most:
        raise HeaderError(f"the header says {width} x {height} pixels, which {len(data)} bytes cannot hold")


def _png(data: bytes) -> PictureHeader:
    width, height, depth, kind = struct.unpack_from(">IIBB", data, 16)
    if data[12:16] != b"IHDR" or kind not in (0, 2, 3, 4, 6) or depth not in (1, 2, 4, 8, 16):
        raise HeaderError(f"a PNG of {depth} bits and colour type {kind}, which there is not")
    place, packed, pages, ended = 8, 0, 1, False
    while place + 8 <= len(data) and not ended:
        length, name = struct.unpack_from(">I4s", data, place)
        if place + 12 + length > len(data):
            break
        if name == b"acTL" and length == 8:
            pages = max(1, struct.unpack_from(">I", data, place + 8)[0])
        packed += length if name in (b"IDAT", b"fdAT") else 0
        ended = name == b"IEND"
        place += 12 + length
    if not ended:
        raise HeaderError(f"the picture is truncated: a PNG of {len(data)} bytes without its end marker")
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}[kind]
    _held(width * height * depth * channels // 8, _DEFLATE * (packed + 64), data, width, height)
    if pages > 1:
        _held(pages, packed, data, width, height)
    decoded = (1 if kind == 0 else 3) if depth <= 8 else (2 if kind == 0 else 6)
    return PictureHeader("PNG", width, height, decoded, tuple(range(pages)), pages > 1)


def _jpeg(data: bytes) -> PictureHeader:
    place = 2
    while place + 4 <= len(data):
        if data[place] != 0xFF:
            raise HeaderError(f"a JPEG with no marker at byte {place}")
        marker = data[place + 1]
        if marker == 0xFF:
            place += 1
            continue
        length = struct.unpack_from(">H", data, place + 2)[0]
        if marker in range(0xC0, 0xD0) and marker not in (0xC4, 0xC8, 0xCC):
            height, width, channels = struct.unpack_from(">HHB", data, place + 5)
            progressive = marker in (0xC2, 0xC6, 0xCA, 0xCE)
            # Arithmetic coding (0xC9 and on) packs a flat picture without bound.
            most = (_JPEG_PROGRESSIVE if progressive else _JPEG) * (1 if marker < 0xC8 else 64)
            _held(width * height, most * len(data), data, width, height)
            # Progressive ones are kept whole as coefficients of 16 bits beside the picture.
            return PictureHeader("JPEG", width, height, channels * (3 if progressive else 1))
        if marker in (0xD9, 0xDA):
            break
        place += 2 if marker in range(0xD0, 0xD9) or marker == 0x01 else 2 + length
    raise HeaderError("a JPEG without a frame header")


def _jpeg_2000(data: bytes) -> PictureHeader:
    place = data.find(b"\xff\x4f\xff\x51")
    if place < 0:
        raise HeaderError("a JPEG 2000 without a codestream")
    right, below, left, top, tile_width, tile_height = struct.unpack_from(">6I", data, place + 8)
    channels = struct.unpack_from(">H", data, place + 40)[0]
    if right <= left or below <= top or tile_width < 1 or tile_height < 1:
        raise HeaderError(
            f"a JPEG 2000 from {left}, {top} to {right}, {below} in tiles of {tile_width} x {tile_height}"
        )
    width, height = right - left, below - top
    # Each tile has a header of 14 bytes in the file, but the decoder makes room for all that the size says.
    _held(14 * -(-width // tile_width) * -(-height // tile_height), len(data), data, width, height)
    return PictureHeader("JPEG 2000", width, height, 4 * max(1, channels))


def _bmp(data: bytes) -> PictureHeader:
    size = struct.unpack_from("<I", data, 14)[0]
    offset = struct.unpack_from("<I", data, 10)[0]
    if size == 12:
        width, height, bits = struct.unpack_from("<HHxxH", data, 18)
        packing = 0
    else:
        width, height, bits, packing = struct.unpack_from("<iixxHI", data, 18)
    width, height = abs(width), abs(height)
    if packing in (0, 3, 6):
        _held(offset + (width * bits + 31) // 32 * 4 * height, len(data) + 4, data, width, height)
    else:
        # Run lengths: two bytes for 255 pixels; a jump of four bytes passes over a little more.
        _held(width * height, 16384 * len(data), data, width, height)
    return PictureHeader("BMP", width, height, 4 if bits == 32 else 3)


def _webp(data: bytes) -> PictureHeader:
    width = height = pages = 0
    place = 12
    if struct.unpack_from("<I", data, 4)[0] + 8 > len(data) + 1:
        raise HeaderError(f"the picture is truncated: a WebP of {len(data)} bytes, whose header says more")
    while place + 8 <= len(data):
        name, length = struct.unpack_from("<4sI", data, place)
        body = place + 8
        if name == b"VP8X":
            wide, high = (int.from_bytes(data[body + k : body + k + 3], "little") + 1 for k in (4, 7))
        elif name == b"ANMF":
            wide, high = (int.from_bytes(data[body + k : body + k + 3], "little") + 1 for k in (6, 9))
            pages += 1
        elif name == b"VP8 ":
            wide, high = (n & 0x3FFF for n in struct.unpack_from("<HH", data, body + 6))
        elif name == b"VP8L":
            bits = struct.unpack_from("<I", data, body + 1)[0]
            wide, high = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
        else:
            wide = high = 0
        width, height = max(width, wide), max(height, high)
        place = body + length + length % 2
    if width < 1 or height < 1:
        raise HeaderError("a WebP without a picture")
    return PictureHeader("WebP", width, height, 4, tuple(range(max(1, pages))), pages > 1)


def _pnm(data: bytes) -> PictureHeader:
    text = re.sub(rb"#[^\n]*", b"", data[:4096])
    if data[1:2] == b"7":
        found = {key: int(value) for key, value in re.findall(rb"(WIDTH|HEIGHT|DEPTH|MAXVAL)\s+(\d{1,10})", text)}
        width, height, channels = (found.get(key, 0) for key in (b"WIDTH", b"HEIGHT", b"DEPTH"))
        deep = 2 if found.get(b"MAXVAL", 255) > 255 else 1
        _held(width * height * channels * deep, len(data), data, width, height)
        return PictureHeader("PAM", width, height, max(1, channels) * deep)
    kind = data[1] - ord("0")
    fields = re.match(rb"P\d\s+(\d{1,10})\s+(\d{1,10})" + (rb"" if kind in (1, 4) else rb"\s+(\d{1,10})"), text)
    if fields is None:
        raise HeaderError("a PNM whose header has no width and height")
    width, height = int(fields[1]), int(fields[2])
    deep = 2 if kind not in (1, 4) and int(fields[3]) > 255 else 1
    channels = 3 if kind in (3, 6) else 1
    if kind == 4:
        _held((width + 7) // 8 * height, len(data), data, width, height)
    else:
        # As text, a value takes a digit at least and what parts it from the next.
        _held(width * height * channels * (deep if kind > 3 else 1), len(data), data, width, height)
    return PictureHeader("PNM", width, height, channels * deep)


def _pfm(data: bytes) -> PictureHeader:
    fields = re.match(rb"P[Ff]\s+(\d{1,10})\s+(\d{1,10})\s", data[:256])
    if fields is None:
        raise HeaderError("a PFM whose header has no width and height")
    width, height = int(fields[1]), int(fields[2])
    channels = 3 if data[1:2] == b"F" else 1
    _held(width * height * channels * 4, len(data), data, width, height)
    return PictureHeader("PFM", width, height, 4 * channels)


def _hdr(data: bytes) -> PictureHeader:
    fields = re.search(rb"\n[-+]Y (\d{1,10}) [-+]X (\d{1,10})", data[:65536])
    if fields is None:
        raise HeaderError("a Radiance picture without a size")
    width, height = int(fields[2]), int(fields[1])
    # Runs of up to 127 of one byte take two.
    _held(width * height, 64 * len(data), data, width, height)
    return PictureHeader("HDR", width, height, 12)


def _exr(data: bytes) -> PictureHeader:
    place = data.find(b"dataWindow\0box2i\0", 0, 65536)
    if place < 0:
        raise HeaderError("an OpenEXR without a window")
    left, top, right, below = struct.unpack_from("<4i", data, place + 21)
    return PictureHeader("OpenEXR", right - left + 1, below - top + 1, 12)


def _sun(data: bytes) -> PictureHeader:
    width, height, bits, _, packing = struct.unpack_from(">5I", data, 4)
    _held(width * height * max(1, bits) // 8, len(data) * (128 if packing == 2 else 1), data, width, height)
    return PictureHeader("Sun raster", width, height, 3)


def _gif(data: bytes) -> PictureHeader:
    """Walk the blocks: pictures are counted, and each of them must lie in the file."""
    width, height, flags = struct.unpack_from("<HHB", data, 6)
    place = 13 + (3 << (flags & 7) + 1 if flags & 0x80 else 0)
    pages = 0
    while place < len(data) and data[place] in (0x21, 0x2C):
        if data[place] == 0x2C:
            local = data[place + 9]
            place += 11 + (3 << (local & 7) + 1 if local & 0x80 else 0)
            pages += 1
        else:
            place += 2
        while place < len(data) and data[place]:
            place += data[place] + 1
        place += 1
    if place >= len(data):
        raise HeaderError(f"the picture is truncated: a GIF of {len(data)} bytes without its end marker")
    return PictureHeader("GIF", width, height, 4, tuple(range(max(1, pages))), pages > 1)


def _avif(data: bytes) -> PictureHeader:
    sizes = [struct.unpack_from(">II", data, place.end() + 4) for place in re.finditer(b"ispe", data[: 1 << 20])]
    if not sizes:
        raise HeaderError("an AVIF without a size")
    width, height = max(size[0] for size in sizes), max(size[1] for size in sizes)
    # The brand of a sequence, and the table of the lengths of its frames.
    table = data.find(b"stsz") if b"avis" in data[8:64] else -1
    count = 1 if table < 0 else struct.unpack_from(">I", data, table + 12)[0]
    _held(count, len(data), data, width, height)
    return PictureHeader("AVIF", width, height, 4, tuple(range(max(1, count))), count > 1)


# TIFF: bytes of a value of each type, and its letter for struct; what is no whole number has none.
_TIFF_TYPES = {1: (1, "B"), 2: (1, ""), 3: (2, "H"), 4: (4, "I"), 5: (8, ""), 6: (1, ""), 7: (1, ""), 8: (2, "")}
_TIFF_TYPES |= {9: (4, ""), 10: (8, ""), 11: (4, ""), 12: (8, ""), 13: (4, "I"), 16: (8, "Q"), 17: (8, "")}
_TIFF_TYPES |= {18: (8, "Q")}


def _tiff(data: bytes) -> PictureHeader:
    order = "<" if data[:2] == b"II" else ">"
    big = struct.unpack_from(order + "H", data, 2)[0] == 43
    place = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)[0]
    width = height = pixel_bytes = 0
    pages: list[int] = []
    seen: set[int] = set()
    while place and len(seen) < _MAX_PAGES:
        if place in seen:
            raise HeaderError(f"a TIFF whose page {len(seen)} is an earlier one again")
        seen.add(place)
        tags, place = _tiff_page(data, place, order, big)
        wide, high = _first(tags, 256), _first(tags, 257)
        deep = max(1, (max(tags.get(258, (1,))) + 7) // 8)
        samples = _first(tags, 277, 1)
        if deep > 8 or samples > 64:
            raise HeaderError(f"a TIFF of {samples} samples of {deep} bytes")
        parts = tags.get(279) or tags.get(325) or ()
        # Parts may share bytes, but not many times over.
        _held(sum(parts), 4 * len(data), data, wide, high)
        tile = _first(tags, 322, 1) * _first(tags, 323, 1)
        # The decoder makes room for a whole tile, also where it reaches beyond the picture.
        if tile > max(wide * high * 64, 2**22):
            raise HeaderError(f"a TIFF of {wide} x {high} pixels in tiles of {tile} pixels")
        packing = _first(tags, 259, 1)
        most = {1: 1, 5: 1365, 8: _DEFLATE, 32946: _DEFLATE, 32773: 64}.get(packing)
        if most is not None:
            bits = max(1, max(tags.get(258, (1,)))) * samples
            if _first(tags, 262) != 6:  # YCbCr may be sampled more coarsely
                _held(wide * high * bits // 8, most * (len(data) + 64), data, wide, high)
        width, height = max(width, wide), max(height, high)
        pixel_bytes = max(pixel_bytes, deep * (1 if samples == 1 else max(3, samples)))
        # Of tag 254, bit 0 tells a reduced copy and bit 2 a mask.
        if not _first(tags, 254) & 5:
            pages.append(len(seen) - 1)
    if not seen:
        raise HeaderError("a TIFF without a page")
    return PictureHeader("TIFF", width, height, pixel_bytes, tuple(pages) or (0,))


def _tiff_page(data: bytes, place: int, order: str, big: bool) -> tuple[dict[int, tuple[int, ...]], int]:
    """Give the whole numbers of one directory, and where the next one is."""
    count = struct.unpack_from(order + ("Q" if big else "H"), data, place)[0]
    place += 8 if big else 2
    entry = 20 if big else 12
    if place + count * entry > len(data):
        raise HeaderError(f"a TIFF directory of {count} entries, which {len(data)} bytes cannot hold")
    tags: dict[int, tuple[int, ...]] = {}
    for at in range(place, place + count * entry, entry):
        tag, kind, number = struct.unpack_from(order + ("HHQ" if big else "HHI"), data, at)
        size, letter = _TIFF_TYPES.get(kind, (1, ""))
        inline, value = (8, at + 12) if big else (4, at + 8)
        if size * number > inline:
            value = struct.unpack_from(order + ("Q" if big else "I"), data, value)[0]
            if value + size * number > len(data):
                raise HeaderError(f"a TIFF whose tag {tag} lies beyond the end of its {len(data)} bytes")
        if letter and tag in (254, 256, 257, 258, 259, 262, 277, 279, 322, 323, 325):
            tags[tag] = struct.unpack_from(f"{order}{number}{letter}", data, value)
    following: int = struct.unpack_from(order + ("Q" if big else "I"), data, place + count * entry)[0]
    return tags, following


def _first(tags: dict[int, tuple[int, ...]], tag: int, default: int = 0) -> int:
    values = tags.get(tag) or (default,)
    return values[0]


def _starts(*beginnings: bytes) -> Callable[[bytes], bool]:
    return lambda data: data.startswith(beginnings)


_READERS: tuple[tuple[Callable[[bytes], bool], Callable[[bytes], PictureHeader]], ...] = (
    (_starts(b"\x89PNG\r\n\x1a\n"), _png),
    (_starts(b"\xff\xd8\xff"), _jpeg),
    (_starts(b"BM"), _bmp),
    (_starts(b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), _tiff),
    (lambda data: data[:4] == b"RIFF" and data[8:12] == b"WEBP", _webp),
    (lambda data: data[:1] == b"P" and data[1:2] in b"1234567" and data[2:3].isspace(), _pnm),
    (_starts(b"PF\n", b"Pf\n", b"PF\r", b"Pf\r", b"PF ", b"Pf "), _pfm),
    (_starts(b"GIF87a", b"GIF89a"), _gif),
    (_starts(b"\0\0\0\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51"), _jpeg_2000),
    (_starts(b"#?RGBE", b"#?RADIANCE"), _hdr),
    (_starts(b"\x76\x2f\x31\x01"), _exr),
    (_starts(b"\x59\xa6\x6a\x95"), _sun),
    (lambda data: data[4:8] == b"ftyp" and b"avi" in data[8:64], _avif),
)
