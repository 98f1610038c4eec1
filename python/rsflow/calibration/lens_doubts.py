"""Signs in the residuals of a calibration that another model of the lens, or of the shutter, would fit."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .bundle_adjustment import Fit, Problem, linearised
from .multi_start import best, ends

__all__ = ["Doubts", "doubts"]

Array = NDArray[np.float64]

# Another model is named where it takes the error down to this share, by more than chance does with this many sigmas.
_BETTER, _SURE = 0.9, 6.0
# Rings of equal count in which residuals along the radius are averaged, and what their mean must exceed in sigmas of a
# coordinate and in its own deviations.
_RINGS, _TREND, _TREND_SURE = 8, 0.3, 6.0
# Share of the squares that a focal length of each view's own must explain: two zooms give 0.6 and more in most sets, a
# rolling shutter up to 0.32.
_ZOOMED = 0.45
# Share of the squares that a motion of the board in each view while the rows were read must explain.
_ROLLING = 0.4


@dataclass(frozen=True, eq=False)
class Doubts:
    """What the residuals look like, in words, and how far fx, fy, cx, cy move with the model that fits better."""

    said: tuple[str, ...]
    moved: Array


def doubts(problem: Problem, found: Fit) -> Doubts:
    """Say what the residuals look like, where they do not look like noise."""
    with np.errstate(all="ignore"):
        other = _other_model(problem, found)
        said = _zoomed(problem, found) or _rolling(problem, found) or _radial(problem, found)
        return other or Doubts((said,) if said else (), np.zeros(4))


def _freedom(problem: Problem) -> int:
    return max(2 * int(problem.there.sum()) - problem.inner - 6 * len(problem.there), 1)


def _other_model(problem: Problem, found: Fit) -> Doubts | None:
    """Find the model that fits clearly better; of two that fit alike, the one with fewer parameters."""
    if problem.model == "pinhole":
        more = {0: 5, 4: 8, 5: 8, 8: 12}.get(problem.coefficients)
        choices = [("fisheye", 4), *([("pinhole", more)] if more else [])]
    else:
        choices = [*([("fisheye", 4)] if problem.coefficients == 0 else []), ("pinhole", 5)]
    result, least = None, _BETTER * found.sigma
    for model, count in sorted(choices, key=lambda choice: choice[1]):
        trial = replace(problem, model=model, coefficients=count)
        begun = ends(trial)
        if not begun:
            continue
        other = best(trial, begun)
        gain = found.sigma**2 * _freedom(problem) - other.sigma**2 * _freedom(trial)
        extra = abs(trial.inner - problem.inner)
        if other.sigma < least and gain > (extra + _SURE * math.sqrt(2.0 * max(extra, 1))) * other.sigma**2:
            least = _BETTER * other.sigma
            falls = f"the deviation of a corner falls from {found.sigma:.3f} to {other.sigma:.3f} px"
            if model == problem.model:
                said = f"the lens needs more terms: with coefficients={count} {falls}"
            else:
                said = f'the residuals look like those of a {model} lens: with model="{model}" {falls}'
            result = Doubts((said,), other.camera[:4] - found.camera[:4])
    return result


def _radial(problem: Problem, found: Fit) -> str:
    there = problem.there
    away = problem.seen[there] - found.camera[2:4]
    radius = np.linalg.norm(away, axis=1)
    along = (found.residuals[there] * away).sum(axis=1) / np.maximum(radius, 1e-9)
    order = np.argsort(radius)
    counted = found.weights[there][order] > 0.9
    for ring in np.array_split(order[counted], _RINGS):
        if len(ring) < 10:
            continue
        mean, deviation = float(along[ring].mean()), float(along[ring].std() / math.sqrt(len(ring)))
        if abs(mean) > max(_TREND * found.sigma, _TREND_SURE * deviation):
            return (
                f"the residuals have a trend along the radius ({mean:+.2f} px about {radius[ring].mean():.0f} px from "
                "the principal point): the lens model does not describe this lens"
            )
    return ""


def _zoomed(problem: Problem, found: Fit) -> str:
    """Say whether the views have different focal lengths: one number a view, where a rolling shutter takes six."""
    residual, _, pose = linearised(problem, found)
    views = len(residual)
    root = np.sqrt(found.weights)[..., None]
    r = (root * residual).reshape(views, -1)
    explained = 0.0
    for view in range(views):
        # What a focal length that is longer by its own size adds to a corner; the pose takes most of it.
        longer = root[view] * (problem.seen[view] - residual[view] - found.camera[2:4])
        longer = np.where(problem.there[view][:, None], longer, 0.0).ravel()
        basis = np.linalg.qr((root[view][..., None] * pose[view]).reshape(-1, 6))[0]
        longer -= basis @ (basis.T @ longer)
        rest = r[view] - basis @ (basis.T @ r[view])
        size = float(longer @ longer)
        if size > 0:
            explained += float(longer @ rest) ** 2 / size
    share = explained / max(float((r**2).sum()), 1e-300)
    if found.sigma <= 0 or share - views / _freedom(problem) < _ZOOMED:
        return ""
    return (
        f"the focal length differs from view to view: one of its own for each explains {share:.0%} of the squares "
        "of the residuals: take all views at one zoom and one focus, without autofocus or electronic stabilisation"
    )


def _rolling(problem: Problem, found: Fit) -> str:
    residual, _, pose = linearised(problem, found)
    views = len(residual)
    root = np.sqrt(found.weights)[..., None]
    r = (root * residual).reshape(views, -1)
    when = problem.seen[..., 1] / problem.size[1] - 0.5
    explained = 0.0
    for view in range(views):
        columns = np.concatenate([pose[view], pose[view] * when[view][:, None, None]], axis=-1)
        basis = np.linalg.qr((root[view][..., None] * columns).reshape(-1, 12))[0]
        explained += float(((basis[:, 6:].T @ r[view]) ** 2).sum())
    share = explained / max(float((r**2).sum()), 1e-300)
    # What is expected of noise comes off: half a view's corners can be enough for that.
    if share - 6 * views / _freedom(problem) < _ROLLING:
        return ""
    return (
        f"the residuals look like those of a rolling shutter: motion while the rows were read explains {share:.0%} of "
        "their squares: hold camera and board still, take pictures in place of a video; a board that bends from view "
        "to view, or a zoom or focus that changes, looks alike"
    )
