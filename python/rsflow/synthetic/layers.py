"""A hard scene with exact truth: fast things at several depths, blurred by motion, hidden by each other, in fog."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from .lighting import Lighting, lit
from .motions import Part
from .sensor import Sensor, sensor_or
from .textures import CONTRAST_LEVELS, MEAN_LEVEL, Texture

__all__ = ["LayersPair", "layers_pair"]

F64 = NDArray[np.float64]

# Grey level of fog.
FOG_LEVEL = 175.0
# Pixels of motion between two samples of an exposure, and the most samples of one.
SAMPLE_PX, MOST_SAMPLES = 2.0, 24
# Values of a texture a pixel and axis. They are read with a cubic filter at multiples of a 32nd of their distance.
OVERSAMPLE = 2
# The turn in degrees, and the logarithm of the zoom, that go with a median motion of so many pixels.
TURN_DEG, LOG_ZOOM, WITH_PX = 6.0, 0.06, 27.0


@dataclass(frozen=True, eq=False)
class LayersPair:
    """Two frames of things that move over each other, and where each pixel of the first one went.

    Attributes
    ----------
    prev, next : (height, width) of the sensor's dtype
        The frames.
    flow : (height, width, 2) float32
        Motion in pixels of what is at each pixel half-way through the exposure of `prev`, until half-way through that
        of `next`; where it leaves the frame or is hidden, too.
    visible : (height, width) bool
        Where that is in `next`, inside of the frame (of its pixels, half of one beyond their centres) and not hidden.
    layer : (height, width) int64
        What is seen in `prev`: 0 the ground, then the things from the farthest to the nearest.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow import synthetic
    >>> pair = synthetic.layers_pair(size=(160, 120), median_px=8.0, seed=1)
    >>> pair.flow.shape, pair.visible.dtype, round(float(np.median(np.hypot(*pair.flow.transpose(2, 0, 1)))), 2)
    ((120, 160, 2), dtype('bool'), 8.0)
    """

    prev: NDArray[Any]
    next: NDArray[Any]
    flow: NDArray[np.float32]
    visible: NDArray[np.bool_]
    layer: NDArray[np.int64]

    __repr__ = fields


@dataclass(frozen=True)
class _Layer:
    """Ground, or a thing with an outline, at a distance: 1 the farthest, 0 the nearest."""

    motion: Part
    distance: float
    mean_level: float
    # One period of its texture, `OVERSAMPLE` values a pixel and axis.
    texture: F64
    radius: float
    waves: F64

    def at(self, time: float) -> Part:
        """Give the motion from the first frame until `time`, in frames."""
        motion = self.motion
        return replace(
            motion,
            dx=motion.dx * time,
            dy=motion.dy * time,
            turn_deg=motion.turn_deg * time,
            zoom=motion.zoom**time,
        )

    def covers(self, places: F64) -> F64:
        """Give the share of each pixel of the first frame that it covers."""
        if not self.radius:
            return np.ones(places.shape[:-1])
        x, y = places[..., 0] - self.motion.x, places[..., 1] - self.motion.y
        outline, angle = np.ones(x.shape), np.arctan2(y, x)
        for count, depth, phase in self.waves:
            outline += depth * np.cos(count * angle + phase)
        return np.asarray(np.clip(0.5 + self.radius * outline - np.hypot(x, y), 0.0, 1.0), np.float64)

    def levels(self, places: F64, fog: float) -> F64:
        """Grey levels at places of the first frame, through the fog."""
        import cv2

        x, y = ((OVERSAMPLE * places[..., axis] % len(self.texture)).astype(np.float32) for axis in (0, 1))
        values = cv2.remap(self.texture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
        own = self.mean_level + CONTRAST_LEVELS * values
        return np.asarray(FOG_LEVEL + (1.0 - fog * self.distance) * (own - FOG_LEVEL), np.float64)

    def window(self, pixels: F64, time: float) -> tuple[slice, slice]:
        """Rows and columns of the pixels that it may cover."""
        height, width = pixels.shape[:-1]
        if not self.radius:
            return slice(0, height), slice(0, width)
        motion = self.at(time)
        reach = 1.5 * self.radius * motion.zoom + 2.0
        ends = []
        for middle, first, count in (
            (motion.y + motion.dy, pixels[0, 0, 1], height),
            (motion.x + motion.dx, pixels[0, 0, 0], width),
        ):
            start = int(np.clip(np.floor(middle - reach - first), 0, count))
            ends.append(slice(start, max(start, int(np.clip(np.ceil(middle + reach - first), 0, count)))))
        return ends[0], ends[1]


def layers_pair(
    *,
    size: tuple[int, int] = (640, 480),
    median_px: float | None = None,
    things: int = 8,
    shutter: float = 0.4,
    fog: float = 0.7,
    lighting: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> LayersPair:
    """Two frames of a scene that is hard to measure, as those of films are.

    Ground and things shift, turn and zoom each in its own way, near ones more than far ones. Near things hide far ones,
    motion blurs them over the exposure, and fog takes contrast from what is far.

    Parameters
    ----------
    size : (int, int)
        Width and height in pixels, 8 to 10,000.
    median_px : float, optional
        Length of the motion vectors of `prev`, in pixels: their median, at most the shorter side of the frame. By
        default 27, and less where that is more than a quarter of the shorter side.
    things : int
        How many things there are over the ground, 0 to 1000.
    shutter : float
        Share of the time between two frames that each is exposed; 0: no blur by motion.
    fog : float
        Share of its contrast that the farthest loses; 0: no fog.
    lighting : Lighting, optional
        What happens to the light of `next`.
    sensor : Sensor, optional
        Blur, noise and dtype of both frames; by default noise of 1.5 grey levels, uint8.
    seed : int
        Of things, motions, textures and noise.

    Returns
    -------
    LayersPair

    Raises
    ------
    OptionError
        If a number is beyond what it may be: `median_px` the shorter side of the frame, `shutter` and `fog` 0 to 1.

    Examples
    --------
    >>> pair = layers_pair(size=(160, 120), median_px=12.0, things=4, seed=3)
    >>> pair.prev.shape, pair.prev.dtype, int(pair.layer.max())
    ((120, 160), dtype('uint8'), 4)
    >>> bool(0.3 < pair.visible.mean() < 1.0)
    True
    """
    size = _checks.size("size", size, least=8, most=10_000)
    if median_px is None:
        median_px = min(WITH_PX, 0.25 * min(size))
    median_px = _checks.number("median_px", median_px, least=0, most=min(size), of="pixels")
    things = _checks.integer("things", things, least=0, most=1_000)
    shutter = _checks.number("shutter", shutter, least=0, most=1)
    fog = _checks.number("fog", fog, least=0, most=1)
    seed = _checks.integer("seed", seed, least=0, most=2**48)
    sensor = sensor_or(Sensor(noise=1.5), sensor)
    lighting = None if lighting is None else _checks.function("lighting", lighting, 1)
    rng = np.random.default_rng([seed, 150_889])
    layers = _still(size, things, seed, rng)
    pixels = _pixels(size, 0)
    layer = _seen(layers, pixels, 0.0)
    layers, flow = _moved(layers, pixels, layer, median_px, rng)
    to = pixels + flow
    whole = np.rint(to).astype(np.int64)
    x, y = whole[..., 0], whole[..., 1]
    visible: NDArray[np.bool_] = (x >= 0) & (y >= 0) & (x < size[0]) & (y < size[1])
    after = _seen(layers, pixels, 1.0)
    visible[visible] = after[whole[visible][:, 1], whole[visible][:, 0]] == layer[visible]
    images = [sensor.blur(_exposed(layers, _pixels(size, sensor.margin), time, shutter, fog)) for time in (0.0, 1.0)]
    images[1] = lit("lighting", lighting, images[1])
    prev, following = (sensor.expose(image, rng) for image in images)
    return LayersPair(prev, following, flow.astype(np.float32), visible, layer)


def _pixels(size: tuple[int, int], margin: int) -> F64:
    x, y = (np.arange(-margin, side + margin, dtype=np.float64) for side in size)
    return np.stack(np.meshgrid(x, y), axis=-1)


def _still(size: tuple[int, int], things: int, seed: int, rng: np.random.Generator) -> list[_Layer]:
    """Put the ground and the things where they are in the first frame, without motion."""
    width, height = size
    texture = _texture("ground", 1000 * seed, 1024)
    middle = Part(x=width / 2, y=height / 2)
    layers = [_Layer(middle, 1.0, MEAN_LEVEL, texture, 0.0, np.zeros((0, 3)))]
    for index in range(things):
        near = (index + 1) / things
        place = Part(x=rng.uniform(0.05, 0.95) * width, y=rng.uniform(0.05, 0.95) * height)
        waves = np.stack([[2, 3, 5], rng.uniform(-0.15, 0.15, 3), rng.uniform(0, 2 * np.pi, 3)], axis=1)
        # What is near looks larger.
        radius = min(size) * rng.uniform(0.06, 0.12) * (1.0 + near)
        kind = ("fine", "ground", "smooth")[index % 3]
        texture = _texture(kind, 1000 * seed + index + 1, 256 if min(size) <= 240 else 512)
        layers.append(_Layer(place, 0.8 * (1.0 - near), rng.uniform(85.0, 145.0), texture, radius, waves))
    return layers


def _texture(kind: str, seed: int, period: int) -> F64:
    at = np.arange(OVERSAMPLE * period) / OVERSAMPLE
    return Texture.make(kind, seed=seed, period=period, oversample=float(OVERSAMPLE)).sample(at[None, :], at[:, None])


def _moved(
    layers: list[_Layer], pixels: F64, seen: NDArray[np.int64], median_px: float, rng: np.random.Generator
) -> tuple[list[_Layer], F64]:
    """Give each layer a motion, such that the median length over the first frame is as asked; and its flow."""
    strength = min(median_px / WITH_PX, 3.0)
    heading, motions = rng.uniform(0, 2 * np.pi), []
    for index, layer in enumerate(layers):
        share = 0.25 if index == 0 else 1.0
        turn, zoom = share * strength * rng.uniform(-1.0, 1.0, 2)
        # With the ground, faster where near, and in a way of its own.
        own, way = (0.0, 0.0) if index == 0 else (rng.uniform(0.2, 1.5), rng.uniform(0, 2 * np.pi))
        speed = 1.6 - 0.6 * layer.distance
        shift = (speed * np.cos(heading) + own * np.cos(way), speed * np.sin(heading) + own * np.sin(way))
        motions.append((shift, turn * TURN_DEG, float(np.exp(zoom * LOG_ZOOM))))

    # Of the flow: what turn and zoom do, and what the shift is multiplied by.
    layers = [
        replace(layer, motion=replace(layer.motion, turn_deg=turn, zoom=zoom))
        for layer, (_, turn, zoom) in zip(layers, motions, strict=True)
    ]
    turned: F64 = np.zeros(pixels.shape)
    by: F64 = np.zeros(pixels.shape)
    for index, layer in enumerate(layers):
        turned[seen == index] = layer.motion.move(pixels[seen == index]) - pixels[seen == index]
        by[seen == index] = motions[index][0]
    low, high = 0.0, 4.0 * median_px
    for _ in range(40):
        length = 0.5 * (low + high)
        median = float(np.median(np.hypot(*np.moveaxis(turned + length * by, -1, 0))))
        low, high = (length, high) if median < median_px else (low, length)
    length = 0.5 * (low + high)
    moved = [
        replace(layer, motion=replace(layer.motion, dx=length * dx, dy=length * dy))
        for layer, ((dx, dy), _, _) in zip(layers, motions, strict=True)
    ]
    return moved, turned + length * by


def _seen(layers: list[_Layer], pixels: F64, time: float) -> NDArray[np.int64]:
    """Which layer is nearest at each pixel."""
    seen = np.zeros(pixels.shape[:-1], dtype=np.int64)
    for index, layer in enumerate(layers):
        window = layer.window(pixels, time)
        seen[window][layer.covers(layer.at(time).trace(pixels[window])) >= 0.5] = index
    return seen


def _exposed(layers: list[_Layer], pixels: F64, time: float, shutter: float, fog: float) -> F64:
    """Give the light of one exposure: the mean over the time that the shutter is open."""
    corners = pixels[:: max(1, len(pixels) - 1), :: max(1, pixels.shape[1] - 1)]
    way = max(float(np.hypot(*np.moveaxis(layer.motion.move(corners) - corners, -1, 0)).max()) for layer in layers)
    count = int(np.clip(np.ceil(way * shutter / SAMPLE_PX), 1, MOST_SAMPLES))
    image = np.zeros(pixels.shape[:-1])
    for moment in time + shutter * ((np.arange(count) + 0.5) / count - 0.5):
        sample = np.zeros(pixels.shape[:-1])
        for layer in layers:
            window = layer.window(pixels, float(moment))
            if sample[window].size:
                places = layer.at(float(moment)).trace(pixels[window])
                share = layer.covers(places)
                sample[window] = (1.0 - share) * sample[window] + share * layer.levels(places, fog)
        image += sample / count
    return image
