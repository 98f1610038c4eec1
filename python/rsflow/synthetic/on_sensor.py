"""What is fixed to the camera and hides or changes a part of every picture: dirt, a fixed pattern, the own vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .lighting import Lighting, lit
from .textures import texture

__all__ = ["VehiclePart", "combined", "dirt", "fixed_pattern"]

F64 = NDArray[np.float64]
Side = Literal["bottom", "top", "left", "right"]


def dirt(depth: float = 0.4, *, share: float = 0.25, size_px: float = 3.0, seed: int = 0) -> Lighting:
    """Darken spots that stay where they are in the picture, as of dirt on the lens.

    Parameters
    ----------
    depth : float
        How much of the light the middle of a spot takes, 0 to 1.
    share : float
        Of the picture that is covered.
    size_px : float
        Deviation of the Gaussian that forms the spots.
    seed : int
        Of their places.

    Returns
    -------
    Lighting
        For ``flight(lighting=...)``.

    Examples
    --------
    >>> import numpy as np
    >>> image = dirt(0.5, share=0.2, seed=1)(np.full((60, 80), 100.0))
    >>> bool(49.9 < image.min() < 55), bool(0.15 < (image < 99).mean() < 0.22)
    (True, True)
    """
    depth = _checks.number("depth", depth, least=0, most=1)
    share = _checks.number("share", share, least=0, most=1)
    size_px, seed = _size_px(size_px), _checks.integer("seed", seed, least=0)

    def apply(image: F64) -> F64:
        bumps = _smooth(image.shape, size_px, seed)
        least, most = np.quantile(bumps, 1.0 - share), bumps.max()
        spots = np.clip((bumps - least) / max(most - least, 1e-12), 0.0, 1.0)
        return np.asarray(image * (1.0 - depth * np.sqrt(spots)), dtype=np.float64)

    return apply


def fixed_pattern(levels: float = 2.0, *, size_px: float = 0.0, seed: int = 0) -> Lighting:
    """Add a pattern that stays where it is in the picture: the fixed-pattern noise of a sensor.

    Parameters
    ----------
    levels : float
        Its standard deviation in grey levels.
    size_px : float
        Deviation of the Gaussian that smooths it; 0 gives each pixel a value of its own.
    seed : int

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> round(float(fixed_pattern(2.0, seed=1)(np.zeros((60, 80))).std()), 6)
    2.0
    """
    levels = _checks.number("levels", levels, least=0, most=1e9, of="grey levels")
    size_px, seed = _size_px(size_px, least=0), _checks.integer("seed", seed, least=0)
    return lambda image: image + levels * _smooth(image.shape, size_px, seed)


@dataclass(frozen=True)
class VehiclePart:
    """A part of the own vehicle that hides a side of the picture: a `Lighting` that knows its mask.

    Attributes
    ----------
    share : float
        Of the picture that it hides, 0 to 0.95.
    side : {"bottom", "top", "left", "right"}
        Where it comes into the picture.
    slope : float
        How much deeper it reaches into the picture at one end of its edge than at the other, as a share of the picture.
    level, contrast_levels : float
        Mean and standard deviation of its grey levels.
    seed : int
        Of its pattern.

    Examples
    --------
    >>> import rsflow
    >>> part = VehiclePart(0.46)
    >>> flight = rsflow.synthetic.flight(frames=2, lighting=part, seed=1)
    >>> mask = part.mask(*flight.camera.size)
    >>> mask.shape, round(float((~mask).mean()), 2)
    ((144, 176), 0.46)
    >>> estimator = rsflow.VelocityEstimator(flight.camera, height_m=0.2, mask=mask)
    >>> [estimator.update(frame.image, frame.t_s).status.name for frame in flight]
    ['FIRST_FRAME', 'OK']
    """

    share: float = 0.3
    side: Side = "bottom"
    slope: float = 0.1
    level: float = 90.0
    contrast_levels: float = 20.0
    seed: int = 0

    def __post_init__(self) -> None:
        bounds: dict[str, tuple[float, float]] = {
            "share": (0, 0.95), "slope": (-1, 1), "level": (-1e9, 1e9), "contrast_levels": (0, 1e9),
        }  # fmt: skip
        for name, (least, most) in bounds.items():
            object.__setattr__(self, name, _checks.number(name, getattr(self, name), least=least, most=most))
        _checks.choice("side", self.side, get_args(Side))
        object.__setattr__(self, "seed", _checks.integer("seed", self.seed, least=0))

    def __call__(self, image: F64) -> F64:
        """Put the part over an image, (height, width), in grey levels."""
        height, width = image.shape
        pattern = texture((height, width), "fine", seed=self.seed + 60_013)
        return np.where(self.mask(width, height), image, self.level + self.contrast_levels * pattern)

    def mask(self, width: int, height: int, *, grow_px: float = 0.0) -> NDArray[np.bool_]:
        """Give the `mask` of an estimator: True where the ground is seen.

        Parameters
        ----------
        width, height : int
            Of the picture.
        grow_px : float
            How much larger than the part the masked region is.

        Returns
        -------
        (height, width) bool
        """
        width, height = _checks.integer("width", width, least=1), _checks.integer("height", height, least=1)
        grow_px = _checks.number("grow_px", grow_px, least=-1e6, most=1e6, of="pixels")
        x, y = (np.arange(width) + 0.5) / width, ((np.arange(height) + 0.5) / height)[:, None]
        deep, along, pixels = {
            "bottom": (1.0 - y, x, height), "top": (y, x, height), "left": (x, y, width), "right": (1.0 - x, y, width),
        }[self.side]  # fmt: skip
        return np.asarray(deep + 0.0 * along > self.share + self.slope * (along - 0.5) + grow_px / pixels)


def combined(*lightings: Lighting) -> Lighting:
    """Apply several, the first one first: the light on the ground, then dirt, then the vehicle.

    Parameters
    ----------
    *lightings : Lighting

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow import synthetic
    >>> combined(synthetic.gain(0.5), synthetic.offset(10.0))(np.full((1, 1), 100.0)).item()
    60.0
    """
    checked = [_checks.function("lightings", lighting, 1) for lighting in lightings]

    def apply(image: F64) -> F64:
        for lighting in checked:
            image = lit("lightings", lighting, image)
        return image

    return apply


def _size_px(value: float, *, least: float = 0.1) -> float:
    return _checks.number("size_px", value, least=least, most=1e4, of="pixels")


def _smooth(shape: tuple[int, ...], sigma: float, seed: int) -> F64:
    """White noise through a Gaussian, of mean 0 and standard deviation 1."""
    noise = np.random.default_rng([seed, 49_979_687]).standard_normal(shape)
    for axis in (0, 1) if sigma else ():
        w = 2 * np.pi * np.fft.fftfreq(shape[axis])
        response = np.expand_dims(np.exp(-0.5 * (sigma * w) ** 2), 1 - axis)
        noise = np.fft.ifft(np.fft.fft(noise, axis=axis) * response, axis=axis).real
    noise = noise - noise.mean()
    return np.asarray(noise / (noise.std() or 1.0), dtype=np.float64)
