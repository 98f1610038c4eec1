"""A camera's sensor: blur, noise and quantisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import ShapeError

__all__ = ["WEBCAM", "Sensor"]

# dtype -> grey levels of that type for one grey level of 0..255; None keeps the fraction.
_SCALE: dict[str, float | None] = {"uint8": 1.0, "uint16": 257.0, "float32": None}


# A lens this soft shows nothing any more; its kernel would be larger than most pictures.
_MOST_BLUR_PX = 200.0


@dataclass(frozen=True)
class Sensor:
    """What a sensor makes of the light that falls on it.

    Attributes
    ----------
    noise : float
        Standard deviation of the read noise, in grey levels of 0..255.
    shot_noise : float
        Standard deviation of the photon noise at grey level 255; it falls with the square root of the level.
    blur_px : float
        Standard deviation of the lens's Gaussian blur, in pixels.
    dtype : str
        ``"uint8"``, ``"uint16"`` (full scale 65535) or ``"float32"`` (grey levels of 0..255, not rounded, not clipped).

    Examples
    --------
    >>> import numpy as np
    >>> Sensor(noise=0.0).expose(np.full((2, 2), 99.6), np.random.default_rng(1))
    array([[100, 100],
           [100, 100]], dtype=uint8)
    """

    noise: float = 1.0
    shot_noise: float = 0.0
    blur_px: float = 0.0
    dtype: str = "uint8"

    def __post_init__(self) -> None:
        for name in ("noise", "shot_noise", "blur_px"):
            most = _MOST_BLUR_PX if name == "blur_px" else 1e9
            object.__setattr__(self, name, _checks.number(name, getattr(self, name), least=0, most=most))
        _checks.choice("dtype", self.dtype, _SCALE)

    @property
    def margin(self) -> int:
        """Pixels that an image needs around it so that blur meets real content at its border."""
        return int(np.ceil(4.0 * self.blur_px))

    def blur(self, image: NDArray[np.float64]) -> NDArray[np.float64]:
        """Blur an image that is `margin` larger on each side, and crop that margin.

        Parameters
        ----------
        image : (height + 2 margin, width + 2 margin) float64
            Grey levels.

        Returns
        -------
        (height, width) float64
        """
        image = _image(image)
        if self.blur_px == 0.0:
            return image
        import cv2

        m = self.margin
        if min(image.shape) <= 2 * m:
            raise ShapeError(f"image: got shape {image.shape}, expected more than the margin of {m} on each side")
        blurred = cv2.GaussianBlur(image, (2 * m + 1, 2 * m + 1), self.blur_px)
        return np.asarray(blurred[m:-m, m:-m], dtype=np.float64)

    def expose(self, image: NDArray[np.float64], rng: np.random.Generator) -> NDArray[Any]:
        """Add noise to grey levels of 0..255 and convert to `dtype`; integers are rounded and clipped.

        Parameters
        ----------
        image : (height, width) float64
            Grey levels of 0..255.
        rng : numpy.random.Generator
            Of the noise.

        Returns
        -------
        (height, width) of `dtype`
        """
        image = _image(image)
        _checks.instance("rng", rng, np.random.Generator, "a numpy.random.Generator")
        noise: NDArray[np.float64] | float = self.noise
        if self.shot_noise:
            noise = np.sqrt(self.noise**2 + self.shot_noise**2 * np.clip(image, 0.0, None) / 255.0)
        noisy = image + noise * rng.standard_normal(image.shape)
        scale = _SCALE[self.dtype]
        if scale is None:
            # What float32 cannot hold is infinite there.
            with np.errstate(over="ignore"):
                return noisy.astype(np.float32)
        return np.clip(np.rint(noisy * scale), 0.0, 255.0 * scale).astype(self.dtype)


def _image(image: NDArray[np.float64]) -> NDArray[np.float64]:
    expected = "finite grey levels, (height, width)"
    return _checks.array("image", image, ("height", "width"), expected, finite=True).astype(np.float64, copy=False)


def sensor_or(default: Sensor, sensor: Sensor | None) -> Sensor:
    """Take a caller's sensor, or the default where there is none."""
    return default if sensor is None else _checks.instance("sensor", sensor, Sensor, "a Sensor")


# A cheap webcam in room light: a soft lens and visible noise.
WEBCAM = Sensor(noise=2.0, blur_px=0.7)
