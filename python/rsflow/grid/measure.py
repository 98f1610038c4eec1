"""One pair of frames, measured on a grid.

docs/explanation/algorithms.md, section "Grid: displacement_grid".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks, _core
from .._checks import knobs
from .._checks.knobs import GridShape, Illumination
from ..camera import Camera
from .lens import without_distortion
from .result import Grid

__all__ = ["displacement_grid"]


def displacement_grid(
    prev: NDArray[Any],
    next: NDArray[Any],
    *,
    window_size: int = 32,
    step: int = 16,
    shape: GridShape = "affine",
    robust: bool = False,
    mask: NDArray[np.bool_] | None = None,
    next_mask: NDArray[np.bool_] | None = None,
    initial: ArrayLike | Grid | None = None,
    illumination: Illumination = "gain_offset",
    max_displacement: float | None = None,
    scale_m_px: float | None = None,
    dt_s: float | None = None,
    camera: Camera | None = None,
) -> Grid:
    """Measure displacement and its gradient on a regular grid: particles in a fluid (PIV), speckle on a material (DIC).

    Each window is fitted with its motion and its light together [1]_, from where its surest neighbour leads [2]_; where
    no neighbour does, it is sought by phase correlation. Its covariance is what its pixels do pull [3]_, with what the
    shape cannot follow. A node that its neighbours contradict, each seen with its gradient, is not valid.

    Parameters
    ----------
    prev, next : ndarray, shape (height, width)
        Grey frames of the same size and type: uint8, uint16 or float32. Crops are read in place.
    window_size : int, optional
        Side of the square window around each node, 8 to 256 pixels. It is the gauge length of the gradient.
    step : int, optional
        Pixels from one node to the next. As many windows as fit stand in the middle of the frame.
    shape : {"translation", "affine", "quadratic"}, optional
        How the displacement may vary over a window: not at all, linearly, or as polynomials of second degree. A
        quadratic shape follows vortices and notches that bend within a window, with some 1.5 times the noise.
    robust : bool, optional
        Whether pixels that do not follow the others of their window lose their weight: particles that enter or leave
        the light sheet, cracks, glare.
    mask, next_mask : ndarray of bool, shape (height, width), optional
        True where a pixel of `prev`, and of `next`, counts. Windows use the pixels that count and whose targets do, a
        quarter of them at least.
    initial : array_like, shape (2,) or (ny, nx, 2), or Grid, optional
        Displacements (u, v) to begin with, of all nodes or of each; NaN where none is known.
    illumination : {"none", "offset", "gain_offset"}, optional
        What may change in the light of a window.
    max_displacement : float, optional
        The longest displacement along each axis, in pixels; by default any.
    scale_m_px, dt_s : float, optional
        Metres a pixel, and seconds between the frames: what `Grid.velocity_m_s` and files in such units need.
    camera : Camera, optional
        Its lens distortion is taken out of displacement, gradient and covariance; `x` and `y` stay places in the
        picture.

    Returns
    -------
    Grid
        Of no nodes where not one window fits.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If the arguments do not fit together; the message says which and how.

    References
    ----------
    .. [1] S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004,
       https://doi.org/10.1023/B:VISI.0000011205.11775.fd.
    .. [2] B. Pan, "Reliability-guided digital image correlation for image deformation measurement", Applied Optics
       2009, https://doi.org/10.1364/AO.48.001535.
    .. [3] H. White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 1980,
       https://doi.org/10.2307/1912934.

    Examples
    --------
    >>> import rsflow
    >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0.02 * x, 0 * y + 1.5), size=(128, 96), seed=1)
    >>> grid = rsflow.displacement_grid(scene.prev, scene.next)
    >>> grid.u.shape, bool(grid.valid.all())
    ((5, 7), True)
    >>> bool(abs(grid.gradient[..., 0, 0] - 0.02).max() < 0.002), bool(abs(grid.v - 1.5).max() < 0.02)
    (True, True)
    """
    options = knobs.grid(
        window_size=window_size,
        step=step,
        shape=shape,
        robust=robust,
        illumination=illumination,
        max_displacement=max_displacement,
    )
    scale = _checks.number_or_none("scale_m_px", scale_m_px, above=0, of="metres")
    dt = _checks.number_or_none("dt_s", dt_s, above=0, of="seconds")
    before, after = _checks.pair(prev, next)
    if camera is not None:
        _checks.instance("camera", camera, Camera, "a Camera, or None")
    where = _checks.mask_or_none("mask", mask, before.shape)
    where_next = _checks.mask_or_none("next_mask", next_mask, before.shape)
    rows, columns = (_count(side, options["window_size"], options["step"]) for side in before.shape)
    start = _start(initial, (rows, columns) if rows and columns else (0, 0))
    found = _core.displacement_grid(before, after, start, where, where_next, options)
    x, y = _places(found["first"], found["status"].shape, options["step"])
    grid = Grid(
        x=x,
        y=y,
        raw=found["raw"],
        gradient=found["gradient"],
        joint_covariance=found["joint_covariance"],
        status=found["status"],
        residual=found["residual"],
        correlation=found["correlation"],
        gain=found["gain"],
        offset=found["offset"],
        window_size=options["window_size"],
        step=options["step"],
        shape=options["shape"],
        size=(before.shape[1], before.shape[0]),
        scale_m_px=scale,
        dt_s=dt,
    )
    return grid if camera is None else without_distortion(grid, camera)


def _count(size: int, window: int, step: int) -> int:
    """Count the windows that fit along a side."""
    return (size - window) // step + 1 if size >= window else 0


def _places(
    first: tuple[float, float], shape: tuple[int, ...], step: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Give the places of all nodes, each of the shape (ny, nx)."""
    rows, columns = shape
    x = (first[0] + step * np.arange(columns)).astype(np.float32)
    y = (first[1] + step * np.arange(rows)).astype(np.float32)
    across, down = np.meshgrid(x, y)
    return across, down


def _start(initial: ArrayLike | Grid | None, shape: tuple[int, int]) -> NDArray[np.float32] | None:
    """Give a first guess of each node, (N, 2)."""
    if initial is None:
        return None
    if isinstance(initial, Grid):
        initial = np.stack([initial.u, initial.v], axis=-1)
    expected = f"a Grid, (2,) or {(*shape, 2)}: u and v of each node"
    found = _checks.array("initial", initial, ..., expected)
    if found.shape == (2,):
        found = np.broadcast_to(found, (*shape, 2))
    found = _checks.array("initial", found, (*shape, 2), expected)
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(found, dtype=np.float32).reshape(-1, 2)
