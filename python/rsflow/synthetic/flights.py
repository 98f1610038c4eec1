"""What a camera sees that flies over flat, textured ground, with its exact motion."""

from __future__ import annotations

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
from ._geometry import Optics
from ._path import Motion, Path, path_from_rates
from ._scene import Scene, row_delay
from .ground_effects import GroundEffect
from .lighting import Lighting, lit
from .moving_object import MovingObject
from .sensor import WEBCAM, Sensor, sensor_or
from .textures import BANDS, CONTRAST_LEVELS, Texture

__all__ = ["Flight", "flight", "flight_with_object"]

F64 = NDArray[np.float64]


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
        Time of each frame: the middle of its exposure, of that of its middle row where the shutter rolls.
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
    path : Path
        The pose at any time.
    readout_s : float
        How much later the last row is exposed than the first: row r of H is, by ``readout_s * (r / (H - 1) - 1 / 2)``,
        later than the frame's time. 0 for a global shutter.
    shown_s : (N,) float64
        When the picture was taken that each frame shows: `t_s`, but for frames that `repeated` gives once more.

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
    readout_s: float
    shown_s: F64

    __repr__ = fields

    def __len__(self) -> int:
        return len(self.images)

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames as `rsflow.frames` does."""
        for index, (image, t_s) in enumerate(zip(self.images, self.t_s, strict=True)):
            yield Frame(image, float(t_s), index)

    def flow(self, index: int) -> F64:
        """Compute the exact flow from frame `index - 1` to frame `index`, objects and rolling shutter included.

        Returns
        -------
        (height, width, 2) float64
            NaN where the ray of a pixel does not meet the ground.
        """
        index = _checks.integer("index", index, least=1, most=len(self) - 1)
        optics = Optics(self.camera)
        rows, columns = np.indices((optics.height, optics.width), dtype=np.float64)
        before, after = float(self.shown_s[index - 1]), float(self.shown_s[index])
        start = before + row_delay(rows[:, :1], optics.height, self.readout_s) if self.readout_s else np.array(before)
        ground_x, ground_y = np.broadcast_arrays(*optics.ground(*self.path.at(start), margin=0))

        def seen(at: F64) -> tuple[F64, F64]:
            """Pixels of the same ground, and of what moves on it, at times that broadcast."""
            to_x, to_y = ground_x.copy(), ground_y.copy()
            since = np.broadcast_to(at - start, to_x.shape)
            for number, thing in enumerate(self.objects, 1):
                inside = self.masks[index - 1] == number
                to_x[inside] += thing.velocity_m_s[0] * since[inside]
                to_y[inside] += thing.velocity_m_s[1] * since[inside]
            return optics.project(to_x, to_y, *self.path.at(at))

        u, v = seen(np.array(after))
        if self.readout_s:
            # Where a point is seen depends on when its row is exposed.
            for _ in range(60):
                told = np.where(np.isfinite(v), v, 0.0)
                last, (u, v) = v, seen(after + row_delay(told, optics.height, self.readout_s))
                if not np.nanmax(np.abs(v - last), initial=0.0) > 1e-10:
                    break
        return np.stack([u - columns, v - rows], axis=-1)


def flight(
    camera: Camera | None = None,
    *,
    frames: int = 30,
    rate_hz: float = 30.0,
    times_s: ArrayLike | None = None,
    height_m: float = 0.2,
    velocity_m_s: Motion = (0.02, 0.0, 0.0),
    rate_rad_s: Motion = (0.0, 0.0, 0.0),
    tilt_rad: tuple[float, float] = (0.0, 0.0),
    kind: str = "ground",
    ground: Texture | None = None,
    contrast_levels: float = CONTRAST_LEVELS,
    texture_scale_m: float | None = None,
    ground_effects: Sequence[GroundEffect] = (),
    sensor: Sensor = WEBCAM,
    exposure_s: float = 0.0,
    readout_s: float = 0.0,
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
    velocity_m_s : (3,) or (N - 1, 3) array_like, or callable
        Velocity of the camera in its own axes, for the whole flight or for each interval, or a function of the time in
        seconds; z positive goes down.
    rate_rad_s : (3,) or (N - 1, 3) array_like, or callable
        Angular rate in the camera's own axes, right-handed.
    tilt_rad : (float, float)
        Attitude at the first frame: a turn about the camera's x axis, then one about its y axis.
    kind : str
        Texture of the ground, see `rsflow.synthetic.BANDS`.
    ground : Texture, optional
        Ground of another kind, such as `tiled_floor()`; it goes before `kind`.
    contrast_levels : float
        Standard deviation of the ground in grey levels, before blur: 1 to 2 for fine concrete, 0 for none.
    texture_scale_m : float, optional
        Metres on the ground for one pixel of the texture's bands; by default what a pixel sees at the first frame.
    ground_effects : sequence of GroundEffect
        What changes the look of the ground, and of what is on it, with place and time: `moving_shadow`, `water`.
    sensor : Sensor
        Blur, noise and dtype.
    exposure_s : float
        Time of exposure, for motion blur, around the time of the frame.
    readout_s : float
        Rolling shutter: how much later the last row is exposed than the first. The frame's time is the middle of its
        middle row's exposure. Negative where the last row comes first.
    exposure_drift : callable, optional
        Time in seconds to the light of that moment, such as `auto_exposure(0.15)`.
    lighting : Lighting, optional
        What stays fixed in the image, such as `ramp(0.8, 1.2)` (vignetting or a lamp on the camera), `dirt()` or
        `VehiclePart()`; `combined` takes several.
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
    tilt = _checks.vector("tilt_rad", tilt_rad, 2, "two finite angles in radians")
    sensor = sensor_or(WEBCAM, sensor)
    lighting = None if lighting is None else _checks.function("lighting", lighting, 1)
    drift = None if exposure_drift is None else _checks.function("exposure_drift", exposure_drift, 1)
    if times_s is None:
        times = np.arange(frames) / rate_hz
    else:
        expected = "finite times in seconds, each later than the one before"
        times = _checks.array("times_s", times_s, ("N",), expected, finite=True).astype(np.float64)
    path = path_from_rates(times, height_m, velocity_m_s, rate_rad_s, (float(tilt[0]), float(tilt[1])))
    optics = Optics(camera)
    given = _checks.number_or_none("texture_scale_m", texture_scale_m, least=1e-9, most=1e9, of="metres")
    seed = _checks.integer("seed", seed, least=0)
    scene = Scene(
        optics=optics,
        path=path,
        ground=_ground(kind, ground, seed, optics),
        scale_m=height_m / optics.focal_px if given is None else given,
        contrast_levels=_checks.number("contrast_levels", contrast_levels, least=0, most=1e9, of="grey levels"),
        objects=[_checks.instance("objects", thing, MovingObject, "MovingObjects")
                 for thing in _checks.iterable("objects", objects, "MovingObjects")],
        kind=kind,
        effects=[_checks.function("ground_effects", e, 4) for e in _checks.iterable("ground_effects", ground_effects,
                                                                                    "functions of 4 arguments")],
        readout_s=_checks.number("readout_s", readout_s, least=-1e6, most=1e6, of="seconds"),
    )  # fmt: skip
    rng = np.random.default_rng([seed, 15_485_863])
    images, masks = [], []
    for t_s in times:
        image = sensor.blur(scene.exposed(float(t_s), exposure_s, sensor.margin))
        image = lit("lighting", lighting, image)
        if drift is not None:
            image = lit("exposure_drift", _checks.function("exposure_drift", drift(float(t_s)), 1), image)
        images.append(sensor.expose(image, rng))
        masks.append(scene.mask(float(t_s)))
    return _flown(camera, scene, times, np.stack(images), np.stack(masks))


def _ground(kind: str, ground: Texture | None, seed: int, optics: Optics) -> Texture:
    _checks.choice("kind", kind, BANDS)
    if ground is not None:
        return _checks.instance("ground", ground, Texture, "a Texture or None")
    # The ground repeats after at least two pictures' width.
    period = 1 << max(9, int(np.ceil(np.log2(2 * max(optics.width, optics.height)))))
    return Texture.make(kind, seed=seed, period=period)


def _flown(camera: Camera, scene: Scene, times: F64, images: NDArray[Any], masks: NDArray[np.uint8]) -> Flight:
    """Put the truth of the frames beside them."""
    path = scene.path
    position, rotation = path.at(times)
    # Between frames alone the means are what was asked for, to the last bit.
    asked = path.velocity_m_s, path.rate_rad_s
    velocity, rate = asked if len(path.t_s) == len(times) else path.means(times[:-1], times[1:])
    unknown = np.full((1, 3), np.nan)
    return Flight(
        camera=camera,
        images=images,
        t_s=times,
        height_m=-position[:, 2],
        velocity_m_s=np.vstack([unknown, velocity]),
        rate_rad_s=np.vstack([unknown, rate]),
        down=rotation[:, 2, :].copy(),
        position_m=np.array(position),
        masks=masks,
        objects=tuple(scene.objects),
        path=path,
        readout_s=scene.readout_s,
        shown_s=times.copy(),
    )


def flight_with_object(
    camera: Camera | None = None,
    *,
    objects: Sequence[MovingObject] | None = None,
    height_m: float = 0.2,
    velocity_m_s: Motion = (0.02, 0.0, 0.0),
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
    start = _checks.function("velocity_m_s", velocity_m_s, 1)(0.0) if callable(velocity_m_s) else velocity_m_s
    velocity = _checks.array("velocity_m_s", start, ..., "finite numbers, (3,) or (N - 1, 3)", finite=True)
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
