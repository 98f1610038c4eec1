"""Points through a sequence, each with a number that lasts: where it went, in the colour of its speed.

Two cars over ground, before a camera that stands: most points stand too.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    width, height = (160, 120) if small else (480, 320)
    scene = synthetic.moving_things(
        2, frames=6 if small else 25, size=(width, height), shape="car", textured=True, speed_px=4.0, seed=3
    )
    tracker = rsflow.PointTracker(max_corners=300, max_displacement=20)
    ways: dict[int, list[tuple[float, float]]] = {}
    for frame in scene:
        tracks = tracker.update(frame.image)
        for number, point, valid in zip(tracks.ids.tolist(), tracks.points, tracks.valid, strict=True):
            if valid:
                ways.setdefault(number, []).append(tuple(point.tolist()))
    figure = Figure(figsize=(7.5, 5.0), layout="constrained")
    ax = figure.subplots()
    ax.imshow(frame.image, cmap="gray", vmin=0, vmax=255, alpha=0.6)
    lines = [np.array(way) for way in ways.values() if len(way) > 1]
    for line in sorted(lines, key=lambda way: float(np.hypot(*(way[-1] - way[0])))):
        moved = float(np.hypot(*(line[-1] - line[0]))) / (len(line) - 1)
        ax.plot(*line.T, color="#e6194b" if moved > 0.5 else "#4363d8", linewidth=1.0)
        ax.plot(*line[-1], ".", color="#e6194b" if moved > 0.5 else "#4363d8", markersize=4)
    ax.set(xticks=[], yticks=[], xlim=(0, width), ylim=(height, 0))
    ax.set_title(f"{len(lines)} points over {len(scene)} frames; red: they move")
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "points.png")
