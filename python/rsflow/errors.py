"""The errors that rsflow raises: each says what is wrong, where, what it got and what it expected."""

from __future__ import annotations

__all__ = [
    "CalibrationError",
    "CaptureError",
    "DTypeError",
    "FormatError",
    "InternalError",
    "MissingExtraError",
    "OptionError",
    "OutOfMemoryError",
    "RsflowError",
    "ShapeError",
]


class RsflowError(Exception):
    """Base of every error that rsflow raises on purpose.

    Examples
    --------
    >>> import rsflow
    >>> try:
    ...     rsflow.read_flow("motion.txt")
    ... except rsflow.RsflowError as error:
    ...     print(error)
    motion.txt: cannot tell the flow format of '.txt'; expected one of .flo, .png, .npy, .npz, .pfm
    """


class ShapeError(RsflowError, ValueError):
    """An array has the wrong number of dimensions, or sizes that do not fit together.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> try:
    ...     rsflow.dense_flow(np.zeros((48, 64), np.uint8), np.zeros((40, 64), np.uint8))
    ... except rsflow.ShapeError as error:
    ...     print(error)
    next: got (40, 64), expected the shape of prev, (48, 64)
    """


class DTypeError(RsflowError, TypeError):
    """An array or argument has a type that is not supported.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> try:
    ...     rsflow.detect_corners(np.zeros((48, 64)))
    ... except rsflow.DTypeError as error:
    ...     print(error)
    frame: got dtype float64, expected uint8, uint16 or float32: convert it with frame.astype(numpy.float32)
    """


class OptionError(RsflowError, ValueError):
    """An option has a value outside of what it allows.

    Examples
    --------
    >>> import rsflow
    >>> try:
    ...     rsflow.DenseFlow(preset="best")
    ... except rsflow.OptionError as error:
    ...     print(error)
    preset: got "best", expected "ultrafast", "fast", "balanced" or "accurate"
    """


class FormatError(RsflowError, ValueError):
    """A file's content is not what its format demands.

    Examples
    --------
    >>> import pathlib, rsflow, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "motion.flo")
    ...     _ = path.write_bytes(b"PIEH")
    ...     try:
    ...         rsflow.read_flow(path)
    ...     except rsflow.FormatError as error:
    ...         print(str(error).replace(folder, "folder"))
    folder/motion.flo: the header is cut off after 4 bytes, expected 12
    """


class CalibrationError(RsflowError, RuntimeError):
    """A calibration cannot be computed from what was given.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> blank = np.full((3, 120, 160), 90, np.uint8)
    >>> try:
    ...     rsflow.calibrate(blank, board=(8, 6), square_size_m=0.025)
    ... except rsflow.CalibrationError as error:
    ...     print(str(error).split(",")[0])
    a board of 8 x 6 inner corners was found in 0 of 3 pictures
    """


class CaptureError(RsflowError, OSError):
    """A camera, a video or a folder of pictures cannot be read, or went away.

    Examples
    --------
    >>> import rsflow
    >>> try:
    ...     rsflow.frames("missing.mp4")
    ... except rsflow.CaptureError as error:
    ...     print(error)
    missing.mp4: no such file or folder
    """


class OutOfMemoryError(RsflowError, MemoryError):
    """The system has no memory for a result, or for what a call needs to find it.

    The objects in the call are as they were before it, or new, and work on smaller frames.

    Examples
    --------
    >>> import rsflow
    >>> print(rsflow.OutOfMemoryError("out of memory: grey levels take 256000000 bytes"))
    out of memory: grey levels take 256000000 bytes
    >>> issubclass(rsflow.OutOfMemoryError, MemoryError)
    True
    """


class InternalError(RsflowError):
    """Something went wrong inside of rsflow that no call should be able to bring about: please report it.

    Examples
    --------
    >>> import rsflow
    >>> issubclass(rsflow.InternalError, rsflow.RsflowError)
    True
    """


class MissingExtraError(RsflowError, ImportError):
    """An optional dependency is needed for this call; the message names the extra to install.

    Examples
    --------
    >>> import rsflow
    >>> print(rsflow.MissingExtraError("reading YAML needs the package 'yaml', which is not installed"))
    reading YAML needs the package 'yaml', which is not installed
    >>> issubclass(rsflow.MissingExtraError, ImportError)
    True
    """
