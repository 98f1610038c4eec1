"""The camera model: projection, distortion and its inverse, scaling, cropping."""

from __future__ import annotations

import pickle

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rsflow
from rsflow.camera import distortion

LENS = (-0.2561, 0.13089, -0.00019, 0.00004, 0.0)


def camera(**changes) -> rsflow.Camera:
    values = {"width": 640, "height": 480, "distortion": LENS} | changes
    return rsflow.Camera(657.8, 658.4, 311.2, 245.6, **values)


def pixels(seed: int = 1, count: int = 500) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-0.5, -0.5), (639.5, 479.5), (count, 2))


@pytest.mark.parametrize(
    "lens",
    [
        (),
        LENS[:4],
        LENS,
        (0.3, -0.1, 0.001, -0.002, 0.02, 0.5, -0.05, 0.01),
        (0.3, -0.1, 0.001, -0.002, 0.02, 0.5, -0.05, 0.01, 0.002, -0.001, 0.0015, 0.0005),
    ],
)
def test_distortion_is_that_of_opencv_and_is_inverted_exactly(lens):
    own = camera(distortion=lens)
    ideal = own.undistort_points(pixels())
    assert np.isfinite(ideal).all()
    assert np.abs(own.distort_points(ideal) - pixels()).max() < 1e-7
    rays = own.undistort_points(pixels(), normalized=True)
    scene = np.column_stack([rays, np.ones(len(rays))])
    seen = cv2.projectPoints(scene, np.zeros(3), np.zeros(3), own.matrix, np.array(lens or (0.0,) * 4))[0].reshape(
        -1, 2
    )
    assert np.abs(seen - pixels()).max() < 1e-7
    assert np.allclose(rays * (own.fx, own.fy) + (own.cx, own.cy), ideal)
    assert np.abs(own.distort_points(rays, normalized=True) - pixels()).max() < 1e-7


def test_fisheye_is_that_of_opencv_up_to_the_edge_of_its_field():
    own = rsflow.Camera(
        220.0, 221.0, 319.0, 241.0, width=640, height=480, distortion=(0.02, -0.006, 0.001, -0.0003), model="fisheye"
    )
    rays = own.undistort_points(pixels(), normalized=True)
    inside = np.isfinite(rays).all(axis=1)
    assert inside.mean() > 0.75
    back = cv2.fisheye.distortPoints(rays[inside][None], own.matrix, np.array(own.distortion))[0]
    assert np.abs(back - pixels()[inside]).max() < 1e-6
    # A ray at 90 degrees or more meets no plane before the camera.
    beyond = (own.fx * 1.65 + own.cx, own.cy)
    assert np.isnan(own.undistort_points([beyond])).all()


def test_a_point_beyond_the_fold_of_the_lens_model_has_no_ray():
    own = camera(distortion=(-0.5, 0.0, 0.0, 0.0))
    # The distorted radius r (1 - 0.5 r^2) has its largest value at r^2 = 2/3: 0.544.
    inside, beyond = own.cx + own.fx * 0.54, own.cx + own.fx * 0.55
    assert np.isfinite(own.undistort_points([(inside, own.cy)])).all()
    assert np.isnan(own.undistort_points([(beyond, own.cy)])).all()


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(
        st.floats(-0.4, 0.4), st.floats(-0.2, 0.2), st.floats(-0.01, 0.01), st.floats(-0.01, 0.01), st.floats(-0.1, 0.1)
    )
)
def test_what_is_undistorted_is_either_right_or_nan(lens):
    own = camera(distortion=lens)
    ideal = own.undistort_points(pixels(count=50))
    good = np.isfinite(ideal).all(axis=1)
    assert np.isnan(ideal[~good]).all()
    assert np.abs(own.distort_points(ideal[good]) - pixels(count=50)[good]).max(initial=0.0) < 1e-6
    assert np.isfinite(own.undistort_points([(own.cx, own.cy)])).all()


def test_points_keep_their_type_and_shape():
    own = camera()
    assert own.undistort_points(pixels().astype(np.float32)).dtype == np.float32
    assert own.undistort_points(pixels()).dtype == np.float64
    assert own.undistort_points([(1, 2)]).dtype == np.float64
    assert own.undistort_points(np.zeros((0, 2))).shape == (0, 2)
    assert own.distort_points(np.zeros((0, 2), np.float32)).shape == (0, 2)
    for bad in (np.zeros(2), np.zeros((3, 3))):
        with pytest.raises(rsflow.ShapeError, match=r"points: got shape .* expected \(N, 2\)"):
            own.undistort_points(bad)
    assert np.isnan(own.undistort_points([(np.nan, 1.0)])).all()


def test_scaling_agrees_with_resizing_a_picture():
    own = camera(distortion=())
    small = own.scaled(320, 240)
    # The centre of a 2 x 2 block of pixels is the centre of the small pixel.
    corner = np.array([[100.5, 60.5]])
    ray = own.undistort_points(corner, normalized=True)
    assert np.allclose(small.distort_points(ray, normalized=True), [[50.0, 30.0]])
    image = np.zeros((480, 640), np.float32)
    image[60:62, 100:102] = 1.0
    resized = cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)
    assert np.unravel_index(resized.argmax(), resized.shape) == (30, 50)
    assert small.scaled(640, 480).matrix == pytest.approx(own.matrix)
    assert small.horizontal_fov_rad == pytest.approx(own.horizontal_fov_rad)
    with_std = camera(std={"fx": 0.6, "cy": 0.4, "k1": 0.01}).scaled(320, 120)
    assert with_std.std == pytest.approx({"fx": 0.3, "cy": 0.1, "k1": 0.01})
    with pytest.raises(rsflow.OptionError, match="width: got 0, expected"):
        own.scaled(0, 240)


def test_cropping_moves_the_principal_point():
    own = camera()
    cut = own.cropped((100, 50, 200, 150))
    assert cut.size == (200, 150)
    moved = own.undistort_points([(120.0, 70.0)], normalized=True)
    assert np.allclose(cut.undistort_points([(20.0, 20.0)], normalized=True), moved)
    with pytest.raises(rsflow.OptionError, match="expected a region inside 640 x 480"):
        own.cropped((600, 0, 41, 10))


def test_the_field_of_view_is_that_of_the_edges():
    plain = rsflow.Camera(320.0, 320.0, 319.5, 239.5, width=640, height=480)
    assert plain.horizontal_fov_rad == pytest.approx(np.pi / 2)
    assert plain.vertical_fov_rad == pytest.approx(2 * np.arctan(240 / 320))


def test_a_camera_is_a_value():
    own = camera(std={"fx": 0.5})
    assert own == pickle.loads(pickle.dumps(own))
    assert hash(own) == hash(camera())
    assert own != camera()
    assert rsflow.Camera.from_matrix(own.matrix, np.array(LENS), width=640, height=480, std={"fx": 0.5}) == own
    with pytest.raises(AttributeError):
        own.fx = 3.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fx": 0.0}, "fx: got 0.0, expected a positive number of pixels"),
        ({"fy": float("nan")}, "fy: got NaN, expected a positive number"),
        ({"cx": "middle"}, 'cx: got "middle", expected a finite number'),
        ({"width": 0}, "width: got 0, expected an integer of pixels"),
        ({"height": 1.5}, r"height: got 1\.5"),
        ({"distortion": (0.1, 0.2)}, "distortion: got 2 coefficients, expected 0, 4, 5, 8 or 12"),
        ({"distortion": (0.1, 0.2, 0.3, float("inf"))}, r"distortion\[3\]: got inf"),
        ({"model": "omni"}, 'model: got "omni", expected "pinhole" or "fisheye"'),
        ({"model": "fisheye", "distortion": LENS}, "got 5 coefficients, expected 0 or 4 for the model 'fisheye'"),
        ({"std": {"k9": 1.0}}, 'std: got "k9"'),
        ({"std": {"fx": -1.0}}, r"std\['fx'\]: got -1\.0"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(changes, message):
    values = {"fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0, "width": 640, "height": 480} | changes
    with pytest.raises(rsflow.OptionError, match=message):
        rsflow.Camera(**values)


def test_a_matrix_that_is_none_is_refused():
    with pytest.raises(rsflow.ShapeError, match=r"matrix: got shape \(2, 2\)"):
        rsflow.Camera.from_matrix(np.eye(2), width=4, height=4)
    with pytest.raises(rsflow.OptionError, match="without skew"):
        rsflow.Camera.from_matrix([[500, 1, 300], [0, 500, 200], [0, 0, 1]], width=640, height=480)


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_the_jacobian_is_that_of_differences(model):
    lens = (0.3, -0.1, 0.001, -0.002, 0.02, 0.5, -0.05, 0.01, 0.002, -0.001, 0.0015, 0.0005)[
        : 4 if model == "fisheye" else 12
    ]
    xy = np.random.default_rng(3).uniform(-0.8, 0.8, (200, 2))
    step = 1e-6
    got = np.stack(distortion.lens_map(model, lens, xy[:, 0], xy[:, 1])[2:], axis=1)
    by_x, by_y = (
        (distortion.forward(model, lens, xy + shift) - distortion.forward(model, lens, xy - shift)) / (2 * step)
        for shift in (np.array([step, 0.0]), np.array([0.0, step]))
    )
    assert np.allclose(got, np.column_stack([by_x[:, 0], by_y[:, 0], by_x[:, 1], by_y[:, 1]]), atol=1e-8)
