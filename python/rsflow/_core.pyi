from typing import Any, Self, final

import numpy as np
from numpy.typing import NDArray

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
def track_points(
    prev: object,
    next: object,
    points: NDArray[np.float32],
    initial: NDArray[np.float32] | None,
    mask: object,
    next_mask: object,
    options: dict[str, Any],
) -> dict[str, Any]: ...
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
    def __new__(cls, options: dict[str, Any], max_corners: int, quality: float, min_distance: float) -> Self: ...
    def update(self, frame: object, mask: object) -> dict[str, Any]: ...
    def reset(self) -> None: ...
    @property
    def scene_cut(self) -> bool: ...
    def state(self) -> dict[str, Any]: ...
    def restore(self, state: dict[str, Any]) -> None: ...

def estimate_shift(
    prev: Any,
    next: Any,
    roi: tuple[int, int, int, int] | None,
    mask: Any | None,
    next_mask: Any | None,
    illumination: str,
    deformation: str,
    max_displacement: float | None,
) -> tuple[
    tuple[float, float, NDArray[np.float64], float, float, float, int],
    tuple[tuple[float, float], float],
    tuple[NDArray[np.float64], NDArray[np.float64]],
]: ...
def shift_statuses() -> list[tuple[str, int]]: ...

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
    def __new__(cls, preset: str, illumination: str, max_displacement: float | None, covariance: bool) -> Self: ...
    def pair(self, prev: object, next: object, initial: object, mask: object, next_mask: object) -> _FlowParts: ...
    def update(self, frame: object, initial: object, mask: object, next_mask: object) -> _FlowParts | None: ...
    def reset(self) -> None: ...
    def state(self) -> dict[str, Any] | None: ...
    def restore(self, state: dict[str, Any] | None) -> None: ...
