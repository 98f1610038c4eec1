"""Strain from the gradient of displacement, with its deviation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .._display import fields

__all__ = ["Strain", "StrainKind", "strain_of"]

StrainKind = Literal["small", "green", "hencky"]
F64 = NDArray[np.float64]

# Half the step over which Hencky's strain is derived from the gradient: its error is of the square.
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Strain:
    """Strain of each node of a grid, along x (right) and y (down) of the picture; NaN where a node is not valid.

    Attributes
    ----------
    kind : {"small", "green", "hencky"}
        Half the sum of gradient and its transpose; Green and Lagrange's; or the logarithm of the right stretch.
    xx, yy, xy : ndarray of float64, shape (ny, nx)
        Its components; `xy` is the tensor's, half of the engineering shear strain.
    std_xx, std_yy, std_xy : ndarray of float64, shape (ny, nx)
        Their standard deviations.
    gauge_length_px : float
        Side of the window that each is a mean over.

    Examples
    --------
    >>> import rsflow
    >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0.02 * x, 0 * y), size=(96, 96), seed=1)
    >>> strain = rsflow.displacement_grid(scene.prev, scene.next).strain("green")
    >>> bool(abs(strain.xx.mean() - (0.02 + 0.02**2 / 2)) < 5e-4), strain.gauge_length_px
    (True, 32.0)
    """

    kind: StrainKind
    xx: F64
    yy: F64
    xy: F64
    std_xx: F64
    std_yy: F64
    std_xy: F64
    gauge_length_px: float

    __repr__ = fields

    @property
    def principal(self) -> tuple[F64, F64, F64]:
        """The larger and the smaller principal strain, and the angle of the first from x towards y, in radians."""
        middle, half = 0.5 * (self.xx + self.yy), 0.5 * (self.xx - self.yy)
        radius = np.hypot(half, self.xy)
        return middle + radius, middle - radius, 0.5 * np.arctan2(self.xy, half)


def strain_of(kind: StrainKind, gradient: F64, covariance: F64, gauge_length_px: float) -> Strain:
    """Give the strain of gradients (ny, nx, 2, 2) whose covariances (ny, nx, 4, 4) are row by row.

    >>> turned = np.array([[[[np.cos(1) - 1, -np.sin(1)], [np.sin(1), np.cos(1) - 1]]]])
    >>> found = strain_of("hencky", turned, np.eye(4)[None, None] * 1e-8, 32.0)
    >>> bool(abs(found.xx) < 1e-12), bool(abs(found.std_xx - 1e-4) < 1e-8)
    (True, True)
    """
    components = _tensor(kind, gradient)
    steps = _STEP * np.eye(4).reshape(4, 2, 2)
    # The derivative of the components (.., 3) by each of the four derivatives of displacement, (.., 3, 4).
    rate = np.stack([(_tensor(kind, gradient + s) - _tensor(kind, gradient - s)) / (2 * _STEP) for s in steps], -1)
    with np.errstate(invalid="ignore"):
        variance = np.einsum("...ij,...jk,...ik->...i", rate, covariance, rate)
    std = np.sqrt(variance)
    xx, yy, xy = (components[..., k] for k in range(3))
    std_xx, std_yy, std_xy = (std[..., k] for k in range(3))
    return Strain(kind, xx, yy, xy, std_xx, std_yy, std_xy, gauge_length_px)


def _tensor(kind: StrainKind, gradient: F64) -> F64:
    """Give xx, yy and xy of the strain, (.., 3)."""
    if kind == "small":
        tensor = 0.5 * (gradient + np.swapaxes(gradient, -1, -2))
        return _three(tensor)
    deformation = gradient + np.eye(2)
    right = np.swapaxes(deformation, -1, -2) @ deformation
    if kind == "green":
        return _three(0.5 * (right - np.eye(2)))
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(right).all(axis=(-1, -2)))
    values, vectors = np.linalg.eigh(np.where(finite[..., None, None], right, np.eye(2)))
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithm = 0.5 * np.log(values)
        tensor = (vectors * logarithm[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return _three(np.where(finite[..., None, None], tensor, np.nan))


def _three(tensor: F64) -> F64:
    return np.stack([tensor[..., 0, 0], tensor[..., 1, 1], tensor[..., 0, 1]], axis=-1)
