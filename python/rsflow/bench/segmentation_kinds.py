"""The kinds of scenes on which what moves is told from what stands still: made clips with exact masks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..synthetic import (
    Lighting,
    MovingThings,
    Sensor,
    Thing,
    auto_exposure,
    gain,
    light_switch,
    moving_things,
    passing_clouds,
)

__all__ = ["Kind", "kinds"]

RATE_HZ = 30.0
# Clips of one kind have so many things, in turns.
THINGS = (3, 1, 5, 2, 4)

Light = Callable[[float], Lighting]


@dataclass(frozen=True)
class Kind:
    """A kind of scene: what `moving_things` is told, and of what depends on how long a clip is.

    `light`: seconds of the clip to the light over time. `stops`: things stand still for the middle third. `across`: one
    walker, who goes across the camera's way: along it, motion cannot be told from depth.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    light: Callable[[float], Light] | None = None
    stops: bool = False
    empty: bool = False
    across: bool = False

    @property
    def still_camera(self) -> bool:
        """Whether the camera stands still."""
        return bool(self.options.get("camera", "static") == "static")

    @property
    def pad(self) -> float:
        """How far, as a share of its size, the view goes beyond the first frame before rivals start anew."""
        return 0.1 if self.options.get("camera") == "hand_held" else 0.5

    def make(self, clip: int, frames: int, size: tuple[int, int]) -> MovingThings:
        """Render one of its clips."""
        told = dict(self.options)
        if self.light is not None:
            told["exposure_drift"] = self.light(frames / RATE_HZ)
        things = told.pop("things", THINGS[clip % len(THINGS)])
        return moving_things(
            0 if self.empty else [_across(clip, frames, size)] if self.across else things,
            frames=frames,
            size=size,
            rate_hz=RATE_HZ,
            stop_frames=frames // 3 if self.stops else 0,
            seed=clip,
            **told,
        )


def _across(clip: int, frames: int, size: tuple[int, int]) -> Thing:
    """Give a walker who comes down beside the picture's middle, two thirds of its height within the clip."""
    width, height = size
    return Thing(
        x=0.7 * width,
        y=0.15 * height,
        dy=0.7 * height / frames,
        dx=0.2 * height / frames,
        width=0.1 * width,
        height=0.2 * width,
        shape="walker",
        level=(190.0, 45.0)[clip % 2],
        seed=1_000 + clip,
    )


def _switch(seconds: float) -> Light:
    return light_switch(0.6, seconds / 3, 2 * seconds / 3, plus=3.0)


def _clouds(seconds: float) -> Light:
    return passing_clouds(0.6, seed=1)


def _exposure(seconds: float) -> Light:
    return auto_exposure(0.2, period_s=1.5)


def _dusk(seconds: float) -> Light:
    return lambda t_s: gain(1.0 - 0.35 * t_s / seconds)


LIGHTS = (("light switch", _switch), ("clouds", _clouds), ("auto exposure", _exposure), ("dusk", _dusk))
HANDS = (("static", "static camera"), ("hand_held", "hand-held"))


def kinds() -> tuple[Kind, ...]:
    """Give all kinds."""
    cameras = [
        Kind("static camera"),
        Kind("pan, 2 px/frame", {"camera": "pan"}),
        Kind("pan, 8 px/frame", {"camera": "pan", "camera_speed": 8.0}),
        Kind("zoom, 1 %/frame", {"camera": "zoom"}),
        Kind("turn, 0.5 deg/frame", {"camera": "turn"}),
        Kind("hand-held", {"camera": "hand_held"}),
    ]
    speeds = [
        Kind(f"{speed:g} px/frame, {said}", {"camera": camera, "speed_px": speed})
        for speed in (0.3, 1.0, 10.0, 30.0)
        for camera, said in HANDS
    ]
    each = []
    for camera, said in HANDS:
        told = {"camera": camera}
        each += [
            Kind(f"stop and go, {said}", told, stops=True),
            Kind(f"crossing, {said}", {**told, "crossing": True, "things": 3}),
            *(Kind(f"{name}, {said}", told, light=light) for name, light in LIGHTS),
            Kind(f"noise of 8 levels, {said}", {**told, "sensor": Sensor(noise=8.0, blur_px=0.7)}),
            Kind(f"weak ground, plain things, {said}", {**told, "contrast_levels": 3.0, "textured": False}),
            Kind(f"walkers with shadows, {said}", {**told, "shape": "walker", "shadow": 0.4}),
            Kind(f"empty, {said}", told, empty=True),
            Kind(f"empty, light switch, {said}", told, light=_switch, empty=True),
        ]
    depth = [
        Kind(
            f"{boxes} {'box' if boxes == 1 else 'boxes'} of {height:g}, {camera}",
            {
                "camera": camera,
                "camera_speed": speed,
                "camera_heading_deg": 0.0,
                "boxes": boxes,
                "box_height": height,
            },
            across=True,
        )
        for camera, speed in (("sideways", 2.0), ("forward", 0.0025))
        for boxes, height in ((1, 0.15), (12, 0.35))
    ]
    return (*cameras, *speeds, *each, *depth)
