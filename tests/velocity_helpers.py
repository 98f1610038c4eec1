"""What the tests of velocity share: two cameras, and velocities of a whole flight."""

from __future__ import annotations

import numpy as np

from rsflow import Camera, Velocity, VelocityEstimator, VelocityStatus
from rsflow.synthetic import Flight, Sensor

WIDE = Camera(150.0, 152.0, 80.0, 60.0, width=160, height=120, distortion=(-0.25, 0.12, 0.001, -0.0005, 0.01))
QUIET = Sensor(noise=0.5)


def velocities(f: Flight, **options: object) -> list[Velocity]:
    """All but the first frame's velocity; `rate`, `down`, `height` say what truth is handed over."""
    give = {name: options.pop(name, False) for name in ("rate", "down", "height")}
    constant = {} if give["height"] else {"height_m": float(f.height_m[0])}
    estimator = VelocityEstimator(f.camera, **{**constant, **options})  # type: ignore[arg-type]
    found = []
    for k, frame in enumerate(f):
        known: dict[str, object] = {}
        if give["rate"] and k > 0:
            known["rate_rad_s"] = f.rate_rad_s[k]
        if give["down"]:
            known["down"] = f.down[k]
        if give["height"]:
            known["height_m"] = f.height_m[k]
        found.append(estimator.update(frame.image, frame.t_s, **known))  # type: ignore[arg-type]
    assert found[0].status is VelocityStatus.FIRST_FRAME
    return found[1:]


def vector(v: Velocity) -> np.ndarray:
    return np.array([v.vx_m_s, v.vy_m_s, v.vz_m_s])


def errors(f: Flight, found: list[Velocity]) -> np.ndarray:
    assert all(v.valid for v in found), [v.status.name for v in found]
    return np.array([vector(v) for v in found]) - f.velocity_m_s[1:]
