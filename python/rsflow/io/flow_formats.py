"""The formats of flow files, for `rsflow.io`: a reader and a writer for each.

A reader is given the path, for messages, the open file, its length and the limit on pixels, and holds what the header
claims against both before it allocates. A writer is given where to write, the flow with NaN in both components where it
is unknown, and what `.npz` keeps besides.
"""

from __future__ import annotations

import math
import tokenize
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from ..errors import FormatError, OptionError
from .limits import check_pixels
from .picture_headers import HeaderError, picture_header

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

__all__ = ["READERS", "UNKNOWN_FROM", "WRITERS", "npz_times"]

# Beyond this many pixels a value means "unknown", in Middlebury's format and so in all.
UNKNOWN_FROM = 1e9

# Middlebury: the first four bytes, "PIEH" as a little-endian float32; what is written where a value is unknown.
_FLO_MAGIC = b"PIEH"
_FLO_UNKNOWN = 1e10

# KITTI: value = 64 * displacement + 2**15, in 16 bits.
_KITTI_SCALE = 64.0
_KITTI_ZERO = 32768.0
_KITTI_HIGHEST = (65535.0 - _KITTI_ZERO) / _KITTI_SCALE

# Times are one number each.
_TIME_BYTES = 1024

# What numpy raises for a header that is none: it tokenizes and evaluates the text.
_HEADER_ERRORS = (
    ValueError,
    TypeError,
    OverflowError,
    EOFError,
    SyntaxError,
    tokenize.TokenError,
    RecursionError,
    MemoryError,
    KeyError,
    AttributeError,
    SystemError,
)

# No deflate stream grows by more than this (zlib's technical notes): a header that claims more is lying.
_DEFLATE_LIMIT = 1032


# Bytes of a pixel of a flow: two float32.
_FLOW_BYTES = 8


def _expect_length(path: Path, header: int, width: int, height: int, pixel: int, size: int, limit: int) -> None:
    """Hold the size that a header claims against the length of the file, in Python's unbounded integers."""
    if width < 1 or height < 1:
        raise FormatError(f"{path}: the header says {width} x {height} pixels, expected at least 1 x 1")
    expected = header + width * height * pixel
    if size != expected:
        raise FormatError(
            f"{path}: the header says {width} x {height} pixels, which takes {expected} bytes, but the file has {size}"
        )
    check_pixels(str(path), width, height, pixel_bytes=_FLOW_BYTES, file_bytes=size, limit=limit, allowed=_FLOW_BYTES)


def _read_flo(path: Path, file: BinaryIO, size: int, limit: int) -> NDArray[np.float32]:
    header = file.read(12)
    if header[:4] != _FLO_MAGIC:
        raise FormatError(f"{path}: not a .flo file: starts with {header[:4]!r}, expected {_FLO_MAGIC!r} (202021.25)")
    if len(header) < 12:
        raise FormatError(f"{path}: the header is cut off after {len(header)} bytes, expected 12")
    width, height = (int(n) for n in np.frombuffer(header, "<i4", offset=4))
    _expect_length(path, 12, width, height, 8, size, limit)
    return np.fromfile(file, "<f4", width * height * 2).reshape(height, width, 2).astype(np.float32, copy=False)


def _write_flo(path: Path, uv: NDArray[np.float32], _: dict[str, float]) -> None:
    height, width = uv.shape[:2]
    with path.open("wb") as file:
        file.write(_FLO_MAGIC + np.array([width, height], "<i4").tobytes())
        file.write(np.where(np.isnan(uv), _FLO_UNKNOWN, uv).astype("<f4").tobytes())


def _read_kitti(path: Path, file: BinaryIO, size: int, limit: int) -> NDArray[np.float32]:
    if size > 16 * limit:
        raise FormatError(f"{path}: got {size} bytes, expected a PNG of at most {16 * limit}")
    data = file.read()
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 26:
        raise FormatError(f"{path}: not a PNG file")
    depth, kind = data[24], data[25]
    if (depth, kind) != (16, 2):
        raise FormatError(
            f"{path}: not a KITTI flow: expected 16 bits of RGB, got {depth} bits of PNG colour type {kind}"
        )
    try:
        header = picture_header(data)
    except HeaderError as error:
        raise FormatError(f"{path}: the PNG is damaged or cut off: {error}") from None
    if header is None or len(header.pages) > 1:
        raise FormatError(f"{path}: an animated PNG is no flow, expected one picture")
    width, height = header.width, header.height
    check_pixels(str(path), width, height, pixel_bytes=_FLOW_BYTES, file_bytes=size, limit=limit, allowed=_FLOW_BYTES)
    import cv2

    from .opencv_files import quiet

    with quiet():
        try:
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        except cv2.error as error:
            raise FormatError(f"{path}: the PNG cannot be decoded: {error.err}") from None
    if picture is None or picture.dtype != np.uint16 or picture.shape != (height, width, 3):
        raise FormatError(f"{path}: the PNG cannot be decoded")
    # OpenCV's order is B, G, R: validity, v, u.
    uv: NDArray[np.float32] = (picture[..., :0:-1].astype(np.float32) - np.float32(_KITTI_ZERO)) / np.float32(
        _KITTI_SCALE
    )
    uv[picture[..., 0] == 0] = np.nan
    return uv


def _write_kitti(path: Path, uv: NDArray[np.float32], _: dict[str, float]) -> None:
    import cv2

    known = ~np.isnan(uv[..., 0])
    code = np.rint(uv.astype(np.float64) * _KITTI_SCALE + _KITTI_ZERO)
    outside = known & ((code < 0) | (code > 65535)).any(axis=2)
    if outside.any():
        y, x = (int(n) for n in np.argwhere(outside)[0])
        raise OptionError(
            f"field: got ({uv[y, x, 0]:g}, {uv[y, x, 1]:g}) at x={x}, y={y} and {int(outside.sum())} such pixels, "
            f"expected displacements from -512 to {_KITTI_HIGHEST:.2f} px in a KITTI .png; .flo holds any"
        )
    picture = np.zeros((*uv.shape[:2], 3), np.uint16)
    picture[known, 0] = 1
    picture[known, 1] = code[known, 1]
    picture[known, 2] = code[known, 0]
    done, data = cv2.imencode(".png", picture)
    if not done:
        raise FormatError(f"OpenCV could not encode a 16-bit PNG of {uv.shape[1]} x {uv.shape[0]} pixels")
    with path.open("wb") as file:
        file.write(data.tobytes())


def _array(path: Path, file: BinaryIO, size: int, what: str, packed: int, limit: int) -> NDArray[Any]:
    """Read one array in numpy's format from a stream of `size` bytes; its header is believed only if it fits."""
    try:
        version = np.lib.format.read_magic(file)
        if version == (1, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
        elif version == (2, 0):
            shape, fortran, dtype = np.lib.format.read_array_header_2_0(file)
        else:
            raise ValueError(f"version {version} of the npy format")
    except _HEADER_ERRORS as error:
        raise FormatError(f"{path}: {what} is not a numpy array: {' '.join(str(error).split())}") from None
    if dtype.kind not in "biuf":
        raise FormatError(f"{path}: {what}: got dtype {dtype}, expected real numbers")
    if any(length < 0 for length in shape):
        raise FormatError(f"{path}: the header of {what} says {shape}, expected sizes of at least 0")
    length = math.prod(shape) * dtype.itemsize
    if file.tell() + length != size:
        raise FormatError(
            f"{path}: the header of {what} says {shape} {dtype}, which takes {length} bytes, "
            f"but {size - file.tell()} follow"
        )
    if length:
        check_pixels(
            f"{path}: {what}",
            -(-math.prod(shape) // 2),
            1,
            pixel_bytes=2 * max(4, dtype.itemsize),
            file_bytes=packed,
            limit=limit,
            allowed=2 * _FLOW_BYTES,
        )
    data = np.frombuffer(_exactly(file, length), dtype)
    return data.reshape(shape[::-1]).T if fortran else data.reshape(shape)


def _exactly(file: BinaryIO, length: int) -> bytearray:
    """Read `length` bytes: less is an error, and no byte is unpacked beyond."""
    data = bytearray(length)
    view, done = memoryview(data), 0
    while done < length:
        chunk = file.read(min(length - done, 2**24))
        if not chunk:
            raise EOFError(f"got {done} bytes, expected {length}")
        view[done : done + len(chunk)] = chunk
        done += len(chunk)
    return data


def _as_flow(path: Path, array: NDArray[Any], what: str) -> NDArray[np.float32]:
    if array.ndim != 3 or array.shape[2] != 2 or array.size == 0 or array.dtype.kind == "b":
        raise FormatError(f"{path}: {what}: got {array.shape} {array.dtype}, expected (height, width, 2) numbers")
    with np.errstate(over="ignore", invalid="ignore"):
        # In place where it can be: a copy of what was just read would double the memory.
        return np.require(array, np.float32, ["C", "W"])


def _read_npy(path: Path, file: BinaryIO, size: int, limit: int) -> NDArray[np.float32]:
    return _as_flow(path, _array(path, file, size, "the array", size, limit), "the array")


def _write_npy(path: Path, uv: NDArray[np.float32], _: dict[str, float]) -> None:
    with path.open("wb") as file:
        # Not `write_array`: what numpy raises on a full disk does not say that it is full.
        data = np.ascontiguousarray(uv)
        np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(data))
        file.write(data.data)


def _zip(path: Path, file: BinaryIO) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(file)
    except MemoryError:
        raise
    except Exception as error:
        # zipfile trusts the fields that it unpacks: struct, Unicode and index errors come out of damaged ones.
        raise FormatError(f"{path}: not an .npz file: {error}") from None


def _member(path: Path, archive: zipfile.ZipFile, name: str, limit: int) -> NDArray[Any]:
    try:
        info = archive.getinfo(f"{name}.npy")
        if info.file_size > _DEFLATE_LIMIT * (info.compress_size + 64):
            raise FormatError(f"{path}: {name} claims {info.file_size} bytes, too many for {info.compress_size} packed")
        with archive.open(info) as stream:
            return _array(path, stream, info.file_size, name, info.compress_size, limit)  # type: ignore[arg-type]
    except KeyError:
        raise FormatError(f"{path}: has no array {name!r}, but {sorted(archive.namelist())}") from None
    except (FormatError, MemoryError):
        raise
    except Exception as error:
        # What a damaged stream raises differs with the packing: zlib, bz2, lzma and zstd have errors of their own.
        raise FormatError(f"{path}: {name} cannot be unpacked: {error}") from None


def _read_npz(path: Path, file: BinaryIO, _: int, limit: int) -> NDArray[np.float32]:
    with _zip(path, file) as archive:
        uv = _as_flow(path, _member(path, archive, "flow", limit), "flow")
        if "valid.npy" in archive.namelist():
            valid = _member(path, archive, "valid", limit)
            if valid.shape != uv.shape[:2]:
                raise FormatError(f"{path}: valid: got {valid.shape}, expected {uv.shape[:2]} as flow is")
            uv[valid == 0] = np.nan
    return uv


def npz_times(path: Path, file: BinaryIO) -> tuple[float, float] | None:
    """Read the times of the two pictures in seconds; None where the `.npz` has none."""
    with _zip(path, file) as archive:
        if not {"t0.npy", "t1.npy"} <= set(archive.namelist()):
            return None
        times = [_member(path, archive, name, _TIME_BYTES) for name in ("t0", "t1")]
    if any(time.size != 1 or time.dtype.kind not in "fiu" for time in times):
        raise FormatError(f"{path}: t0 and t1 must each be one number, got {times[0]!r} and {times[1]!r}")
    return float(times[0].reshape(())), float(times[1].reshape(()))


def _write_npz(path: Path, uv: NDArray[np.float32], times: dict[str, float]) -> None:
    arrays: dict[str, Any] = {"flow": uv, "valid": ~np.isnan(uv[..., 0]), **times}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _read_pfm(path: Path, file: BinaryIO, size: int, limit: int) -> NDArray[np.float32]:
    fields = [file.readline(64).strip() for _ in range(2)]
    if fields[0] == b"Pf":
        raise FormatError(f"{path}: a .pfm of one channel is no flow (a disparity map?), expected three")
    if fields[0] != b"PF":
        raise FormatError(f"{path}: not a .pfm file: starts with {fields[0][:8]!r}, expected b'PF'")
    try:
        width, height = (int(n) for n in fields[1].split())
        scale = float(file.readline(64))
        if not math.isfinite(scale) or scale == 0:
            raise ValueError
    except ValueError:
        raise FormatError(
            f"{path}: got another header, expected that of a .pfm: 'PF', 'width height' and a scale that is not 0"
        ) from None
    _expect_length(path, file.tell(), width, height, 12, size, limit)
    # The sign of the scale is the order of bytes; its size is a unit of light and has no meaning for flow.
    data = np.frombuffer(file.read(), "<f4" if scale < 0 else ">f4").reshape(height, width, 3)
    return np.array(data[::-1, :, :2], np.float32, order="C")


def _write_pfm(path: Path, uv: NDArray[np.float32], _: dict[str, float]) -> None:
    height, width = uv.shape[:2]
    data = np.zeros((height, width, 3), "<f4")
    data[..., :2] = uv[::-1]
    with path.open("wb") as file:
        file.write(f"PF\n{width} {height}\n-1.0\n".encode())
        file.write(data.tobytes())


READERS: dict[str, Callable[[Path, BinaryIO, int, int], NDArray[np.float32]]] = {
    ".flo": _read_flo,
    ".png": _read_kitti,
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".pfm": _read_pfm,
}
WRITERS: dict[str, Callable[[Path, NDArray[np.float32], dict[str, float]], None]] = {
    ".flo": _write_flo,
    ".png": _write_kitti,
    ".npy": _write_npy,
    ".npz": _write_npz,
    ".pfm": _write_pfm,
}
