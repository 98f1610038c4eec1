"""Parallax: what a scene with depth does when the camera travels, told from things that move.

Against the motion of a plane, everything that stands still moves along lines through one point, the epipole (M. Irani
and P. Anandan, "A unified approach to moving object detection in 2D and 3D scenes", PAMI 1998). What moves along such a
line by itself, the way that depth does, cannot be told from depth.

docs/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from .. import _core
from . import homography as _homography

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .reduction import Reduction

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Parallax:
    """What is believed of the parallax of a scene; it grows and fades over frames.

    Attributes
    ----------
    epipole : tuple of float
        In the next picture, homogeneous and of unit length.
    sign : float, optional
        Which way still things move against the plane: 1 away from the epipole, -1 towards it; None where both were
        seen or too few.
    belief : float
        Logarithm of the odds that the scene has depth.
    depth : bool
        Whether the scene is believed to have depth.
    believed : bool
        Whether that tells in this frame, in which the camera travelled.
    seen : tuple of float
        Things seen lately that moved away from the epipole, and towards it.
    turned : tuple of float
        The angle in radians by which things turned lately from where the plane's motion has the epipole, and its
        inverse variance.
    travel : tuple of float
        The plane's own motion by the camera's travel at (x, y): ``travel[0] + travel[1] x + travel[2] y`` times the way
        to the epipole.
    """

    epipole: tuple[float, ...]
    sign: float | None
    belief: float
    depth: bool
    believed: bool
    seen: tuple[float, ...]
    turned: tuple[float, ...]
    travel: tuple[float, ...]

    def _parts(
        self,
    ) -> tuple[list[float], float | None, float, bool, bool, list[float], list[float], list[float]]:
        seen, turned, travel = list(self.seen), list(self.turned), list(self.travel)
        return list(self.epipole), self.sign, self.belief, self.depth, self.believed, seen, turned, travel

    def unexplained(self, residual: F32, small: Reduction) -> F32:
        """Give the part of a residual motion, of a frame that was reduced so, that depth cannot explain."""
        k = small.factor
        epipole = tuple(float(part) for part in small.point(np.array(self.epipole)))
        # Pixel centres: x = X k + (k - 1) / 2; the way to the epipole is shorter by the factor, as motions are.
        at, by_x, by_y = self.travel
        travel = (at + (by_x + by_y) * (k - 1) / 2, by_x * k, by_y * k)
        reduced = dataclasses.replace(self, epipole=epipole, travel=travel)
        return _core.unexplained_motion(residual, reduced._parts())


def find(
    points: F64,
    vectors: F64,
    covariance: F64 | None,
    camera: _homography.CameraMotion,
    before: Parallax | None,
) -> Parallax | None:
    """Look for parallax among vectors that a camera's motion does not explain; None before there was anything to tell.

    Parameters
    ----------
    points, vectors : (n, 2) float64
        Where the motion vectors stand, and they.
    covariance : (n, 2, 2) float64, optional
        Of the vectors, in squared pixels.
    camera : CameraMotion
        The motion of the plane.
    before : Parallax, optional
        What was believed after the frame before.
    """
    found = _core.find_parallax(
        _homography.rows(points, vectors, covariance),
        camera.homography.tolist(),
        camera.sigma_px,
        None if before is None else before._parts(),
    )
    if found is None:
        return None
    epipole, sign, belief, depth, believed, seen, turned, travel = found
    return Parallax(tuple(epipole), sign, belief, depth, believed, tuple(seen), tuple(turned), tuple(travel))
