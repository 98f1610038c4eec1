"""Strain of a material and vorticity of a fluid, on a grid of windows, each beside what the scene was made with.

Above speckle on a plate with a soft band, below particles in a vortex.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def stretched(x: Any, y: Any) -> tuple[Any, Any]:
    """Displacement at a place from the middle: a stretch along x by 0.5 %, in a band by up to 4 %."""
    return 0.005 * x + 0.035 * 25.0 * np.tanh(x / 25.0), -0.3 * 0.01 * y


def vortex(x: Any, y: Any) -> tuple[Any, Any]:
    """Displacement at a place from the middle: a turn about it, as a Lamb-Oseen vortex has."""
    square = x * x + y * y + 1e-9
    turn = 90.0 * (1.0 - np.exp(-square / 40.0**2)) / square
    return -turn * y, turn * x


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    size, step = ((128, 96), 16) if small else ((360, 240), 8)
    figure = Figure(figsize=(10.0, 6.8), layout="constrained")
    axes = figure.subplots(2, 2)
    extent, middle = (0, size[0], size[1], 0), ((size[0] - 1) / 2, (size[1] - 1) / 2)
    plate = synthetic.speckle_pair(lambda x, y: stretched(x - middle[0], y - middle[1]), size=size, seed=1)
    strained = rsflow.displacement_grid(plate.prev, plate.next, window_size=24, step=step, shape="quadratic")
    fluid = synthetic.particle_pair(lambda x, y: vortex(x - middle[0], y - middle[1]), size=size, seed=2)
    flowing = rsflow.displacement_grid(fluid.prev, fluid.next, window_size=32, step=step)
    for row, picture, values, label, limits in (
        (axes[0], plate.next, 100 * strained.strain("small").xx, "strain along x, %", (0.0, 4.5)),
        (axes[1], fluid.next, flowing.vorticity, "vorticity, 1 per frame", (0.0, 0.12)),
    ):
        row[0].imshow(picture, cmap="gray")
        shown = row[1].imshow(values, cmap="viridis", vmin=limits[0], vmax=limits[1], extent=extent)
        figure.colorbar(shown, ax=row[1], label=label)
    axes[0, 0].set_title("speckle on a plate, stretched")
    axes[0, 1].set_title("a soft band across it")
    axes[1, 0].set_title("particles in a fluid")
    axes[1, 1].set_title("a vortex")
    x, y = np.meshgrid(np.linspace(0, size[0], 13)[1:-1], np.linspace(0, size[1], 9)[1:-1])
    axes[1, 1].quiver(x, y, *vortex(x - middle[0], y - middle[1]), angles="xy", color="white", width=0.004)
    for ax in axes.ravel():
        ax.set(xticks=[], yticks=[])
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "strain.png")
