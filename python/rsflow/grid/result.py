"""What was measured on a grid."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from ..errors import OptionError
from . import files
from .data import F64, GridData
from .filling import Replaced, filled
from .plot import Quantity, plot_grid
from .sampling import Extension, Samples, sampled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

__all__ = ["Grid"]


@dataclass(frozen=True, eq=False, repr=False)
class Grid(GridData):
    """Displacement, its gradient and their covariance on a regular grid of windows.

    x runs to the right and y down, u and v along them, from the older frame to the newer one. What is not valid is NaN
    in `u` and `v` and has infinite variances; `raw` keeps what the last fit said there.

    Attributes
    ----------
    x, y : ndarray of float32, shape (ny, nx)
        Places of the nodes, the centres of their windows, in pixels.
    raw : ndarray of float32, shape (ny, nx, 2)
        Displacement (u, v) in pixels as it was found, whether it is valid or not; NaN where nothing was.
    gradient : ndarray of float32, shape (ny, nx, 2, 2)
        ``[[du/dx, du/dy], [dv/dx, dv/dy]]`` as it was found, a mean over the window; NaN for windows that only shift.
    joint_covariance : ndarray of float32, shape (ny, nx, 6, 6)
        Of u, v, du/dx, du/dy, dv/dx, dv/dy; infinite on the diagonal unless valid.
    status : ndarray of uint8, shape (ny, nx)
        A `GridStatus` for each node.
    residual : ndarray of float32, shape (ny, nx)
        Root mean square of what motion and light leave of the difference of both windows, in grey levels of the
        newer frame.
    correlation : ndarray of float32, shape (ny, nx)
        Correlation of both windows, motion and light taken out.
    gain, offset : ndarray of float32, shape (ny, nx)
        Light: ``next = gain * prev + offset`` at the node, in grey levels.
    window_size, step : int
        Side of the windows and pixels from one node to the next.
    shape : str
        How the displacement may vary over a window.
    size : (int, int)
        Width and height of the frames, in pixels.
    scale_m_px, dt_s : float or None
        Metres a pixel and seconds between the frames, if they were given.

    Examples
    --------
    >>> import rsflow
    >>> scene = rsflow.synthetic.particle_pair(lambda x, y: (-0.02 * y, 0.02 * x), size=(128, 128), seed=1)
    >>> grid = rsflow.displacement_grid(scene.prev, scene.next, scale_m_px=5e-5, dt_s=1e-3)
    >>> bool(abs(grid.vorticity - 0.04).mean() < 0.002), grid.velocity_m_s.shape
    (True, (7, 7, 2))
    >>> bool((abs(grid.u - -0.02 * grid.y) < 5 * grid.std[..., 0] + 0.01).all())
    True
    """

    @property
    def velocity_m_s(self) -> F64:
        """Velocity along x and y in metres a second, shape (ny, nx, 2); needs `scale_m_px` and `dt_s`."""
        if self.scale_m_px is None or self.dt_s is None:
            known = f"scale_m_px={self.scale_m_px}, dt_s={self.dt_s}"
            raise OptionError(f"velocity_m_s: got {known}, expected both to be given to displacement_grid")
        return np.stack([self.u, self.v], axis=-1).astype(np.float64) * (self.scale_m_px / self.dt_s)

    def replaced(self) -> Replaced:
        """Give displacements of all nodes: those that are not valid from the valid ones around them.

        Each is the mean of its four neighbours, as a membrane hangs between what was measured.

        Returns
        -------
        Replaced
        """
        u, v = (filled(part, self.valid) for part in (self.raw[..., 0], self.raw[..., 1]))
        return Replaced(u, v, ~self.valid)

    def at(self, points: ArrayLike) -> Samples:
        """Give displacement and gradient at any places, from the four nodes around each, with their gradients.

        Parameters
        ----------
        points : array_like, shape (N, 2)
            Pixels (x, y) of the older frame: probes, points of a line.

        Returns
        -------
        Samples
            NaN where the nodes around a place are not valid.
        """
        places = _checks.coordinates("points", points).astype(np.float64)
        raw, valid = self.raw.astype(np.float64), self.valid
        covariance = self.joint_covariance.astype(np.float64)
        gradient = self.gradient.astype(np.float64)
        x, y = (self.x[:1].ravel(), self.y[:, :1].ravel()) if valid.size else (self.x.ravel(), self.y.ravel())
        return sampled(x.astype(np.float64), y.astype(np.float64), raw, gradient, covariance, valid, places)

    def extension(self, a: ArrayLike, b: ArrayLike) -> Extension:
        """Give how much longer the line from `a` to `b` has become, as an extensometer tells.

        Parameters
        ----------
        a, b : array_like, shape (2,)
            Its ends (x, y) in the older frame, in pixels, at different places.

        Returns
        -------
        Extension

        Examples
        --------
        >>> import rsflow
        >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0.02 * x, 0 * y), size=(160, 96), seed=1)
        >>> found = rsflow.displacement_grid(scene.prev, scene.next).extension((30, 40), (130, 40))
        >>> bool(abs(found.strain - 0.02) < 3e-4), found.length_px
        (True, 100.0)
        """
        ends = np.stack([_checks.vector(name, end, 2, "x and y, finite") for name, end in (("a", a), ("b", b))])
        before = ends[1] - ends[0]
        length = float(np.hypot(*before))
        if length == 0:
            raise OptionError(f"b: got {ends[1].tolist()}, expected another place than a")
        found = self.at(ends)
        after = before + found.displacement[1] - found.displacement[0]
        direction = after / np.hypot(*after)
        variance = float(direction @ found.covariance.sum(axis=0) @ direction)
        strain = float(np.hypot(*after)) / length - 1.0
        return Extension(length, strain, float(np.sqrt(variance)) / length)

    def save(self, path: str | os.PathLike[str], *, y_up: bool = False) -> None:
        """Write the grid; every file says which way its axes point.

        Parameters
        ----------
        path : path
            ``.csv``; ``.parquet`` (``rsflow-motion[parquet]``); ``.nc``, NetCDF (``rsflow-motion[netcdf]``); ``.vtu``,
            VTK (``rsflow-motion[vtk]``); or ``.txt``, which OpenPIV reads: x, y, u, v, flags (1 where not valid), mask.
        y_up : bool
            Let y run up from the lowest row, and v with it, as in fluid mechanics; by default it runs down, as in
            pictures.

        Raises
        ------
        OptionError
            If the suffix is another.
        MissingExtraError
            If a library that the format needs is not installed.
        OSError
            If the file cannot be written; an older file of that name then stays.
        """
        files.save(self, files.save_path(path), y_up=_checks.flag("y_up", y_up))

    def to_xarray(self, *, y_up: bool = False) -> Dataset:
        """Give the grid as a dataset of xarray: labelled arrays over y and x, with units.

        Parameters
        ----------
        y_up : bool
            As in `save`.

        Returns
        -------
        xarray.Dataset

        Raises
        ------
        MissingExtraError
            If xarray is not installed: ``pip install 'rsflow-motion[xarray]'``.
        """
        data: Dataset = files.dataset(self, y_up=_checks.flag("y_up", y_up))
        return data

    def plot(
        self,
        what: Quantity = "speed",
        *,
        picture: NDArray[Any] | None = None,
        arrows: bool = True,
        ax: Axes | None = None,
        path: str | os.PathLike[str] | None = None,
    ) -> Axes:
        """Draw a map of one quantity with arrows of the displacement and their key.

        Parameters
        ----------
        what : str
            ``"speed"``, ``"u"``, ``"v"``, ``"std"``, ``"vorticity"``, ``"divergence"``, ``"correlation"``, small strain
            ``"xx"``, ``"yy"``, ``"xy"``, or its deviation ``"std_xx"``, ``"std_yy"``, ``"std_xy"``.
        picture : ndarray, (height, width) or (height, width, 3), optional
            What to draw on: `prev`, for one.
        arrows : bool
            Whether there are arrows.
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default in a figure of its own.
        path : path, optional
            Where to save it: ``.png``, ``.svg`` or ``.pdf``.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed: ``pip install 'rsflow-motion[plot]'``.

        Examples
        --------
        >>> import rsflow
        >>> scene = rsflow.synthetic.particle_pair(lambda x, y: (-0.02 * y, 0.02 * x), size=(96, 96), seed=1)
        >>> rsflow.displacement_grid(scene.prev, scene.next).plot("vorticity").get_xlabel()
        'x (px)'
        """
        drawn: Axes = plot_grid(self, what, picture=picture, arrows=arrows, ax=ax, path=path)
        return drawn

    def __repr__(self) -> str:
        rows, columns = self.status.shape
        nodes = int(self.valid.sum())
        text = f"Grid({columns} x {rows} nodes every {self.step} px, {self.shape} windows of {self.window_size} px, "
        text += f"{nodes} of {rows * columns} measured"
        if nodes:
            u, v = (float(np.median(part[self.valid])) for part in (self.u, self.v))
            std = float(np.sqrt(np.median(self.std[self.valid] ** 2)))
            text += f",\n     median u={u:.3f}, v={v:.3f}, std={std:.2g} px"
        return text + ")"
