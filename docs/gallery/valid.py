"""What `valid` means: where dense flow is false, and where it says so itself.

Something crosses in front of the ground. What it covers or uncovers between the two frames cannot be measured, and
neither can what leaves the picture.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    scale = 1 if small else 3
    camera = rsflow.Camera(
        120.0 * scale, 120.0 * scale, 60.0 * scale, 45.0 * scale, width=120 * scale, height=90 * scale
    )
    flight = synthetic.flight_with_object(camera, frames=2, velocity_m_s=(0.2, 0.0, 0.0), seed=3)
    field = rsflow.dense_flow(*flight.images)
    error = np.hypot(*np.moveaxis(field.uv - flight.flow(1), -1, 0))
    figure = Figure(figsize=(12.0, 3.2), layout="constrained")
    axes = figure.subplots(1, 3)
    axes[0].imshow(flight.images[0], cmap="gray", vmin=0, vmax=255)
    axes[0].set_title("the first frame")
    shown = axes[1].imshow(error, cmap="magma", vmin=0, vmax=2)
    axes[1].set_title("error of the flow at all pixels")
    axes[2].imshow(np.where(field.valid, error, np.nan), cmap="magma", vmin=0, vmax=2)
    axes[2].set_facecolor("#b0c4de")
    axes[2].set_title("at valid pixels; the others are light blue")
    figure.colorbar(shown, ax=list(axes), label="pixels")
    for ax in axes:
        ax.set(xticks=[], yticks=[])
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "valid.png")
