"""Changes of light: functions from an image in grey levels to the same image in another light."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .. import _checks

__all__ = [
    "LIGHTING",
    "Lighting",
    "auto_exposure",
    "flicker",
    "gain",
    "gamma",
    "light_switch",
    "offset",
    "passing_clouds",
    "ramp",
    "shadow",
    "spotlight",
]

# An image as float64 (height, width) in grey levels of 0..255 -> the image under that light, not clipped.
Lighting = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def gain(factor: float, plus: float = 0.0) -> Lighting:
    """Multiply by `factor` and add `plus` grey levels: exposure and gain of a camera.

    Parameters
    ----------
    factor : float
        Gain.
    plus : float
        Grey levels.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> gain(1.5, plus=-5.0)(np.full((1, 2), 100.0))
    array([[145., 145.]])
    """
    factor, plus = _checks.number("factor", factor), _checks.number("plus", plus, of="grey levels")
    return lambda image: factor * image + plus


def offset(levels: float) -> Lighting:
    """Add `levels` grey levels everywhere, as the report's kappa (equation 2.7) does.

    Parameters
    ----------
    levels : float
        Grey levels.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> offset(25.0)(np.full((1, 2), 100.0))
    array([[125., 125.]])
    """
    levels = _checks.number("levels", levels, of="grey levels")
    return lambda image: image + levels


def gamma(exponent: float) -> Lighting:
    """Raise to `exponent` on the scale of 0..255: 0.6 brightens the dark parts. Clips at 0 and 255.

    Parameters
    ----------
    exponent : float
        Below 1 brightens, above 1 darkens.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> gamma(0.5)(np.array([[0.0, 63.75, 255.0]]))
    array([[  0. , 127.5, 255. ]])
    """
    exponent = _checks.number("exponent", exponent, above=0)

    def apply(image: NDArray[np.float64]) -> NDArray[np.float64]:
        share: NDArray[np.float64] = np.clip(image, 0.0, 255.0) / 255.0
        return np.asarray(255.0 * share**exponent, dtype=np.float64)

    return apply


def ramp(start: float, stop: float, *, axis: str = "x") -> Lighting:
    """Apply a gain that varies linearly from `start` at the first column (row for axis "y") to `stop` at the last.

    Parameters
    ----------
    start, stop : float
        Gain at the first and at the last column, or row.
    axis : {"x", "y"}
        Along which it varies.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> ramp(0.8, 1.2)(np.full((1, 3), 100.0))
    array([[ 80., 100., 120.]])
    """
    start, stop = _checks.number("start", start), _checks.number("stop", stop)
    _checks.choice("axis", axis, ("x", "y"))

    def apply(image: NDArray[np.float64]) -> NDArray[np.float64]:
        height, width = image.shape
        factor = np.linspace(start, stop, width)[None, :] if axis == "x" else np.linspace(start, stop, height)[:, None]
        return image * factor

    return apply


def spotlight(levels: float, *, x: float = 0.6, y: float = 0.4, radius: float = 0.15) -> Lighting:
    """Add a Gaussian spot of `levels` grey levels.

    Parameters
    ----------
    levels : float
        Height of the spot in grey levels.
    x, y : float
        Its centre as a share of the width and of the height.
    radius : float
        Its standard deviation as a share of the width.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> lit = spotlight(50.0, x=0.5, y=0.5)(np.full((9, 9), 100.0))
    >>> bool(lit.max() == lit[4, 4]), bool(lit[0, 0] < 101)
    (True, True)
    """
    levels = _checks.number("levels", levels, of="grey levels")
    x, y, radius = _checks.number("x", x), _checks.number("y", y), _checks.number("radius", radius, above=0)

    def apply(image: NDArray[np.float64]) -> NDArray[np.float64]:
        height, width = image.shape
        column = np.exp(-0.5 * ((np.arange(height) - y * height) / (radius * width)) ** 2)
        row = np.exp(-0.5 * ((np.arange(width) - x * width) / (radius * width)) ** 2)
        return np.asarray(image + levels * column[:, None] * row[None, :], dtype=np.float64)

    return apply


def shadow(factor: float, *, x: float = 0.55, slope: float = 0.5) -> Lighting:
    """Multiply by `factor` everything right of a hard, slanting edge.

    Parameters
    ----------
    factor : float
        Gain in the shadow.
    x : float
        Where the edge meets the first row, as a share of the width.
    slope : float
        Pixels that the edge goes to the left for each row down.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> shadow(0.5, x=0.5, slope=0.0)(np.full((1, 4), 100.0))
    array([[100., 100., 100.,  50.]])
    """
    factor, x, slope = _checks.number("factor", factor), _checks.number("x", x), _checks.number("slope", slope)

    def apply(image: NDArray[np.float64]) -> NDArray[np.float64]:
        height, width = image.shape
        inside = np.arange(width)[None, :] + slope * np.arange(height)[:, None] > x * width
        return np.where(inside, factor * image, image)

    return apply


def flicker(amplitude: float, *, rows: float = 60.0, phase: float = 0.0) -> Lighting:
    """Multiply rows by 1 + amplitude sin(2 pi y / rows + phase): lamps on mains, read row by row by a rolling shutter.

    Parameters
    ----------
    amplitude : float
        Of the gain: 0.1 lets it go from 0.9 to 1.1.
    rows : float
        Rows that are read in one period of the light.
    phase : float
        At the first row, in radians; it differs from frame to frame.

    Returns
    -------
    Lighting

    Examples
    --------
    >>> import numpy as np
    >>> flicker(0.1, rows=4.0)(np.full((4, 1), 100.0)).round(6).ravel().tolist()
    [100.0, 110.0, 100.0, 90.0]
    """
    amplitude, phase = _checks.number("amplitude", amplitude), _checks.number("phase", phase, of="radians")
    rows = _checks.number("rows", rows, above=0)

    def apply(image: NDArray[np.float64]) -> NDArray[np.float64]:
        gains = 1.0 + amplitude * np.sin(2 * np.pi * np.arange(image.shape[0]) / rows + phase)
        return np.asarray(image * gains[:, None], dtype=np.float64)

    return apply


def auto_exposure(amplitude: float, *, period_s: float = 2.0, phase: float = 0.0) -> Callable[[float], Lighting]:
    """Let a gain drift as a camera's automatic exposure does: 1 + amplitude sin(2 pi t / period + phase).

    Parameters
    ----------
    amplitude : float
        Of the gain: 0.1 lets it go from 0.9 to 1.1.
    period_s : float
        Seconds.
    phase : float
        At time 0, in radians.

    Returns
    -------
    callable
        Takes the time in seconds and returns the `Lighting` of that moment.

    Examples
    --------
    >>> import numpy as np
    >>> auto_exposure(0.1, period_s=2.0)(0.5)(np.full((1, 1), 100.0)).round(6)
    array([[110.]])
    """
    amplitude = _checks.number("amplitude", amplitude)
    period_s = _checks.number("period_s", period_s, above=0, of="seconds")
    phase = _checks.number("phase", phase, of="radians")
    return lambda t_s: gain(1.0 + amplitude * float(np.sin(2 * np.pi * t_s / period_s + phase)))


def light_switch(
    factor: float, from_s: float, until_s: float | None = None, *, plus: float = 0.0
) -> Callable[[float], Lighting]:
    """Let the light change at once, as when a lamp is switched, and change back.

    Parameters
    ----------
    factor, plus : float
        Gain and offset, the latter in grey levels, from `from_s` on and before `until_s`.
    from_s : float
        Seconds.
    until_s : float, optional
        Seconds; by default it does not change back.

    Returns
    -------
    callable
        Takes the time in seconds and returns the `Lighting` of that moment.

    Examples
    --------
    >>> import numpy as np
    >>> light = light_switch(0.5, 1.0, 2.0)
    >>> [light(t_s)(np.full((1, 1), 100.0)).item() for t_s in (0.9, 1.0, 1.9, 2.0)]
    [100.0, 50.0, 50.0, 100.0]
    """
    factor, plus = _checks.number("factor", factor), _checks.number("plus", plus, of="grey levels")
    from_s = _checks.number("from_s", from_s, of="seconds")
    until_s = _checks.number_or_none("until_s", until_s, least=from_s, of="seconds")
    end_s = np.inf if until_s is None else until_s
    return lambda t_s: gain(factor, plus) if from_s <= t_s < end_s else gain(1.0)


def passing_clouds(
    factor: float = 0.6, *, period_s: float = 4.0, size: float = 0.7, seed: int = 0
) -> Callable[[float], Lighting]:
    """Let soft shadows of clouds pass over the picture: a gain between `factor` and 1 that varies with place and time.

    Parameters
    ----------
    factor : float
        Gain in the middle of a cloud.
    period_s : float
        Seconds in which the clouds move on by about their own size.
    size : float
        Their size, as a share of the picture's longer side.
    seed : int
        Of their places and of where they go.

    Returns
    -------
    callable
        Takes the time in seconds and returns the `Lighting` of that moment.

    Examples
    --------
    >>> import numpy as np
    >>> lit = passing_clouds(0.6, seed=1)(0.5)(np.full((60, 80), 100.0))
    >>> bool(59.9 < lit.min() < lit.max() < 100.1), bool(np.ptp(lit) > 10)
    (True, True)
    """
    factor = _checks.number("factor", factor, least=0, most=1e6)
    period_s = _checks.number("period_s", period_s, above=0, of="seconds")
    size = _checks.number("size", size, least=1e-3, most=1e6)
    rng = np.random.default_rng([_checks.integer("seed", seed, least=0), 1_299_709])
    heading, phases = rng.uniform(0.0, 2 * np.pi), rng.uniform(0.0, 2 * np.pi, 3)
    angles, waves = heading + rng.normal(0.0, 0.5, 3), 2 * np.pi / (size * rng.uniform(0.8, 1.4, 3))

    def at(t_s: float) -> Lighting:
        def apply(image: NDArray[np.float64]) -> NDArray[np.float64]:
            side = max(image.shape)
            y, x = np.ogrid[: image.shape[0], : image.shape[1]]
            sky = np.zeros(image.shape)
            for angle, wave, phase in zip(angles, waves, phases, strict=True):
                along = (x * np.cos(angle) + y * np.sin(angle)) / side - size * t_s / period_s
                sky = sky + np.sin(wave * along + phase) / 3
            return np.asarray(image * (1.0 - (1.0 - factor) * (0.5 - 0.5 * np.clip(1.5 * sky, -1.0, 1.0))))

        return apply

    return at


def lit(name: str, light: Lighting | None, image: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a caller's light, which must give a picture of the same size."""
    if light is None:
        return image
    expected = f"a function that gives finite grey levels, {image.shape}, as it gets"
    return _checks.array(name, light(image), image.shape, expected, finite=True).astype(np.float64, copy=False)


# One of each kind, at a strength that is common outdoors and at a camera's automatic exposure.
LIGHTING: dict[str, Lighting] = {
    "steady": lambda image: image,
    "gain": gain(1.25),
    "gain and offset": gain(0.7, plus=20.0),
    "offset": offset(25.0),
    "gamma": gamma(0.7),
    "ramp": ramp(0.75, 1.25),
    "spotlight": spotlight(50.0),
    "shadow": shadow(0.5),
}
