"""What the header of a video says, before a decoder opens it: the size of its pictures, and whether the file is whole.

AVI, MP4 and MOV, Matroska and WebM, and GIF say how long they are; what says nothing is neither whole nor cut.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ..errors import CaptureError
from ..io.limits import opened
from ..io.picture_headers import HeaderError, picture_header

__all__ = ["Container", "read_container"]

# Bytes of headers that are looked at.
_HEAD = 2**20

# Boxes and elements that are walked over: a file of hours in fragments has some thousands.
_STEPS = 100_000


@dataclass(frozen=True, slots=True)
class Container:
    """What a header says.

    Attributes
    ----------
    sizes : tuple of (int, int)
        Width and height of each stream of pictures.
    cut : bool or None
        Whether the file ends before its header says; None where it does not say.
    kind : str
        The format, where it is one of these.
    """

    sizes: tuple[tuple[int, int], ...] = ()
    cut: bool | None = None
    kind: str = ""


def read_container(path: Path) -> Container:
    """Read the header of a video file.

    Raises
    ------
    CaptureError
        If it is no regular file, or cannot be read.
    """
    try:
        with opened(path, error=CaptureError) as (file, size):
            head = file.read(_HEAD)
            if head[:4] == b"RIFF" and head[8:12] == b"AVI ":
                return _avi(file, head, size)
            if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                return _mp4(file, size)
            if head[:4] == b"\x1a\x45\xdf\xa3":
                return _matroska(head, size)
            if head[:4] == b"GIF8" and len(head) >= 10:
                return _gif(file, head, size)
            return Container()
    except CaptureError:
        raise
    except OSError as error:
        raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (struct.error, IndexError):
        return Container()


def _avi(file: BinaryIO, head: bytes, size: int) -> Container:
    sizes = []
    for stream in re.finditer(rb"strh.{4}vids", head, re.DOTALL):
        place = head.find(b"strf", stream.end())
        if 0 <= place <= len(head) - 20:
            width, height = struct.unpack_from("<ii", head, place + 12)
            sizes.append((abs(width), abs(height)))
    # A file beyond a gigabyte is several RIFFs, one after the other.
    place = 0
    for _ in range(_STEPS):
        file.seek(place)
        part = file.read(8)
        if len(part) < 8 or part[:4] != b"RIFF":
            break
        length = struct.unpack("<I", part[4:])[0]
        if length == 0:
            return Container(tuple(sizes), kind="AVI")
        place += 8 + length + length % 2
    return Container(tuple(sizes), place > size + 1, "AVI")


def _boxes(file: BinaryIO, size: int) -> Iterator[tuple[bytes, int, int]]:
    """Give kind, start of the body and end of each box at the top."""
    place = 0
    for _ in range(_STEPS):
        file.seek(place)
        part = file.read(16)
        if len(part) < 8:
            return
        length, kind = struct.unpack_from(">I4s", part)
        body = place + 8
        if length == 1:
            length, body = struct.unpack_from(">Q", part, 8)[0], place + 16
        end = size if length == 0 else place + length
        if end < body:
            return
        yield kind, body, end
        place = end


def _mp4(file: BinaryIO, size: int) -> Container:
    sizes: list[tuple[int, int]] = []
    cut = False
    for kind, body, end in _boxes(file, size):
        cut = end > size
        if kind == b"moov":
            file.seek(body)
            moov = file.read(min(end - body, 16 * _HEAD))
            for table in re.finditer(rb"vmhd.*?stsd", moov, re.DOTALL):
                entry = table.end() + 8
                if entry + 36 <= len(moov):
                    sizes.append(struct.unpack_from(">HH", moov, entry + 32))
    return Container(tuple(sizes), cut, "MP4")


def _elements(data: bytes, place: int, end: int) -> Iterator[tuple[int, int, int, bool]]:
    """Give identifier, start, end of each element of EBML, and whether its length is known."""
    for _ in range(_STEPS):
        if place >= end:
            return
        width = 9 - data[place].bit_length()
        name = int.from_bytes(data[place : place + width], "big")
        place += width
        first = data[place]
        width = 9 - first.bit_length()
        if width > 8:
            return
        length = int.from_bytes(data[place : place + width], "big") & (1 << 7 * width) - 1
        place += width
        known = length != (1 << 7 * width) - 1
        stop = place + length if known else end
        yield name, place, stop, known
        place = stop


def _matroska(data: bytes, size: int) -> Container:
    segment, tracks, entry, video, wide, high = 0x18538067, 0x1654AE6B, 0xAE, 0xE0, 0xB0, 0xBA
    sizes: list[tuple[int, int]] = []
    cut: bool | None = None

    def walk(place: int, end: int, inside: tuple[int, ...]) -> None:
        found: dict[int, int] = {}
        try:
            for name, start, stop, _ in _elements(data, place, min(end, len(data))):
                if inside and name == inside[0]:
                    walk(start, stop, inside[1:])
                elif name in (wide, high) and not inside:
                    found[name] = int.from_bytes(data[start : min(stop, start + 8)], "big")
        except IndexError:
            pass
        if len(found) == 2:
            sizes.append((found[wide], found[high]))

    for name, start, stop, known in _elements(data, 0, len(data)):
        if name == segment:
            cut = stop > size if known else None
            walk(start, stop, (tracks, entry, video))
    return Container(tuple(sizes), cut, "Matroska")


def _gif(file: BinaryIO, head: bytes, size: int) -> Container:
    wide, high = struct.unpack_from("<HH", head, 6)
    if size > 64 * _HEAD:
        return Container(((wide, high),), None, "GIF")
    file.seek(0)
    try:
        picture_header(file.read())
    except HeaderError:
        return Container(((wide, high),), True, "GIF")
    return Container(((wide, high),), False, "GIF")
