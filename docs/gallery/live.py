"""What `rsflow live` shows of a camera: the newest frame with arrows and things, and the velocity as it comes.

A made flight stands in for the camera. The viewer itself is a program of its own; this is drawn from the same figures,
which `rsflow.live.watch` hands over frame by frame.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

import rsflow
from rsflow import synthetic
from rsflow.live import LiveFrame


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    frames = 10 if small else 30
    thing = synthetic.MovingObject(center_m=(0.1, -0.1), size_m=(0.12, 0.09), velocity_m_s=(-0.1, 0.12))
    turn = np.linspace(0.0, 2.0, frames - 1)
    velocity_m_s = np.stack([0.15 * np.cos(turn), 0.1 * np.sin(turn), 0.0 * turn], axis=1)
    exact = dict.fromkeys(("fx", "fy", "cx", "cy"), 0.0)
    camera = rsflow.Camera(330.0, 330.0, 159.5, 119.5, width=320, height=240, std=exact)
    how = {"frames": frames, "height_m": 0.5, "velocity_m_s": velocity_m_s, "seed": 3}
    flight = synthetic.flight_with_object(camera, objects=[thing], **how)
    seen: list[LiveFrame] = []
    rsflow.live.watch(
        flight, camera=flight.camera, height_m=0.5, height_std_m=0.002, camera_motion="moving", on_frame=seen.append
    )
    last = seen[-1].measured
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    picture, curve = figure.subplots(1, 2, width_ratios=[1.2, 1])
    arrows = rsflow.quiver(last.flow, picture=last.frame.image, step=20)
    picture.imshow(arrows[..., ::-1])
    zoom = arrows.shape[1] / last.frame.image.shape[1]
    for thing in last.segmentation.objects:
        x, y, width, height = (zoom * value for value in thing.box)
        picture.add_patch(Rectangle((x, y), width, height, fill=False, color="#c44f00"))
        text = f"number {thing.id}: {thing.speed_px_s:.0f} px/s"
        picture.text(x, y - 8, text, color="white", backgroundcolor="#c44f00", fontsize=9)
    picture.set(xticks=[], yticks=[], title="the newest frame: arrows, things with their speeds")
    velocities = [one.measured.velocity for one in seen if one.measured.velocity is not None]
    t = np.array([velocity.t_s for velocity in velocities])
    for axis, (name, colour) in enumerate((("vx", "#0072b2"), ("vy", "#c44f00"))):
        value = np.array([getattr(velocity, f"{name}_m_s") for velocity in velocities])
        std = np.sqrt([velocity.covariance[axis, axis] for velocity in velocities])
        known = np.isfinite(value) & np.isfinite(std)
        curve.plot(t[known], value[known], color=colour, label=name)
        curve.fill_between(t[known], (value - std)[known], (value + std)[known], color=colour, alpha=0.25)
    curve.set(xlabel="time in s", ylabel="m/s", title="velocity over the ground")
    curve.legend()
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "live.png")
