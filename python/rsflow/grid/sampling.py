"""A grid between its nodes: displacement at any place, and the extension of a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._display import fields

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Extension", "Samples", "sampled"]

F64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Samples:
    """Displacement at some places; NaN, with infinite variance, where the nodes around one are not valid.

    Attributes
    ----------
    displacement : ndarray of float64, shape (N, 2)
        u and v in pixels.
    gradient : ndarray of float64, shape (N, 2, 2)
        ``[[du/dx, du/dy], [dv/dx, dv/dy]]``.
    joint_covariance : ndarray of float64, shape (N, 6, 6)
        Of u, v, du/dx, du/dy, dv/dx, dv/dy, as large as those of the nodes around: their windows overlap.

    Examples
    --------
    >>> import rsflow
    >>> scene = rsflow.synthetic.speckle_pair(lambda x, y: (0.02 * x, 0 * y), size=(128, 96), seed=1)
    >>> found = rsflow.displacement_grid(scene.prev, scene.next).at([(60.0, 40.0)])
    >>> bool(abs(found.displacement[0, 0] - 1.2) < 0.02)
    True
    """

    displacement: F64
    gradient: F64
    joint_covariance: F64

    __repr__ = fields

    @property
    def covariance(self) -> F64:
        """Covariance of u and v in square pixels, shape (N, 2, 2)."""
        return self.joint_covariance[:, :2, :2]


@dataclass(frozen=True)
class Extension:
    """How much longer a line between two places has become, as an extensometer tells.

    Attributes
    ----------
    length_px : float
        Before.
    strain : float
        Its growth over that; NaN where one of its ends is not known.
    std : float
        Standard deviation of the strain.
    """

    length_px: float
    strain: float
    std: float

    def __repr__(self) -> str:
        from .._display import measured

        return f"Extension({measured(self.strain, self.std)} over {self.length_px:.1f} px)"


def sampled(
    x: F64, y: F64, displacement: F64, gradient: F64, covariance: F64, valid: NDArray[np.bool_], points: F64
) -> Samples:
    """Blend what the four nodes around each point say of it, each with its gradient.

    Half of their weight must be valid. `x` and `y` are those of columns and rows. It is exact for polynomials of second
    degree.
    """
    count = len(points)
    found = Samples(np.full((count, 2), np.nan), np.full((count, 2, 2), np.nan), np.full((count, 6, 6), np.nan))
    # What is not valid has no weight, and no value that could spread.
    displacement, gradient, covariance = (
        np.where(valid.reshape(*valid.shape, *(1,) * (part.ndim - 2)), part, 0.0)
        for part in (displacement, gradient, covariance)
    )
    slopes = np.where(np.isfinite(gradient), gradient, 0.0)
    total = np.zeros(count)
    sums = [np.zeros_like(part) for part in (found.displacement, found.gradient, found.joint_covariance)]
    # What slopes add on the way to the point, as far as it is between the nodes, and beyond them.
    between, beyond = np.zeros((count, 2)), np.zeros((count, 2))
    held = np.stack(
        [np.clip(points[:, k], c.min(), c.max()) if c.size else points[:, k] for k, c in enumerate((x, y))], -1
    )
    for column, across in _corners(x, points[:, 0]):
        for row, down in _corners(y, points[:, 1]):
            at = (np.maximum(row, 0), np.maximum(column, 0))
            weight = np.where((column >= 0) & (row >= 0) & valid[at], across * down, 0.0)
            total += weight
            for into, part in zip(sums, (displacement[at], gradient[at], covariance[at]), strict=True):
                into += weight.reshape(-1, *(1,) * (part.ndim - 1)) * part
            node = np.stack([x[at[1]], y[at[0]]], axis=-1)
            for into, offset in ((between, held - node), (beyond, points - held)):
                way = np.where(weight[:, None] > 0, offset, 0.0)
                into += weight[:, None] * np.einsum("nij,nj->ni", slopes[at], way)
    # Values alone miss a bend on one side, values with slopes by as much on the other; of some nodes alone slopes lead.
    sums[0] += np.where(total[:, None] > 1.0 - 1e-9, 0.5, 1.0) * between + beyond
    known = total > 0.5
    for into, part in zip((found.displacement, found.gradient, found.joint_covariance), sums, strict=True):
        into[known] = part[known] / total[known].reshape(-1, *(1,) * (part.ndim - 1))
    found.joint_covariance[~known] = np.where(np.eye(6, dtype=bool), np.inf, 0.0)
    return found


def _corners(places: F64, at: F64) -> Iterator[tuple[NDArray[np.intp], F64]]:
    """Give the nodes before and after each coordinate, and their shares; -1 more than half a step outside."""
    if not len(places):
        return
    if len(places) < 2:
        near = np.abs(at - places[0]) < 1e-3
        yield np.where(near, 0, -1), np.ones(len(at))
        return
    step = places[1] - places[0]
    place = (at - places[0]) / step
    inside = (place >= -0.5) & (place <= len(places) - 0.5)
    first = np.clip(np.floor(np.where(inside, place, 0.0)).astype(np.intp), 0, len(places) - 2)
    share = np.clip(place - first, 0.0, 1.0)
    share = np.where(inside, share, 0.0)
    yield np.where(inside, first, -1), 1.0 - share
    yield np.where(inside, first + 1, -1), share
