"""Draw velocity_axes.svg: the axes, and what the picture does for each motion of a camera over level ground.

python docs/explanation/draw_velocity_axes.py [FILE]
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

F64 = NDArray[np.float64]

# On paper: x to the right, y towards the reader, z down.
ONTO_PAPER = np.array([[1.0, 0.0], [-0.42, -0.32], [0.0, -1.0]])
# Half of the picture's width and height, in focal lengths.
HALF = np.array([0.5, 0.375])
# Each motion: what moves, the velocity in heights a second, the rate in rad/s, and how it looks.
MOTIONS = (
    ("vx > 0", "the camera goes to its right", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ("vy > 0", "it goes down the picture", (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)),
    ("vz > 0", "it goes nearer the ground", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    ("rate about x > 0", "looks almost like vy < 0", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ("rate about y > 0", "looks almost like vx > 0", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ("rate about z > 0", "turns clockwise from above", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
)


def flow(x: F64, y: F64, velocity: tuple[float, float, float], rate: tuple[float, float, float]) -> F64:
    """Give the motion of rays (x, y, 1) that look at level ground one unit below, per second (algorithms.md)."""
    (vx, vy, vz), (wx, wy, wz) = velocity, rate
    u = -vx + x * vz + x * y * wx - (1 + x * x) * wy + y * wz
    v = -vy + y * vz + (1 + y * y) * wx - x * y * wy - x * wz
    return np.stack([u, v])


def draw_axes(ax: Any) -> None:
    """Draw the camera over the ground."""

    def arrow(begin: F64, end: F64, text: str, shift: tuple[float, float], color: str) -> None:
        tail, head = begin @ ONTO_PAPER, end @ ONTO_PAPER
        ax.annotate("", head, tail, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.8, "shrinkA": 0})
        ax.text(*(head + shift), text, color=color, ha="center", va="center")

    ground = np.array([(-1.0, -0.9, 1.0), (1.0, -0.9, 1.0), (1.0, 0.9, 1.0), (-1.0, 0.9, 1.0)])
    ax.fill(*(ground @ ONTO_PAPER).T, color="0.9")
    corners = np.array([(sx * HALF[0], sy * HALF[1], 1.0) for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    ax.fill(*(corners @ ONTO_PAPER).T, color="C0", alpha=0.25)
    for corner in corners:
        ax.plot(*np.array([np.zeros(2), corner @ ONTO_PAPER]).T, color="C0", lw=0.8)
    origin = np.zeros(3)
    arrow(origin, np.array([0.75, 0.0, 0.0]), "x: right in the picture", (0.0, 0.1), "C3")
    arrow(origin, np.array([0.0, 0.95, 0.0]), "y: down the picture", (-0.3, -0.07), "C2")
    arrow(origin, np.array([0.0, 0.0, 0.72]), "z: optical axis", (0.0, -0.07), "C0")
    ax.plot(0.0, 0.0, "o", color="0.1", markersize=9)
    ax.text(-0.07, 0.09, "camera", ha="right", va="center")
    ends = np.array([(1.05, 0.0, 0.0), (1.05, 0.0, 1.0)]) @ ONTO_PAPER
    ax.plot((0.75, 1.1), (0.0, 0.0), color="0.5", lw=0.8, ls="--")
    ax.annotate("", ends[1], ends[0], arrowprops={"arrowstyle": "<->", "color": "0.2", "shrinkA": 0, "shrinkB": 0})
    ax.text(1.1, -0.5, "height", ha="left", va="center")
    ax.text(-0.98, -1.22, "level ground", color="0.35", ha="left", va="center")
    ax.set(aspect="equal", xlim=(-1.5, 1.7), ylim=(-1.4, 0.42))
    ax.axis("off")


def draw_motion(ax: Any, name: str, words: str, velocity: Any, rate: Any) -> None:
    """Draw the flow of one motion as arrows in a picture."""
    x, y = np.meshgrid(*(np.linspace(-0.8, 0.8, count) * half for count, half in zip((5, 3), HALF, strict=True)))
    u, v = flow(x, y, velocity, rate)
    scale = 0.16 / float(np.hypot(u, v).max())
    ax.quiver(
        x, y, u * scale, v * scale, angles="xy", scale_units="xy", scale=1.0, width=0.012, color="C0", pivot="mid"
    )
    ax.set(xlim=(-HALF[0], HALF[0]), ylim=(HALF[1], -HALF[1]), aspect="equal", xticks=[], yticks=[])
    ax.set_title(name, fontsize=10, color="C3", pad=3)
    ax.set_xlabel(words, fontsize=8, labelpad=3)


def draw() -> Any:
    """Give the figure: the axes to the left, the six motions to the right."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
    draw_axes(left.subplots())
    right.suptitle("what the picture does: arrows from a frame to the next", fontsize=10)
    for ax, motion in zip(right.subplots(2, 3).ravel(), MOTIONS, strict=True):
        draw_motion(ax, *motion)
    return figure


def main() -> None:
    """Write the drawing."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("velocity_axes.svg")
    # Letters stay letters, which keeps the file small; the same drawing gives the same file.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "rsflow"}):
        draw().savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
