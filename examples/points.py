"""Points through a video: each keeps its number until it is lost, with the reason, and a new one takes its place.

python examples/points.py [VIDEO]
"""

import collections
import sys

import rsflow
from rsflow import synthetic

# %% [markdown]
# A video, or a made flight.

# %%
if len(sys.argv) > 1:
    video = rsflow.frames(sys.argv[1])
else:
    video = synthetic.flight(frames=8, velocity_m_s=(0.05, 0.02, 0.0))

# %% [markdown]
# Each point has a number that lasts, and a status.

# %%
tracker = rsflow.PointTracker(max_corners=200, max_displacement=40)
for frame in video:
    tracks = tracker.update(frame.image)
    told = collections.Counter(tracks.status_names.tolist())
    words = ", ".join(f"{count} {name.lower().replace('_', ' ')}" for name, count in told.most_common())
    print(f"frame {frame.index}: {words}; numbers up to {tracks.ids.max(initial=0)}")
tracks
