"""Clips of things that move, against an evaluation of their own: areas, ways, textures, parallax, light."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from rsflow import DTypeError, OptionError, synthetic
from rsflow.synthetic import MovingThings, Sensor, Thing, moving_things

CLEAN = Sensor(noise=0.0, dtype="float32")
CAMERAS = ("static", "pan", "zoom", "turn", "hand_held", "sideways", "forward")
SIZE = (112, 84)


def seen_at(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., 2) through a homography, written out."""
    whole = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ homography.T
    return np.asarray(whole[..., :2] / whole[..., 2:])


def read(image: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray(ndimage.map_coordinates(image.astype(float), [points[..., 1], points[..., 0]], order=5))


def grid() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(SIZE[0], dtype=float), np.arange(SIZE[1], dtype=float)), axis=-1)


def inside(points: np.ndarray, border: float = 5.0) -> np.ndarray:
    return np.asarray(((points > border) & (points < np.array(SIZE) - 1 - border)).all(axis=-1))


@pytest.mark.parametrize("camera", CAMERAS)
def test_each_frame_is_the_first_one_through_its_homography(camera: str) -> None:
    thing = Thing(40.0, 30.0, dx=1.5, dy=0.7)
    scene = moving_things([thing], frames=9, size=SIZE, camera=camera, kind="smooth", sensor=CLEAN, seed=3)
    np.testing.assert_allclose(scene.homographies[0], np.eye(3), atol=1e-12)
    points = grid()
    there = seen_at(scene.homographies[8], points)
    still = inside(there) & ~ndimage.binary_dilation(scene.masks[0] | (read(scene.masks[8], there) > 0.1), iterations=3)
    assert still.mean() > 0.3
    off = (read(scene.images[8], there) - scene.images[0])[still]
    slope = np.hypot(*np.gradient(scene.images[0].astype(float)))[still]
    assert np.sqrt(np.mean(off**2)) < 0.01 * np.sqrt(np.mean(slope**2))
    if camera != "static":
        assert np.abs(scene.images[8] - scene.images[0])[still].mean() > 2.0
        assert np.abs(there - points).max() > 1.0


def test_areas_are_those_of_the_outlines() -> None:
    things = [
        Thing(30.3, 25.1, dx=0.3, dy=0.4, width=31.0, height=20.5, turn_deg=7.0),
        Thing(70.2, 55.8, dx=-0.7, width=25.25, height=18.5, shape="rectangle"),
    ]
    scene = moving_things(things, frames=5, size=SIZE, seed=1)
    true = np.array([np.pi / 4 * 31.0 * 20.5, 25.25 * 18.5])
    np.testing.assert_allclose(scene.areas_px, np.broadcast_to(true, (5, 2)), rtol=0.015)
    for number, area in enumerate(true, 1):
        counted = (scene.labels == number).sum(axis=(1, 2))
        np.testing.assert_allclose(counted, area, rtol=0.06)
    zoomed = moving_things(things, frames=5, size=SIZE, camera="zoom", camera_speed=0.05, seed=1)
    np.testing.assert_allclose(zoomed.areas_px[4, 0], true[0] * 1.05**8, rtol=0.01)


def test_a_pixel_belongs_to_a_thing_that_covers_more_than_half_of_it() -> None:
    # Its left edge is at 20.3 pixels from the first pixel's left edge, its right edge at 33.7.
    thing = Thing(26.5, 20.0, dx=0.0, width=13.4, height=9.0, shape="rectangle", contrast_levels=0.0, level=200.0)
    scene = moving_things([thing], frames=1, size=SIZE, contrast_levels=0.0, sensor=CLEAN)
    assert np.flatnonzero(scene.labels[0, 20]).tolist() == list(range(20, 34))
    # 7 of 10 of an edge's pixel: two of its three samples.
    np.testing.assert_allclose(scene.images[0][20, 19:22], [115.0, 115.0 + 85.0 * 2 / 3, 200.0], atol=1e-4)
    other = moving_things([Thing(26.1, 20.0, dx=0.0, width=13.4, shape="rectangle")], frames=1, size=SIZE)
    assert np.flatnonzero(other.labels[0, 20]).tolist() == list(range(20, 33))


@pytest.mark.parametrize("camera", ["static", "pan", "turn"])
def test_a_thing_keeps_its_texture_and_is_where_it_is_said(camera: str) -> None:
    thing = Thing(35.0, 30.0, dx=2.25, dy=1.5, width=36.0, height=28.0, kind="smooth", stops=((2, 4),), turn_deg=3.0)
    scene = moving_things([thing], frames=7, size=SIZE, camera=camera, sensor=CLEAN, seed=5)
    for frame in (3, 6):
        steps = {3: 1, 6: 4}[frame]
        np.testing.assert_allclose(thing.position(frame), [35 + 2.25 * steps, 30 + 1.5 * steps])
        middle = seen_at(scene.homographies[frame], thing.position(frame))
        np.testing.assert_allclose(scene.positions_px[frame, 0], middle, atol=1e-9)
        rows, columns = np.nonzero(scene.labels[frame] == 1)
        np.testing.assert_allclose([columns.mean(), rows.mean()], middle, atol=0.2)
        angle = np.deg2rad(3.0 * frame)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        points = grid()[ndimage.binary_erosion(scene.labels[0] == 1, iterations=6)]
        there = seen_at(scene.homographies[frame], (points - [35.0, 30.0]) @ turn.T + thing.position(frame))
        off = read(scene.images[frame], there) - read(scene.images[0], points)
        assert len(points) > 100
        assert np.sqrt(np.mean(off**2)) < 0.1
    assert scene.labels.max() == 1


def test_speeds_are_against_the_still_ground() -> None:
    thing = Thing(50.0, 40.0, dx=3.0, dy=-4.0, stops=((2, 3),), first_frame=1, last_frame=4)
    for camera in CAMERAS:
        scene = moving_things([thing], frames=6, size=SIZE, camera=camera, seed=2)
        speeds = np.hypot(*np.moveaxis(scene.velocities_px[:, 0], -1, 0))
        growth = np.sqrt([np.linalg.det(h[:2, :2]) for h in scene.homographies])
        np.testing.assert_allclose(speeds, [np.nan, np.nan, 0.0, *5.0 * growth[3:5], np.nan], atol=1e-9)
        assert np.isnan(scene.positions_px[:, 0, 0]).tolist() == [True, False, False, False, False, True]
        assert scene.counts.tolist() == [0, 1, 1, 1, 1, 0]
    static = moving_things([thing], frames=6, size=SIZE)
    np.testing.assert_allclose(static.velocities_px[4, 0], [3.0, -4.0])


def test_stops_that_overlap_count_once_and_before_its_first_frame_nothing_does() -> None:
    thing = Thing(0.0, 0.0, stops=((2, 5), (4, 6), (0, 3)), first_frame=1)
    assert [thing.steps(frame) for frame in range(9)] == [-1, 0, 0, 0, 0, 0, 1, 2, 3]
    assert [thing.present(frame) for frame in range(3)] == [False, True, True]


@pytest.mark.parametrize("speed", [0.3, 9.0])
@pytest.mark.parametrize("camera", ["static", "pan", "hand_held"])
def test_drawn_things_are_in_view_all_the_time_and_keep_their_numbers(speed: float, camera: str) -> None:
    scene = moving_things(2, frames=30, size=SIZE, speed_px=speed, camera=camera, shape="ellipse", seed=4)
    there = np.isfinite(scene.positions_px[..., 0])
    assert (there.sum(axis=1) == 2).all()
    if speed > 1:
        assert len(scene.things) > 2
    elif camera != "pan":
        assert len(scene.things) == 2
    moved = np.isfinite(scene.velocities_px[..., 0])
    still = np.array([np.linalg.det(h[:2, :2]) for h in scene.homographies])
    np.testing.assert_allclose(still, 1.0)
    np.testing.assert_allclose(np.hypot(*np.moveaxis(scene.velocities_px[moved], -1, 0)), speed)
    # What the labels show of a thing is near where it is, and nothing is shown of what is not there.
    for frame, labels in enumerate(scene.labels):
        for number in np.unique(labels[labels > 0]):
            rows, columns = np.nonzero(labels == number)
            off = np.hypot(*(np.array([columns.mean(), rows.mean()]) - scene.positions_px[frame, number - 1]))
            assert off < max(scene.things[number - 1].width, scene.things[number - 1].height)
    assert (scene.areas_px[~there] == 0).all()
    assert (scene.areas_px > 0).sum(axis=1).mean() > 1.6


def test_stop_and_go_and_crossing_of_drawn_things() -> None:
    stopped = moving_things(3, frames=40, size=SIZE, stop_frames=10, speed_px=1.0, seed=6)
    speeds = np.hypot(*np.moveaxis(stopped.velocities_px, -1, 0))
    assert (speeds == 0).sum() == 3 * 10
    assert ((stopped.areas_px > 0) & (speeds == 0)).sum() > 10
    crossed = moving_things(3, frames=40, size=SIZE, crossing=True, camera="pan", seed=6)
    apart = np.ptp(crossed.positions_px, axis=1).max(axis=1)
    assert apart[20] < 15 < apart[0]
    assert inside(crossed.positions_px[20], 20).all()


def test_later_things_hide_earlier_ones() -> None:
    things = [Thing(40.0, 40.0, dx=0.0, width=30.0, height=30.0), Thing(40.0, 40.0, dx=0.0, width=20.0, height=20.0)]
    scene = moving_things(things, frames=1, size=SIZE)
    areas = np.pi / 4 * np.array([30.0**2 - 20.0**2, 20.0**2])
    np.testing.assert_allclose(scene.areas_px[0], areas, rtol=0.01)
    assert scene.labels[0, 40, 40] == 2


def test_walkers_and_cars_keep_their_area_within_what_limbs_do() -> None:
    for shape in ("walker", "car"):
        thing = Thing(40.0, 40.0, dx=1.5, width=28.0, height=44.0, shape=shape)
        scene = moving_things([thing], frames=8, size=SIZE)
        assert 0.25 * 28 * 44 < scene.areas_px.min() < scene.areas_px.max() < 0.8 * 28 * 44
        changed = scene.areas_px.std() / scene.areas_px.mean()
        assert changed > 0.01 if shape == "walker" else changed < 0.005
    left, right = (
        moving_things([Thing(40.5, 40.0, dx=dx, width=29.0, height=20.0, shape="car")], frames=1, size=SIZE).masks[0]
        for dx in (-1.0, 1.0)
    )
    about = slice(40 - 20, 40 + 22)
    mirrored, straight = ((left != other)[:, about].sum() for other in (np.roll(right[:, ::-1], -30, axis=1), right))
    assert mirrored < 0.4 * straight


@pytest.mark.parametrize(("camera", "frame"), [("sideways", 8), ("forward", 20)])
def test_tops_of_boxes_move_as_their_height_says_and_are_not_moving(camera: str, frame: int) -> None:
    height = 0.3
    options = {"frames": frame + 1, "size": SIZE, "camera": camera, "kind": "smooth", "sensor": CLEAN, "seed": 8}
    scene = moving_things(0, boxes=3, box_height=height, **options)  # type: ignore[arg-type]
    assert not scene.masks.any()
    assert scene.things == ()
    points, centre = grid(), (np.array(SIZE) - 1) / 2
    bare = moving_things(0, **options)  # type: ignore[arg-type]
    box = ndimage.binary_erosion(np.abs(scene.images[0] - bare.images[0]) > 1e-3, iterations=2)
    assert 0.02 < box.mean() < 0.6
    ground = seen_at(scene.homographies[frame], points)
    # A point p of a plane at height z is seen at centre + (p - centre - shift) / (distance - z).
    distance = 1.0 / scene.homographies[frame, 0, 0]
    shift = (centre - ground[0, 0]) * distance - centre
    of_top = centre + (points - centre) * (1.0 - height)
    top = centre + (of_top - centre - shift) / (distance - height)
    residual = {}
    for name, there in (("ground", ground), ("top", top)):
        error = np.abs(read(scene.images[frame], there) - scene.images[0])
        residual[name] = np.where(inside(there), error, np.nan)
    on_top = residual["top"] < 0.3
    assert (on_top & box)[np.isfinite(residual["top"]) & box].mean() > 0.4
    assert (residual["ground"] < 0.3)[np.isfinite(residual["ground"]) & box].mean() < 0.2
    free = ~ndimage.binary_dilation(box, iterations=14) & np.isfinite(residual["ground"])
    assert free.sum() > 100
    assert (residual["ground"] < 0.3)[free].mean() > 0.8


@pytest.mark.parametrize("camera", ["pan", "sideways"])
def test_a_heading_is_where_the_camera_goes(camera: str) -> None:
    scene = moving_things(0, frames=3, size=SIZE, camera=camera, camera_speed=2.0, camera_heading_deg=30.0)
    np.testing.assert_allclose(scene.homographies[2, :2, 2], [-4 * np.cos(np.pi / 6), -4 * np.sin(np.pi / 6)])
    other = moving_things(0, frames=3, size=SIZE, camera=camera, seed=1).homographies[2, :2, 2]
    np.testing.assert_allclose(np.hypot(*other), 4.0)
    assert not np.allclose(other, scene.homographies[2, :2, 2])


def test_a_box_is_in_view_half_way_through() -> None:
    options = {"frames": 31, "size": SIZE, "camera": "sideways", "camera_speed": 6.0, "sensor": CLEAN, "seed": 5}
    bare, boxed = (moving_things(0, boxes=boxes, **options).images[15] for boxes in (0, 1))  # type: ignore[arg-type]
    assert (np.abs(bare - boxed) > 1).sum() > 50


def test_things_go_behind_boxes() -> None:
    thing = Thing(10.0, 42.0, dx=3.0, width=14.0, height=60.0, shape="rectangle")
    free = moving_things([thing], frames=30, size=SIZE, seed=9)
    hidden = moving_things([thing], frames=30, size=SIZE, boxes=3, seed=9)
    assert (hidden.areas_px <= free.areas_px + 1e-9).all()
    assert (hidden.areas_px < 0.95 * free.areas_px).any()


def test_a_shadow_darkens_the_ground_beside_and_is_not_moving() -> None:
    thing = Thing(40.0, 30.0, dx=0.0, width=36.0, height=30.0)
    options = {"frames": 1, "size": SIZE, "contrast_levels": 0.0, "sensor": CLEAN}
    lit, shaded = (moving_things([thing], shadow=depth, **options) for depth in (0.0, 0.4))  # type: ignore[arg-type]
    np.testing.assert_array_equal(lit.labels, shaded.labels)
    ground = ~ndimage.binary_dilation(lit.masks[0], iterations=2)
    assert shaded.images[0][ground].min() == pytest.approx(0.6 * 115.0, abs=2.0)
    darker = (lit.images[0] - shaded.images[0] > 10) & ground
    rows, columns = np.nonzero(darker)
    assert columns.mean() > 45
    assert rows.mean() > 33
    thing_alone = ndimage.binary_erosion(lit.masks[0], iterations=2)
    np.testing.assert_allclose(lit.images[0][thing_alone], shaded.images[0][thing_alone], atol=1e-3)


def test_light_goes_on_the_whole_picture() -> None:
    options = {"frames": 4, "size": SIZE, "rate_hz": 10.0, "sensor": CLEAN, "seed": 2}
    steady = moving_things(1, **options)  # type: ignore[arg-type]
    switched = moving_things(1, exposure_drift=synthetic.light_switch(0.5, 0.1, 0.3, plus=4.0), **options)  # type: ignore[arg-type]
    for frame, (gain, plus) in enumerate([(1, 0), (0.5, 4), (0.5, 4), (1, 0)]):
        np.testing.assert_allclose(switched.images[frame], gain * steady.images[frame] + plus, rtol=1e-5)
    clouds = moving_things(1, exposure_drift=synthetic.passing_clouds(0.5, seed=1), **options)  # type: ignore[arg-type]
    share = clouds.images / steady.images
    assert 0.5 - 1e-5 < share.min() < 0.6 < 0.9 < share.max() < 1.0 + 1e-5
    assert np.abs(np.diff(share, axis=0)).max() > 0.01
    assert np.abs(np.diff(share, axis=1)).max() < 0.1


def test_the_same_arguments_give_the_same_pixels() -> None:
    def made(seed: int) -> MovingThings:
        return moving_things(2, frames=2, size=SIZE, camera="hand_held", shadow=0.3, seed=seed)

    first, again, other = made(1), made(1), made(2)
    np.testing.assert_array_equal(first.images, again.images)
    np.testing.assert_array_equal(first.labels, again.labels)
    assert first.things == again.things != other.things
    frames = list(first)
    assert [(frame.index, frame.t_s) for frame in frames] == [(0, 0.0), (1, pytest.approx(1 / 30))]
    np.testing.assert_array_equal(frames[1].image, first.images[1])
    assert (len(first), first.labels.dtype, first.images.dtype) == (2, np.int32, np.uint8)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"boxes": 2, "camera": "pan"}, 'boxes, camera: got 2 and "pan"'),
        ({"boxes": 2, "camera": "forward", "frames": 400}, "box_height|camera_speed, frames"),
        ({"boxes": 1, "camera": "forward", "frames": 100, "box_height": 0.6}, "box_height: got 0.6"),
        ({"camera": "zoom", "camera_speed": 0.5, "frames": 100}, "camera_speed, frames: got 0.5 and 100"),
        ({"camera": "walking"}, 'camera: got "walking"'),
        ({"things": -1}, "things: got -1"),
        ({"shadow": 1.5}, "shadow: got 1.5"),
        ({"shape": "cat"}, 'shape: got "cat"'),
        ({"speed_px": -1.0}, "speed_px: got -1"),
    ],
)
def test_what_makes_no_sense_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        moving_things(**{"frames": 2, "size": (32, 24), **options})  # type: ignore[arg-type]


def test_things_that_are_none_are_refused() -> None:
    with pytest.raises(DTypeError, match="things"):
        moving_things([(1.0, 2.0)], frames=1)  # type: ignore[list-item]
    with pytest.raises(OptionError, match='shape: got "cat"'):
        Thing(0.0, 0.0, shape="cat")
    with pytest.raises(OptionError, match="width: got 0"):
        Thing(0.0, 0.0, width=0.0)
