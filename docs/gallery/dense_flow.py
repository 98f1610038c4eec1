"""Where every pixel went: arrows, and Middlebury's colours with their key.

A flight over ground on which something crosses the camera's way.
"""

from __future__ import annotations

import sys

from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    scale = 1 if small else 3
    camera = rsflow.Camera(
        140.0 * scale, 140.0 * scale, 70.0 * scale, 48.0 * scale, width=140 * scale, height=96 * scale
    )
    prev, after = synthetic.flight_with_object(camera, frames=2, velocity_m_s=(0.06, 0.03, 0.0), seed=1).images
    field = rsflow.dense_flow(prev, after)
    figure = Figure(figsize=(11.0, 4.1), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.imshow(
        rsflow.quiver(field, picture=prev, step=9 * scale, color=(40, 220, 40), line_width=scale - scale // 2)[
            ..., ::-1
        ]
    )
    left.set_title("rsflow.quiver(field, picture=prev)")
    right.imshow(rsflow.flow_to_color(field, legend=True, order="rgb"))
    right.set_title("rsflow.flow_to_color(field, legend=True)")
    for ax in (left, right):
        ax.set(xticks=[], yticks=[])
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "dense_flow.png")
