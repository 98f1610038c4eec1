"""What was measured on a grid."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks, _display
from .._checks.knobs import GridShape
from .._results.status import Status
from ..errors import OptionError
from .filling import filled
from .strain import Strain, StrainKind, strain_of

__all__ = ["Grid", "GridStatus", "Replaced"]

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


class GridStatus(Status):
    """Whether a node was measured, or else why not. The values are those of lk-core.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> blank = np.full((64, 64), 90, np.uint8)
    >>> grid = rsflow.displacement_grid(blank, blank)
    >>> bool(grid.valid.any()), rsflow.GridStatus(grid.status[0, 0]).name
    (False, 'LOW_TEXTURE')
    """

    MEASURED = 0, "Measured: displacement and covariance hold."
    NOT_FOUND = 1, "Neither a neighbour nor a search led to a displacement that explains the window."
    LOW_SUPPORT = 2, "Less than a quarter of the window counts in both frames: the rest is outside, masked, not finite."
    LOW_TEXTURE = 3, "The window has too little texture to tell its motion."
    NOT_CONVERGED = 4, "The steps did not come to rest, or went further than `max_displacement`."
    LOW_CORRELATION = 5, "What was found does not look like what was sought."
    UNSURE = 6, "The standard deviation of the displacement is above 0.3 pixels."
    CONTRADICTED = 7, "The neighbours, each seen with its gradient, say otherwise."


@dataclass(frozen=True, eq=False)
class Replaced:
    """Displacements of all nodes: measured where they are valid, else from the valid ones around them.

    Attributes
    ----------
    u, v : ndarray of float32, shape (ny, nx)
        Displacement in pixels; NaN if no node is valid.
    replaced : ndarray of bool, shape (ny, nx)
        Where it was not measured.

    Examples
    --------
    >>> import rsflow
    >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0 * x + 1.0, 0 * y), size=(96, 96), seed=1)
    >>> rsflow.displacement_grid(scene.prev, scene.next).replaced().replaced.any()
    np.False_
    """

    u: F32
    v: F32
    replaced: NDArray[np.bool_]

    __repr__ = _display.fields


@dataclass(frozen=True, eq=False)
class Grid:
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

    x: F32
    y: F32
    raw: F32
    gradient: F32
    joint_covariance: F32
    status: NDArray[np.uint8]
    residual: F32
    correlation: F32
    gain: F32
    offset: F32
    window_size: int
    step: int
    shape: GridShape
    scale_m_px: float | None = None
    dt_s: float | None = None

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Which nodes were measured, shape (ny, nx)."""
        valid: NDArray[np.bool_] = self.status == np.uint8(GridStatus.MEASURED)
        return valid

    @cached_property
    def u(self) -> F32:
        """Displacement along x in pixels, shape (ny, nx); NaN where a node is not valid."""
        return np.where(self.valid, self.raw[..., 0], np.float32(np.nan))

    @cached_property
    def v(self) -> F32:
        """Displacement along y, down, in pixels, shape (ny, nx); NaN where a node is not valid."""
        return np.where(self.valid, self.raw[..., 1], np.float32(np.nan))

    @property
    def covariance(self) -> F32:
        """Covariance of u and v in square pixels, shape (ny, nx, 2, 2); infinite on the diagonal unless valid."""
        return self.joint_covariance[..., :2, :2]

    @property
    def std(self) -> F32:
        """Standard deviations of u and v in pixels, shape (ny, nx, 2)."""
        return np.sqrt(self.joint_covariance[..., [0, 1], [0, 1]])

    @property
    def gauge_length_px(self) -> float:
        """Pixels that each gradient is a mean over: the side of the window."""
        return float(self.window_size)

    @property
    def status_names(self) -> NDArray[np.str_]:
        """The statuses by name, shape (ny, nx)."""
        return np.array([status.name for status in GridStatus])[self.status]

    @property
    def vorticity(self) -> F64:
        """dv/dx - du/dy, shape (ny, nx), of one interval: twice the angle, from x towards y, of small turns."""
        return self._combined((0.0, -1.0, 1.0, 0.0))[0]

    @property
    def vorticity_std(self) -> F64:
        """Standard deviation of the vorticity, shape (ny, nx)."""
        return self._combined((0.0, -1.0, 1.0, 0.0))[1]

    @property
    def divergence(self) -> F64:
        """du/dx + dv/dy, shape (ny, nx), of one interval."""
        return self._combined((1.0, 0.0, 0.0, 1.0))[0]

    @property
    def divergence_std(self) -> F64:
        """Standard deviation of the divergence, shape (ny, nx)."""
        return self._combined((1.0, 0.0, 0.0, 1.0))[1]

    @property
    def velocity_m_s(self) -> F64:
        """Velocity along x and y in metres a second, shape (ny, nx, 2); needs `scale_m_px` and `dt_s`."""
        if self.scale_m_px is None or self.dt_s is None:
            known = f"scale_m_px={self.scale_m_px}, dt_s={self.dt_s}"
            raise OptionError(f"velocity_m_s: got {known}, expected both to be given to displacement_grid")
        return np.stack([self.u, self.v], axis=-1).astype(np.float64) * (self.scale_m_px / self.dt_s)

    def strain(self, kind: StrainKind = "small") -> Strain:
        """Give the strain of each node, with its deviation.

        Parameters
        ----------
        kind : {"small", "green", "hencky"}
            Small strain, which a turn changes; Green and Lagrange's; or Hencky's, the logarithm of the stretch.

        Returns
        -------
        Strain

        Examples
        --------
        >>> import rsflow
        >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0.01 * x, 0 * y), size=(96, 96), seed=1)
        >>> strain = rsflow.displacement_grid(scene.prev, scene.next).strain()
        >>> bool(abs(strain.xx - 0.01).max() < 0.002), bool(strain.std_xx.max() < 0.001)
        (True, True)
        """
        kind = _checks.choice("kind", kind, get_args(StrainKind))
        gradient, covariance = self._gradients()
        return strain_of(kind, gradient, covariance, self.gauge_length_px)

    def replaced(self) -> Replaced:
        """Give displacements of all nodes: those that are not valid from the valid ones around them.

        Each is the mean of its four neighbours, as a membrane hangs between what was measured.

        Returns
        -------
        Replaced
        """
        u, v = (filled(part, self.valid) for part in (self.raw[..., 0], self.raw[..., 1]))
        return Replaced(u, v, ~self.valid)

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Give the nodes as columns of equal length, for ``pandas.DataFrame``: a row for each.

        Returns
        -------
        dict of str to ndarray
            ``x_px, y_px, u_px, v_px, std_u_px, std_v_px, cov_uv_px2, du_dx, du_dy, dv_dx, dv_dy, residual, correlation,
            gain, offset, status``. What was not measured is NaN.

        Examples
        --------
        >>> import rsflow
        >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0 * x + 1.0, 0 * y), size=(96, 96), seed=1)
        >>> table = rsflow.displacement_grid(scene.prev, scene.next).to_table()
        >>> len(table["u_px"]), str(table["status"][0])
        (25, 'measured')
        """
        gradient, _ = self._gradients()
        flat = gradient.reshape(-1, 4)
        std = np.where(self.valid[..., None], self.std, np.nan).reshape(-1, 2)
        between = np.where(self.valid, self.joint_covariance[..., 0, 1], np.nan)
        return {
            "x_px": self.x.ravel(),
            "y_px": self.y.ravel(),
            "u_px": self.u.ravel(),
            "v_px": self.v.ravel(),
            "std_u_px": std[:, 0],
            "std_v_px": std[:, 1],
            "cov_uv_px2": between.ravel(),
            **{name: flat[:, k] for k, name in enumerate(("du_dx", "du_dy", "dv_dx", "dv_dy"))},
            "residual": self.residual.ravel(),
            "correlation": self.correlation.ravel(),
            "gain": self.gain.ravel(),
            "offset": self.offset.ravel(),
            "status": np.array([status.word for status in GridStatus])[self.status.ravel()],
        }

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

    def _gradients(self) -> tuple[F64, F64]:
        """Give gradients and their covariances (ny, nx, 4, 4), row by row; NaN where a node is not valid."""
        gradient = np.where(self.valid[..., None, None], self.gradient, np.nan).astype(np.float64)
        covariance = np.where(self.valid[..., None, None], self.joint_covariance[..., 2:, 2:], np.nan)
        return gradient, covariance.astype(np.float64)

    def _combined(self, weights: tuple[float, ...]) -> tuple[F64, F64]:
        """Give a sum of the derivatives and its standard deviation."""
        gradient, covariance = self._gradients()
        factors = np.array(weights)
        with np.errstate(invalid="ignore"):
            variance = np.einsum("i,...ij,j->...", factors, covariance, factors)
        return gradient.reshape(*self.status.shape, 4) @ factors, np.sqrt(variance)
