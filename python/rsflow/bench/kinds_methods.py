"""What is measured by kind of scene: the calls of rsflow and of its rivals, and what each of them answers."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..flow import dense_flow
from ..grid import displacement_grid
from ..shift import estimate_shift
from ..tracking import track_points
from .kinds_scenes import Scene
from .methods import dense_methods

__all__ = ["REFERENCE", "SUBJECTS", "Answer", "Method", "methods_of", "missing"]

Array = NDArray[Any]
F64 = NDArray[np.float64]

SUBJECTS = ("dense flow", "points", "displacement", "grid")
# What the times of a subject are multiples of.
REFERENCE = {
    "dense flow": "rsflow balanced", "points": "rsflow track_points", "displacement": "rsflow estimate_shift",
    "grid": "rsflow displacement_grid",
}  # fmt: skip
# A point is taken back where the way back ends farther than this from it, as by `track_points`.
BACK_PX = 0.5
WINDOW_PX, STEP_PX = 32, 16


@dataclass(frozen=True)
class Answer:
    """Displacements (n, 2) at places (n, 2), which of them are said to hold, and deviations (n, 2) if there are any.

    `deviation` (n,) is that along the axis of the largest one. `halfway`: the places are those half of the way on.
    """

    places: F64
    motion: F64
    valid: NDArray[np.bool_]
    std: F64 | None = None
    deviation: F64 | None = None
    halfway: bool = False


@dataclass(frozen=True)
class Method:
    """A call that is timed, of a scene and points in it, and how to read what it gives.

    `told` is called in its place for the answer, where deviations cost extra.
    """

    name: str
    call: Callable[[Scene, Array], Any]
    answer: Callable[[Any, Scene, Array], Answer]
    told: Callable[[Scene, Array], Any] | None = None


def missing() -> tuple[str, ...]:
    """Say which rivals are not installed."""
    names = {"skimage": "scikit-image", "openpiv": "OpenPIV"}
    return tuple(name for module, name in names.items() if find_spec(module) is None)


def methods_of(subject: str, *, quick: bool = False) -> list[Method]:
    """Give what a subject is measured with; quick: without what takes seconds a picture, or needs larger ones."""
    made: dict[str, Callable[[], list[Method]]] = {
        "dense flow": partial(_dense, slow=not quick), "points": _points, "displacement": _shift,
        "grid": partial(_grid, small=quick),
    }  # fmt: skip
    return made[subject]()


def _spread(covariance: Array) -> tuple[F64, F64]:
    """Give deviations along x and y (n, 2), and the largest in any direction (n,); infinite where there is none."""
    flat = covariance.reshape(-1, 2, 2).astype(np.float64)
    known = np.isfinite(flat).all(axis=(1, 2))
    std, largest = np.full((len(flat), 2), np.inf), np.full(len(flat), np.inf)
    std[known] = np.sqrt(np.maximum(np.diagonal(flat[known], axis1=1, axis2=2), 0.0))
    largest[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(flat[known])[:, -1], 0.0))
    return std, largest


def _pixels(scene: Scene) -> F64:
    height, width = scene.prev.shape
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(np.float64)


def _dense(*, slow: bool) -> list[Method]:
    def ours(preset: Any, covariance: bool, scene: Scene, points: Array) -> Any:
        masks: dict[str, Any] = {"mask": scene.mask, "next_mask": scene.mask}
        return dense_flow(scene.prev, scene.next, preset=preset, covariance=covariance, **masks)

    def read(field: Any, scene: Scene, points: Array) -> Answer:
        std, largest = _spread(field.covariance)
        motion = np.asarray(field.uv, np.float64).reshape(-1, 2)
        return Answer(_pixels(scene), motion, field.valid.ravel(), std, largest)

    def every(flow: Any, scene: Scene, points: Array) -> Answer:
        motion = np.asarray(flow, np.float64).reshape(-1, 2)
        return Answer(_pixels(scene), motion, np.asarray(np.isfinite(motion).all(axis=1)))

    methods = [
        Method(f"rsflow {preset}", partial(ours, preset, False), read, partial(ours, preset, True))
        for preset in ("ultrafast", "fast", "balanced", "accurate")
    ]
    for method in dense_methods():
        if not method.name.startswith("rsflow"):
            name = method.name.replace("OpenCV ", "").replace(",", "")
            methods.append(Method(f"OpenCV {name}", partial(_of_frames, method.call), every))
    if slow and find_spec("skimage") is not None:
        methods += [
            Method("scikit-image TV-L1", partial(_skimage, "optical_flow_tvl1"), every),
            Method("scikit-image ILK", partial(_skimage, "optical_flow_ilk"), every),
        ]
    return methods


def _of_frames(call: Callable[[Array, Array], Any], scene: Scene, points: Array) -> Any:
    return call(scene.prev, scene.next)


def _skimage(name: str, scene: Scene, points: Array) -> Array:
    from skimage import registration

    # Its scale is that of pictures from 0 to 1; rows come first.
    prev, after = (frame.astype(np.float32) / 255.0 for frame in (scene.prev, scene.next))
    rows, columns = getattr(registration, name)(prev, after)
    return np.stack([columns, rows], axis=-1)


def _points() -> list[Method]:
    import cv2

    empty: Any = None

    def ours(scene: Scene, points: Array, **options: Any) -> Any:
        return track_points(scene.prev, scene.next, points, mask=scene.mask, next_mask=scene.mask, **options)

    def read(tracks: Any, scene: Scene, points: Array) -> Answer:
        std, largest = _spread(tracks.covariance)
        motion = tracks.points.astype(np.float64) - points
        return Answer(points.astype(np.float64), motion, np.asarray(tracks.valid), std, largest)

    def there(scene: Scene, points: Array) -> tuple[Array, Array]:
        moved, status, _ = cv2.calcOpticalFlowPyrLK(scene.prev, scene.next, points, empty)
        return moved, status.ravel() == 1

    def and_back(scene: Scene, points: Array) -> tuple[Array, Array]:
        moved, found = there(scene, points)
        back, status, _ = cv2.calcOpticalFlowPyrLK(scene.next, scene.prev, moved, empty)
        return moved, found & (status.ravel() == 1) & (np.hypot(*(back - points).T) < BACK_PX)

    def theirs(found: Any, scene: Scene, points: Array) -> Answer:
        places = points.astype(np.float64)
        return Answer(places, found[0].astype(np.float64) - places, found[1])

    return [
        Method("rsflow track_points", ours, read),
        Method("rsflow, no check back", partial(ours, max_forward_backward=None), read),
        Method("OpenCV PyrLK", there, theirs),
        Method("OpenCV PyrLK, there and back", and_back, theirs),
    ]


def _shift() -> list[Method]:
    import cv2

    def ours(scene: Scene, points: Array, **options: Any) -> Any:
        return estimate_shift(scene.prev, scene.next, mask=scene.mask, next_mask=scene.mask, **options)

    def read(shift: Any, scene: Scene, points: Array) -> Answer:
        std, largest = _spread(np.asarray(shift.covariance))
        motion = np.array([[shift.dx, shift.dy]], np.float64)
        return Answer(_middle(scene), motion, np.array([bool(shift.valid)]), std, largest)

    def theirs(found: Any, scene: Scene, points: Array) -> Answer:
        return Answer(_middle(scene), np.array([found], np.float64), np.array([True]))

    methods = [
        Method("rsflow estimate_shift", ours, read),
        Method('rsflow, deformation="affine"', partial(ours, deformation="affine"), read),
        Method("OpenCV phaseCorrelate", _phase_correlate, theirs),
    ]
    # OpenCV before 4.12 does not have it.
    if hasattr(cv2, "phaseCorrelateIterative"):
        methods.append(Method("OpenCV phaseCorrelateIterative", _phase_iterative, theirs))
    if find_spec("skimage") is not None:
        methods.append(Method("scikit-image phase_cross_correlation", _phase_cross_correlation, theirs))
    return methods


def _middle(scene: Scene) -> F64:
    height, width = scene.prev.shape
    return np.array([[(width - 1) / 2, (height - 1) / 2]])


def _hann(scene: Scene) -> Array:
    import cv2

    return np.asarray(cv2.createHanningWindow(scene.prev.shape[::-1], cv2.CV_32F))


def _phase_correlate(scene: Scene, points: Array) -> Any:
    import cv2

    return cv2.phaseCorrelate(scene.prev.astype(np.float32), scene.next.astype(np.float32), _hann(scene))[0]


def _phase_iterative(scene: Scene, points: Array) -> Any:
    import cv2

    window = _hann(scene)
    return cv2.phaseCorrelateIterative(scene.prev * window, scene.next * window)


def _phase_cross_correlation(scene: Scene, points: Array) -> tuple[float, float]:
    from skimage.registration import phase_cross_correlation

    window = _hann(scene)
    rows, columns = phase_cross_correlation(scene.next * window, scene.prev * window, upsample_factor=100)[0]
    return float(columns), float(rows)


def _grid(*, small: bool) -> list[Method]:
    def ours(scene: Scene, points: Array, **options: Any) -> Any:
        return displacement_grid(
            scene.prev,
            scene.next,
            window_size=WINDOW_PX,
            step=STEP_PX,
            mask=scene.mask,
            next_mask=scene.mask,
            **options,
        )

    def read(grid: Any, scene: Scene, points: Array) -> Answer:
        x, y = (np.asarray(axis, np.float64) for axis in (grid.x, grid.y))
        places = np.stack(np.meshgrid(x, y) if x.ndim == 1 else (x, y), axis=-1).reshape(-1, 2)
        motion = np.stack([grid.u, grid.v], axis=-1).reshape(-1, 2).astype(np.float64)
        std, largest = _spread(np.asarray(grid.covariance))
        return Answer(places, motion, np.asarray(grid.valid).ravel(), std, largest)

    methods = [
        Method("rsflow displacement_grid", ours, read),
        Method("rsflow, robust", partial(ours, robust=True), read),
    ]
    # Between its two steps it lays a spline through the windows, which four along each side are needed for.
    if not small and find_spec("openpiv") is not None:
        methods.append(Method("OpenPIV, windows 64, 32", _passes, _piv))
    return methods


def _passes(scene: Scene, points: Array) -> Any:
    from openpiv import windef

    settings = windef.PIVSettings()
    settings.windowsizes, settings.overlap, settings.num_iterations = (
        (2 * WINDOW_PX, WINDOW_PX),
        (WINDOW_PX, STEP_PX),
        2,
    )
    settings.min_max_u_disp = settings.min_max_v_disp = (-60, 60)
    # It prints what it replaces.
    with contextlib.redirect_stdout(io.StringIO()):
        return windef.simple_multipass(scene.prev, scene.next, settings)


def _piv(found: Any, scene: Scene, points: Array) -> Answer:
    x, y, u, v, flags = (np.asarray(part) for part in found)
    # Its y runs up from the lower border; both axes begin at the picture's corner, not in the middle of a pixel.
    places = np.stack([x, scene.prev.shape[0] - y], axis=-1).reshape(-1, 2) - 0.5
    motion = np.stack([u, -v], axis=-1).reshape(-1, 2).astype(np.float64)
    return Answer(places, motion, (flags.ravel() == 0) & np.isfinite(motion).all(axis=1), halfway=True)
