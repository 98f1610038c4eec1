from typing import Any, Self, TypedDict, final

import numpy as np
from numpy.typing import NDArray

from ._checks.knobs import Illumination, Preset, ShiftDeformation, TrackOptions

__all__ = [
    "DenseFlow",
    "PointTracker",
    "__version__",
    "build_info",
    "detect_corners",
    "estimate_shift",
    "gaussian_pyramid",
    "get_num_threads",
    "point_statuses",
    "set_num_threads",
    "shift_statuses",
    "track_points",
    "track_pyr_lk",
]

__version__: str

def set_num_threads(threads: int) -> None: ...
def get_num_threads() -> int: ...
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
