"""The arrays of a grid, and what follows from them alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._checks.knobs import GridShape
from .._results.status import Status
from .strain import Strain, StrainKind, strain_of

__all__ = ["GridData", "GridStatus"]

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
class GridData:
    """What `Grid` has: its arrays, and what follows from them alone."""

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
    size: tuple[int, int]
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

    def to_table(self, *, y_up: bool = False) -> dict[str, NDArray[Any]]:
        """Give the nodes as columns of equal length, for ``pandas.DataFrame``: a row for each.

        Parameters
        ----------
        y_up : bool
            As in `save`.

        Returns
        -------
        dict of str to ndarray
            ``x_px, y_px, u_px, v_px, std_u_px, std_v_px, cov_uv_px2, du_dx, du_dy, dv_dx, dv_dy, residual, correlation,
            gain, offset, status``, with a scale ``x_m, y_m``, and with a time too ``vx_m_s, vy_m_s``. What was not
            measured is NaN.

        Examples
        --------
        >>> import rsflow
        >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0 * x + 1.0, 0 * y), size=(96, 96), seed=1)
        >>> table = rsflow.displacement_grid(scene.prev, scene.next).to_table()
        >>> len(table["u_px"]), str(table["status"][0])
        (25, 'measured')
        """
        sign = -1.0 if _checks.flag("y_up", y_up) else 1.0
        gradient, _ = self._gradients()
        flat = (gradient * [[1.0, sign], [sign, 1.0]]).reshape(-1, 4)
        std = np.where(self.valid[..., None], self.std, np.nan).reshape(-1, 2)
        between = sign * np.where(self.valid, self.joint_covariance[..., 0, 1], np.nan)
        y = (self.size[1] - 1) - self.y if y_up else self.y
        found: dict[str, NDArray[Any]] = {
            "x_px": self.x.ravel(),
            "y_px": y.ravel(),
            "u_px": self.u.ravel(),
            "v_px": (np.float32(sign) * self.v).ravel(),
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
        if self.scale_m_px is not None:
            found |= {f"{axis}_m": found[f"{axis}_px"] * np.float64(self.scale_m_px) for axis in "xy"}
            if self.dt_s is not None:
                per_s = self.scale_m_px / self.dt_s
                found |= {
                    f"v{axis}_m_s": found[f"{name}_px"] * np.float64(per_s)
                    for axis, name in zip("xy", "uv", strict=True)
                }
        return found

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
