"""Arrows of one frame: where motion is beyond its uncertainty, and one for each thing.

A pixel's motion counts where it is significant against its covariance and a neighbour moves alike: what is left are
the things that move, and with a moving camera the scene. Each thing has its own motion at its centre, whatever its
pixels tell.

docs/explanation/algorithms.md, section "Where arrows stand".
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..plotting import arrows, drawing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..flow.field import FlowField
    from ..plotting import QuiverStyle
    from ..segmentation.result import MotionSegmentation

    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["draw_motion"]

# The 99.99 % quantile of chi-squared with two degrees of freedom, and its median: errors that are larger than their
# covariance says show in the median of what stands still.
_SIGNIFICANT, _MEDIAN = 18.4, 1.386
# The 99 % quantile, for the velocity of a thing.
_SIGNIFICANT_THING = 9.2
# Two vectors are alike when they differ by less than this share of the longer one.
_ALIKE = 0.5
# The scene's own motion, of a moving camera, is drawn paler than that of things.
_SCENE_COLOR: drawing.Color = (200, 190, 165)
# And on every so many points of the grid.
_SCENE_STEP = 2
# Of things, on the screen: shorter arrows are dots, and longer ones than this share of the picture are cut.
_LEAST_LENGTH, _LONGEST_SHARE = 4.0, 0.3


def draw_motion(
    picture: NDArray[np.uint8], flow: FlowField, seen: MotionSegmentation, style: QuiverStyle
) -> NDArray[np.uint8]:
    """Draw the motion to the frame of `seen` on the picture before it, enlarged by the style's zoom."""
    out = drawing.magnified(picture, style.zoom)
    points, vectors, things, scene = chosen(flow, seen, style.step)
    of_scene, _ = arrows.shapes(points[scene], vectors[scene], style)
    of_things, _ = arrows.shapes(points[things], vectors[things], style)
    drawing.rimmed(
        out,
        drawing.Strokes(of_scene, _SCENE_COLOR, style.line_width),
        drawing.Strokes(of_things, style.color, style.line_width),
        _thing_strokes(out, seen, style),
    )
    if style.key:
        arrows.draw_key(out, style)
    return out


def chosen(flow: FlowField, seen: MotionSegmentation, step: int) -> tuple[F64, F64, Mask, Mask]:
    """Points of a grid and their motion, (n, 2) each, and which of them are of things and which of the scene."""
    height, width = flow.valid.shape
    points = arrows.grid(height, width, step)
    columns, rows = points.astype(int).T
    vectors = flow.uv[rows, columns].astype(np.float64)
    valid = flow.valid[rows, columns] & np.isfinite(vectors).all(axis=1)
    vectors[~valid] = 0
    precision = _precision(flow, rows, columns, valid)
    own = vectors - (_mapped(seen.camera_motion, points) - points)
    x, y = np.rint(points + vectors).astype(int).T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    on_thing = np.zeros(len(points), bool)
    on_thing[inside] = seen.moving[y[inside], x[inside]]
    own_chi = _chi_squared(own, precision)
    still = valid & ~on_thing
    excess = max(1.0, float(np.median(own_chi[still])) / _MEDIAN) if still.any() else 1.0
    moves = valid & (own_chi > _SIGNIFICANT * excess)
    if seen.camera_model in ("static", "none"):
        # Of a camera at rest the scene has no motion; what moves without being a thing is shown like one.
        things = moves & (on_thing | _supported(vectors, moves, height, step))
        return points, vectors, things, np.zeros_like(things)
    things = moves & on_thing
    scene = still & (_chi_squared(vectors, precision) > _SIGNIFICANT * excess)
    scene &= _supported(vectors, scene, height, step)
    # The scene's motion changes little from one to the next, and would cover the picture.
    sparse = np.zeros((max(1, height // step), len(points) // max(1, height // step)), bool)
    sparse[::_SCENE_STEP, ::_SCENE_STEP] = True
    return points, vectors, things, scene & sparse.ravel()


def _precision(flow: FlowField, rows: NDArray[Any], columns: NDArray[Any], valid: Mask) -> F64:
    """Inverse covariance at some pixels as xx, xy and yy, (3, n): zero where nothing is known."""
    out = np.zeros((3, len(rows)))
    if flow.covariance is None:
        return out
    covariance = flow.covariance[rows, columns].astype(np.float64)
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    known = valid & np.isfinite(xx + xy + yy)
    determinant = xx[known] * yy[known] - xy[known] ** 2
    out[:, known] = np.stack([yy[known], -xy[known], xx[known]]) / np.maximum(determinant, 1e-20)
    return out


def _chi_squared(vectors: F64, precision: F64) -> F64:
    x, y = vectors.T
    xx, xy, yy = precision
    out: F64 = x * x * xx + 2 * x * y * xy + y * y * yy
    return out


def _supported(vectors: F64, wanted: Mask, height: int, step: int) -> Mask:
    """Whether a neighbour on the grid is wanted too and moves alike."""
    rows = max(1, height // step)
    grid, some = vectors.reshape(rows, -1, 2), wanted.reshape(rows, -1)
    length = np.hypot(grid[..., 0], grid[..., 1])
    out = np.zeros_like(some)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one = np.s_[: rows - down, max(-right, 0) : some.shape[1] - max(right, 0)]
        other = np.s_[down:, max(right, 0) : some.shape[1] + min(right, 0)]
        off = np.hypot(*np.moveaxis(grid[one] - grid[other], -1, 0))
        both = some[one] & some[other] & (off < _ALIKE * np.maximum(length[one], length[other]))
        out[one] |= both
        out[other] |= both
    return out.ravel()


def _mapped(homography: F64, points: NDArray[Any]) -> F64:
    mapped: F64 = np.column_stack([points, np.ones(len(points))]) @ homography.T
    out: F64 = mapped[:, :2] / mapped[:, 2:]
    return out


def _thing_strokes(out: NDArray[np.uint8], seen: MotionSegmentation, style: QuiverStyle) -> drawing.Strokes:
    """Give the motion of each thing at its centre, in its colour; draw a dot where that is too short to see."""
    things = [thing for thing in seen.objects if math.isfinite(thing.vx_px_per_frame + thing.vy_px_per_frame)]
    if not things:
        return drawing.Strokes([], [])
    centres = np.array([(thing.x, thing.y) for thing in things])
    own = np.array([(thing.vx_px_per_frame, thing.vy_px_per_frame) for thing in things])
    back: F64 = np.asarray(np.linalg.inv(seen.camera_motion), np.float64)
    before = _mapped(back, centres - own)
    colors = [drawing.distinct_color(thing.id) for thing in things]
    on_screen = (before + 0.5) * style.zoom - 0.5
    ways = (centres - before) * (style.scale * style.zoom)
    off = np.array([(thing.vx_std_px_per_frame, thing.vy_std_px_per_frame) for thing in things])
    # One whose deviation nobody knows is taken as sure.
    sure = ~(((own / np.maximum(off, 1e-6)) ** 2).sum(axis=1) < _SIGNIFICANT_THING)
    long = sure & (np.hypot(*ways.T) >= _LEAST_LENGTH)
    lines = arrows.lines(on_screen[long], ways[long], _LONGEST_SHARE * math.hypot(*out.shape[:2]))
    for number in np.flatnonzero(~long):
        drawing.disc(out, on_screen[number], 3, (0, 0, 0))
        drawing.disc(out, on_screen[number], 2, colors[number])
    inks = [color for color, drawn in zip(colors, long, strict=True) if drawn]
    return drawing.Strokes(lines, inks, style.line_width + 1)
