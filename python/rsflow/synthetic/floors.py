"""Floors that repeat: tiles that look the same, and a board of light and dark squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .textures import Texture

__all__ = ["checkered_floor", "tiled_floor"]

F64 = NDArray[np.float64]

# Deviation, in units of the texture, of the blur that keeps the edges within what the grid can hold.
_EDGE = 0.7
_OVERSAMPLE = 2.0


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
