"""What rsflow does in one picture: a frame and what is told of it; and a change of light, beside OpenCV.

The frames are made, so that the truth is known: a camera flies over ground on which three things move. Below, the
camera's gain falls to 0.7 and 20 grey levels are added between two frames that are 7.25 and 3.5 pixels apart; the
maps show how far each pixel's flow is from that.
"""

from __future__ import annotations

import sys
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic

COLORS = ("#e6194b", "#4363d8", "#f58231", "#911eb4")
HEIGHT_M = 0.5


def flown(frames: int, scale: int) -> synthetic.Flight:
    """Make a flight over three things that move."""
    camera = rsflow.Camera(
        140.0 * scale, 140.0 * scale, 70.0 * scale, 48.0 * scale, width=140 * scale, height=96 * scale
    )
    things = (
        synthetic.MovingObject((-0.02, 0.02), (0.09, 0.07), (0.26, 0.0), level=190.0, seed=3),
        synthetic.MovingObject((0.17, -0.10), (0.10, 0.05), (0.0, 0.05), "rectangle", level=90.0, seed=4),
        synthetic.MovingObject((0.22, 0.15), (0.06, 0.06), (0.08, -0.10), level=150.0, seed=5),
    )
    return synthetic.flight(
        camera, frames=frames, height_m=HEIGHT_M, velocity_m_s=(0.16, 0.04, 0.0), objects=things, seed=2
    )


def draw_frame(left: Any, right: Any, flight: synthetic.Flight) -> None:
    """Draw the last frame as it is, and with all that is told of it."""
    camera = flight.camera
    segmenter = rsflow.MotionSegmenter(camera_motion="moving")
    speed = rsflow.VelocityEstimator(camera, height_m=HEIGHT_M, height_std_m=0.002)
    flow = rsflow.DenseFlow(preset="accurate")
    for frame in flight:
        seen = segmenter.update(frame.image, t_s=frame.t_s)
        velocity = speed.update(frame.image, frame.t_s)
        field = flow.update(frame.image)
    left.imshow(frame.image, cmap="gray", vmin=0, vmax=255)
    left.set_title("a frame of a camera that moves")
    right.imshow(frame.image, cmap="gray", vmin=0, vmax=255, alpha=0.55)
    step = camera.height // 12
    y, x = np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step]
    u, v = np.moveaxis(field.uv[y, x], -1, 0)
    right.quiver(x, y, u, v, angles="xy", scale_units="xy", scale=0.3, color="#0a7f3f", width=0.0035)
    to_m_s = HEIGHT_M / camera.fx * 30.0
    for thing in seen.objects:
        color = COLORS[(thing.id - 1) % len(COLORS)]
        right.contour(seen.labels == thing.id, [0.5], colors=[color], linewidths=2.0)
        along, down = thing.vx_px_per_frame * to_m_s, thing.vy_px_per_frame * to_m_s
        x0, y0, wide, high = thing.box
        above = y0 > 30
        right.annotate(
            f"{thing.id}: {np.hypot(along, down):.2f} m/s",
            (x0 + wide / 2, y0 if above else y0 + high),
            xytext=(0, 4 if above else -4), textcoords="offset points",
            ha="center", va="bottom" if above else "top", color="white", fontsize=10,
            bbox={"facecolor": color, "edgecolor": "none", "pad": 2},
        )  # fmt: skip
    std = np.sqrt(velocity.covariance[0, 0])
    true = flight.velocity_m_s[-1][:2]
    right.text(
        0.02, 0.03,
        f"camera: {velocity.vx_m_s:+.4f} m/s right, {velocity.vy_m_s:+.4f} m/s down; deviation {std:.4f}\n"
        f"(made with {true[0]:+.4f} and {true[1]:+.4f})",
        transform=right.transAxes, fontsize=9.5, va="bottom",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.9, "pad": 3},
    )  # fmt: skip
    right.set_title("what rsflow tells: flow, what moves, how fast")


def draw_light(axes: list[Any], size: tuple[int, int]) -> Any:
    """Draw a pair under a change of light, and how far OpenCV's and our flow is off at each pixel."""
    pair = synthetic.shifted_pair(7.25, -3.5, size=size, lighting=synthetic.gain(0.7, 20), seed=2)
    both = pair.prev.copy()
    half = size[0] // 2
    both[:, half:] = pair.next[:, half:]
    axes[0].imshow(both, cmap="gray", vmin=0, vmax=255)
    axes[0].axvline(half, color="white", linewidth=1.5)
    axes[0].set_title("two frames; the light falls")
    dis = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    found = {
        "OpenCV DIS, medium": dis.calc(pair.prev, pair.next, None),
        "rsflow dense_flow, fast": rsflow.dense_flow(pair.prev, pair.next, preset="fast").uv,
    }
    for ax, (name, uv) in zip(axes[1:], found.items(), strict=True):
        error = np.hypot(uv[..., 0] - pair.dx, uv[..., 1] - pair.dy)
        shown = ax.imshow(error, cmap="magma", vmin=0, vmax=0.25)
        # What moves out of the picture is not judged.
        inside = error[4 : size[1], : size[0] - 8]
        ax.set_title(f"{name}: off by {np.median(inside):.3f} px")
    return shown


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    figure = Figure(figsize=(12.0, 7.9), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.35, 1.0))
    above, below = upper.subplots(1, 2), lower.subplots(1, 3)
    draw_frame(*above, flown(6 if small else 12, 1 if small else 3))
    shown = draw_light(list(below), (160, 120) if small else (640, 480))
    lower.colorbar(shown, ax=below, label="error in pixels", shrink=0.8)
    for ax in (*above, *below):
        ax.set(xticks=[], yticks=[])
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "overview.jpg", dpi=100, pil_kwargs={"quality": 85})
