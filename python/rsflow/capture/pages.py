"""Picture files: one picture, or the pages and frames that one file holds."""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CaptureError
from ..io.fork_guard import opening
from ..io.limits import check_pixels, opened
from ..io.opencv_files import quiet
from ..io.picture_headers import HeaderError, PictureHeader, picture_header
from .reader import Raw, Timestamps

__all__ = ["PagesReader", "PictureFile", "read_picture"]

# Pixels decoded at once of a file with many pages.
_CHUNK_PIXELS = 2**25

# What browsers and FFmpeg take for a frame whose delay is 0.
_NO_DELAY_MS = 100


class PictureFile:
    """The bytes of a picture file whose header has been looked at."""

    def __init__(self, path: Path, limit: int) -> None:
        self.path = path
        try:
            with opened(path, most=_file_bytes(limit), error=CaptureError) as (file, _):
                self.data = file.read()
        except CaptureError:
            raise
        except OSError as error:
            raise CaptureError(f"{path}: cannot be read: {error.strerror or error}") from None
        if not self.data:
            raise CaptureError(f"{path}: the file is empty")
        try:
            header = picture_header(self.data)
        except HeaderError as error:
            raise CaptureError(f"{path}: {error}") from None
        if header is None:
            raise self._undecodable()
        # The JPEG decoder fills what is missing with grey and only warns: the end marker must be there.
        if header.kind == "JPEG" and b"\xff\xd9" not in self.data[-65536:]:
            raise CaptureError(
                f"{path}: the picture is truncated: a JPEG of {len(self.data)} bytes without its end marker"
            )
        check_pixels(
            str(path),
            header.width,
            header.height,
            pixel_bytes=header.pixel_bytes,
            file_bytes=len(self.data),
            limit=limit,
            error=CaptureError,
        )
        self.header: PictureHeader = header

    def _undecodable(self, what: str = "") -> CaptureError:
        return CaptureError(f"{self.path}: {what}cannot be decoded as a picture ({len(self.data)} bytes)")

    def picture(self) -> NDArray[Any]:
        """Decode the file's one picture, or its first."""
        with opening:
            import cv2

        image: NDArray[Any] | None = None
        with quiet():
            try:
                image = cv2.imdecode(np.frombuffer(self.data, np.uint8), _flags())
            except (cv2.error, SystemError):
                image = None
        if image is None:
            raise self._undecodable()
        picture: NDArray[Any] = image
        return picture

    def expect_one(self) -> None:
        """Raise CaptureError where the file holds several pictures."""
        if len(self.header.pages) > 1:
            raise CaptureError(
                f"{self.path}: holds {len(self.header.pages)} pages, expected one picture: a file with several pages "
                "is read alone, frames(path)"
            )

    def pages(self, first: int) -> tuple[list[NDArray[Any]], list[float]]:
        """Decode some pages from the one at place `first` on; give them, and how long each is shown in ms."""
        with opening:
            import cv2

        numbers = self.header.pages
        most = max(1, _CHUNK_PIXELS // (self.header.width * self.header.height))
        start = numbers[first]
        last = first
        while last + 1 < min(len(numbers), first + most) and numbers[last + 1] == numbers[last] + 1:
            last += 1
        count = last - first + 1
        data = np.frombuffer(self.data, np.uint8)
        images: Any = []
        durations: list[float] = []
        with quiet():
            try:
                if self.header.animated:
                    if not hasattr(cv2, "imdecodeanimation"):
                        raise CaptureError(
                            f"{self.path}: {self.header.kind} with {len(numbers)} frames: reading it needs "
                            "opencv-python-headless 4.11 or newer"
                        )
                    _, animation = cv2.imdecodeanimation(data, start, count)
                    images = animation.frames
                    durations = [float(value) for value in animation.durations]
                else:
                    _, images = cv2.imdecodemulti(data, _flags(), None, (start, start + count))
            except (cv2.error, SystemError):
                images = []
        if len(images) == 0:
            raise self._undecodable(f"page {first} of {len(numbers)} ")
        # Alpha is left out, as it is of a file with one picture.
        pictures = [image[:, :, :3] if image.ndim == 3 and image.shape[2] == 4 else image for image in images]
        return pictures[:count], durations[:count]


class PagesReader:
    """The pages of one file, in order; those of an animation with their times."""

    def __init__(self, file: PictureFile) -> None:
        self.source = str(file.path)
        self.frame_rate: float | None = None
        self.count: int | None = len(file.header.pages)
        self.live = False
        self.exact = True
        self.lost = 0
        self.notes: tuple[str, ...] = ()
        self.size: tuple[int, int] | None = (file.header.width, file.header.height)
        self.timestamps: Timestamps = "file" if file.header.animated else "none"
        self._file: PictureFile | None = file
        self._ahead: deque[tuple[NDArray[Any], float]] = deque()
        self._decoded = 0
        self._next = 0
        self._t_ms = 0.0
        self._decode()

    def _decode(self) -> None:
        if self._file is None:
            return
        pictures, durations = self._file.pages(self._decoded)
        if any(duration <= 0 for duration in durations):
            self.notes = (f"{self.source}: frames whose delay is 0 are taken to last {_NO_DELAY_MS} ms",)
        for place, picture in enumerate(pictures):
            duration = durations[place] if place < len(durations) else math.nan
            self._ahead.append((picture, duration if duration > 0 else float(_NO_DELAY_MS)))
        self._decoded += len(pictures)

    def read(self, wanted: bool) -> Raw | None:
        """Give the next page."""
        if self.count is None or self._next >= self.count:
            return None
        if not self._ahead:
            self._decode()
        if not self._ahead:
            return None
        picture, duration_ms = self._ahead.popleft()
        t_s = round(self._t_ms * 1e-3, 9) if self.timestamps == "file" else math.nan
        self._t_ms += duration_ms
        self._next += 1
        return Raw(picture, t_s, self._next - 1)

    def close(self) -> None:
        """Let go of the file."""
        self._file = None
        self._ahead.clear()


def read_picture(path: Path, limit: int) -> NDArray[Any]:
    """Read a file with one picture in its own depth, as grey or BGR; EXIF rotation is not applied.

    The pixels are those of the sensor's grid; alpha is left out.

    Raises
    ------
    CaptureError
        If the file is missing, no regular file, empty, truncated, not a picture, beyond `limit` pixels, or holds
        several pictures.
    """
    file = PictureFile(path, limit)
    file.expect_one()
    return file.picture()


def _file_bytes(limit: int) -> int:
    # Text (PNM) takes four bytes for a value, colour three values.
    return 16 * limit + 2**20


def _flags() -> int:
    import cv2

    flags: int = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    return flags
