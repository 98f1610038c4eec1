"""Clips in which things move over flat ground, before any camera, with exact masks, numbers, ways and speeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import fields
from ..capture.stream import Frame
from ..errors import OptionError
from . import _sight
from ._boxes import Box, box_layers, drawn_boxes
from ._composite import Layer, composed, shares
from ._drawn_things import Wishes, drawn
from ._outlines import SHAPES, SQUARE, outlines
from ._sight import Sight, mapped
from .lighting import Lighting, lit
from .sensor import WEBCAM, Sensor, sensor_or
from .textures import BANDS, MEAN_LEVEL, Texture
from .thing import Thing

__all__ = ["MovingThings", "moving_things"]

F64 = NDArray[np.float64]

# Standard deviation of the ground, in grey levels.
GROUND_LEVELS = 25.0
# A shadow lies beside its thing by these shares of the thing's height, and its edge is so soft, as a share of it.
_SHADOW_BESIDE = (0.5, 0.25)
_SHADOW_SOFT = 0.06
# Units after which a thing's texture repeats.
_THING_PERIOD = 128


@dataclass(frozen=True, eq=False)
class MovingThings:
    """Frames in which things move, and the truth about them: N frames, T things.

    A thing that stands still for a while is still one that moves; its shadow is not part of it, nor are boxes that
    stand on the ground.

    Attributes
    ----------
    images : (N, height, width) of the sensor's dtype
    t_s : (N,) float64
        Time of each frame.
    labels : (N, height, width) int32
        Number, from 1, of the thing that more than half of the pixel shows (of several, the one that it shows most of);
        0 for what stands still. Thing k is ``things[k - 1]``.
    homographies : (N, 3, 3) float64
        From the ground as the first frame shows it to each frame.
    things : tuple of Thing
    positions_px : (N, T, 2) float64
        Where the middle of each thing is in the frame, hidden and out of view as well; NaN where it is not there.
    velocities_px : (N, T, 2) float64
        Motion since the frame before against the still ground, in pixels of the frame; NaN in row 0 and where the thing
        is not there in both.
    areas_px : (N, T) float64
        How much of the picture shows it, in pixels.
    camera : str
        How the camera moves.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> thing = synthetic.Thing(30.0, 20.0, dx=2.0, width=16.0, height=10.0)
    >>> scene = synthetic.moving_things([thing], frames=3, size=(80, 60), camera="pan", seed=1)
    >>> scene.images.shape, scene.counts.tolist(), scene.velocities_px[2].round(6).tolist()
    ((3, 60, 80), [1, 1, 1], [[2.0, 0.0]])
    >>> bool(abs(scene.areas_px[0, 0] / (np.pi * 8 * 5) - 1) < 0.02)
    True
    """

    images: NDArray[Any]
    t_s: F64
    labels: NDArray[np.int32]
    homographies: F64
    things: tuple[Thing, ...]
    positions_px: F64
    velocities_px: F64
    areas_px: F64
    camera: str

    __repr__ = fields

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames as `rsflow.frames` does."""
        for index, (image, t_s) in enumerate(zip(self.images, self.t_s, strict=True)):
            yield Frame(image, float(t_s), index)

    @property
    def masks(self) -> NDArray[np.bool_]:
        """Where something moves, (N, height, width)."""
        return np.asarray(self.labels) > 0

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many things have a pixel in each frame, (N,)."""
        return np.array([np.count_nonzero(np.unique(labels)) for labels in self.labels], dtype=np.int64)


@dataclass(frozen=True)
class _Scene:
    """All that is seen: the ground, boxes that stand on it and things that move over it."""

    size: tuple[int, int]
    sight: Sight
    ground: Texture
    contrast_levels: float
    things: Sequence[Thing]
    skins: Sequence[Texture]
    boxes: Sequence[Box]
    shadow: float

    def picture(self, frame: int, margin: int) -> tuple[F64, NDArray[np.int32], dict[int, float]]:
        """Levels with a margin, labels and areas of one frame."""
        ground = self._ground(frame, margin)
        layers = [layer for number, thing in enumerate(self.things, 1) for layer in self._of(number, thing, frame)]
        if self.shadow:
            for number, thing in enumerate(self.things, 1):
                self._shade(ground, self._of(number, thing, frame, beside=True), thing, margin)
        layers += box_layers(self.boxes, self.sight, frame)
        return composed(ground, layers, margin)

    def _ground(self, frame: int, margin: int) -> F64:
        x, y = (np.arange(-margin, side + margin, dtype=np.float64) for side in self.size)
        inverse = np.linalg.inv(self.sight.homographies[frame])
        if inverse[0, 1] == 0.0 and inverse[1, 0] == 0.0:
            # A row against a column is sampled much faster.
            at: tuple[F64, F64] = inverse[0, 0] * x[None, :] + inverse[0, 2], inverse[1, 1] * y[:, None] + inverse[1, 2]
        else:
            at = tuple(np.moveaxis(mapped(inverse, np.stack(np.meshgrid(x, y), axis=-1)), -1, 0))
        return MEAN_LEVEL + self.contrast_levels * self.ground.sample(*at)

    def _of(self, number: int, thing: Thing, frame: int, *, beside: bool = False) -> list[Layer]:
        """Give the layers of a thing in a frame; `beside`: where its shadow lies."""
        if not thing.present(frame):
            return []
        half = 0.5 * np.array([thing.width, thing.height])
        pose = thing.pose(frame)
        if beside:
            pose[:2, 2] += thing.height * np.array(_SHADOW_BESIDE)
        to_picture = self.sight.homographies[frame] @ pose
        around = mapped(to_picture, 1.05 * SQUARE)
        skin = self.skins[number - 1]

        def own(x: F64, y: F64) -> F64:
            if not thing.contrast_levels:
                return np.full(x.shape, thing.level)
            return np.asarray(thing.level + thing.contrast_levels * skin.sample(x * half[0], y * half[1]))

        def glass(x: F64, y: F64) -> F64:
            return np.full(np.broadcast_shapes(x.shape, y.shape), MEAN_LEVEL)

        way = thing.steps(frame) * float(np.hypot(thing.dx, thing.dy)) / half[1]
        parts = outlines(thing.shape, way, mirrored=thing.dx < 0.0)
        back = np.linalg.inv(to_picture)
        return [Layer(back, around, part.inside, glass if part.glass else own, number) for part in parts]

    def _shade(self, ground: F64, parts: list[Layer], thing: Thing, margin: int) -> None:
        """Darken the ground where a thing's shadow lies, softly."""
        import cv2

        window = parts[0].window((ground.shape[0], ground.shape[1]), margin) if parts else None
        if window is None:
            return
        cover = np.zeros(ground.shape)
        for part in parts:
            cover[window] = np.maximum(cover[window], shares(part, window, margin))
        soft = max(1.0, _SHADOW_SOFT * thing.height)
        ground *= 1.0 - self.shadow * cv2.GaussianBlur(cover, (0, 0), soft, borderType=cv2.BORDER_REPLICATE)


def moving_things(
    things: int | Sequence[Thing] = 3,
    *,
    frames: int = 60,
    size: tuple[int, int] = (320, 240),
    rate_hz: float = 30.0,
    camera: str = "static",
    camera_speed: float | None = None,
    camera_heading_deg: float | None = None,
    speed_px: float | None = None,
    textured: bool | None = None,
    shape: str | None = None,
    stop_frames: int = 0,
    crossing: bool = False,
    boxes: int = 0,
    box_height: float = 0.15,
    kind: str = "ground",
    contrast_levels: float = GROUND_LEVELS,
    shadow: float = 0.0,
    exposure_drift: Callable[[float], Lighting] | None = None,
    lighting: Lighting | None = None,
    sensor: Sensor | None = None,
    seed: int = 0,
) -> MovingThings:
    """Render things that move over flat ground before a camera that stands or moves, with masks of where they are.

    Parameters
    ----------
    things : int or sequence of Thing
        What moves; later ones lie on top. A number draws so many, which are in view all the time: one that has left
        the picture comes in on the other side, as another thing with a number of its own.
    frames : int
        Number of frames.
    size : (int, int)
        Width and height in pixels.
    rate_hz : float
        Frames per second.
    camera : {"static", "pan", "zoom", "turn", "hand_held", "sideways", "forward"}
        How it moves. The last two travel over the ground, towards a side or towards it, so that boxes show parallax.
    camera_speed : float, optional
        Of "pan" and "sideways", pixels per frame (by default 2); of "zoom" the share by which the picture grows per
        frame (0.01); of "turn" degrees per frame (0.5); of "hand_held" the deviation of its sway in pixels, with a
        tenth of that in degrees (3); of "forward" the share of the first distance that it travels per frame (0.005).
    camera_heading_deg : float, optional
        Where "pan" and "sideways" go over the ground, from x towards y: at 0 the ground moves to the left in the
        picture. By default any direction.
    speed_px : float, optional
        Speed over the ground of the things that are drawn, in pixels per frame; by default 1 to 4. Of crossing things
        at most what leads from the picture's edge to its middle in half of the frames.
    textured : bool, optional
        Whether these have a texture or are plain; by default some of each.
    shape : {"ellipse", "rectangle", "car", "walker"}, optional
        Their shape; by default any.
    stop_frames : int
        For so many frames each of these stands still, from a frame in the second quarter on.
    crossing : bool
        Whether these meet in the middle of the picture, half-way through.
    boxes : int
        How many boxes stand on the ground, for a camera that is static or travels; things go behind them.
    box_height : float
        Height of the boxes as a share of the camera's distance in the first frame.
    kind : str
        Texture of the ground, see `rsflow.synthetic.BANDS`.
    contrast_levels : float
        Standard deviation of the ground in grey levels.
    shadow : float
        Share of the light that a shadow on the ground beside each thing takes; 0 for no shadow.
    exposure_drift : callable, optional
        Time in seconds to the light of that moment, such as `auto_exposure(0.15)` or `light_switch(0.6, 1.0)`.
    lighting : Lighting, optional
        What stays fixed in the image, such as `ramp(0.8, 1.2)` or `dirt()`.
    sensor : Sensor, optional
        Blur, noise and dtype; by default `WEBCAM`, with noise of 2 grey levels.
    seed : int
        Of what is drawn, of textures and noise.

    Returns
    -------
    MovingThings

    Raises
    ------
    OptionError
        If a number makes no sense, boxes are to be seen by a camera that pans, turns or zooms, or would be reached.

    Examples
    --------
    >>> import rsflow
    >>> scene = moving_things(2, frames=4, size=(96, 72), camera="hand_held", shape="ellipse", seed=3)
    >>> scene.images.shape, scene.counts.tolist(), len(scene.things)
    ((4, 72, 96), [2, 2, 2, 2], 2)
    >>> segmenter = rsflow.MotionSegmenter(camera_motion="moving")
    >>> wrong = [(segmenter.update(frame.image).moving ^ mask).mean() for frame, mask in zip(scene, scene.masks)]
    """
    frames = _checks.integer("frames", frames, least=1, most=100_000)
    size = _checks.size("size", size, least=8, most=10_000)
    rate_hz = _checks.number("rate_hz", rate_hz, least=1e-6, most=1e6, of="frames per second")
    seed = _checks.integer("seed", seed, least=0, most=2**48)
    sensor = sensor_or(WEBCAM, sensor)
    lighting = None if lighting is None else _checks.function("lighting", lighting, 1)
    drift = None if exposure_drift is None else _checks.function("exposure_drift", exposure_drift, 1)
    rng = np.random.default_rng([seed, 179_424_673])
    sight = _camera(camera, camera_speed, camera_heading_deg, frames, size, rng)
    wishes = Wishes(
        speed_px=_checks.number_or_none("speed_px", speed_px, least=0, most=1e5, of="pixels per frame"),
        textured=None if textured is None else _checks.flag("textured", textured),
        shape=None if shape is None else _checks.choice("shape", shape, SHAPES),
        stop_frames=_checks.integer("stop_frames", stop_frames, least=0, most=10**6),
        crossing=_checks.flag("crossing", crossing),
    )
    moving = _things(things, wishes, sight, size, rng)
    scene = _Scene(
        size=size,
        sight=sight,
        ground=_ground(kind, seed, size),
        contrast_levels=_checks.number("contrast_levels", contrast_levels, least=0, most=1e6, of="grey levels"),
        things=moving,
        skins=[Texture.make(thing.kind, seed=thing.seed, period=_THING_PERIOD) for thing in moving],
        boxes=_boxes(boxes, box_height, camera, sight, size, rng),
        shadow=_checks.number("shadow", shadow, least=0, most=1),
    )
    times = np.arange(frames) / rate_hz
    images, labels, areas = [], [], np.zeros((frames, len(moving)))
    for frame, t_s in enumerate(times):
        levels, seen, shown = scene.picture(frame, sensor.margin)
        image = lit("lighting", lighting, sensor.blur(levels))
        if drift is not None:
            image = lit("exposure_drift", _checks.function("exposure_drift", drift(float(t_s)), 1), image)
        images.append(sensor.expose(image, rng))
        labels.append(seen)
        for thing, area in shown.items():
            areas[frame, thing - 1] = area
    positions, velocities = _ways(moving, sight.homographies)
    return MovingThings(
        images=np.stack(images),
        t_s=times,
        labels=np.stack(labels),
        homographies=sight.homographies.copy(),
        things=tuple(moving),
        positions_px=positions,
        velocities_px=velocities,
        areas_px=areas,
        camera=camera,
    )


def _camera(
    camera: str,
    speed: float | None,
    heading_deg: float | None,
    frames: int,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> Sight:
    _checks.choice("camera", camera, _sight.SPEEDS)
    given = _checks.number_or_none("camera_speed", speed, least=-1e4, most=1e4)
    heading_deg = _checks.number_or_none("camera_heading_deg", heading_deg, least=-1e6, most=1e6, of="degrees")
    return _sight.sight(camera, _sight.SPEEDS[camera] if given is None else given, heading_deg, frames, size, rng)


def _things(
    things: int | Sequence[Thing], wishes: Wishes, sight: Sight, size: tuple[int, int], rng: np.random.Generator
) -> list[Thing]:
    count = _checks.whole(things)
    if count is not None:
        return drawn(_checks.integer("things", things, least=0, most=1_000), wishes, sight, size, rng)
    expected = "how many, or Things"
    return [
        _checks.instance("things", thing, Thing, "Things") for thing in _checks.iterable("things", things, expected)
    ]


def _ground(kind: str, seed: int, size: tuple[int, int]) -> Texture:
    _checks.choice("kind", kind, BANDS)
    # The ground repeats after at least two pictures' width.
    return Texture.make(kind, seed=seed, period=1 << max(9, int(np.ceil(np.log2(2 * max(size))))))


def _boxes(
    boxes: int, height: float, camera: str, sight: Sight, size: tuple[int, int], rng: np.random.Generator
) -> list[Box]:
    boxes = _checks.integer("boxes", boxes, least=0, most=1_000)
    height = _checks.number("box_height", height, least=0, most=0.99)
    if not boxes:
        return []
    if camera not in _sight.WITH_DEPTH:
        raise OptionError(
            f'boxes, camera: got {boxes} and "{camera}", expected boxes with a camera that is "static", "sideways" or '
            '"forward"'
        )
    if height >= 0.99 * sight.distances.min():
        raise OptionError(
            f"box_height: got {height:g}, expected less than the camera's least distance, {sight.distances.min():g}"
        )
    return drawn_boxes(boxes, height, sight, size, rng)


def _ways(things: Sequence[Thing], homographies: F64) -> tuple[F64, F64]:
    """Positions in the frames, and motions against the ground there."""
    positions = np.full((len(homographies), len(things), 2), np.nan)
    velocities = positions.copy()
    for frame, homography in enumerate(homographies):
        for k, thing in enumerate(things):
            if thing.present(frame):
                positions[frame, k] = mapped(homography, thing.position(frame))
                if frame and thing.present(frame - 1):
                    # Where it would be now if it had stood since the frame before.
                    velocities[frame, k] = positions[frame, k] - mapped(homography, thing.position(frame - 1))
    return positions, velocities
