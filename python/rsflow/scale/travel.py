"""How a camera travels over the ground through a clip, as it measures that itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..capture import Frame
from ..velocity import VelocityEstimator

__all__ = ["Travel", "measure_travel"]

F64 = NDArray[np.float64]
# Pairs on either side over which the direction of the way is taken.
_AROUND = 2


@dataclass(frozen=True, eq=False)
class Travel:
    """Velocities in the camera's axes between successive frames, of those pairs that could be measured.

    Attributes
    ----------
    start_s, stop_s : (K,) float64
    velocity_m_s : (K, 2) float64
        Along the camera's x and y.
    covariance : (K, 2, 2) float64
        Of what is independent from pair to pair.
    rows_1_s : (K,) float64
        Heights of the picture that its content goes down in a second: this times the readout time is how much longer
        the way of a point is than the time between the frames says.
    move_px : (K,) float64
        Median displacement.
    frames : int
    first_s, last_s : float
        Times of the first and the last frame.
    lost : str
        The most frequent status of the pairs that could not be measured; empty where all could.
    """

    start_s: F64
    stop_s: F64
    velocity_m_s: F64
    covariance: F64
    rows_1_s: F64
    move_px: F64
    frames: int
    first_s: float
    last_s: float
    lost: str

    def __len__(self) -> int:
        return len(self.start_s)

    @property
    def dt_s(self) -> F64:
        """Time between the frames of each pair."""
        return self.stop_s - self.start_s

    def along(self) -> F64:
        """Speed (K,) along the direction of the way, which neighbours share: noise across it adds nothing."""
        count = len(self)
        mean = np.zeros_like(self.velocity_m_s)
        for offset in range(-_AROUND, _AROUND + 1):
            mean += self.velocity_m_s[np.clip(np.arange(count) + offset, 0, count - 1)]
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        return np.asarray(np.einsum("ki,ki->k", self.velocity_m_s, mean / np.maximum(length, 1e-12)))


def measure_travel(
    clip: Iterable[Frame], camera: Camera, heights: tuple[F64, F64], mask: NDArray[np.bool_] | None
) -> Travel:
    """Measure the velocity from frame to frame; `heights` are times and metres, read between."""
    estimator: Any = VelocityEstimator(camera, height_std_m=0.0, readout_s=0.0, mask=mask)
    rows: list[tuple[Any, ...]] = []
    lost: Counter[str] = Counter()
    count, before, first = 0, np.nan, np.nan
    for frame in clip:
        height = float(np.interp(frame.t_s, *heights))
        v = estimator.update(frame.image, frame.t_s, height_m=height)
        if v.valid:
            own = v.parts.get("displacement", v.covariance)[:2, :2]
            share = v.dy_px / ((camera.height - 1) * v.dt_s)
            rows.append((before, frame.t_s, (v.vx_m_s, v.vy_m_s), own, share, v.flow_px))
        elif count:
            lost[v.status.word] += 1
        first = frame.t_s if count == 0 else first
        count, before = count + 1, frame.t_s
    columns: list[Any] = list(zip(*rows, strict=True)) if rows else [[]] * 6
    start, stop, velocity, covariance, share, moved = (np.asarray(c, dtype=np.float64) for c in columns)
    return Travel(
        start_s=start,
        stop_s=stop,
        velocity_m_s=velocity.reshape(-1, 2),
        covariance=covariance.reshape(-1, 2, 2),
        rows_1_s=share,
        move_px=moved,
        frames=count,
        first_s=first,
        last_s=before,
        lost=lost.most_common(1)[0][0] if lost else "",
    )
