"""How fast a camera travels over flat ground: from a video, its camera file and the height over the ground.

python examples/ground_speed.py [VIDEO CAMERA.yaml HEIGHT_M]
"""

import sys

import rsflow
from rsflow import synthetic

# %% [markdown]
# A video, the camera's file as `rsflow calibrate` makes it, and the height over the ground in metres.

# %%
if len(sys.argv) == 4:
    video, camera, height_m = rsflow.frames(sys.argv[1]), rsflow.Camera.load(sys.argv[2]), float(sys.argv[3])
else:
    video = synthetic.flight(frames=8, height_m=0.2, velocity_m_s=(0.02, -0.01, 0.0))
    camera, height_m = video.camera, 0.2

# %% [markdown]
# One call a frame. The first one has no velocity: there is nothing to compare it with.

# %%
estimator = rsflow.VelocityEstimator(camera, height_m=height_m, height_std_m=0.002)
for frame in video:
    velocity = estimator.update(frame.image, frame.t_s)
    if velocity.valid:
        deviation = velocity.covariance.diagonal() ** 0.5
        print(
            f"{frame.t_s:.3f} s: {velocity.vx_m_s:+.4f} m/s to the right, {velocity.vy_m_s:+.4f} m/s down the picture, "
            f"deviations {deviation[0]:.4f} and {deviation[1]:.4f} m/s"
        )
    else:
        print(f"{frame.t_s:.3f} s: {velocity.status}")
velocity

# %% [markdown]
# Where its deviation comes from:

# %%
print(velocity.budget())
