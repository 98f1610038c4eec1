"""What the parameters of a calibration are worth: their covariance, with the poses and the board's shape unknown too.

Errors of corners are not independent: those of one view share the blur and the light, those of one corner of the board
share its print. So beside the plain covariance of least squares two others are computed by the jackknife, one that
leaves out a view at a time (Bell and McCaffrey 2002), one that leaves out a part of the board in all views (both ways
to group together: Cameron, Gelbach and Miller 2011), and what they say more is added. A board that is hardly tilted
leaves the focal length open in a way that no tangent shows, many coefficients the principal point: the fit is repeated
with other values of these held, and the deviation widened to what the sum of squares allows.

docs/explanation/algorithms.md, section "Calibration: calibrate".
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .bundle_adjustment import Fit, Problem, fit, linearised, priors

__all__ = ["Deviations", "deviations"]

Array = NDArray[np.float64]

# Parts of the board along each axis: what is wrong with its print or its plane is alike within them in all views.
_BLOCKS = 3
# Least share of a pose that is taken to be known without a part.
_LEFT = 0.1
# Steps of each fit with a parameter held.
_STEPS = 30
# How far the held parameter is off, in deviations, and at most as a share of the focal length.
_OFF, _OFF_MOST = 2.0, 0.5


@dataclass(frozen=True, eq=False)
class Deviations:
    """Covariance (q, q) of fx, fy, cx, cy and the distortion; how far they move without each view (V, q).

    `widened` is how much more the focal length is open than its tangent shows.
    """

    covariance: Array
    influence: Array
    widened: float

    @property
    def std(self) -> Array:
        """Standard deviation of each parameter."""
        std: Array = np.sqrt(np.diag(self.covariance))
        return std


def deviations(problem: Problem, found: Fit) -> Deviations:
    """Find the deviations at a fit."""
    residual, inner, pose = linearised(problem, found)
    views = len(residual)
    root = np.sqrt(found.weights)[..., None]
    r = (root * residual).reshape(views, -1)
    J = (root[..., None] * inner).reshape(views, r.shape[1], -1)
    P = (root[..., None] * pose).reshape(views, r.shape[1], 6)
    basis = np.linalg.qr(P)[0]
    reduced = J - basis @ (basis.transpose(0, 2, 1) @ J)
    own = np.einsum("vik,vil->vkl", reduced, reduced)
    total = own.sum(axis=0) + np.diag(priors(problem, found) ** 2)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = _inverse(total / np.outer(scale, scale)) / np.outer(scale, scale)
    plain = found.sigma**2 * inverse
    scores = np.einsum("vik,vi->vk", reduced, r)
    moved = _left_out(total, own, scores, scale)
    by_part = _left_out(total, *_parts(problem, reduced, r, basis), scale)
    # Both are themselves uncertain: they may raise the plain covariance, never lower it.
    excess = sum(np.maximum(np.diag(_spread(part)) / np.diag(plain) - 1.0, 0.0) for part in (moved, by_part))
    factor = np.sqrt(1.0 + excess)
    covariance = plain * np.outer(factor, factor)
    covariance *= _few(min(len(moved), len(by_part))) ** 2
    count = problem.inner
    covariance, moved = covariance[:count, :count], moved[:, :count]
    widened = 1.0
    # With the weights of the last round its minimum is a little elsewhere.
    base = fit(problem, found, steps=_STEPS, rounds=0)
    for name, index in (("f", 0), ("cx", 2 - problem.square_pixels), ("cy", 3 - problem.square_pixels)):
        more = _widened(problem, base, index, math.sqrt(plain[index, index]))
        widened = more if name == "f" else widened
        along = covariance[:, index] / math.sqrt(covariance[index, index])
        covariance = covariance + (more**2 - 1.0) * np.outer(along, along)
    if problem.square_pixels:
        order = [0, *range(count)]
        covariance, moved = covariance[np.ix_(order, order)], moved[:, order]
    return Deviations(covariance, moved, widened)


def _left_out(total: Array, own: Array, scores: Array, scale: Array) -> Array:
    """How far all parameters move when each group is left out, (G, q), in the linearised problem."""
    moved = np.zeros_like(scores)
    for group, (information, score) in enumerate(zip(own, scores, strict=True)):
        rest = (total - information) / np.outer(scale, scale)
        moved[group] = -_inverse(rest) @ (score / scale) / scale
    return moved


def _inverse(matrix: Array) -> Array:
    """Inverse of a scaled normal matrix; what rounding leaves of a direction without information is all but free."""
    values, vectors = np.linalg.eigh(matrix)
    inverse: Array = (vectors / np.maximum(values, 1e-13)) @ vectors.T
    return inverse


def _spread(moved: Array) -> Array:
    count = len(moved)
    off = moved - moved.mean(axis=0)
    spread: Array = (count - 1) / count * off.T @ off
    return spread


def _parts(problem: Problem, reduced: Array, r: Array, basis: Array) -> tuple[Array, Array]:
    """Information (G, q, q) and scores (G, q) of each part of the board, over all views.

    The residuals of a part are those that it would have if the pose of each view were found without it: a part at the
    edge turns the board its own way.
    """
    views = len(r)
    flat = (problem.board - problem.centre)[..., :2] / problem.half
    cells = np.clip(((flat + 1.0) * (_BLOCKS / 2)).astype(int), 0, _BLOCKS - 1)
    part = np.where(problem.there, cells[..., 1] * _BLOCKS + cells[..., 0], -1)
    information, scores = [], []
    for number in np.unique(part[problem.there]):
        rows = np.repeat((part == number)[..., None], 2, axis=2).reshape(views, -1, 1)
        own, pose, off = reduced * rows, basis * rows, r * rows[..., 0]
        left = np.eye(6) - pose.transpose(0, 2, 1) @ pose
        values, vectors = np.linalg.eigh(left)
        inverse = (vectors / np.maximum(values, _LEFT)[:, None, :]) @ vectors.transpose(0, 2, 1)
        off = off + np.einsum("vik,vkl,vjl,vj->vi", pose, inverse, pose, off)
        information.append(np.einsum("vik,vil->kl", own, own))
        scores.append(np.einsum("vik,vi->k", own, off))
    return np.array(information), np.array(scores)


def _few(groups: int) -> float:
    """Widening for few groups, whose spread is itself uncertain: Student's 95 % with a degree less than there are."""
    freedom = max(groups - 1, 1)
    # Cornish and Fisher's expansion of Student's quantile about the normal one, good to 2 % from 2 degrees on.
    z = 1.96
    quantile = z + (z**3 + z) / (4 * freedom) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * freedom**2)
    return quantile / z


def _widened(problem: Problem, base: Fit, index: int, std: float) -> float:
    """How much wider than the tangent shows one parameter is open, from fits with it held at either side."""
    place = index + (problem.square_pixels and index > 0)
    focal = float(base.camera[0])
    off = min(_OFF * std, _OFF_MOST * focal)
    most = 1.0
    for sign in (-1.0, 1.0):
        camera, translations = base.camera.copy(), base.translations
        camera[place] += sign * off
        if index == 0:
            # The board goes away as the focal length grows.
            camera[1] *= camera[0] / focal
            translations = translations * np.array([1.0, 1.0, camera[0] / focal])
        start = replace(base, camera=camera, translations=translations)
        other = fit(problem, start, steps=_STEPS, rounds=0, held=(index,))
        rise = max(other.cost - base.cost, 1e-12) / base.sigma**2
        most = max(most, off / std / math.sqrt(rise))
    return most
