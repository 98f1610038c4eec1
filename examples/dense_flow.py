"""Where every pixel went: a picture with arrows, one in Middlebury's colours, and the flow as a file.

python examples/dense_flow.py [PREV.png NEXT.png]
"""

import sys

import numpy as np

import rsflow
from rsflow import synthetic

# %% [markdown]
# Two pictures: those of the command line, or two frames of a made flight over which something crosses.

# %%
if len(sys.argv) > 2:
    prev, after = (frame.image for frame in rsflow.frames(sys.argv[1:3]))
else:
    prev, after = synthetic.flight_with_object(frames=2).images

# %% [markdown]
# The flow. What cannot be measured, such as what the thing uncovers, is not `valid`; here it is shown as black.

# %%
field = rsflow.dense_flow(prev, after)  # preset="fast", "balanced" or "accurate"
length = np.hypot(*field.uv[field.valid].T)
print(f"{field.valid.mean():.0%} of the pixels valid; median {np.median(length):.2f} px, most {length.max():.2f} px")

field

# %% [markdown]
# Pictures and a file of it.

# %%
rsflow.quiver(field, picture=prev, path="arrows.png")
rsflow.flow_to_color(field, legend=True, path="colors.png")
field.save("motion.flo")
print("look at arrows.png and colors.png; motion.flo is read by rsflow.read_flow")
