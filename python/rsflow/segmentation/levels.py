"""Grey levels of any type of frame as those of 0 to 255 that `_core.Segmenter` takes."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]

# Standard deviation of rounding to whole levels; floating-point frames are taken to have so many levels of 255.
_ROUNDING = 0.29
_ROUNDING_OF_FLOATS = 1e-3 * 255
# The darkest and the brightest of so many pixels are left out: hot pixels tell nothing of the contrast.
_EXTREMES = 1e-3
_SAMPLED_PIXELS = 20_000
# A picture of more than so many times the contrast of the first one needs other levels.
_MOST_CONTRAST = 4.0


@dataclasses.dataclass(frozen=True)
class Levels:
    """How the grey levels of a sequence become those of 0 to 255.

    Attributes
    ----------
    base : float
        What is taken away from them first.
    contrast : float
        What then spans 255; 0 where the first frame was of one level.
    scale : float
        What they are multiplied by.
    rounding : float
        Standard deviation of their rounding, in levels of 0 to 255.
    """

    base: float
    contrast: float
    scale: float
    rounding: float

    @classmethod
    def of(cls, image: NDArray[Any]) -> Levels:
        """Choose them for a sequence that begins with this frame."""
        if image.dtype == np.uint8:
            return cls(0.0, 255.0, 1.0, _ROUNDING)
        low, high = _span(image)
        scale = 255 / (high - low) if high > low else 1.0
        return cls(low, high - low, scale, _ROUNDING * scale if image.dtype == np.uint16 else _ROUNDING_OF_FLOATS)

    def hold(self, image: NDArray[Any]) -> bool:
        """Whether they do for another frame of the sequence."""
        if image.dtype == np.uint8:
            return True
        low, high = _span(image)
        return high - low <= _MOST_CONTRAST * self.contrast

    def taken(self, image: NDArray[Any]) -> NDArray[Any]:
        """Give a frame without the base."""
        return image if self.base == 0 else np.subtract(image, np.float32(self.base), dtype=np.float32)

    def of_255(self, image: NDArray[Any]) -> NDArray[Any]:
        """Give a frame in levels of 0 to 255, brighter and darker ones beyond."""
        return (
            image
            if image.dtype == np.uint8
            else np.float32(self.scale) * (image.astype(np.float32) - np.float32(self.base))
        )

    def given(self, picture: F32) -> F32:
        """Give a picture with the base again."""
        return picture if self.base == 0 else picture + np.float32(self.base)


def _span(image: NDArray[Any]) -> tuple[float, float]:
    step = max(1, int((image.size / _SAMPLED_PIXELS) ** 0.5))
    some = image[::step, ::step]
    some = some[np.isfinite(some)].astype(np.float64)
    if not some.size:
        return 0.0, 0.0
    low, high = np.quantile(some, [_EXTREMES, 1 - _EXTREMES])
    return float(low), float(high)
