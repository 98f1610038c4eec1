"""A camera as the flow sensor of an autopilot, and its way over the ground by a filter.

    python examples/autopilot.py                                             a made flight, into flow.tlog
    python examples/autopilot.py 0 camera.yaml 1.2 px4:/dev/ttyUSB0,115200   camera 0, 1.2 m up, to PX4

The top of the picture points forward. Needs pymavlink: pip install 'rsflow-motion[mavlink]'
"""

from __future__ import annotations

import sys

import rsflow
from rsflow.interop.mavlink import MavlinkWriter

# %% [markdown]
# A camera, its file and its height; or a made flight at 0.4 m/s, half a metre up.

# %%
if len(sys.argv) > 4:
    source: rsflow.Frames | rsflow.synthetic.Flight = rsflow.frames(int(sys.argv[1]))
    camera, height_m, target = rsflow.Camera.load(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
else:
    source = rsflow.synthetic.flight(frames=31, height_m=0.5, velocity_m_s=(0.0, -0.4, 0.0), seed=1)
    camera, height_m, target = source.camera, 0.5, "px4:flow.tlog"

# %% [markdown]
# Each frame is measured, sent as a message of a flow sensor, and filtered over time.

# %%
estimator = rsflow.VelocityEstimator(camera, height_m=height_m, height_std_m=0.02 * height_m)
kalman = rsflow.VelocityFilter(acceleration_walk_m_s2=1.0)
# The height was typed in: it is not sent as what a range finder measured.
with MavlinkWriter(target, forward="top", distance=False) as autopilot:
    for frame in source:
        velocity = estimator.update(frame.image, frame.t_s)
        sent = autopilot.write(velocity, height_m=height_m)
        now = kalman.update(velocity)
        if sent is not None:
            rate = sent.flow_rad / sent.dt_s
            print(f"{frame.t_s:.3f} s: flow {rate[0]:+.3f}, {rate[1]:+.3f} rad/s, quality {sent.quality}")
print(now)
