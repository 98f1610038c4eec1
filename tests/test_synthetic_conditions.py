"""Conditions of made flights, each against an evaluation of its own: rows, instruments, floors, recordings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

import rsflow
from rsflow import Camera, OptionError, RsflowError, synthetic
from rsflow.synthetic import Clock, Flight, Gyro, MovingObject, RangeFinder, Sensor, VehiclePart, flight

CLEAN = Sensor(noise=0.0, dtype="float32")
WIDE = Camera(150.0, 152.0, 80.0, 60.0, width=160, height=120, distortion=(-0.25, 0.12, 0.001, -0.0005, 0.01))
READOUT = 0.015


def swaying(t: float) -> tuple[float, float, float]:
    return (0.8 * math.sin(20 * t), 0.6 * math.cos(17 * t), 0.4)


def speeding(t: float) -> tuple[float, float, float]:
    return (0.3 + 0.2 * math.sin(9 * t), -0.1, 0.1 * math.cos(12 * t))


def test_each_row_of_a_rolling_shutter_is_that_row_of_a_picture_at_its_time() -> None:
    """Row r of H is exposed readout (r / (H - 1) - 1 / 2) later: global pictures at those times have the same row."""
    motion = {"velocity_m_s": speeding, "rate_rad_s": swaying, "tilt_rad": (0.1, -0.05)}
    thing = MovingObject((0.02, 0.01), (0.1, 0.08), (0.5, 0.3))
    options = {"height_m": 0.3, "sensor": CLEAN, "objects": [thing], "seed": 3, "kind": "smooth", **motion}
    rolling = flight(WIDE, times_s=[0.0, 0.04], readout_s=READOUT, **options)  # type: ignore[arg-type]
    for row in (0, 17, 60, 119):
        at = 0.04 + READOUT * (row / 119 - 0.5)
        whole = flight(WIDE, times_s=[0.0, at], **options)  # type: ignore[arg-type]
        np.testing.assert_allclose(rolling.images[1][row], whole.images[1][row], atol=0.1)
        np.testing.assert_array_equal(rolling.masks[1][row], whole.masks[1][row])
    still = flight(WIDE, times_s=[0.0, 0.04], **options)  # type: ignore[arg-type]
    assert np.abs(rolling.images[1][0] - still.images[1][0]).mean() > 1.0


@pytest.mark.parametrize("readout_s", [READOUT, -READOUT])
def test_flow_of_a_rolling_shutter_is_where_the_ground_goes(readout_s: float) -> None:
    f = flight(WIDE, times_s=[0.0, 0.02], kind="smooth", height_m=0.3, velocity_m_s=speeding, rate_rad_s=swaying,
               readout_s=readout_s, sensor=CLEAN, seed=3)  # fmt: skip
    flow = f.flow(1)
    height, width = f.images[0].shape
    y, x = np.indices((height, width))
    to_x, to_y = x + flow[..., 0], y + flow[..., 1]
    inside = (to_x > 4) & (to_x < width - 5) & (to_y > 4) & (to_y < height - 5)
    assert inside.mean() > 0.5
    read = ndimage.map_coordinates(f.images[1].astype(float), [to_y[inside], to_x[inside]], order=5)
    slope = np.hypot(*np.gradient(f.images[0].astype(float)))[inside]
    error = np.sqrt(np.mean((read - f.images[0][inside]) ** 2)) / np.sqrt(np.mean(slope**2))
    assert error < 0.005
    # Taken for a global shutter, the same motion is off by much more than the test can tell.
    other = flight(WIDE, times_s=[0.0, 0.02], height_m=0.3, velocity_m_s=speeding, rate_rad_s=swaying, seed=3)
    assert np.nanmax(np.abs(other.flow(1) - flow)) > 0.2


def test_level_rolling_flight_has_the_textbook_flow() -> None:
    """At v rows a second a picture moves by v dt (1 + v readout / (H - 1)) and so on: the rows' own equation."""
    f = flight(times_s=[0.0, 0.02], height_m=0.2, velocity_m_s=(0.0, 0.3, 0.0), readout_s=READOUT)
    rows_a_second = -0.3 * 180 / 0.2
    # y + v (t_y) = const with t_y the row's time: the row where a point is seen solves a linear equation.
    np.testing.assert_allclose(f.flow(1)[..., 1], rows_a_second * 0.02 / (1 - rows_a_second * READOUT / 143), atol=1e-7)


def test_motion_as_a_function_of_time_is_the_integral_of_it() -> None:
    f = flight(times_s=[0.0, 0.1, 0.25], height_m=0.3, velocity_m_s=lambda t: (0.2 * t, 0.1, 0.0), sensor=CLEAN)
    np.testing.assert_allclose(f.position_m[:, 0], 0.1 * f.t_s**2, atol=1e-12)
    np.testing.assert_allclose(f.velocity_m_s[1:, 0], [0.01, 0.035], atol=1e-9)
    turning = flight(times_s=[0.0, 0.1, 0.3], height_m=0.3, rate_rad_s=lambda t: (0.0, 0.0, 3 * t), sensor=CLEAN)
    np.testing.assert_allclose(turning.rate_rad_s[1:, 2], [0.15, 0.6], atol=1e-9)
    tilting = flight(times_s=np.arange(20) / 20, height_m=1.0, rate_rad_s=swaying, velocity_m_s=(0, 0, 0))
    turns = np.array([Gyro(rate_hz=4000.0).log(tilting).between(tilting.t_s)[k] for k in range(1, 20)])
    np.testing.assert_allclose(turns, tilting.rate_rad_s[1:], atol=0.05)


def test_velocity_of_a_flight_with_functions_is_the_displacement_in_the_axes_half_way() -> None:
    f = flight(times_s=[0.0, 0.05, 0.11], height_m=0.4, velocity_m_s=speeding, rate_rad_s=swaying)
    for k in (1, 2):
        half = f.path.at((f.t_s[k] + f.t_s[k - 1]) / 2)[1]
        mean = half.T @ (f.position_m[k] - f.position_m[k - 1]) / (f.t_s[k] - f.t_s[k - 1])
        np.testing.assert_allclose(f.velocity_m_s[k], mean, atol=1e-12)
    np.testing.assert_allclose(f.down[2], f.path.at(0.11)[1].T @ (0, 0, 1), atol=1e-12)


def long_flight(**motion: object) -> Flight:
    """A tiny picture: the instruments are what counts."""
    camera = Camera(10.0, 10.0, 7.5, 5.5, width=16, height=12)
    options = {"velocity_m_s": (0.0, 0.0, 0.0), **motion}
    return flight(camera, frames=121, rate_hz=60.0, height_m=1.0, **options)  # type: ignore[arg-type]


def test_gyro_has_its_bias_noise_and_rate() -> None:
    f = long_flight(rate_rad_s=(0.0, 0.0, 0.3))
    log = Gyro(rate_hz=500.0, bias_rad_s=(0.03, -0.02, 0.01), noise_rad_s=0.05, scale=1.1, seed=5).log(f)
    assert len(log.t_s) == pytest.approx(500 * 2.2, abs=2)
    assert log.t_s[0] < f.t_s[0] < f.t_s[-1] < log.t_s[-1]
    np.testing.assert_allclose(np.diff(log.t_s), 1 / 500, atol=1e-12)
    # Four deviations of the mean of 1100 readings, and of their deviation.
    np.testing.assert_allclose(log.rate_rad_s.mean(axis=0), (0.03, -0.02, 0.34), atol=4 * 0.05 / math.sqrt(1100))
    np.testing.assert_allclose(log.rate_rad_s.std(axis=0), 0.05, rtol=4 / math.sqrt(2200))
    steps = np.diff(log.rate_rad_s, axis=0)
    correlation = np.mean(steps[1:] * steps[:-1]) / np.mean(steps**2)
    assert correlation == pytest.approx(-0.5, abs=0.05)  # each reading's noise is its own


@pytest.mark.parametrize("means", [False, True])
def test_gyro_lags_by_its_delay(means: bool) -> None:
    f = long_flight(rate_rad_s=swaying)
    log = Gyro(rate_hz=1000.0, delay_s=0.02, means=means).log(f)
    middle = log.t_s - 0.02 - (0.0005 if means else 0.0)
    np.testing.assert_allclose(log.rate_rad_s[:, 0], 0.8 * np.sin(20 * middle), atol=0.02)
    exact = Gyro(rate_hz=1000.0, means=means).log(f).between(f.t_s)
    np.testing.assert_allclose(exact[1:], f.rate_rad_s[1:], atol=0.02)
    assert np.isnan(exact[0]).all()
    late = log.between(f.t_s)
    shifted = log.between(f.t_s + 0.02)
    np.testing.assert_allclose(shifted[1:-6], exact[1:-6], atol=0.02)
    assert np.abs(late[1:] - exact[1:]).max() > 0.2


def test_means_are_held_and_a_log_that_ends_says_nan() -> None:
    log = synthetic.GyroLog(np.array([0.0, 0.01, 0.02]), np.array([[9.0] * 3, [1.0] * 3, [2.0] * 3]), means=True)
    np.testing.assert_allclose(log.between([0.0, 0.015, 0.02])[1:, 0], [(1.0 + 0.5 * 2.0) / 1.5, 2.0])
    assert np.isnan(log.between([-0.1, 0.01, 0.03])[:, 0]).all()
    joined = synthetic.GyroLog(log.t_s, log.rate_rad_s)
    np.testing.assert_allclose(joined.between([0.0, 0.02])[1], (0.5 * 10 + 0.5 * 3) / 2)


def test_gyro_measures_in_the_axes_of_the_body() -> None:
    swapped = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    log = Gyro(R_body_from_camera=swapped).log(long_flight(rate_rad_s=(0.1, -0.2, 0.3)))
    np.testing.assert_allclose(log.rate_rad_s[50], (-0.2, 0.1, 0.3), atol=1e-12)


def test_range_finder_has_its_rate_noise_holes_and_axis() -> None:
    f = long_flight(tilt_rad=(0.4, 0.0), velocity_m_s=(0.0, 0.0, 0.0))
    down, axis = (RangeFinder(rate_hz=500.0, along=along).log(f) for along in ("down", "axis"))
    np.testing.assert_allclose(down.range_m, 1.0)
    np.testing.assert_allclose(axis.range_m, 1 / math.cos(0.4))
    noisy = RangeFinder(rate_hz=500.0, noise_m=0.003, noise_share=0.004, bias_m=0.05, along="down", seed=2).log(f)
    assert noisy.range_m.mean() == pytest.approx(1.05, abs=4 * 0.005 / math.sqrt(1100))
    assert noisy.range_m.std() == pytest.approx(0.005, rel=4 / math.sqrt(2200))
    holes = RangeFinder(rate_hz=20.0, holes_s=[(0.5, 1.5)]).log(f)
    np.testing.assert_array_equal(np.isnan(holes.range_m), (holes.t_s >= 0.5) & (holes.t_s < 1.5))
    assert np.isnan(RangeFinder().log(long_flight(tilt_rad=(1.7, 0.0))).range_m).all()


def test_range_readings_come_when_they_are_new() -> None:
    f = long_flight(velocity_m_s=(0.0, 0.0, 0.2))
    log = RangeFinder(rate_hz=20.0, delay_s=0.01).log(f)
    np.testing.assert_allclose(log.range_m, 1.0 - 0.2 * (log.t_s - 0.01), atol=1e-12)
    new, held = log.at(f.t_s), log.at(f.t_s, hold=True)
    assert np.isfinite(new).sum() == pytest.approx(40, abs=2)
    assert np.isfinite(held).all()
    assert (np.diff(held) <= 0).all()
    known = np.isfinite(new)
    np.testing.assert_array_equal(new[known], held[known])


def test_saved_logs_are_what_the_command_line_reads(tmp_path: Path) -> None:
    f = long_flight(rate_rad_s=swaying, velocity_m_s=(0.0, 0.0, 0.05))
    gyro = Gyro(rate_hz=200.0, noise_rad_s=0.01).log(f)
    heights = RangeFinder(rate_hz=20.0, along="down", holes_s=[(0.5, 0.8)]).log(f)
    gyro.save(tmp_path / "gyro.csv")
    heights.save(tmp_path / "heights.csv")
    table = np.loadtxt(tmp_path / "gyro.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(table, np.column_stack([gyro.t_s, gyro.rate_rad_s]))
    rates = rsflow.velocity.Rates.read(tmp_path / "gyro.csv")
    means = [rates.mean(float(f.t_s[k - 1]), float(f.t_s[k])) for k in (1, 50, 120)]
    np.testing.assert_allclose(means, gyro.between(f.t_s)[[1, 50, 120]], atol=0.01)
    known = rsflow.velocity.Heights.read(tmp_path / "heights.csv")
    assert known.at(frame=20, t_s=float(f.t_s[20])) == pytest.approx(f.height_m[20], abs=0.005)
    assert math.isnan(known.at(frame=39, t_s=float(f.t_s[39])))
    seen = np.isfinite(heights.range_m)
    written = np.loadtxt(tmp_path / "heights.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(written, np.column_stack([heights.t_s[seen], heights.range_m[seen]]))


def test_clock_tells_times_with_its_faults() -> None:
    t = np.arange(4000) / 60
    told = Clock(jitter_s=0.003, offset_s=0.5, rate=1.001, seed=3).read(t)
    error = told - (1.001 * t + 0.5)
    assert error.std() == pytest.approx(0.003, rel=4 / math.sqrt(8000))
    assert abs(error.mean()) < 4 * 0.003 / math.sqrt(4000)
    ticks = Clock(tick_s=0.001).read(t)
    assert ((t - ticks > -1e-11) & (t - ticks < 0.001)).all()
    np.testing.assert_array_equal(Clock().read(t), t)


def test_lost_frames_leave_means_over_longer_intervals() -> None:
    f = flight(frames=8, rate_hz=30.0, height_m=0.4, velocity_m_s=speeding, rate_rad_s=swaying, seed=2)
    lost = synthetic.dropped(f, [1, 4, 5])
    assert lost.t_s.tolist() == f.t_s[[0, 2, 3, 6, 7]].tolist()
    np.testing.assert_array_equal(lost.images, f.images[[0, 2, 3, 6, 7]])
    np.testing.assert_allclose(lost.velocity_m_s[2], f.velocity_m_s[3], atol=1e-12)
    half = f.path.at((f.t_s[6] + f.t_s[3]) / 2)[1]
    mean = half.T @ (f.position_m[6] - f.position_m[3]) / (f.t_s[6] - f.t_s[3])
    np.testing.assert_allclose(lost.velocity_m_s[3], mean, atol=1e-12)
    direct = flight(times_s=f.t_s[[3, 6]], height_m=0.4, velocity_m_s=(0, 0, 0))
    assert lost.flow(3).shape == direct.flow(1).shape


def test_repeated_frames_show_the_picture_before_and_no_motion() -> None:
    f = flight(frames=6, rate_hz=30.0, velocity_m_s=(0.05, 0.0, 0.0), seed=2)
    twice = synthetic.repeated(f, [2, 3])
    np.testing.assert_array_equal(twice.images[3], f.images[1])
    assert twice.shown_s.tolist() == f.t_s[[0, 1, 1, 1, 4, 5]].tolist()
    np.testing.assert_allclose(twice.flow(2), 0.0, atol=1e-9)
    np.testing.assert_allclose(twice.flow(4), 3 * f.flow(1), atol=1e-9)
    np.testing.assert_array_equal(twice.velocity_m_s, f.velocity_m_s)
    again = synthetic.repeated(f, [2], jpeg_quality=70)
    assert 0.5 < np.abs(again.images[2].astype(float) - f.images[1]).mean() < 12
    with pytest.raises(RsflowError, match="got images of float32, expected uint8"):
        synthetic.encoded(flight(frames=1, sensor=CLEAN))


def test_tiles_repeat_exactly_and_look_alike() -> None:
    """On a level flight by one tile a frame every picture is the same."""
    scale = 0.2 / 180
    floor = synthetic.tiled_floor(24, seed=2)
    f = flight(times_s=[0.0, 1.0], height_m=0.2, velocity_m_s=(24 * scale, -24 * scale, 0), ground=floor, sensor=CLEAN)
    np.testing.assert_allclose(f.images[0], f.images[1], atol=1e-3)
    assert f.images[0].std() == pytest.approx(35, rel=0.1)
    half = flight(times_s=[0.0, 1.0], height_m=0.2, velocity_m_s=(12 * scale, 0, 0), ground=floor, sensor=CLEAN)
    assert np.abs(half.images[0] - half.images[1]).mean() > 10


def test_worn_squares_can_be_told_apart() -> None:
    clean, worn = synthetic.checkered_floor(32), synthetic.checkered_floor(32, wear=0.2, seed=1)
    x = np.linspace(0, 31, 40)
    assert np.abs(clean.sample(x, x + 3) - clean.sample(x + 32, x + 3)).max() < 1e-9
    assert np.abs(worn.sample(x, x + 3) - worn.sample(x + 32, x + 3)).mean() > 0.05


def test_what_a_homography_moves_is_where_it_says() -> None:
    """Grey levels of the older frame, read where the truth says, are those of the newer one."""
    matrix = np.array([[1.02, -0.04, 2.0], [0.03, 0.98, -1.5], [2e-4, -1e-4, 1.0]])
    move = synthetic.homography_motion(matrix)
    pair = synthetic.textured_pair(move, size=(120, 90), sensor=CLEAN, seed=3)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(10.0, 110.0, 7), np.arange(10.0, 80.0, 7)))
    to = np.stack([x, y, np.ones_like(x)], axis=1) @ matrix.T
    np.testing.assert_allclose(pair.truth(x, y), to[:, :2] / to[:, 2:] - np.stack([x, y], axis=1), atol=1e-12)
    seen = ndimage.map_coordinates(pair.next.astype(float), (to[:, 1] / to[:, 2], to[:, 0] / to[:, 2]), order=5)
    assert np.abs(seen - pair.prev[y.astype(int), x.astype(int)]).max() < 1.0
    assert pair.prev.std() > 20


def test_light_of_both_frames_of_a_textured_pair() -> None:
    half, rows = synthetic.gain(0.5), synthetic.flicker(0.2, rows=10.0)
    plain = synthetic.textured_pair(lambda x, y: (0.0, 0.0), size=(40, 30), sensor=CLEAN, seed=3)
    pair = synthetic.textured_pair(
        lambda x, y: (0.0, 0.0), size=(40, 30), lighting=half, lighting_prev=rows, sensor=CLEAN, seed=3
    )
    np.testing.assert_allclose(pair.next, 0.5 * plain.next, atol=1e-4)
    np.testing.assert_allclose(pair.prev, rows(plain.prev.astype(float)), atol=1e-4)
    assert np.ptp((pair.prev / plain.prev)[:, 0]) == pytest.approx(0.4, abs=0.03)


def test_grounds_repeat_and_show_what_they_say() -> None:
    x, y = np.arange(128.0)[None, :], np.arange(128.0)[:, None]
    floors = {
        "stripes": synthetic.striped_floor(128, seed=1),
        "patches": synthetic.patchy_floor(128, plain=0.4, seed=1),
        "discs": synthetic.disc_floor(128, largest=30.0, seed=1),
    }
    seen = {name: floor.sample(x, y) for name, floor in floors.items()}
    for name, floor in floors.items():
        np.testing.assert_allclose(floor.sample(x + 128.0, y - 256.0), seen[name], atol=1e-9)
        assert (seen[name].mean(), seen[name].std()) == pytest.approx((0.0, 1.0), abs=0.02)
    # Along a stripe nothing changes, across it all does.
    assert np.abs(floors["stripes"].sample(x - 5.0, y + 5.0) - seen["stripes"]).max() < 0.02
    assert np.abs(floors["stripes"].sample(x + 5.0, y + 5.0) - seen["stripes"]).mean() > 0.3
    plain = np.abs(seen["patches"] - np.median(seen["patches"])) < 0.02
    assert plain.mean() == pytest.approx(0.4, abs=0.08)
    # Half of the steps from one pixel to the next are within a disc; those over its edge are many times as large.
    steps = np.abs(np.diff(seen["discs"]))
    assert np.quantile(steps, 0.95) > 10 * np.median(steps)
    assert not np.array_equal(seen["discs"], synthetic.disc_floor(128, largest=30.0, seed=2).sample(x, y))


def test_contrast_is_in_grey_levels() -> None:
    for levels in (0.0, 1.5, 20.0):
        f = flight(frames=1, contrast_levels=levels, kind="noise", sensor=CLEAN)
        assert f.images[0].std() == pytest.approx(levels, rel=0.05, abs=1e-9)


def test_a_moving_shadow_moves_as_it_says() -> None:
    """What the shadow leaves, in the picture of a camera that stands still, moves by the shadow's way."""
    shade = synthetic.moving_shadow(0.5, width_m=0.05, gap_m=0.4, velocity_m_s=(0.3, 0.0))
    still = {"velocity_m_s": (0, 0, 0), "contrast_levels": 0.0, "sensor": CLEAN, "times_s": [0.2, 0.25]}
    f = flight(ground_effects=[shade], **still)  # type: ignore[arg-type]
    places = [np.flatnonzero(np.diff((image[0] < 90).astype(int)))[0] for image in f.images]
    assert places[1] - places[0] == pytest.approx(0.3 * 0.05 * 180 / 0.2, abs=1)
    with pytest.raises(OptionError, match="one finite grey level a point"):
        flight(frames=1, ground_effects=[lambda levels, x, y, t: levels[:5]])


def test_water_moves_over_ground_that_stays() -> None:
    still = {"velocity_m_s": (0, 0, 0), "frames": 40, "rate_hz": 8.0, "sensor": CLEAN, "seed": 1}
    dry = flight(**still)  # type: ignore[arg-type]
    wet = flight(ground_effects=[synthetic.water(glint_levels=0.0, seed=1)], **still)  # type: ignore[arg-type]
    ratio = wet.images / dry.images - 1
    assert ratio.std() == pytest.approx(0.1, rel=0.15)
    assert np.abs(ratio.mean(axis=0)).mean() < 0.03


def test_what_is_fixed_to_the_sensor_stays_in_the_picture() -> None:
    part = VehiclePart(0.4, side="left", seed=2)
    moving = {"velocity_m_s": (0.5, 0.0, 0.0), "frames": 2, "sensor": CLEAN}
    f = flight(lighting=synthetic.combined(synthetic.dirt(0.5, seed=1), part), **moving)  # type: ignore[arg-type]
    plain = flight(**moving)  # type: ignore[arg-type]
    mask = part.mask(*f.camera.size)
    assert (~mask).mean() == pytest.approx(0.4, abs=0.01)
    np.testing.assert_array_equal(f.images[0][~mask], f.images[1][~mask])
    share = f.images / plain.images
    np.testing.assert_allclose(share[0][mask], share[1][mask], rtol=1e-4)
    assert share[0][mask].min() == pytest.approx(0.5, abs=0.06)
    grown = part.mask(*f.camera.size, grow_px=3)
    assert not (grown & ~mask).any()
    assert (~grown).sum() - (~mask).sum() == pytest.approx(3 * f.camera.height, rel=0.02)
    for side in ("bottom", "top", "right"):
        assert (~VehiclePart(0.3, side=side).mask(64, 48)).mean() == pytest.approx(0.3, abs=0.02)


def test_an_estimator_measures_under_conditions_that_it_is_told() -> None:
    """The pieces fit together as a user joins them: part of the vehicle, dropped frames, gyro, range finder."""
    part = VehiclePart(0.3)
    f = synthetic.dropped(
        flight(frames=30, rate_hz=60.0, height_m=0.5, velocity_m_s=(0.3, 0.1, 0.0), rate_rad_s=swaying, lighting=part),
        [7, 8, 19],
    )
    rates = Gyro(rate_hz=1000.0, noise_rad_s=0.002).log(f).between(f.t_s)
    heights = RangeFinder(rate_hz=200.0, along="down", noise_m=0.001).log(f).at(f.t_s)
    estimator = rsflow.VelocityEstimator(
        f.camera, height_std_m=0.001, rate_std_rad_s=0.005, mask=part.mask(*f.camera.size, grow_px=2)
    )
    errors = []
    for k, frame in enumerate(f):
        rate = None if k == 0 else rates[k]
        v = estimator.update(frame.image, frame.t_s, height_m=heights[k], rate_rad_s=rate, down=f.down[k])
        if v.valid:
            errors.append(np.array([v.vx_m_s, v.vy_m_s]) - f.velocity_m_s[k, :2])
    assert len(errors) > 20
    assert np.sqrt(np.mean(np.square(errors))) < 0.03 * 0.3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Gyro(rate_hz=0.0), "rate_hz: got 0.0, expected a finite number of readings per second"),
        (lambda: Gyro(bias_rad_s=(1.0, 2.0)), "bias_rad_s: got"),  # type: ignore[arg-type]
        (lambda: Gyro(R_body_from_camera=np.ones((3, 3))), "R_body_from_camera: got"),
        (lambda: Gyro().log(3), "flight: got 3, expected a Flight"),  # type: ignore[arg-type]
        (lambda: Gyro(rate_hz=1e6).log(long_flight()).between([0.0, math.nan]), r"times_s\[1\]: got NaN"),
        (lambda: RangeFinder(along="up"), 'along: got "up", expected "axis" or "down"'),  # type: ignore[arg-type]
        (lambda: RangeFinder(holes_s=[3.0]), r"holes_s: got shape \(\), expected pairs of times"),
        (lambda: Clock(jitter_s=-1.0), "jitter_s: got -1.0"),
        (lambda: VehiclePart(1.5), "share: got 1.5"),
        (lambda: VehiclePart(side="up"), 'side: got "up"'),  # type: ignore[arg-type]
        (lambda: synthetic.checkered_floor(33), "period: got 33, expected an even integer"),
        (lambda: synthetic.tiled_floor(16, joint=0.0, relief=0.0), "a plain floor shows no motion"),
        (lambda: synthetic.dropped(flight(frames=2), [5]), "frames: got 5, expected an integer from 0 to 1"),
        (lambda: synthetic.dropped(flight(frames=2), [0, 1]), "not all"),
        (lambda: synthetic.repeated(flight(frames=2), [0]), "frames: got 0"),
        (lambda: flight(readout_s=math.nan), "readout_s: got NaN"),
        (lambda: flight(ground=3), "ground: got 3, expected a Texture"),  # type: ignore[arg-type]
        (lambda: flight(velocity_m_s=lambda t: (1.0, 2.0)), "velocity_m_s: got"),
        (lambda: flight(frames=2, rate_hz=1e-4, velocity_m_s=lambda t: (0, 0, 0)), "expected at most 2000 s"),
    ],
)
def test_misuse_says_what_where_got_and_expected(make: object, message: str) -> None:
    with pytest.raises(RsflowError, match=message):
        make()  # type: ignore[operator]
