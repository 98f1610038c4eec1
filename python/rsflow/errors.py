"""The errors that rsflow raises: each says what is wrong, where, what it got and what it expected."""

from __future__ import annotations

__all__ = [
    "CalibrationError",
    "CaptureError",
    "DTypeError",
    "FormatError",
    "MissingExtraError",
    "OptionError",
    "RsflowError",
    "ShapeError",
]


class RsflowError(Exception):
    """Base of every error that rsflow raises on purpose."""


class ShapeError(RsflowError, ValueError):
    """An array has the wrong number of dimensions, or sizes that do not fit together."""


class DTypeError(RsflowError, TypeError):
    """An array or argument has a type that is not supported."""


class OptionError(RsflowError, ValueError):
    """An option has a value outside of what it allows."""


class FormatError(RsflowError, ValueError):
    """A file's content is not what its format demands."""


class CalibrationError(RsflowError, RuntimeError):
    """A calibration cannot be computed from what was given."""


class CaptureError(RsflowError, OSError):
    """A camera, a video or a folder of pictures cannot be read, or went away."""


class MissingExtraError(RsflowError, ImportError):
    """An optional dependency is needed for this call; the message names the extra to install."""
