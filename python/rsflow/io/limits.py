"""What a file may cost: only regular files are opened, and sizes are held to limits before anything is allocated.

A picture or a flow has at most `max_pixels` pixels, a picture four bytes and a flow eight for each of these; what
unpacks to more bytes than a quarter of `max_pixels` must not be packed more than 200 to 1. The limit is 2**28 (16384 x
16384), or what an argument or the environment variable ``RSFLOW_MAX_PIXELS`` says.
"""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from typing import BinaryIO

from .._checks import integer
from ..errors import FormatError, OptionError, RsflowError

__all__ = ["MAX_PIXELS", "TEXT_BYTES", "check_pixels", "kind_of", "max_pixels_of", "opened", "read_text"]

MAX_PIXELS = 2**28
_VARIABLE = "RSFLOW_MAX_PIXELS"

# A whole working day at 1 kHz is 29 million rows; a file of times or heights is far smaller.
TEXT_BYTES = 64 * 1024 * 1024

# Bytes that may be decoded for each pixel of the limit: colour of 8 bits with alpha, or float32 grey.
PICTURE_BYTES = 4

# Pictures and flows that are worth measuring pack far worse than this; beyond 64 MiB, by default, it is a bomb.
_MAX_RATIO = 200
_PACKED_SHARE = 4

_RAISE = f"raise the limit with max_pixels= or the environment variable {_VARIABLE}"


def max_pixels_of(given: int | None) -> int:
    """Give the limit on pixels: the argument, else the environment variable, else 2**28.

    Raises
    ------
    OptionError
        If it is not a whole number of at least 1.
    """
    if given is None:
        text = os.environ.get(_VARIABLE, "").strip()
        if not text:
            return MAX_PIXELS
        if not (text.isascii() and text.isdigit() and len(text) < 19 and int(text) > 0):
            raise OptionError(f"{_VARIABLE}: got {text[:40]!r}, expected a whole number of pixels of at least 1")
        return int(text)
    return integer("max_pixels", given, least=1, of="pixels")


def check_pixels(
    where: str,
    width: int,
    height: int,
    *,
    pixel_bytes: int,
    file_bytes: int,
    limit: int,
    allowed: int = PICTURE_BYTES,
    error: type[RsflowError] = FormatError,
) -> None:
    """Raise `error` unless a picture of this size may be decoded.

    Parameters
    ----------
    where : str
        The file, as the message names it.
    width, height : int
        What the header says, in pixels.
    pixel_bytes : int
        Bytes of one decoded pixel.
    file_bytes : int
        Length of the packed data.
    limit : int
        From `max_pixels_of`.
    allowed : int
        Bytes for each pixel of the limit.
    error : type
        What is raised.
    """
    if width < 1 or height < 1:
        raise error(f"{where}: the header says {width} x {height} pixels, expected at least 1 x 1")
    if width * height > limit:
        raise error(f"{where}: the header says {width} x {height} pixels, expected at most {limit} in all: {_RAISE}")
    size = width * height * pixel_bytes
    if size > allowed * limit:
        raise error(
            f"{where}: {width} x {height} pixels of {pixel_bytes} bytes take {size} bytes, expected at most "
            f"{allowed * limit}: {_RAISE}"
        )
    if size > limit // _PACKED_SHARE and size > _MAX_RATIO * file_bytes:
        raise error(
            f"{where}: {file_bytes} bytes claim to hold {width} x {height} pixels, {size} bytes, expected at most "
            f"{_MAX_RATIO} times as much beyond {limit // _PACKED_SHARE} bytes: {_RAISE}"
        )


@contextlib.contextmanager
def opened(
    path: str | os.PathLike[str], *, most: int | None = None, error: type[RsflowError] = FormatError
) -> Iterator[tuple[BinaryIO, int]]:
    """Open a regular file to read; give it and its length.

    Devices, pipes and sockets are refused before a byte of them is read: they may never end.

    Parameters
    ----------
    path : path
        The file.
    most : int, optional
        Bytes it may have.
    error : type
        What is raised where it is no regular file, or too long.

    Raises
    ------
    OSError
        If it cannot be opened.
    """
    # Without O_NONBLOCK, opening a pipe that nobody writes to waits for ever.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
    try:
        descriptor = os.open(path, flags)
    except ValueError as problem:
        raise error(f"{str(path)[:80]!r}: not the name of a file: {problem}") from None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise error(f"{path}: got {kind_of(status.st_mode)}, expected a regular file")
    except BaseException:
        os.close(descriptor)
        raise
    with os.fdopen(descriptor, "rb") as file:
        if most is not None and status.st_size > most:
            raise error(f"{path}: got {status.st_size} bytes, expected at most {most}")
        yield file, status.st_size


def read_text(path: str | os.PathLike[str], *, most: int = TEXT_BYTES) -> str:
    """Read a regular file of at most `most` bytes as UTF-8, with or without a byte order mark.

    Raises
    ------
    FormatError
        If it is no regular file, too long, or not UTF-8.
    OSError
        If it cannot be read.
    """
    with opened(path, most=most) as (file, _):
        # Files of the kernel (/proc) say 0 bytes and have more; none of them is read beyond the limit.
        data = file.read(most + 1)
    if len(data) > most:
        raise FormatError(f"{path}: got more than {most} bytes, expected at most that")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: not a text file in UTF-8: {error}") from None


def kind_of(mode: int) -> str:
    """Say in words what a file of this mode is."""
    kinds = (
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISSOCK, "a socket"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
    )
    return next((name for test, name in kinds if test(mode)), "something else")
