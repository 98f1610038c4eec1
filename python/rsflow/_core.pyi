from typing import Any, Self, TypedDict, final

import numpy as np
from numpy.typing import NDArray

from ._checks.knobs import GridOptions, Illumination, Preset, ShiftDeformation, TrackOptions

__all__ = [
    "DenseFlow",
    "PlaneTracker",
    "PointTracker",
    "Segmenter",
    "__version__",
    "build_info",
    "detect_corners",
    "displacement_grid",
    "estimate_shift",
    "fit_plane",
    "gaussian_pyramid",
    "get_num_threads",
    "grid_statuses",
    "lay_ink",
    "observe_regions",
    "plane_tile_statuses",
    "point_statuses",
    "ride",
    "set_num_threads",
    "share_threads",
    "shift_statuses",
    "track_points",
    "track_pyr_lk",
]

__version__: str

def set_num_threads(threads: int) -> None: ...
def get_num_threads() -> int: ...
def share_threads(callers: int) -> None: ...
def build_info() -> dict[str, Any]: ...

class _TrackParts(TypedDict):
    points: NDArray[np.float32]
    status: NDArray[np.uint8]
    residual: NDArray[np.float32]
    covariance: NDArray[np.float32]
    forward_backward: NDArray[np.float32]
    deformation: NDArray[np.float32]

class _TrackerParts(_TrackParts):
    origins: NDArray[np.float32]
    ids: NDArray[np.int64]
    ages: NDArray[np.uint32]

def track_points(
    prev: object,
    next: object,
    points: NDArray[np.float32],
    initial: NDArray[np.float32] | None,
    mask: object,
    next_mask: object,
    options: TrackOptions,
) -> _TrackParts: ...

class _GridParts(TypedDict):
    first: tuple[float, float]
    raw: NDArray[np.float32]
    status: NDArray[np.uint8]
    gradient: NDArray[np.float32]
    joint_covariance: NDArray[np.float32]
    residual: NDArray[np.float32]
    correlation: NDArray[np.float32]
    gain: NDArray[np.float32]
    offset: NDArray[np.float32]

def displacement_grid(
    prev: object,
    next: object,
    initial: NDArray[np.float32] | None,
    mask: object,
    next_mask: object,
    options: GridOptions,
) -> _GridParts: ...
def grid_statuses() -> list[tuple[str, int]]: ...
def detect_corners(
    frame: object,
    mask: object,
    max_corners: int,
    quality: float,
    min_distance: float,
    block_size: int,
    harris: float | None,
    mask_corners_only: bool = False,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def track_pyr_lk(
    prev: object,
    next: object,
    points: NDArray[np.float32],
    initial: NDArray[np.float32] | None,
    window: tuple[int, int],
    max_level: int,
    iterations: int,
    epsilon: float,
    min_eigenvalue: float,
    eigenvalue_as_error: bool,
) -> tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.float32]]: ...
def gaussian_pyramid(frame: object, levels: int) -> list[NDArray[np.float32]]: ...
def point_statuses() -> list[tuple[str, int]]: ...

@final
class PointTracker:
    def __new__(cls, options: TrackOptions, max_corners: int, quality: float, min_distance: float) -> Self: ...
    def update(self, frame: object, mask: object) -> _TrackerParts: ...
    def reset(self) -> None: ...
    @property
    def scene_cut(self) -> bool: ...
    def state(self) -> dict[str, Any]: ...
    def restore(self, state: dict[str, Any]) -> None: ...

_Vector = tuple[float, float, float]
_Motion = tuple[float, float, float, float, float, float]
# turn, down, readout, growth; where to begin; levels; rotation, its covariance; numbers whose effect is wanted
_PlaneTask = tuple[
    tuple[_Vector, _Vector, float, _Vector], _Motion, int, tuple[_Vector, tuple[_Vector, _Vector, _Vector]], list[int]
]
# motion, normal matrix, pull, responses; scale, widened, residual, correlation, settled; rows of tiles, their statuses
_PlaneFound = tuple[
    tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    tuple[float, float, float, float, bool],
    tuple[NDArray[np.float64], NDArray[np.uint8]],
]

@final
class PlaneTracker:
    def __new__(
        cls, model: str, focal: tuple[float, float], centre: tuple[float, float], coefficients: list[float]
    ) -> Self: ...
    def push(self, frame: object, mask: object) -> None: ...
    def take_back(self) -> None: ...
    def reset(self) -> None: ...
    def motion(self, task: _PlaneTask) -> _PlaneFound | None: ...

def fit_plane(
    model: str,
    focal: tuple[float, float],
    centre: tuple[float, float],
    coefficients: list[float],
    rows: int,
    matches: NDArray[np.float64],
    task: _PlaneTask,
) -> _PlaneFound | None: ...
def plane_tile_statuses() -> list[tuple[str, int]]: ...

# dx, dy, covariance, gain, offset, residual, status
_ShiftFound = tuple[float, float, NDArray[np.float64], float, float, float, int]
# direction, its variance
_ShiftDirection = tuple[tuple[float, float], float]
# gradient, joint covariance
_ShiftGradient = tuple[NDArray[np.float64], NDArray[np.float64]]

def estimate_shift(
    prev: object,
    next: object,
    roi: tuple[int, int, int, int] | None,
    mask: object,
    next_mask: object,
    illumination: Illumination,
    deformation: ShiftDeformation,
    max_displacement: float | None,
) -> tuple[_ShiftFound, _ShiftDirection, _ShiftGradient]: ...
def shift_statuses() -> list[tuple[str, int]]: ...

# uv, valid, residual, gain, offset, halvings of gain and offset, covariance
_FlowParts = tuple[
    NDArray[np.float32],
    NDArray[np.bool_],
    NDArray[np.float32],
    NDArray[np.float32],
    NDArray[np.float32],
    int,
    NDArray[np.float32] | None,
]

@final
class DenseFlow:
    def __new__(
        cls, preset: Preset, illumination: Illumination, max_displacement: float | None, covariance: bool
    ) -> Self: ...
    def pair(self, prev: object, next: object, initial: object, mask: object, next_mask: object) -> _FlowParts: ...
    def update(self, frame: object, initial: object, mask: object, next_mask: object) -> _FlowParts | None: ...
    def reset(self) -> None: ...
    def state(self) -> dict[str, Any] | None: ...
    def restore(self, state: dict[str, Any] | None) -> None: ...

_Homography = list[list[float]]

# Homography, model, deviation in pixels and explained share of the camera's motion
_CameraFound = tuple[_Homography, str, float, float]
# What moves, the camera's motion, whether there is parallax; gain, offset and noise
_Segmented = tuple[NDArray[np.bool_], _CameraFound, bool, tuple[float, float, float]]

@final
class Segmenter:
    def __new__(
        cls, camera_moves: bool, min_area: int, scale: float, rounding: float, shape: tuple[int, int]
    ) -> Self: ...
    def update(
        self,
        frame: object,
        uv: NDArray[np.float32] | None,
        valid: NDArray[np.bool_] | None,
        mask: object,
    ) -> _Segmented: ...
    def reduced_shape(self) -> tuple[int, int]: ...
    def motion(self, least_px: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
    def scene(self) -> NDArray[np.float32]: ...
    def reset(self) -> None: ...
    def state(self) -> dict[str, Any]: ...
    def restore(self, state: dict[str, Any]) -> None: ...

# Labels; box, area and centre; motion and its variance; shares of grey levels; samples of the picture
_Observed = tuple[
    NDArray[np.int32],
    tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    tuple[NDArray[np.float64], NDArray[np.float64]],
    NDArray[np.float64],
    NDArray[np.float32],
]

def observe_regions(
    mask: NDArray[np.bool_],
    least: int,
    motion: NDArray[np.float32] | None,
    image: object,
    levels: object,
) -> _Observed: ...
def ride(
    pictures: NDArray[np.float32],
    starts: NDArray[np.float64],
    sizes: NDArray[np.float64],
    levels: object,
    mask: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]: ...
def lay_ink(
    picture: NDArray[np.uint8],
    ink: NDArray[np.uint8],
    rim: NDArray[np.uint8],
    which: NDArray[np.uint8] | None,
    colors: list[tuple[int, int, int]],
) -> None: ...
