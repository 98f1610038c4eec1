"""Kinds of scenes by motion, light, content, noise and overlays, each with exact truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..synthetic import (
    DeformedPair,
    Lighting,
    Part,
    Sensor,
    Texture,
    VehiclePart,
    disc_floor,
    flicker,
    gain,
    gamma,
    homography_motion,
    layers_pair,
    motions_pair,
    particle_pair,
    patchy_floor,
    ramp,
    shadow,
    speckle_pair,
    spotlight,
    striped_floor,
    textured_pair,
    tiled_floor,
)

__all__ = ["Kind", "Scene", "Shape", "kinds"]

Array = NDArray[Any]
F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Length of the shift of every kind that is not one of motion, and the turn that goes with it where there may be one.
SHIFT_PX, TURN_DEG = 3.0, 1.0
# Share of the picture that something fixed to the sensor hides.
OVERLAY = VehiclePart(0.25)


@dataclass(frozen=True)
class Scene:
    """Two frames, where each pixel of the first one goes, and what may be looked at.

    `flow` (height, width, 2) is NaN where there is no truth; `seen` (height, width) tells what stays in the picture
    and is not hidden; `mask` is given to what takes one; `truth` tells the displacement between the pixels too.
    """

    prev: Array
    next: Array
    flow: F64
    seen: Mask
    mask: Mask | None = None
    truth: Callable[[ArrayLike, ArrayLike], F64] | None = None


@dataclass(frozen=True)
class Shape:
    """What a scene is made with: its size, its seed, and whether a kind that is not one of motion turns a little."""

    size: tuple[int, int]
    seed: int
    turned: bool = True


@dataclass(frozen=True)
class Kind:
    """A kind of scene, in a group; `subjects` are those it says something about."""

    group: str
    name: str
    make: Callable[[Shape], Scene]
    subjects: tuple[str, ...] = ("dense flow", "points", "displacement", "grid")


WARPED = ("dense flow", "points", "grid")
SEVERAL = ("dense flow", "points")


def kinds() -> tuple[Kind, ...]:
    """Give every kind, group by group."""
    lights: dict[str, dict[str, Any]] = {
        "steady": {},
        "gain 0.7, plus 20": {"lighting": gain(0.7, 20)},
        "ramp, 0.75 to 1.25": {"lighting": ramp(0.75, 1.25)},
        "spot, 50 levels": {"lighting": spotlight(50.0)},
        "gamma 0.7": {"lighting": gamma(0.7)},
        "flicker between rows, 15 %": {
            "lighting_prev": flicker(0.15, rows=80, phase=0.5), "lighting": flicker(0.15, rows=80, phase=2.6),
        },
        "shadow that moves": {"lighting_prev": shadow(0.5), "lighting": shadow(0.5, x=0.62)},
        "dark, a quarter clipped": {"lighting_prev": gain(0.5, -45), "lighting": gain(0.5, -45)},
    }  # fmt: skip
    contents: dict[str, Callable[[Shape], dict[str, Any]]] = {
        "fine texture": lambda shape: {"ground": _ground(shape, "noise")},
        "coarse texture": lambda shape: {"ground": _ground(shape, "smooth")},
        "weak contrast, 5 levels": lambda shape: {"contrast_levels": 5.0},
        "discs, as in photographs": lambda shape: {"ground": _floor("discs", shape.seed)},
        "plain areas, half of it": lambda shape: {"ground": _floor("plain", shape.seed)},
        "stripes": lambda shape: {"ground": _floor("stripes", shape.seed)},
        "tiles of 32 px": lambda shape: {"ground": _floor("tiles", shape.seed)},
    }
    return (
        *_motions(),
        *(Kind("light", name, partial(_gentle, options=options)) for name, options in lights.items()),
        *(Kind("content", name, partial(_of, options=options)) for name, options in contents.items()),
        Kind("noise", "noise of 2 levels", partial(_gentle, options={"sensor": Sensor(noise=2.0)})),
        Kind("noise", "noise of 8 levels", partial(_gentle, options={"sensor": Sensor(noise=8.0)})),
        Kind("noise", "JPEG, quality 60", _packed),
        Kind("overlay", "overlay, masked", partial(_overlaid, told=True)),
        Kind("overlay", "overlay, not told", partial(_overlaid, told=False)),
        Kind("nothing", "another scene", _unrelated),
        *_particles(),
    )


def _motions() -> tuple[Kind, ...]:
    shifts = (
        Kind("motion", f"shift of {length:g} px", partial(_shifted, length=length)) for length in (0.3, 3, 12, 40)
    )
    matrices: dict[str, tuple[tuple[float, float, float], ...]] = {
        "turn of 5 degrees": _similar(5.0, 1.0),
        "zoom by 1.05": _similar(0.0, 1.05),
        "shear of 0.05": ((1.0, 0.05, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        "perspective": ((1.0, 0.02, 0.0), (0.0, 1.03, 0.0), (1e-4, 2e-4, 1.0)),
    }
    return (
        Kind("motion", "still", partial(_shifted, length=0.0)),
        *shifts,
        *(
            Kind("motion", name, partial(_warped, matrix=np.array(matrix)), WARPED if name == "perspective" else _ALL)
            for name, matrix in matrices.items()
        ),
        Kind("motion", "several, with edges", _several, SEVERAL),
        Kind("motion", "several, blurred, in fog", _layered, SEVERAL),
    )


_ALL = ("dense flow", "points", "displacement", "grid")


def _particles() -> tuple[Kind, ...]:
    only = ("grid",)
    worse: dict[str, dict[str, Any]] = {
        "particles": {},
        "particles, 20 % lost": {"lost": 0.2},
        "particles, sparse": {"density_px2": 0.008},
        "particles, gain 0.7, plus 20": {"lighting": gain(0.7, 20)},
    }
    return (
        *(Kind("particles", name, partial(_spotted, options=options), only) for name, options in worse.items()),
        Kind("particles", "particles, vortex of 4 px", _whirled, only),
        Kind("particles", "speckle, strain of 2 %", _strained, only),
    )


def _way(length: float, seed: int) -> tuple[float, float]:
    """Give a displacement of that length, in a direction that each seed changes."""
    angle = 0.6 + 2.4 * seed
    return length * math.cos(angle), length * math.sin(angle)


def _similar(turn_deg: float, zoom: float) -> tuple[tuple[float, float, float], ...]:
    cos, sin = zoom * math.cos(math.radians(turn_deg)), zoom * math.sin(math.radians(turn_deg))
    return (cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)


def _about_centre(matrix: F64, size: tuple[int, int], shift: tuple[float, float] = (0.0, 0.0)) -> F64:
    """Let a homography leave the middle of the picture where it is, and shift it then."""
    to, back = np.eye(3), np.eye(3)
    to[:2, 2] = [(size[0] - 1) / 2, (size[1] - 1) / 2]
    back[:2, 2] = -to[:2, 2]
    to[:2, 2] += shift
    return np.asarray(to @ matrix @ back, np.float64)


def _from_pair(pair: DeformedPair) -> Scene:
    height, width = pair.prev.shape
    y, x = np.mgrid[0:height, 0:width]
    flow = pair.truth(x, y)
    return Scene(pair.prev, pair.next, flow, _stays(flow), truth=pair.truth)


def _textured(move: Callable[[F64, F64], tuple[ArrayLike, ArrayLike]], shape: Shape, options: dict[str, Any]) -> Scene:
    ground = options.get("ground") or _ground(shape)
    return _from_pair(textured_pair(move, size=shape.size, seed=shape.seed, **{**options, "ground": ground}))


def _stays(flow: F64) -> Mask:
    height, width = flow.shape[:2]
    y, x = np.mgrid[0:height, 0:width]
    to_x, to_y = x + flow[..., 0], y + flow[..., 1]
    return np.asarray((to_x >= 0) & (to_x <= width - 1) & (to_y >= 0) & (to_y <= height - 1))


def _shifted(shape: Shape, *, length: float) -> Scene:
    dx, dy = _way(length, shape.seed)
    return _textured(lambda x, y: (dx, dy), shape, {})


def _warped(shape: Shape, *, matrix: F64) -> Scene:
    move = homography_motion(_about_centre(matrix, shape.size))
    return _textured(move, shape, {})


def _gentle(shape: Shape, *, options: dict[str, Any]) -> Scene:
    """Give a shift, with a turn if there may be one, under what the options say."""
    turn = np.array(_similar(TURN_DEG if shape.turned else 0.0, 1.0))
    move = homography_motion(_about_centre(turn, shape.size, _way(SHIFT_PX, shape.seed)))
    return _textured(move, shape, options)


def _of(shape: Shape, *, options: Callable[[Shape], dict[str, Any]]) -> Scene:
    return _gentle(shape, options=options(shape))


def _ground(shape: Shape, kind: str = "ground") -> Texture:
    """Give a ground that repeats only after the picture and what comes into it."""
    return Texture.make(kind, seed=shape.seed, period=2 ** math.ceil(math.log2(max(shape.size) + 45)))


def _floor(name: str, seed: int) -> Texture:
    # To make one takes longer than to look at it: the scenes of a kind share four.
    return _made(name, seed % 4)


@lru_cache(maxsize=8)
def _made(name: str, seed: int) -> Texture:
    made: dict[str, Callable[..., Texture]] = {
        "discs": partial(disc_floor, 512, largest=80.0), "plain": partial(patchy_floor, 512),
        "stripes": partial(striped_floor, 512), "tiles": partial(tiled_floor, 32),
    }  # fmt: skip
    return made[name](seed=seed)


def _packed(shape: Shape) -> Scene:
    import cv2

    def through(image: Array) -> Array:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 60])
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))

    scene = _gentle(shape, options={})
    return replace(scene, prev=through(scene.prev), next=through(scene.next))


def _overlaid(shape: Shape, *, told: bool) -> Scene:
    over: Lighting = OVERLAY
    scene = _gentle(shape, options={"lighting_prev": over, "lighting": over})
    mask = OVERLAY.mask(*shape.size)
    # What comes out from under it, and what goes there, is not seen in both frames.
    to = np.rint(np.stack(np.meshgrid(*(np.arange(n) for n in shape.size)), axis=-1) + scene.flow).astype(np.intp)
    x, y = to[..., 0].clip(0, shape.size[0] - 1), to[..., 1].clip(0, shape.size[1] - 1)
    seen = scene.seen & mask & mask[y, x]
    return replace(scene, seen=seen, flow=np.where(mask[..., None], scene.flow, np.nan), mask=mask if told else None)


def _unrelated(shape: Shape) -> Scene:
    first = _shifted(shape, length=0.0)
    other = _shifted(replace(shape, seed=shape.seed + 500), length=0.0)
    nowhere = np.full(first.flow.shape, np.inf)
    return replace(first, next=other.prev, flow=nowhere, seen=np.zeros_like(first.seen), truth=_nowhere)


def _nowhere(x: ArrayLike, y: ArrayLike) -> F64:
    return np.full((*np.shape(x), 2), np.inf)


def _several(shape: Shape) -> Scene:
    width, height = shape.size
    boxes = (
        Part(-4.0, 2.5, box=(0.08 * width, 0.1 * height, 0.3 * width, 0.35 * height), kind="ground"),
        Part(6.0, 3.0, box=(0.5 * width, 0.15 * height, 0.35 * width, 0.3 * height), kind="ground"),
        Part(1.5, -5.0, 8.0, x=0.35 * width, y=0.7 * height,
             box=(0.2 * width, 0.55 * height, 0.3 * width, 0.35 * height), kind="ground"),
        Part(-2.0, -1.0, zoom=1.1, x=0.8 * width, y=0.75 * height,
             box=(0.68 * width, 0.6 * height, 0.22 * width, 0.3 * height), kind="ground"),
    )  # fmt: skip
    ground = Part(*_way(1.5, shape.seed), kind="ground")
    pair = motions_pair([ground, *boxes], size=shape.size, seed=shape.seed)
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(np.float64)
    to = pair.truth(pixels)
    flow = (to - pixels).reshape(height, width, 2)
    seen = _stays(flow)
    at = np.rint(to).astype(np.intp).reshape(height, width, 2)
    seen[seen] = pair.part_next[at[seen][:, 1], at[seen][:, 0]] == pair.part_prev[seen]
    return Scene(pair.prev, pair.next, flow, seen)


def _layered(shape: Shape) -> Scene:
    pair = layers_pair(size=shape.size, median_px=min(8.0, 0.05 * shape.size[0]), seed=shape.seed)
    flow = pair.flow.astype(np.float64)
    return Scene(pair.prev, pair.next, flow, pair.visible & _stays(flow))


def _spotted(shape: Shape, *, options: dict[str, Any]) -> Scene:
    turn = np.array(_similar(TURN_DEG, 1.0))
    move = homography_motion(_about_centre(turn, shape.size, _way(SHIFT_PX, shape.seed)))
    return _from_pair(particle_pair(move, size=shape.size, seed=shape.seed, **options))


def _whirled(shape: Shape) -> Scene:
    """Give a Lamb-Oseen vortex that is fastest, 4 pixels, at a sixth of the picture's height from its middle."""
    core = shape.size[1] / 6.0

    def move(x: F64, y: F64) -> tuple[F64, F64]:
        across, down = x - shape.size[0] / 2.0, y - shape.size[1] / 2.0
        square = across**2 + down**2 + 1e-9
        # 0.715 of the circulation is within 1.121 radii of the core, where it is fastest.
        turn = 4.0 * 1.1209 * core / 0.7153 * (1.0 - np.exp(-square / core**2)) / square
        return -turn * down, turn * across

    return _from_pair(particle_pair(move, size=shape.size, seed=shape.seed))


def _strained(shape: Shape) -> Scene:
    stretch = np.array([[1.02, 0.0, 0.0], [0.0, 0.994, 0.0], [0.0, 0.0, 1.0]])
    move = homography_motion(_about_centre(stretch, shape.size, _way(0.5, shape.seed)))
    return _from_pair(speckle_pair(move, size=shape.size, seed=shape.seed))
