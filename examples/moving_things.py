"""What moves and what stands still while the camera moves too: a video of each, and the things with their numbers.

python examples/moving_things.py [VIDEO]
"""

import sys

import rsflow
from rsflow import synthetic

# %% [markdown]
# A video, or a made flight under which something crosses.

# %%
if len(sys.argv) > 1:
    video = rsflow.frames(sys.argv[1], color=True)
else:
    video = synthetic.flight_with_object(frames=12)

# %% [markdown]
# Each frame tells what moves in it; `moving_view` and `static_view` are pictures of it.

# %%
segmenter = rsflow.MotionSegmenter(camera_motion="moving")  # "static" for a camera on a tripod: it tells more
with (
    rsflow.VideoWriter("moving.mp4", frame_rate=10) as moving,
    rsflow.VideoWriter("static.mp4", frame_rate=10) as static,
):
    for frame in video:
        seen = segmenter.update(frame.image)
        moving.write(seen.moving_view(frame.color))
        static.write(seen.static_view(frame.color))
        things = ", ".join(f"{thing.id} at ({thing.x:.0f}, {thing.y:.0f})" for thing in seen.objects) or "nothing"
        print(f"frame {frame.index}: {things} moves; the camera: {seen.camera_model}")
seen
