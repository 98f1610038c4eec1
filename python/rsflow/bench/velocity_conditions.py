"""The conditions under which a velocity is measured: made flights, and what the estimator is told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera.model import Camera
from ..synthetic import (
    Clock,
    Flight,
    Gyro,
    GyroLog,
    RangeFinder,
    Sensor,
    VehiclePart,
    auto_exposure,
    dirt,
    dropped,
    encoded,
    fixed_pattern,
    flight,
    moving_shadow,
    repeated,
    shadow,
    tiled_floor,
    water,
)

__all__ = ["HEIGHT_M", "RATE_HZ", "Condition", "Told", "conditions", "small_camera", "wide_camera"]

F64 = NDArray[np.float64]

RATE_HZ = 60.0
HEIGHT_M = 0.6
SENSOR = Sensor(noise=1.2, blur_px=0.6)
# Of a textureless floor's picture: a better sensor, so that what is fixed to it shows.
QUIET = replace(SENSOR, noise=0.7)
READOUT_S = 0.015
# Times of the frames are this wrong, each by itself, so that an interval is by the square root of two more.
JITTER_S = 0.003
GYRO_NOISE = 0.005


def wide_camera() -> Camera:
    """Give one of 320 x 240 pixels, 56 degrees wide, with a lens that distorts."""
    return Camera(300.0, 300.6, 161.2, 117.2, width=320, height=240, distortion=(-0.25, 0.08, 5e-4, -3e-4))


def small_camera() -> Camera:
    """Give one of 64 x 64 pixels, as flow sensors of autopilots have."""
    return Camera(64.0, 64.0, 31.5, 31.5, width=64, height=64)


@dataclass(frozen=True)
class Told:
    """What the estimator gets: a time and the other arguments of `update` for each frame."""

    t_s: F64
    rows: Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Condition:
    """A flight to measure.

    Attributes
    ----------
    name : str
    fly : callable
        Seed and number of frames to a Flight.
    tell : callable
        Flight and seed to what the estimator gets.
    options : mapping
        Of `rsflow.VelocityEstimator`.
    frames : int
        How many frames it takes to show.
    after_s : float
        Only velocities from then on count.
    """

    name: str
    fly: Callable[[int, int], Flight]
    tell: Callable[[Flight, int], Told]
    options: Mapping[str, Any] = field(default_factory=dict)
    frames: int = 40
    after_s: float = 0.0


def heading(seed: int) -> F64:
    """Give the unit vector of the way over the ground, another one for each seed."""
    angle = 0.4 + 2.4 * seed
    return np.array([np.cos(angle), np.sin(angle)])


def rocking(angle_rad: float, rate_rad_s: float) -> Callable[[float], F64]:
    """Give the rate of a camera that rocks by so much about x, at most so fast, and by half of that about y."""
    w = rate_rad_s / angle_rad
    return lambda t: rate_rad_s * np.array([np.cos(w * t), 0.4 * np.cos(0.8 * w * t), 0.0])


def world_velocity(seed: int, speed: float, climb: float, rate: Callable[[float], F64], frames: int) -> F64:
    """Give the velocity of each interval, in the camera's axes, of a straight flight of a camera that turns."""
    path = flight(
        Camera(8.0, 8.0, 3.5, 3.5, width=8, height=8), frames=frames, rate_hz=RATE_HZ, height_m=1.0,
        velocity_m_s=(0.0, 0.0, 0.0), rate_rad_s=rate, contrast_levels=0.0,
    ).path  # fmt: skip
    middle = np.asarray((np.arange(frames - 1) + 0.5) / RATE_HZ, dtype=np.float64)
    return np.asarray(np.swapaxes(path.at(middle)[1], 1, 2) @ np.append(speed * heading(seed), -climb))


def straight(
    speed: float = 1.0, *, climb: float = 0.0, rate: Callable[[float], F64] | None = None, camera: Camera | None = None,
    after: Callable[[Flight], Flight] = lambda f: f, **options: Any,
) -> Callable[[int, int], Flight]:  # fmt: skip
    """Fly straight on over the ground; what rocks goes straight on too."""

    def fly(seed: int, frames: int) -> Flight:
        velocity: Any = (*speed * heading(seed), -climb)
        if rate is not None:
            velocity = world_velocity(seed, speed, climb, rate, frames)
        made = {name: value(seed) if name == "lighting" else value for name, value in options.items()}
        return after(
            flight(
                camera or wide_camera(), frames=frames, rate_hz=RATE_HZ,
                **{"height_m": HEIGHT_M, "sensor": SENSOR, "seed": seed, "velocity_m_s": velocity,
                   "rate_rad_s": (0.0, 0.0, 0.0) if rate is None else rate, **made},
            )
        )  # fmt: skip

    return fly


def tell(
    *, rate: Gyro | str | None = "exact", down: bool = False, clock: Clock | None = None,
    heights: RangeFinder | None = None, odd: bool = False,
) -> Callable[[Flight, int], Told]:  # fmt: skip
    """Say what the estimator gets: exact heights, and with "exact" the exact rates, where nothing else is said."""

    def give(flown: Flight, seed: int) -> Told:
        times = flown.t_s if clock is None else replace(clock, seed=seed).read(flown.t_s)
        rates: F64 | None = None
        if isinstance(rate, Gyro):
            log: GyroLog = replace(rate, seed=seed).log(flown)
            rates = log.between(flown.t_s)
        elif rate == "exact":
            rates = flown.rate_rad_s
        found = None if heights is None else replace(heights, seed=seed).log(flown).at(flown.t_s)
        rows: list[dict[str, Any]] = []
        for k in range(len(flown)):
            row: dict[str, Any] = {"height_m": float(flown.height_m[k])}
            if found is not None and heights is not None:
                row = {"range_m" if heights.along == "axis" else "height_m": float(found[k])}
            if rates is not None and k:
                row["rate_rad_s"] = rates[k]
            if down:
                row["down"] = flown.down[k]
            if odd:
                row |= _odd(k)
            rows.append({name: value for name, value in row.items() if value is not None})
        return Told(np.asarray(times), rows)

    return give


def _odd(k: int) -> dict[str, Any]:
    """Give what instruments say when they fail: nothing of it may raise."""
    nothing = np.full(3, np.nan)
    failures: list[dict[str, Any]] = [
        {"rate_rad_s": nothing}, {"down": nothing}, {"height_m": 0.0}, {"height_m": None, "range_m": np.inf},
    ]  # fmt: skip
    return failures[k // 3 % 4] if k % 3 == 2 else {}


def _jumps(flown: Flight) -> Flight:
    """Leave out a second in the middle: what follows has nothing in common with what was before."""
    start = len(flown) // 3
    return dropped(flown, range(start, min(start + 60, len(flown) - 3)))


def _ramp(period_m: float, frames: int) -> Callable[[float], F64]:
    """From standing still to nine tenths of a period a frame, along x."""
    last = (frames - 1) / RATE_HZ
    return lambda t: np.array([0.9 * period_m * RATE_HZ * min(t / last, 1.0), 0.0, 0.0])


def conditions() -> tuple[Condition, ...]:
    """Give all, in the order in which the table has them."""
    exact = {"height_std_m": 0.0, "rate_std_rad_s": 0.0}
    unknown = {"height_std_m": 0.0}
    return (*_light(exact), *_rotation(exact, unknown), *_picture(exact), *_heights(exact))


def _light(exact: Mapping[str, Any]) -> list[Condition]:
    known = tell()
    shade = moving_shadow(0.5, width_m=0.15, gap_m=0.3, velocity_m_s=(0.8, 0.5), edge_m=0.01)
    ground = {
        "level flight": straight(),
        "64 x 64": straight(camera=small_camera()),
        "55 px a frame": straight(6.6),
        "100 px a frame": straight(12.0),
        "160 px a frame": straight(19.2),
        "exposure of 8 ms": straight(exposure_s=0.008),
        "light that drifts by 40 %": straight(exposure_drift=auto_exposure(0.4, period_s=0.5)),
        "fixed shadow": straight(lighting=lambda seed: shadow(0.5)),
        "moving shadows": straight(ground_effects=[shade]),
        "shallow water": straight(ground_effects=[water(ripple=0.1, glint_levels=60.0, wavelength_m=0.1, seed=1)]),
        "JPEG of quality 50": straight(after=lambda f: encoded(f, 50)),
        "climb at 0.5 m/s": straight(climb=0.5),
    }
    return [Condition(name, fly, known, exact) for name, fly in ground.items()]


def _rotation(exact: Mapping[str, Any], unknown: Mapping[str, Any]) -> list[Condition]:
    fast = straight(rate=rocking(np.deg2rad(24), 3.0))
    slow = straight(rate=rocking(np.deg2rad(5), 0.5))
    shaken = straight(rate=rocking(np.deg2rad(2), 1.0))
    rolling = straight(readout_s=READOUT_S)
    tilted = straight(readout_s=READOUT_S, rate=rocking(np.deg2rad(10), 1.5))
    bias = (0.03, -0.024, 0.018)
    late = {name: Gyro(rate_hz=400.0, delay_s=s, noise_rad_s=GYRO_NOISE) for name, s in (("20", 0.02), ("5", 0.005))}
    biased = Gyro(rate_hz=400.0, bias_rad_s=bias, noise_rad_s=GYRO_NOISE)
    noisy = Gyro(rate_hz=RATE_HZ, noise_rad_s=0.05, means=True)
    stated = {**unknown, "rate_std_rad_s": GYRO_NOISE}
    gyros = [
        (f"gyro {name} ms late, rate_delay_std_s", tell(rate=gyro), {**stated, "rate_delay_std_s": 0.02})
        for name, gyro in late.items()
    ] + [
        ("gyro biased by 0.03 rad/s, rate_std_rad_s", tell(rate=biased), {**stated, "rate_std_rad_s": 0.03}),
        ("gyro noise of 0.05 rad/s, rate_std_rad_s", tell(rate=noisy), {**stated, "rate_std_rad_s": 0.05}),
        ("gyro noise of 0.05 rad/s, not told", tell(rate=noisy), unknown),
    ]  # fmt: skip
    jitter = Clock(jitter_s=JITTER_S)
    return [
        Condition("tilt to 24 deg at 3 rad/s, down", fast, tell(rate=None, down=True), unknown, 60),
        Condition("tilt to 24 deg at 3 rad/s, down and gyro", fast, tell(down=True), exact, 60),
        Condition("rocking by 5 deg at 0.5 rad/s, nothing told", slow, tell(rate=None), unknown, 60),
        *(Condition(f"{name}, first 2 s", shaken, told, options, 121) for name, told, options in gyros),
        *(Condition(f"{name}, after 2 s", shaken, told, options, 180, 2.0) for name, told, options in gyros),
        Condition("times off by 3 ms, not told", straight(), tell(clock=jitter), exact),
        Condition("times off by 3 ms, dt_std_s", straight(), tell(clock=jitter),
                  {**exact, "dt_std_s": JITTER_S * float(np.sqrt(2.0))}),
        Condition("rolling shutter of 15 ms, not told", rolling, tell(), exact),
        Condition("rolling shutter of 15 ms, readout_s", rolling, tell(), {**exact, "readout_s": READOUT_S}),
        Condition("the same, tilting at 1.5 rad/s", tilted, tell(down=True), {**exact, "readout_s": READOUT_S}),
    ]  # fmt: skip


def _picture(exact: Mapping[str, Any]) -> list[Condition]:
    known = tell()
    plain: dict[str, Any] = {"sensor": QUIET, "contrast_levels": 0.15}
    tile = 32
    period_m = tile * HEIGHT_M / 300.3
    part = VehiclePart(0.46)
    mask = part.mask(*wide_camera().size, grow_px=2)
    tiles: dict[str, Any] = {"ground": tiled_floor(tile, relief=0.7, seed=3)}
    every, lost = (4, 9, 14, 19, 24, 29, 34), (5, 6, 13, 20, 21, 22, 33)
    made = {
        **{f"own vehicle on {share} %": straight(lighting=lambda seed, share=share: VehiclePart(share / 100, seed=seed))
           for share in (30, 46, 50)},
        "every fifth frame repeated": straight(after=lambda f: repeated(f, [k for k in every if k < len(f)])),
        "the same, encoded again": straight(
            after=lambda f: repeated(encoded(f, 90), [k for k in every if k < len(f)], jpeg_quality=80)),
        "dropped frames": straight(after=lambda f: dropped(f, [k for k in lost if k < len(f) - 1])),
        "dirt on the lens": straight(lighting=lambda seed: dirt(0.4, seed=seed)),
        "dirt over weak ground": straight(lighting=lambda seed: dirt(0.3, seed=seed), **plain),
        "fixed pattern over weak ground": straight(lighting=lambda seed: fixed_pattern(2.0, seed=seed), **plain),
        "weak ground": straight(**plain),
        "fine concrete, 1.5 grey levels": straight(kind="noise", contrast_levels=1.5, sensor=QUIET),
        "tiles, 5 px a frame": straight(5.0 * HEIGHT_M / 300.3 * RATE_HZ, **tiles),
        "tiles, 0.9 periods a frame": straight(0.9 * period_m * RATE_HZ, **tiles),
    }  # fmt: skip
    found = [Condition(name, fly, known, exact) for name, fly in made.items()]
    found.insert(
        3, Condition("own vehicle on 46 %, mask", straight(lighting=lambda seed: part), known, {**exact, "mask": mask})
    )
    speeding = Condition("tiles, from 0 to 0.9 periods a frame", _speeding(period_m, tiles), known, exact, 80)
    return [*found, speeding, Condition("a second missing", straight(after=_jumps), known, exact, 100)]  # fmt: skip


def _speeding(period_m: float, options: Mapping[str, Any]) -> Callable[[int, int], Flight]:
    return lambda seed, frames: flight(
        wide_camera(), frames=frames, rate_hz=RATE_HZ, height_m=HEIGHT_M, velocity_m_s=_ramp(period_m, frames),
        sensor=SENSOR, seed=seed, **options,
    )  # fmt: skip


def _heights(exact: Mapping[str, Any]) -> list[Condition]:
    climbing = straight(climb=0.2)
    hole = RangeFinder(rate_hz=RATE_HZ, noise_m=0.003, holes_s=[(0.5, 1.5)])
    finder = RangeFinder(rate_hz=20.0, noise_m=0.006)
    return [
        Condition("heights with a hole of 1 s", climbing, tell(heights=hole), {**exact, "height_std_m": 0.003}, 110),
        Condition("range finder at 20 Hz, 1 %", climbing, tell(heights=finder), {**exact, "height_std_m": 0.006}, 110),
        Condition("NaN rates and down, height 0, range inf", straight(), tell(odd=True), exact, 60),
    ]
