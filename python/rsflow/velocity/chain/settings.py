"""What an estimator of velocity was told, once and for all and with each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...camera.model import Camera

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Settings:
    """What `VelocityEstimator` was told once and for all; see there."""

    camera: Camera
    mask: NDArray[np.bool_] | None
    R_body_from_camera: F64
    lever_arm_m: F64
    height_std_m: float | None
    rate_std_rad_s: float | None
    rate_delay_std_s: float | None
    dt_std_s: float | None
    readout_s: float | None
    down_std_rad: float | None
    max_height_gap_s: float
    max_speed_m_s: float | None

    def unstated(self) -> tuple[str, ...]:
        """Name what the covariance leaves out, since nobody said how exact it is."""
        std = self.camera.std
        known = {
            "height": self.height_std_m is not None,
            "focal length": "fx" in std and "fy" in std,
            "principal point": "cx" in std and "cy" in std,
        }
        return tuple(name for name, stated in known.items() if not stated)


@dataclass(frozen=True)
class Told:
    """What came with a frame: its time, height with deviation, rate in the body's axes, down in the camera's."""

    t_s: float
    height_m: float
    height_std_m: float
    rate: F64 | None
    down: F64 | None
