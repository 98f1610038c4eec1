"""The calibration of a camera from corners: from several starts, with deviations, or the reason why there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import distortion
from ..errors import CalibrationError
from .bundle_adjustment import Fit, Problem, fit, residuals_of, weighted
from .deviations import deviations
from .lens_doubts import doubts
from .multi_start import MOST_CORNERS, STEPS, best, ends, thinned

__all__ = ["Solution", "again", "solve"]

Array = NDArray[np.float64]


# Relative deviation of f from which the views cannot be said to determine it.
UNDETERMINED = 0.1
# Views whose normals lie within so much of each other are parallel: what tells f from distance is then less than what
# the paper's waves make. And from how much on the tilt is not to blame.
PARALLEL_RAD = math.radians(2.0)
_TILTED_RAD = math.radians(15.0)
# Starts as good as the best, to this many times the sigma squared, must agree within so many deviations.
_AS_GOOD, _AGREE = 9.0, 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Parameters in the order fx, fy, cx, cy, then the distortion coefficients."""

    values: Array
    covariance: Array
    rms: float
    # Deviation of one coordinate of a corner that fits, in pixels.
    sigma: float
    rotations: list[Array]
    residuals: list[Array]
    # How far the parameters move when a view is left out, (views, parameters).
    influence: Array
    # Largest angle between the board's normals in two views.
    span_rad: float
    # Height of the board's bend over its plane, at most, in metres.
    bend_m: float
    problem: Problem
    found: Fit

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter."""
        std: Array = np.sqrt(np.diag(self.covariance))
        return std


def solve(
    board: list[NDArray[np.float32]],
    corners: list[NDArray[np.float32]],
    size: tuple[int, int],
    coefficients: int,
    square_pixels: bool,
    *,
    ids: list[NDArray[np.int64]] | None = None,
    model: str = "pinhole",
) -> Solution:
    """Calibrate from corners on the board, (N, 3) each, and in the pictures, (N, 2) each.

    Raises
    ------
    CalibrationError
        If the views do not determine a camera; the message says what was measured, what is needed and what to do.
    """
    numbers = ids if ids is not None else [np.arange(len(points)) for points in board]
    whole = Problem.of(
        board, corners, numbers, size=size, model=model, coefficients=coefficients, square_pixels=square_pixels
    )
    problem = thinned(whole, MOST_CORNERS)
    with np.errstate(all="ignore"):
        begun = ends(problem)
        if not begun:
            raise CalibrationError(f"the views do not determine a camera: no {model} camera sees the board so")
        found = best(problem, begun)
        span = _span(found.rotations)
        if span < PARALLEL_RAD:
            raise CalibrationError(f"the views do not determine a camera: {_what_to_do(problem, found, span)}")
        worth = deviations(problem, found)
    focal, std = float(found.camera[0]), math.sqrt(worth.covariance[0, 0])
    if not (np.isfinite(worth.covariance).all() and std < UNDETERMINED * focal):
        raise CalibrationError(
            f"the {len(board)} views do not determine the focal length: got {focal:.1f} +- {std:.1f} px; "
            f"{_what_to_do(problem, found, span)}"
        )
    _agree(begun, found, std, span)
    _unfolded(problem, found)
    residuals = [part[there] for part, there in zip(residuals_of(whole, found), whole.there, strict=True)]
    return Solution(
        found.camera,
        worth.covariance,
        float(np.sqrt((np.concatenate(residuals) ** 2).sum(axis=1).mean())),
        found.sigma,
        list(found.rotations),
        residuals,
        worth.influence,
        span,
        float(np.abs(found.shape[:3]).max()) * problem.half,
        problem,
        found,
    )


def again(solution: Solution, corners: list[NDArray[np.float32]]) -> Array:
    """Give the parameters with other corners in place of those of a solution."""
    seen = solution.problem.seen.copy()
    for view, points in enumerate(corners):
        seen[view, : len(points)] = points
    problem = replace(solution.problem, seen=seen)
    start = replace(solution.found, residuals=residuals_of(problem, solution.found))
    return fit(problem, weighted(problem, start), steps=STEPS).camera


def _what_to_do(problem: Problem, found: Fit, span: float) -> str:
    """Say what was measured, what is needed and what to do: of the tilt only where the tilt is to blame."""
    views = len(problem.board)
    measured = f"the board's normals in {views} views lie within {math.degrees(span):.1f} degrees of each other"
    if span < _TILTED_RAD:
        return (
            f"{measured}; it takes more than {math.degrees(PARALLEL_RAD):.0f}, and 20 to 45 for a good result: tilt "
            "the board by 20 to 45 degrees, in different directions"
        )
    said = doubts(problem, found).said
    if said:
        return said[0]
    return (
        f"{measured}, which is enough; but {views} views are too few or too alike for {problem.coefficients} "
        "coefficients: add views, to 10 or 20, in all parts of the picture, or take fewer coefficients"
    )


def _agree(begun: list[Fit], found: Fit, std: float, span: float) -> None:
    """Refuse where starts end at other focal lengths with sums of squares that are as good."""
    limit = begun[0].cost + _AS_GOOD * found.sigma**2
    focals = [float(end.camera[0]) for end in begun if end.cost <= limit]
    if max(focals) - min(focals) > max(_AGREE * std, 0.01 * focals[0]):
        raise CalibrationError(
            f"the views do not determine a camera: focal lengths from {min(focals):.0f} to {max(focals):.0f} px "
            f"explain them equally well; the board's normals lie within {math.degrees(span):.1f} degrees of each "
            "other: tilt the board by 20 to 45 degrees, in different directions, near and far"
        )


def _unfolded(problem: Problem, found: Fit) -> None:
    """Refuse a lens that maps two rays to one corner of the views."""
    rays = distortion.invert(
        problem.model,
        found.camera[4:].tolist(),
        (problem.seen[problem.there] - found.camera[2:4]) / found.camera[:2],
    )
    lost = int(np.count_nonzero(~np.isfinite(rays).all(axis=1)))
    if lost:
        raise CalibrationError(
            f"the views do not determine a camera: with {problem.coefficients} coefficients of the {problem.model} "
            f"model the picture folds over itself at {lost} of {len(rays)} corners: take fewer coefficients, or the "
            f"model {'pinhole' if problem.model == 'fisheye' else 'fisheye'} if the lens is one"
        )


def _span(rotations: Array) -> float:
    normals = rotations[:, :, 2]
    # Through the chord: an arc cosine has no digits left for small angles.
    chord = np.linalg.norm(normals[:, None] - normals[None], axis=2).max()
    return 2.0 * math.asin(min(1.0, float(chord) / 2.0))
