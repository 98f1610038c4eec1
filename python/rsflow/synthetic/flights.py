"""What a camera sees that flies over flat, textured ground, with its exact motion."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import fields
from ..camera.model import Camera
from ..capture.stream import Frame
from ..errors import ShapeError
from ._geometry import Optics, Path, path_from_rates
from .lighting import Lighting, lit
from .sensor import WEBCAM, Sensor, sensor_or
from .textures import BANDS, CONTRAST_LEVELS, MEAN_LEVEL, Texture

__all__ = ["Flight", "MovingObject", "flight", "flight_with_object"]

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class MovingObject:
    """A flat thing that slides over the ground, with a texture of its own.

    Attributes
    ----------
    center_m : (x, y)
        Where it is on the ground at time 0, from the point below the camera; x and y as the camera's.
    size_m : (float, float)
        Its extent along x and y.
    velocity_m_s : (x, y)
        Its velocity over the ground.
    shape : {"ellipse", "rectangle"}
        Its outline.
    level : float
        Its mean grey level.
    seed : int
        Of its texture.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> thing = synthetic.MovingObject((0.01, 0.0), (0.02, 0.01), (0.05, 0.0), shape="rectangle")
    >>> flight = synthetic.flight(frames=3, objects=[thing], seed=1)
    >>> bool((flight.masks == 1).any()), flight.objects == (thing,)
    (True, True)
    """

    center_m: tuple[float, float]
    size_m: tuple[float, float]
    velocity_m_s: tuple[float, float]
    shape: str = "ellipse"
    level: float = 150.0
    seed: int = 1_000

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        for name in ("center_m", "size_m", "velocity_m_s"):
            values = _checks.vector(name, getattr(self, name), 2, "two finite numbers, along x and y")
            put(name, tuple(values.tolist()))
        if not 1e-9 <= min(self.size_m) <= max(self.size_m) <= 1e9:
            raise _checks.refused("size_m", self.size_m, "two lengths from 1e-09 to 1e+09 metres")
        _checks.choice("shape", self.shape, ("ellipse", "rectangle"))
        put("level", _checks.number("level", self.level, least=-1e9, most=1e9, of="grey levels"))
        put("seed", _checks.integer("seed", self.seed, least=0))

    def covers(self, x: F64, y: F64, t_s: float) -> NDArray[np.bool_]:
        """Whether the ground at (x, y), in metres, is under the object at time `t_s`."""
        x = _checks.array("x", x, ..., "metres on the ground").astype(np.float64, copy=False)
        y = _checks.array("y", y, ..., "metres on the ground").astype(np.float64, copy=False)
        t_s = _checks.number("t_s", t_s, of="seconds")
        _checks.broadcast("x, y", x, y)
        # Far outside it overflows, and is outside.
        with np.errstate(over="ignore", invalid="ignore"):
            a = (x - self.center_m[0] - self.velocity_m_s[0] * t_s) / (0.5 * self.size_m[0])
            b = (y - self.center_m[1] - self.velocity_m_s[1] * t_s) / (0.5 * self.size_m[1])
            if self.shape == "ellipse":
                return np.asarray(a * a + b * b <= 1.0)
        return np.asarray((np.abs(a) <= 1.0) & (np.abs(b) <= 1.0))


@dataclass(frozen=True, eq=False)
class Flight:
    """Frames of a flight and the truth about it.

    Velocity, rate and `down` follow `rsflow.VelocityEstimator` with a camera fixed to the body without rotation: the
    velocity of an interval is the camera's mean velocity over the ground, in the camera's axes half-way through.

    Attributes
    ----------
    camera : Camera
        The camera that took the frames.
    images : (N, height, width) of the sensor's dtype
    t_s : (N,) float64
        Time of each frame, the middle of its exposure.
    height_m : (N,) float64
        Perpendicular distance from the ground.
    velocity_m_s : (N, 3) float64
        Mean velocity since the previous frame; row 0 is NaN.
    rate_rad_s : (N, 3) float64
        Mean angular rate since the previous frame, right-handed, in the camera's axes; row 0 is NaN.
    down : (N, 3) float64
        Straight down, in the camera's axes.
    position_m : (N, 3) float64
        Of the camera; the ground is z = 0, z points down, x and y are the camera's at time 0 if it starts level.
    masks : (N, height, width) uint8
        0 on the ground, k where object k - 1 is seen.
    objects : tuple of MovingObject

    Examples
    --------
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=3, rate_hz=30.0, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> [(frame.index, round(frame.t_s, 3), frame.image.shape) for frame in flight]
    [(0, 0.0, (144, 176)), (1, 0.033, (144, 176)), (2, 0.067, (144, 176))]
    >>> flight.velocity_m_s[1].round(6).tolist()
    [0.03, 0.0, 0.0]
    """

    camera: Camera
    images: NDArray[Any]
    t_s: F64
    height_m: F64
    velocity_m_s: F64
    rate_rad_s: F64
    down: F64
    position_m: F64
    masks: NDArray[np.uint8]
    objects: tuple[MovingObject, ...]
    path: Path = field(repr=False)

    __repr__ = fields

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames as `rsflow.frames` does."""
        for index, (image, t_s) in enumerate(zip(self.images, self.t_s, strict=True)):
            yield Frame(image, float(t_s), index)

    def flow(self, index: int) -> F64:
        """Compute the exact flow from frame `index - 1` to frame `index`, objects included.

        Returns
        -------
        (height, width, 2) float64
            NaN where the ray of a pixel does not meet the ground.
        """
        index = _checks.integer("index", index, least=1, most=len(self) - 1)
        optics = Optics(self.camera)
        before, after = float(self.t_s[index - 1]), float(self.t_s[index])
        x, y = optics.ground(*self.path.at(before), margin=0)
        x, y = np.broadcast_arrays(x, y)
        to_x, to_y = x.copy(), y.copy()
        for number, thing in enumerate(self.objects, 1):
            inside = self.masks[index - 1] == number
            to_x[inside] += thing.velocity_m_s[0] * (after - before)
            to_y[inside] += thing.velocity_m_s[1] * (after - before)
        u, v = optics.project(to_x, to_y, *self.path.at(after))
        rows, columns = np.indices(u.shape)
        return np.stack([u - columns, v - rows], axis=-1)


def flight(
    camera: Camera | None = None,
    *,
    frames: int = 30,
    rate_hz: float = 30.0,
    times_s: ArrayLike | None = None,
    height_m: float = 0.2,
    velocity_m_s: ArrayLike = (0.02, 0.0, 0.0),
    rate_rad_s: ArrayLike = (0.0, 0.0, 0.0),
    tilt_rad: tuple[float, float] = (0.0, 0.0),
    kind: str = "ground",
    texture_scale_m: float | None = None,
    sensor: Sensor = WEBCAM,
    exposure_s: float = 0.0,
    exposure_drift: Callable[[float], Lighting] | None = None,
    lighting: Lighting | None = None,
    objects: Sequence[MovingObject] = (),
    seed: int = 0,
) -> Flight:
    """Render a flight over flat, textured ground.

    Parameters
    ----------
    camera : Camera, optional
        By default 176 x 144 pixels, a focal length of 180 pixels, no distortion.
    frames : int
        Number of frames.
    rate_hz : float
        Frames per second, where `times_s` is not given.
    times_s : (N,) array_like, optional
        Times of the frames, increasing; replaces `frames` and `rate_hz`.
    height_m : float
        Perpendicular distance from the ground at the first frame.
    velocity_m_s : (3,) or (N - 1, 3) array_like
        Velocity of the camera in its own axes, for the whole flight or for each interval; z positive goes down.
    rate_rad_s : (3,) or (N - 1, 3) array_like
        Angular rate in the camera's own axes, right-handed.
    tilt_rad : (float, float)
        Attitude at the first frame: a turn about the camera's x axis, then one about its y axis.
    kind : str
        Texture of the ground, see `rsflow.synthetic.BANDS`.
    texture_scale_m : float, optional
        Metres on the ground for one pixel of the texture's bands; by default what a pixel sees at the first frame.
    sensor : Sensor
        Blur, noise and dtype.
    exposure_s : float
        Time of exposure, for motion blur, around the time of the frame.
    exposure_drift : callable, optional
        Time in seconds to the light of that moment, such as `auto_exposure(0.15)`.
    lighting : Lighting, optional
        Light that stays fixed in the image, such as `ramp(0.8, 1.2)`: vignetting or a lamp on the camera.
    objects : sequence of MovingObject
        What moves on the ground; later ones lie on top.
    seed : int
        Of ground and noise.

    Returns
    -------
    Flight

    Raises
    ------
    OptionError
        If a number makes no sense, times do not increase, or the camera would reach the ground.

    Examples
    --------
    >>> f = flight(frames=3, height_m=0.2, velocity_m_s=(0.02, 0.0, 0.0), seed=1)
    >>> f.images.shape, f.velocity_m_s[1].tolist()
    ((3, 144, 176), [0.02, 0.0, 0.0])
    >>> f.flow(1)[0, 0].round(4).tolist()  # 0.02 m/s * 180 px / 0.2 m / 30 Hz, to the left
    [-0.6, 0.0]
    """
    camera = _camera(camera)
    frames = _checks.integer("frames", frames, least=1, most=100_000)
    rate_hz = _checks.number("rate_hz", rate_hz, least=1e-6, most=1e6, of="frames per second")
    height_m = _checks.number("height_m", height_m, least=1e-6, most=1e9, of="metres")
    exposure_s = _checks.number("exposure_s", exposure_s, least=0, most=1e6, of="seconds")
    seed = _checks.integer("seed", seed, least=0)
    _checks.choice("kind", kind, BANDS)
    tilt = _checks.vector("tilt_rad", tilt_rad, 2, "two finite angles in radians")
    tilt_rad = (float(tilt[0]), float(tilt[1]))
    sensor = sensor_or(WEBCAM, sensor)
    lighting = None if lighting is None else _checks.function("lighting", lighting, 1)
    drift = None if exposure_drift is None else _checks.function("exposure_drift", exposure_drift, 1)
    objects = list(_checks.iterable("objects", objects, "MovingObjects"))
    for thing in objects:
        _checks.instance("objects", thing, MovingObject, "MovingObjects")
    if times_s is None:
        times = np.arange(frames) / rate_hz
    else:
        expected = "finite times in seconds, each later than the one before"
        times = _checks.array("times_s", times_s, ("N",), expected, finite=True).astype(np.float64)
    path = path_from_rates(times, height_m, velocity_m_s, rate_rad_s, tilt_rad)
    optics = Optics(camera)
    given = _checks.number_or_none("texture_scale_m", texture_scale_m, least=1e-9, most=1e9, of="metres")
    scale = height_m / optics.focal_px if given is None else given
    # The ground repeats after at least two pictures' width.
    period = 1 << max(9, int(np.ceil(np.log2(2 * max(optics.width, optics.height)))))
    scene = _Scene(optics, path, Texture.make(kind, seed=seed, period=period), scale, tuple(objects), kind)
    rng = np.random.default_rng([seed, 15_485_863])
    images, masks = [], []
    for t_s in times:
        image = sensor.blur(scene.exposed(float(t_s), exposure_s, sensor.margin))
        image = lit("lighting", lighting, image)
        if drift is not None:
            image = lit("exposure_drift", _checks.function("exposure_drift", drift(float(t_s)), 1), image)
        images.append(sensor.expose(image, rng))
        masks.append(scene.mask(float(t_s)))
    poses = [path.at(float(t)) for t in times]
    unknown = np.full((1, 3), np.nan)
    return Flight(
        camera=camera,
        images=np.stack(images),
        t_s=times,
        height_m=np.array([-position[2] for position, _ in poses]),
        velocity_m_s=np.vstack([unknown, path.velocity_m_s]),
        rate_rad_s=np.vstack([unknown, path.rate_rad_s]),
        down=np.stack([rotation.T @ (0.0, 0.0, 1.0) for _, rotation in poses]),
        position_m=np.stack([position for position, _ in poses]),
        masks=np.stack(masks),
        objects=tuple(objects),
        path=path,
    )


def flight_with_object(
    camera: Camera | None = None,
    *,
    objects: Sequence[MovingObject] | None = None,
    height_m: float = 0.2,
    velocity_m_s: ArrayLike = (0.02, 0.0, 0.0),
    **options: Any,
) -> Flight:
    """Render a `flight` over ground on which something moves; `Flight.masks` says where it is seen.

    Parameters
    ----------
    camera, height_m, velocity_m_s
        As for `flight`.
    objects : sequence of MovingObject, optional
        By default one ellipse, a quarter of the picture wide, that crosses the camera's way at its speed.
    **options
        Everything else that `flight` takes.

    Examples
    --------
    >>> f = flight_with_object(frames=2, seed=1)
    >>> 0.02 < float((f.masks[1] == 1).mean()) < 0.2
    True
    """
    camera = _camera(camera)
    height_m = _checks.number("height_m", height_m, least=1e-6, most=1e9, of="metres")
    velocity = _checks.array("velocity_m_s", velocity_m_s, ..., "finite numbers, (3,) or (N - 1, 3)", finite=True)
    if velocity.ndim not in (1, 2) or velocity.shape[-1] != 3 or velocity.size == 0:
        raise ShapeError(f"velocity_m_s: got shape {velocity.shape}, expected (3,) or (N - 1, 3)")
    if objects is None:
        seen = camera.width / camera.fx * height_m
        speed = float(np.hypot(*velocity.astype(np.float64).reshape(-1, 3)[0, :2])) or 0.1 * seen
        objects = (
            MovingObject(center_m=(0.1 * seen, -0.2 * seen), size_m=(seen / 4, seen / 5), velocity_m_s=(0.0, speed)),
        )
    return flight(camera, objects=objects, height_m=height_m, velocity_m_s=velocity_m_s, **options)


def _camera(camera: Camera | None) -> Camera:
    if camera is None:
        return Camera(180.0, 180.0, 87.5, 71.5, width=176, height=144)
    return _checks.instance("camera", camera, Camera, "an rsflow.Camera")


class _Scene:
    """The ground and what moves on it, seen along a path."""

    def __init__(
        self,
        optics: Optics,
        path: Path,
        ground: Texture,
        scale_m: float,
        objects: tuple[MovingObject, ...],
        kind: str,
    ) -> None:
        self.optics, self.path, self.ground, self.scale_m, self.objects = optics, path, ground, scale_m, objects
        self.textures = [Texture.make(kind, seed=thing.seed, period=256) for thing in objects]

    def exposed(self, t_s: float, exposure_s: float, margin: int) -> F64:
        """Render the picture without noise, averaged over the exposure, with `margin` more pixels on each side."""
        if exposure_s == 0.0:
            return self.instant(t_s, margin)
        # Half a pixel between instants: the sum then differs from the integral by less than the rounding to uint8.
        way_px = self.optics.longest_way(self.path, t_s - exposure_s / 2, t_s + exposure_s / 2)
        count = int(np.clip(np.ceil(2.0 * way_px), 2, 64))
        moments = t_s + exposure_s * ((np.arange(count) + 0.5) / count - 0.5)
        return np.asarray(sum(self.instant(float(t), margin) for t in moments) / count)

    def instant(self, t_s: float, margin: int) -> F64:
        x, y = self.optics.ground(*self.path.at(t_s), margin=margin)
        seen = np.isfinite(x) & np.isfinite(y)
        image = self.ground.sample(np.where(np.isfinite(x), x, 0.0) / self.scale_m,
                                   np.where(np.isfinite(y), y, 0.0) / self.scale_m)  # fmt: skip
        image = np.where(seen, MEAN_LEVEL + CONTRAST_LEVELS * image, MEAN_LEVEL)
        for thing, own in zip(self.objects, self.textures, strict=True):
            inside = thing.covers(x, y, t_s)
            if inside.any():
                wide_x, wide_y = np.broadcast_arrays(x, y)
                dx = wide_x[inside] - thing.velocity_m_s[0] * t_s
                dy = wide_y[inside] - thing.velocity_m_s[1] * t_s
                image[inside] = thing.level + CONTRAST_LEVELS * own.sample(dx / self.scale_m, dy / self.scale_m)
        return image

    def mask(self, t_s: float) -> NDArray[np.uint8]:
        mask = np.zeros((self.optics.height, self.optics.width), dtype=np.uint8)
        if self.objects:
            x, y = self.optics.ground(*self.path.at(t_s), margin=0)
            for number, thing in enumerate(self.objects, 1):
                mask[thing.covers(x, y, t_s)] = number
        return mask
