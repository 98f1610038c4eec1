"""Ground, particles and speckle that any displacement moves, a function of the place, with exact truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import fields
from ..errors import ShapeError
from .lighting import Lighting, lit
from .sensor import Sensor, sensor_or
from .textures import CONTRAST_LEVELS, MEAN_LEVEL, Texture

__all__ = ["DeformedPair", "Displacement", "homography_motion", "particle_pair", "speckle_pair", "textured_pair"]

F64 = NDArray[np.float64]

# x and y of places in the older frame, arrays of one shape -> u and v there, each of that shape or a number.
Displacement = Callable[[F64, F64], tuple[ArrayLike, ArrayLike]]

# Rounds of a fixed point that seeks where a pixel came from; its error shrinks by the gradient in each.
_ROUNDS = 80
# Deviations of a particle's picture beyond which it is dark, and steps in one of them of the table of erf.
_REACH = 5.0
_STEPS = 400
# Pixels beyond the frame from which particles may come into it are a multiple of this, so that all displacements up to
# nearly as long have the same particles.
_MARGIN = 64
_SPECKLE_MEAN, _SPECKLE_CONTRAST = 125.0, 105.0
_PARTICLE_DARK = 12.0


@dataclass(frozen=True, eq=False)
class DeformedPair:
    """Two frames between which a known displacement lies.

    Attributes
    ----------
    prev, next : ndarray, shape (height, width)
        What is at (x, y) in `prev` is at (x + u, y + v) in `next`.
    displacement : function
        As it was given: of x and y in `prev`.

    Examples
    --------
    >>> from rsflow.synthetic import speckle_pair
    >>> pair = speckle_pair(lambda x, y: (0.01 * x, 0 * y + 2.0), size=(64, 48), seed=1)
    >>> pair.prev.shape, pair.truth(10.0, 20.0).tolist(), pair.gradient(10.0, 20.0).round(6).tolist()
    ((48, 64), [0.1, 2.0], [[0.01, 0.0], [0.0, 0.0]])
    """

    prev: NDArray[Any]
    next: NDArray[Any]
    displacement: Displacement

    __repr__ = fields

    def truth(self, x: ArrayLike, y: ArrayLike) -> F64:
        """Displacement (u, v) at places of `prev`, shape (.., 2).

        Parameters
        ----------
        x, y : array_like of float
            Pixels.

        Returns
        -------
        (.., 2) float64
        """
        return _moved(self.displacement, *_places(x, y))

    def gradient(self, x: ArrayLike, y: ArrayLike) -> F64:
        """``[[du/dx, du/dy], [dv/dx, dv/dy]]`` at places of `prev`, by differences over 0.002 pixels, shape (.., 2, 2).

        Parameters
        ----------
        x, y : array_like of float
            Pixels.

        Returns
        -------
        (.., 2, 2) float64
        """
        across, down = _places(x, y)
        e, move = 1e-3, self.displacement
        along_x = (_moved(move, across + e, down) - _moved(move, across - e, down)) / (2 * e)
        along_y = (_moved(move, across, down + e) - _moved(move, across, down - e)) / (2 * e)
        return np.stack([along_x, along_y], axis=-1)


def homography_motion(matrix: ArrayLike) -> Displacement:
    """Give the displacement that a homography makes: a shift, turn, zoom, shear or change of perspective.

    Parameters
    ----------
    matrix : (3, 3) array_like
        Takes (x, y, 1) in pixels of the older frame to where it is in the newer one, up to a factor.

    Returns
    -------
    function
        Of x and y, as `textured_pair`, `speckle_pair` and `particle_pair` take it.

    Examples
    --------
    >>> move = homography_motion([[1, 0, 3], [0, 1, -2], [0, 0.01, 1]])
    >>> [float(value) for value in move(0.0, 0.0)], [round(float(value), 2) for value in move(0.0, 25.0)]
    ([3.0, -2.0], [2.4, -6.6])
    """
    rows = _checks.array("matrix", matrix, (3, 3), "(3, 3) finite numbers", finite=True).astype(np.float64)

    def move(x: F64, y: F64) -> tuple[F64, F64]:
        to = [row[0] * x + row[1] * y + row[2] for row in rows]
        return to[0] / to[2] - x, to[1] / to[2] - y

    return move


def textured_pair(
    displacement: Displacement,
    *,
    ground: Texture | None = None,
    contrast_levels: float = CONTRAST_LEVELS,
    size: tuple[int, int] = (256, 256),
    lighting: Lighting | None = None,
    lighting_prev: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> DeformedPair:
    """Make two frames of a ground that `displacement` moves.

    Parameters
    ----------
    displacement : function of (x, y) in pixels of the older frame
        Gives (u, v); its gradient is below 0.5 everywhere. It is asked beyond the frame too.
    ground : Texture, optional
        What is seen, a unit of it a pixel of the older frame; by default ``Texture.make("ground", seed=seed)``.
    contrast_levels : float
        Grey levels for one standard deviation of the ground.
    size : (int, int)
        Width and height in pixels.
    lighting, lighting_prev : Lighting, optional
        What happens to the light of the newer and of the older frame.
    sensor : Sensor, optional
        Noise and type; by default noise of one grey level, uint8.
    seed : int
        Of ground and noise.

    Returns
    -------
    DeformedPair

    Examples
    --------
    >>> from rsflow.synthetic import homography_motion, ramp, textured_pair
    >>> zoom = homography_motion([[1.05, 0, 0], [0, 1.05, 0], [0, 0, 1]])
    >>> pair = textured_pair(zoom, size=(80, 60), lighting=ramp(0.8, 1.2), seed=2)
    >>> pair.prev.shape, pair.truth(20.0, 40.0).round(6).tolist()
    ((60, 80), [1.0, 2.0])
    """
    move = _checks.function("displacement", displacement, 2)
    contrast = _checks.number("contrast_levels", contrast_levels, least=0, most=1e6, of="grey levels")
    width, height = _checks.size("size", size, most=10_000)
    older = None if lighting_prev is None else _checks.function("lighting_prev", lighting_prev, 1)
    sensor, lighting, seed = _common(sensor, lighting, seed, noise=1.0)
    if ground is None:
        ground = Texture.make("ground", seed=seed)
    ground = _checks.instance("ground", ground, Texture, "a Texture")
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    frames = [MEAN_LEVEL + contrast * ground.sample(*at) for at in ((x, y), _origins(move, x, y))]
    frames[0] = lit("lighting_prev", older, frames[0])
    return _exposed(frames, move, lighting, sensor, seed)


def speckle_pair(
    displacement: Displacement,
    *,
    size: tuple[int, int] = (256, 256),
    speckle_px: float = 1.15,
    lighting: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> DeformedPair:
    """Make two frames of a painted speckle pattern that `displacement` deforms.

    Parameters
    ----------
    displacement : function of (x, y) in pixels of the older frame
        Gives (u, v); its gradient is below 0.5 everywhere. It is asked beyond the frame too.
    size : (int, int)
        Width and height in pixels.
    speckle_px : float
        Deviation of the Gaussian that the pattern is made with: its spots are some four times as wide.
    lighting : Lighting, optional
        What happens to the light of the newer frame.
    sensor : Sensor, optional
        Noise and type; by default noise of two grey levels, uint8.
    seed : int
        Of pattern and noise.

    Returns
    -------
    DeformedPair

    Examples
    --------
    >>> pair = speckle_pair(lambda x, y: (0.05 * x, -0.02 * y), size=(80, 60), seed=2)
    >>> pair.prev.shape, pair.prev.dtype
    ((60, 80), dtype('uint8'))
    """
    move = _checks.function("displacement", displacement, 2)
    width, height = _checks.size("size", size, most=10_000)
    spot = _checks.number("speckle_px", speckle_px, least=0.2, most=1000.0, of="pixels")
    sensor, lighting, seed = _common(sensor, lighting, seed)
    pattern = Texture.make("noise", seed=seed, period=512)
    y, x = np.mgrid[0:height, 0:width].astype(np.float64)
    frames = []
    for at in ((x, y), _origins(move, x, y)):
        values = np.tanh(1.1 * pattern.sample(at[0] / spot, at[1] / spot))
        frames.append(_SPECKLE_MEAN + _SPECKLE_CONTRAST * values)
    return _exposed(frames, move, lighting, sensor, seed)


def particle_pair(
    displacement: Displacement,
    *,
    size: tuple[int, int] = (256, 256),
    density_px2: float = 0.03,
    diameter_px: float = 2.5,
    lost: float = 0.0,
    lighting: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> DeformedPair:
    """Make two frames of particles in a sheet of light, which `displacement` carries.

    Each is a Gaussian spot, integrated over the pixels, as bright as its place in the sheet is lit. Displacements up to
    56 pixels have the same particles, so that their newer frames make a sequence.

    Parameters
    ----------
    displacement : function of (x, y) in pixels of the older frame
        Gives (u, v). It is asked beyond the frame too.
    size : (int, int)
        Width and height in pixels.
    density_px2 : float
        Particles a pixel.
    diameter_px : float
        Diameter of a spot, four deviations of its Gaussian.
    lost : float
        Share of the particles that leave the sheet and are replaced by others elsewhere, 0 to 1.
    lighting : Lighting, optional
        What happens to the light of the newer frame.
    sensor : Sensor, optional
        Noise and type; by default noise of two grey levels, uint8.
    seed : int
        Of particles and noise.

    Returns
    -------
    DeformedPair

    Examples
    --------
    >>> pair = particle_pair(lambda x, y: (3.0, -1.0), size=(80, 60), lost=0.1, seed=2)
    >>> pair.next.shape, pair.truth([1.0, 2.0], [3.0, 4.0]).tolist()
    ((60, 80), [[3.0, -1.0], [3.0, -1.0]])
    """
    move = _checks.function("displacement", displacement, 2)
    width, height = _checks.size("size", size, most=10_000)
    density = _checks.number("density_px2", density_px2, above=0, most=10.0)
    spot = _checks.number("diameter_px", diameter_px, least=0.4, most=100.0, of="pixels") / 4.0
    lost = _checks.number("lost", lost, least=0, most=1)
    sensor, lighting, seed = _common(sensor, lighting, seed)
    rng = np.random.default_rng([seed, 15_485_863])
    x, y = np.meshgrid(np.linspace(0, width - 1, 32), np.linspace(0, height - 1, 32))
    longest = min(float(np.abs(_moved(move, x, y)).max()), 0.5 * max(size))
    margin = _REACH * spot + _MARGIN * math.ceil((longest + 8.0) / _MARGIN)
    low, high = np.array([-margin, -margin]), np.array([width + margin, height + margin])
    count = int(np.prod(high - low) * density)
    before = rng.uniform(low, high, (count, 2))
    sheet = rng.uniform(-1.0, 1.0, count)
    # The brightest spot is 207 grey levels at its peak if it stood on one point.
    light = 207.0 * 2.0 * np.pi * spot**2 * np.exp(-2.0 * sheet**2)
    after = before + _moved(move, before[:, 0], before[:, 1])
    gone = rng.random(count) < lost
    after[gone] = rng.uniform(low, high, (int(gone.sum()), 2))
    frames = [_PARTICLE_DARK + _spots(at, light, spot, (width, height)) for at in (before, after)]
    return _exposed(frames, move, lighting, sensor, seed)


def _common(
    sensor: Sensor | None, lighting: Lighting | None, seed: object, *, noise: float = 2.0
) -> tuple[Sensor, Lighting | None, int]:
    found = None if lighting is None else _checks.function("lighting", lighting, 1)
    return sensor_or(Sensor(noise=noise), sensor), found, _checks.integer("seed", seed, least=0)


def _exposed(
    frames: list[F64], move: Displacement, lighting: Lighting | None, sensor: Sensor, seed: int
) -> DeformedPair:
    """Light the newer frame and expose both; there is nothing beyond the frame that a lens could blur into it."""
    frames[1] = lit("lighting", lighting, frames[1])
    rng = np.random.default_rng([seed, 104_729])
    prev, after = (sensor.expose(frame, rng) for frame in frames)
    return DeformedPair(prev, after, move)


def _places(x: ArrayLike, y: ArrayLike) -> tuple[F64, F64]:
    """Take places, which broadcast."""
    first, second = (
        _checks.array(name, value, ..., "finite numbers", finite=True).astype(np.float64)
        for name, value in (("x", x), ("y", y))
    )
    _checks.broadcast("x, y", first, second)
    across, down = np.broadcast_arrays(first, second)
    return across, down


def _moved(move: Displacement, x: F64, y: F64) -> F64:
    """Ask for the displacement, (.., 2)."""
    answer = move(x, y)
    expected = "a function that gives u and v, finite, each of the shape of x or a number"
    if not isinstance(answer, (tuple, list, np.ndarray)) or len(answer) != 2:
        raise ShapeError(f"displacement: got {_checks.described(answer)}, expected {expected}")
    parts = [_checks.array("displacement", part, ..., expected, finite=True) for part in answer]
    if any(part.ndim and part.shape != x.shape for part in parts):
        raise ShapeError(f"displacement: got shapes {[part.shape for part in parts]}, expected {expected}")
    return np.stack([np.broadcast_to(part.astype(np.float64), x.shape) for part in parts], axis=-1)


def _origins(move: Displacement, x: F64, y: F64) -> tuple[F64, F64]:
    """Find where in the older frame the pixels (x, y) of the newer one were."""
    at_x, at_y = x, y
    for _ in range(_ROUNDS):
        moved = _moved(move, at_x, at_y)
        new_x, new_y = x - moved[..., 0], y - moved[..., 1]
        change = max(float(np.abs(new_x - at_x).max()), float(np.abs(new_y - at_y).max()))
        at_x, at_y = new_x, new_y
        if change < 1e-10:
            break
    return at_x, at_y


def _spots(at: F64, light: F64, spot: float, size: tuple[int, int]) -> F64:
    """Draw Gaussian spots of deviation `spot`, integrated over pixels."""
    width, height = size
    reach = math.ceil(_REACH * spot)
    grid = np.arange(-reach - 2, reach + 3)
    table_x = np.linspace(-_REACH - 3 / spot, _REACH + 3 / spot, int(_STEPS * (_REACH + 3 / spot) * 2) + 1)
    table = np.array([0.5 * math.erf(value / math.sqrt(2.0)) for value in table_x])
    centre = np.rint(at).astype(np.int64)
    near: NDArray[np.bool_] = np.asarray(((centre > -reach - 3) & (centre < np.array(size) + reach + 3)).all(axis=1))
    picture = np.zeros((height + 2 * len(grid), width + 2 * len(grid)))
    for first in range(0, len(at), 4096):
        part = np.flatnonzero(near[first : first + 4096]) + first
        sides = []
        for axis in range(2):
            places = centre[part, axis, None] + grid - at[part, axis, None]
            edges = [np.interp((places + half) / spot, table_x, table) for half in (-0.5, 0.5)]
            sides.append(edges[1] - edges[0])
        patches = light[part, None, None] * sides[1][:, :, None] * sides[0][:, None, :]
        rows = centre[part, 1, None, None] + grid[:, None] + len(grid)
        columns = centre[part, 0, None, None] + grid + len(grid)
        np.add.at(picture, (rows, columns), patches)
    return picture[len(grid) : len(grid) + height, len(grid) : len(grid) + width]
