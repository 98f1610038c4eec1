"""Grounds with a look of their own: tiles and squares that repeat, stripes, plain areas, discs as in photographs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .textures import Texture, texture

__all__ = ["checkered_floor", "disc_floor", "patchy_floor", "striped_floor", "tiled_floor"]

F64 = NDArray[np.float64]

# Deviation, in units of the texture, of the blur that keeps the edges within what the grid can hold.
_EDGE = 0.7
_OVERSAMPLE = 2.0
# Deviation of the blur of a stripe's profile on that grid, and of a disc's own texture beside that of their levels.
_STRIPE = 2.0
_GRAIN = 0.03


def tiled_floor(period: int = 32, *, joint: float = 2.0, relief: float = 1.0, seed: int = 0) -> Texture:
    """Square tiles that all look the same, with dark joints between them: it repeats exactly.

    A motion by one tile cannot be told from none. For `rsflow.synthetic.flight`, as its `ground`.

    Parameters
    ----------
    period : int
        Side of a tile with its joint, in units of the texture (`texture_scale_m` metres each, one pixel by default).
    joint : float
        Width of a joint, in the same.
    relief : float
        Deviation of the pattern on the tiles, beside the depth of the joints; 0 leaves plain tiles.
    seed : int
        Of the pattern.

    Returns
    -------
    Texture
        Of mean 0 and standard deviation 1.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> floor = tiled_floor(24, seed=1)
    >>> bool(abs(floor.sample(3.3, 5.0) - floor.sample(3.3 - 24, 5.0 + 48)) < 1e-9)
    True
    >>> synthetic.flight(frames=2, ground=floor).images.shape
    (2, 144, 176)
    """
    period = _checks.integer("period", period, least=4, most=4096)
    joint = _checks.number("joint", joint, least=0, most=period / 2)
    relief = _checks.number("relief", relief, least=0, most=1e6)
    size = round(period * _OVERSAMPLE)
    seed = _checks.integer("seed", seed, least=0)
    place = (np.arange(size) + 0.5) / _OVERSAMPLE
    in_joint = np.minimum(place, period - place) < joint / 2
    values = np.where(in_joint[:, None] | in_joint[None, :], -3.0, 0.0)
    if relief:
        pattern = Texture.make("fine", seed=seed, period=period)
        x = np.arange(size)[None, :] / _OVERSAMPLE
        values += relief * pattern.sample(x, x.T) * (values == 0.0)
    if not values.any():
        raise _checks.refused("joint, relief", (joint, relief), "one of them above 0: a plain floor shows no motion")
    return _floor(values, period)


def checkered_floor(period: int = 64, *, wear: float = 0.0, seed: int = 0) -> Texture:
    """Light and dark squares in turns, as of a chessboard.

    For `rsflow.synthetic.flight`, as its `ground`. Without wear, a motion by two squares along x or y, or by one along
    both, cannot be told from none.

    Parameters
    ----------
    period : int
        Side of two squares, in units of the texture; even.
    wear : float
        Deviation of an uneven surface beside half of the step from dark to light. It repeats after 16 periods or 2048
        units, whichever is less.
    seed : int
        Of the wear.

    Returns
    -------
    Texture
        Of mean 0 and standard deviation 1.

    Examples
    --------
    >>> floor = checkered_floor(64)
    >>> dark, light = floor.sample(16.0, 16.0), floor.sample(48.0, 16.0)
    >>> bool(2.0 < light - dark < 2.2), bool(abs(floor.sample(16.0, 16.0) - floor.sample(48.0, 48.0)) < 1e-9)
    (True, True)
    """
    period = _checks.integer("period", period, least=4, most=2048)
    if period % 2:
        raise _checks.refused("period", period, "an even integer")
    wear = _checks.number("wear", wear, least=0, most=1e6)
    seed = _checks.integer("seed", seed, least=0)
    repeats = max(1, min(16, 2048 // period)) if wear else 1
    total = repeats * period
    size = round(total * _OVERSAMPLE)
    dark = np.arange(size) // round(period * _OVERSAMPLE / 2) % 2 == 0
    values = np.where(dark[:, None] == dark[None, :], -1.0, 1.0)
    if wear:
        x = np.arange(size)[None, :] / _OVERSAMPLE
        values = values + wear * Texture.make("ground", seed=seed, period=total).sample(x, x.T)
    return _floor(values, total)


def striped_floor(period: int = 512, *, slope: int = 1, seed: int = 0) -> Texture:
    """Stripes of uneven width and grey level: along them nothing shows a motion (the aperture problem).

    Parameters
    ----------
    period : int
        Units after which it repeats.
    slope : int
        Units that a stripe goes to the left for each one down; 0: upright stripes.
    seed : int
        Of the stripes.

    Returns
    -------
    Texture
        Of mean 0 and standard deviation 1.

    Examples
    --------
    >>> floor = striped_floor(128, slope=1, seed=1)
    >>> bool(abs(floor.sample(10.0, 20.0) - floor.sample(10.0 - 3.5, 20.0 + 3.5)) < 1e-2)
    True
    """
    period = _checks.integer("period", period, least=16, most=4096)
    slope = _checks.integer("slope", slope, least=-8, most=8)
    seed = _checks.integer("seed", seed, least=0)
    size = round(period * _OVERSAMPLE)
    profile = texture((1, size), "ground", seed=seed)[0]
    smooth = np.fft.irfft(
        np.fft.rfft(profile) * np.exp(-0.5 * (2 * np.pi * np.fft.rfftfreq(size) * _STRIPE) ** 2), size
    )
    column, row = np.arange(size)[None, :], np.arange(size)[:, None]
    return _floor(smooth[(column + slope * row) % size], period)


def patchy_floor(period: int = 512, *, kind: str = "ground", plain: float = 0.5, seed: int = 0) -> Texture:
    """Ground of which a share is plain: patches without any texture, some 60 units wide, that show no motion.

    Parameters
    ----------
    period : int
        Units after which it repeats.
    kind : str
        Texture between the patches, see `BANDS`.
    plain : float
        Share of the ground that is plain, 0 to 0.95.
    seed : int
        Of texture and patches.

    Returns
    -------
    Texture
        Of mean 0 and standard deviation 1.

    Examples
    --------
    >>> import numpy as np
    >>> floor = patchy_floor(256, plain=0.5, seed=1)
    >>> levels = floor.sample(np.arange(256.0)[None, :], np.arange(256.0)[:, None])
    >>> bool(0.4 < (np.abs(levels - np.median(levels)) < 0.05).mean() < 0.6)
    True
    """
    period = _checks.integer("period", period, least=64, most=4096)
    plain = _checks.number("plain", plain, least=0, most=0.95)
    seed = _checks.integer("seed", seed, least=0)
    size = round(period * _OVERSAMPLE)
    place = np.arange(size) / _OVERSAMPLE
    values = Texture.make(kind, seed=seed, period=period).sample(place[None, :], place[:, None])
    # Slow enough that a patch is wider than what an estimator looks at.
    blobs = Texture.make("smooth", seed=seed + 1, period=max(period // 2, 32)).sample(
        place[None, :] / 2, place[:, None] / 2
    )
    return _floor(np.where(blobs > np.quantile(blobs, plain), values, 0.0), period)


def disc_floor(period: int = 512, *, smallest: float = 3.0, largest: float = 100.0, seed: int = 0) -> Texture:
    """Discs of all sizes that hide each other, each nearly plain: edges, corners and plain insides as photographs have.

    Their radii have a density of 1 / r^3, which gives the statistics of natural pictures at all scales ("dead leaves":
    Lee, Mumford and Huang 2001, doi:10.1023/A:1011109015675).

    Parameters
    ----------
    period : int
        Units after which it repeats.
    smallest, largest : float
        Radii, in units; the largest is at most a third of the period.
    seed : int
        Of the discs.

    Returns
    -------
    Texture
        Of mean 0 and standard deviation 1.

    Examples
    --------
    >>> import numpy as np
    >>> floor = disc_floor(256, largest=60.0, seed=1)
    >>> levels = floor.sample(np.arange(256.0)[None, :], np.arange(256.0)[:, None])
    >>> steps = np.abs(np.diff(levels))
    >>> bool(np.median(steps) < 0.05), bool(np.quantile(steps, 0.98) > 0.3)  # plain insides, sharp edges
    (True, True)
    """
    period = _checks.integer("period", period, least=16, most=2048)
    smallest = _checks.number("smallest", smallest, least=0.5, most=period / 3)
    largest = _checks.number("largest", largest, least=smallest, most=period / 3)
    seed = _checks.integer("seed", seed, least=0)
    rng = np.random.default_rng([seed, 86_028_121])
    size = round(period * _OVERSAMPLE)
    values, bare = np.zeros((size, size)), np.ones((size, size), np.bool_)
    # From the nearest to the farthest: a disc fills what is still bare, until hardly anything is.
    while np.count_nonzero(bare) > 0.001 * bare.size:
        share = rng.random()
        radius = smallest * largest / np.sqrt(largest**2 - share * (largest**2 - smallest**2)) * _OVERSAMPLE
        x, y = rng.uniform(0, size, 2)
        level, gradient = rng.normal(), rng.normal(0.0, 0.15, 2)
        columns, rows = (np.arange(np.ceil(at - radius), np.floor(at + radius) + 1).astype(np.intp) for at in (x, y))
        across, down = (columns - x)[None, :] / radius, (rows - y)[:, None] / radius
        window = np.ix_(rows % size, columns % size)
        new = bare[window] & (across**2 + down**2 < 1.0)
        values[window] = np.where(new, level + gradient[0] * across + gradient[1] * down, values[window])
        bare[window] &= ~new
    grain = Texture.make("noise", seed=seed, period=period)
    place = np.arange(size) / _OVERSAMPLE
    return _floor(values + _GRAIN * grain.sample(place[None, :], place[:, None]), period)


def _floor(values: F64, period: int) -> Texture:
    """Make a texture of values on a grid that repeats: blurred to what the grid can hold, standardised."""
    size = len(values)
    w = 2 * np.pi * np.fft.fftfreq(size)
    blur = np.exp(-0.5 * (_EDGE * _OVERSAMPLE * w) ** 2)
    # Through the grid's points exactly: divide by the spectrum of the sampled B-spline.
    spline = (4.0 + 2.0 * np.cos(w)) / 6.0
    spectrum = np.fft.fft2(values) * (blur[:, None] * blur[None, :])
    spectrum[0, 0] = 0.0
    spread = np.fft.ifft2(spectrum).real.std()
    coefficients = np.fft.ifft2(spectrum / (spline[:, None] * spline[None, :] * spread)).real
    coefficients.setflags(write=False)
    return Texture(coefficients, size / period)
