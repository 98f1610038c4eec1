"""Band-limited textures, sampled anywhere, and pairs of frames with an exact displacement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import fields
from ..errors import OptionError
from .lighting import Lighting, lit
from .sensor import Sensor, sensor_or

__all__ = ["BANDS", "ShiftedPair", "Texture", "shifted_pair", "texture"]

# Kind -> bands of (weight, standard deviation in pixels of the Gaussian that smooths white noise).
BANDS: dict[str, tuple[tuple[float, float], ...]] = {
    "noise": ((1.0, 1.0),),
    "fine": ((1.0, 1.25), (0.7, 3.5), (0.5, 9.0)),
    "smooth": ((0.2, 1.5), (0.6, 6.0), (0.8, 20.0)),
    "ground": ((0.7, 1.3), (0.7, 2.6), (0.7, 5.2), (0.7, 12.0)),
}

# Grey level of a texture's mean, and grey levels for one standard deviation: 3 deviations stay within 0..255.
MEAN_LEVEL = 115.0
CONTRAST_LEVELS = 35.0


def texture(shape: tuple[int, int], kind: str = "fine", *, seed: int = 0) -> NDArray[np.float64]:
    """Band-limited noise of mean 0 and standard deviation 1 that repeats without a seam.

    Parameters
    ----------
    shape : (int, int)
        Height and width in pixels.
    kind : {"noise", "fine", "smooth", "ground"}
        Which bands, see `BANDS`.
    seed : int
        Textures of different seeds have nothing in common.

    Returns
    -------
    (height, width) float64

    Examples
    --------
    >>> t = texture((64, 96), "smooth", seed=3)
    >>> t.shape, round(float(t.std()), 6)
    ((64, 96), 1.0)
    """
    expected = "(height, width), integers from 1 to 20000"
    height, width = _checks.integers("shape", shape, 2, expected, least=1, most=20_000)
    shape = (height, width)
    spectrum = _spectrum(shape, _kind(kind), _checks.integer("seed", seed, least=0), 1.0)
    return np.asarray(np.fft.irfft2(spectrum / _deviation(spectrum, shape), s=shape), dtype=np.float64)


def _spectrum(shape: tuple[int, int], kind: str, seed: int, oversample: float) -> NDArray[np.complex128]:
    """Make the half spectrum of a texture whose pixels are `oversample` times finer than the bands' pixels."""
    height, width = shape
    wy = 2 * np.pi * np.fft.fftfreq(height)[:, None]
    wx = 2 * np.pi * np.fft.rfftfreq(width)[None, :]
    response = np.zeros((height, width // 2 + 1))
    for weight, sigma in BANDS[kind]:
        blur = 0.5 * (sigma * oversample) ** 2
        band = np.exp(-blur * wy * wy) * np.exp(-blur * wx * wx)
        # Of the bands' share in the deviation: white noise through a filter has its root mean square.
        response += weight / np.sqrt(np.mean(band * band)) * band
    response[0, 0] = 0.0
    # The Nyquist frequency of an even size has no sign, so no change of phase can shift it.
    if height % 2 == 0:
        response[height // 2] = 0.0
    if width % 2 == 0:
        response[:, -1] = 0.0
    # White noise, drawn where it is needed: two real numbers for each coefficient.
    drawn = np.random.default_rng([seed, 7_919]).standard_normal((*response.shape, 2)).view(np.complex128)[..., 0]
    # The transform of real values repeats itself, conjugated, in the column of frequency 0.
    drawn[:, 0] = (drawn[:, 0] + np.conj(np.roll(drawn[::-1, 0], 1))) / np.sqrt(2.0)
    return np.asarray(drawn * response, dtype=np.complex128)


def _deviation(spectrum: NDArray[np.complex128], shape: tuple[int, int]) -> float:
    """Give the standard deviation of the values of a half spectrum (Parseval's theorem); 1 where all are zero."""
    power = np.abs(spectrum) ** 2
    total = 2.0 * float(power.sum()) - float(power[:, 0].sum())
    return float(np.sqrt(total)) / (shape[0] * shape[1]) or 1.0


@dataclass(frozen=True, eq=False)
class Texture:
    """A texture without end: periodic, and known at every point of the plane.

    Between the grid's points it is the cubic B-spline through them. The grid is `oversample` times finer than the
    finest band needs, so the spline is within 0.001 of a standard deviation of the band-limited function.

    Attributes
    ----------
    coefficients : (size, size) float64
        B-spline coefficients of the tile that repeats.
    oversample : float
        Grid points for one unit of the coordinates that `sample` takes.

    Examples
    --------
    >>> import numpy as np
    >>> texture = Texture.make("smooth", seed=1, period=64)
    >>> texture.sample(np.arange(4)[None, :], np.arange(3)[:, None]).shape
    (3, 4)
    """

    coefficients: NDArray[np.float64]
    oversample: float

    __repr__ = fields

    @classmethod
    def make(cls, kind: str = "ground", *, seed: int = 0, period: int = 1024, oversample: float = 2.0) -> Texture:
        """Make a texture of mean 0 and standard deviation 1 that repeats after `period` units.

        Parameters
        ----------
        kind : str
            One of `BANDS`.
        seed : int
            Of the texture.
        period : int
            Units after which it repeats.
        oversample : float
            Grid points a unit.

        Examples
        --------
        >>> t = Texture.make("fine", seed=1, period=64)
        >>> bool(abs(t.sample(3.2, 5.5) - t.sample(3.2 + 64, 5.5 - 128)) < 1e-9)
        True
        """
        period = _checks.integer("period", period, least=1, most=16_384)
        oversample = _checks.number("oversample", oversample, least=1.0 / period, most=16.0)
        return _make(_kind(kind), _checks.integer("seed", seed, least=0), period, oversample)

    def sample(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Values at (x, y), which broadcast; a row of x against a column of y is sampled much faster.

        Parameters
        ----------
        x, y : array_like of float
            Coordinates in the texture's units; any finite value.

        Returns
        -------
        array of the broadcast shape, float64
        """
        x, y = _coordinate("x", x, self.oversample), _coordinate("y", y, self.oversample)
        _checks.broadcast("x, y", x, y)
        size = self.coefficients.shape[0]
        columns, wx = _taps(x * self.oversample, size)
        rows, wy = _taps(y * self.oversample, size)
        if x.ndim == 2 and y.ndim == 2 and x.shape[0] == 1 and y.shape[1] == 1:
            # Only the grid's columns that are read; their numbers wrap as the texture does.
            first = int(np.floor(x.min() * self.oversample)) - 1
            last = int(np.floor(x.max() * self.oversample)) + 2
            used = np.arange(first, min(last + 1, first + size)) % size
            place = np.full(size, -1)
            place[used] = np.arange(len(used))
            lines = np.zeros((y.shape[0], len(used)))
            for k in range(4):
                lines += wy[k] * self.coefficients[rows[k][:, 0, None], used]
            return np.asarray(sum(wx[k] * lines[:, place[columns[k][0]]] for k in range(4)), dtype=np.float64)
        flat = self.coefficients.ravel()
        value = np.zeros(np.broadcast_shapes(x.shape, y.shape))
        for j in range(4):
            line = rows[j] * size
            value += wy[j] * sum(wx[k] * flat[line + columns[k]] for k in range(4))
        return value


def _kind(kind: str, name: str = "kind") -> str:
    return _checks.choice(name, kind, BANDS)


def _coordinate(name: str, value: Any, oversample: float) -> NDArray[np.float64]:
    found = _checks.array(name, value, ..., "finite coordinates", finite=True).astype(np.float64)
    if found.size and not np.abs(found).max() * oversample < 2**52:
        raise OptionError(f"{name}: got {np.abs(found).max():g}, expected coordinates that tell grid points apart")
    return found


def _taps(at: NDArray[np.float64], size: int) -> tuple[list[NDArray[np.intp]], list[NDArray[np.float64]]]:
    """Find the four grid indices around each position, wrapped, and their cubic B-spline weights."""
    base = np.floor(at)
    f = at - base
    index = base.astype(np.intp)
    g = 1.0 - f
    weights = [
        g * g * g / 6.0,
        (4.0 - 6.0 * f * f + 3.0 * f * f * f) / 6.0,
        (4.0 - 6.0 * g * g + 3.0 * g * g * g) / 6.0,
        f * f * f / 6.0,
    ]
    return [(index + k) % size for k in (-1, 0, 1, 2)], weights


@lru_cache(maxsize=4)
def _make(kind: str, seed: int, period: int, oversample: float) -> Texture:
    size = round(period * oversample)
    spectrum = _spectrum((size, size), kind, seed, oversample)
    # Through the grid's points exactly: divide by the spectrum of the sampled B-spline, (4 + 2 cos w) / 6.
    response_y = (4.0 + 2.0 * np.cos(2 * np.pi * np.fft.fftfreq(size)))[:, None] / 6.0
    response_x = (4.0 + 2.0 * np.cos(2 * np.pi * np.fft.rfftfreq(size)))[None, :] / 6.0
    coefficients = np.fft.irfft2(
        spectrum / (response_y * (response_x * _deviation(spectrum, (size, size)))), s=(size, size)
    )
    coefficients.setflags(write=False)
    return Texture(coefficients, size / period)


@dataclass(frozen=True, eq=False)
class ShiftedPair:
    """Two frames of one scene, the second displaced by exactly (dx, dy).

    Attributes
    ----------
    prev, next : (height, width) of the sensor's dtype
        What is at (x, y) in `prev` is at (x + dx, y + dy) in `next`.
    dx, dy : float
        The true displacement in pixels.
    bound_px : float
        Cramer-Rao bound for steady light: the root mean square length of the error vector that no unbiased estimator
        goes below, from the scene's gradients, the sensor's noise and the rounding of integers.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> pair = synthetic.shifted_pair(2.5, -1.0, size=(80, 60), seed=1)
    >>> pair.prev.shape, pair.dx, pair.dy, pair.bound_px < 0.02
    ((60, 80), 2.5, -1.0, True)
    """

    prev: NDArray[Any]
    next: NDArray[Any]
    dx: float
    dy: float
    bound_px: float

    __repr__ = fields


def shifted_pair(
    dx: float,
    dy: float,
    *,
    size: tuple[int, int] = (60, 60),
    kind: str = "fine",
    lighting: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> ShiftedPair:
    """Two frames with an exact displacement, whole or fractional, and new content at the border.

    The scene is a finite Fourier series and the displacement a change of phase, so the truth holds to rounding.

    Parameters
    ----------
    dx, dy : float
        Displacement in pixels, x to the right and y down.
    size : (int, int)
        Width and height in pixels.
    kind : str
        Texture, see `BANDS`.
    lighting : Lighting, optional
        What happens to the light of `next`.
    sensor : Sensor, optional
        Blur, noise and dtype of both frames; by default noise of one grey level, uint8.
    seed : int
        Of texture and noise.

    Returns
    -------
    ShiftedPair

    Examples
    --------
    >>> pair = shifted_pair(2.25, -1.5, size=(80, 60), seed=1)
    >>> pair.prev.shape, pair.prev.dtype, round(pair.bound_px, 3) < 0.02
    ((60, 80), dtype('uint8'), True)
    """
    dx = _checks.number("dx", dx, least=-10_000, most=10_000, of="pixels")
    dy = _checks.number("dy", dy, least=-10_000, most=10_000, of="pixels")
    width, height = size = _checks.size("size", size, most=10_000)
    kind, seed = _kind(kind), _checks.integer("seed", seed, least=0)
    sensor = sensor_or(Sensor(), sensor)
    lighting = None if lighting is None else _checks.function("lighting", lighting, 1)
    margin = sensor.margin
    longest = max(sigma for _, sigma in BANDS.get(kind, ((1.0, 1.0),)))
    # Beyond the pad the scene repeats; that must not be seen in either frame. It is the same for all displacements up
    # to half the size, so that they share their `prev`.
    pad = int(np.ceil(max(abs(dx), abs(dy), 0.5 * max(size)))) + margin + int(4 * longest)
    shape = (height + 2 * pad, width + 2 * pad)
    spectrum = _spectrum(shape, kind, seed, 1.0)
    wy = 2 * np.pi * np.fft.fftfreq(shape[0])[:, None]
    wx = 2 * np.pi * np.fft.rfftfreq(shape[1])[None, :]
    spectrum *= CONTRAST_LEVELS / _deviation(spectrum, shape)
    crop = (slice(pad - margin, pad + height + margin), slice(pad - margin, pad + width + margin))
    scenes = (spectrum, spectrum * np.exp(-1j * (wx * dx + wy * dy)))
    frames = [sensor.blur(np.ascontiguousarray(MEAN_LEVEL + np.fft.irfft2(s, s=shape)[crop])) for s in scenes]
    bound = _bound(frames[0], sensor)
    frames[1] = lit("lighting", lighting, frames[1])
    rng = np.random.default_rng([seed, 104_729])
    prev, after = (sensor.expose(frame, rng) for frame in frames)
    return ShiftedPair(prev, after, float(dx), float(dy), bound)


def _bound(image: NDArray[np.float64], sensor: Sensor) -> float:
    if min(image.shape) < 2:
        return float("inf")
    gy, gx = np.gradient(image)
    information = np.array([[np.sum(gx * gx), np.sum(gx * gy)], [np.sum(gx * gy), np.sum(gy * gy)]])
    if np.linalg.cond(information) > 1e12:
        return float("inf")
    rounding = {"uint8": 1.0 / 12.0, "uint16": 1.0 / 12.0 / 257.0**2, "float32": 0.0}[sensor.dtype]
    variance = sensor.noise**2 + sensor.shot_noise**2 * float(np.clip(image, 0, None).mean()) / 255.0 + rounding
    return float(np.sqrt(np.trace(2.0 * variance * np.linalg.inv(information))))
