"""How far a window moved between two pictures, and how sure that is.

python examples/displacement.py [PREV.png NEXT.png [X Y WIDTH HEIGHT]]
"""

import sys

import rsflow
from rsflow import synthetic

# %% [markdown]
# Two pictures whose light differs, and the window that is followed: x, y, width, height.

# %%
if len(sys.argv) > 2:
    prev, after = (frame.image for frame in rsflow.frames(sys.argv[1:3]))
else:
    pair = synthetic.shifted_pair(7.25, -3.5, size=(320, 240), lighting=synthetic.ramp(0.7, 1.0), seed=1)
    prev, after = pair.prev, pair.next
roi = tuple(int(number) for number in sys.argv[3:7]) or (130, 90, 60, 60)

# %% [markdown]
# Its displacement, in pixels; a status says why where there is none.

# %%
shift = rsflow.estimate_shift(prev, after, roi=roi)
if not shift.valid:
    sys.exit(f"the displacement of the window {roi} could not be measured: {shift.status}")
deviation = shift.covariance.diagonal() ** 0.5
print(
    f"{shift.dx:+.3f} px to the right, {shift.dy:+.3f} px down; deviations {deviation[0]:.4f} and {deviation[1]:.4f} px"
)
print(f"light: {shift.gain:.3f} x the grey levels {shift.offset:+.1f}")
shift
