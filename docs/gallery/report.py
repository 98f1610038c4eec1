"""What a report shows, from the results of one run: the slider's picture, a curve with its band, the four answers.

The page itself is HTML, with the same figures: these are drawn from the files beside it.
"""

from __future__ import annotations

import csv
import sys
import tempfile
import textwrap
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    frames = 12 if small else 40
    thing = synthetic.MovingObject(center_m=(0.1, -0.1), size_m=(0.12, 0.09), velocity_m_s=(-0.1, 0.12))
    turn = np.linspace(0.0, 2.0, frames - 1)
    velocity_m_s = np.stack([0.15 * np.cos(turn), 0.1 * np.sin(turn), 0.0 * turn], axis=1)
    exact = dict.fromkeys(("fx", "fy", "cx", "cy"), 0.0)
    camera = rsflow.Camera(330.0, 330.0, 159.5, 119.5, width=320, height=240, std=exact)
    how = {"frames": frames, "height_m": 0.5, "velocity_m_s": velocity_m_s, "seed": 3}
    flight = synthetic.flight_with_object(camera, objects=[thing], **how)
    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    panels = figure.subplot_mosaic([["picture", "curve"], ["answers", "answers"]], height_ratios=[3, 1.3])
    with tempfile.TemporaryDirectory() as folder:
        done = rsflow.extract(
            list(flight.images), folder, frame_rate=30, camera=flight.camera, height_m=0.5, height_std_m=0.002
        )
        shown = [frame.color for frame in rsflow.frames(done.files["flow"], color=True)][frames // 2]
        with Path(done.files["velocity"]).open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
    panels["picture"].imshow(shown[..., ::-1])
    panels["picture"].set_title("Views: motion as arrows over the frame")
    panels["picture"].set(xticks=[], yticks=[])
    t = np.array([float(row["t_s"]) for row in rows])
    for name, colour in (("vx", "#0072b2"), ("vy", "#c44f00")):
        v, std = (np.array([float(row[f"{name}_{what}m_s"]) for row in rows]) for what in ("", "std_"))
        panels["curve"].plot(t, v, color=colour, label=name)
        known = np.isfinite(v) & np.isfinite(std)
        panels["curve"].fill_between(t[known], (v - std)[known], (v + std)[known], color=colour, alpha=0.25)
    panels["curve"].set(title="How fast: velocity over the ground", xlabel="time in s", ylabel="m/s")
    panels["curve"].legend()
    lines = [textwrap.fill(line, 150, subsequent_indent="    ") for line in done.summary["answers"]]
    panels["answers"].text(0, 1, "\n".join(lines), va="top", transform=panels["answers"].transAxes, fontsize=10)
    panels["answers"].axis("off")
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "report.png")
