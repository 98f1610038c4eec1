"""What moves while the camera is held in the hand: outlines and numbers, and the still scene behind.

Three things of any shape. The last picture has each pixel as it was when nothing covered it; where something always
did it is white.
"""

from __future__ import annotations

import sys

from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    size = (160, 120) if small else (400, 300)
    scene = synthetic.moving_things(3, frames=8 if small else 30, size=size, camera="hand_held", speed_px=3.5, seed=3)
    segmenter = rsflow.MotionSegmenter(camera_motion="moving")
    for frame in scene:
        seen = segmenter.update(frame.image, t_s=frame.t_s)
    figure = Figure(figsize=(12.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 3)
    axes[0].imshow(frame.image, cmap="gray", vmin=0, vmax=255)
    axes[0].set_title("the frame")
    axes[1].imshow(seen.moving_view()[..., ::-1])
    axes[1].set_title(f"moving_view(): {len(seen.objects)} things")
    axes[2].imshow(seen.background, cmap="gray", vmin=0, vmax=255)
    axes[2].set_title("background: the still scene")
    for ax in axes:
        ax.set(xticks=[], yticks=[])
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "moving_things.png")
