"""Camera files: what is written is read back, what others write is read, what is broken is named."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

import rsflow

LENS = (-0.2561, 0.13089, -0.00019, 6e-05, 0.02)
STD = {"fx": 0.6, "fy": 0.7, "cx": 1.1, "cy": 1.2, "k1": 0.003, "k2": 0.0125, "p1": 2e-4, "p2": 3e-05, "k3": 0.1}


def camera(**changes) -> rsflow.Camera:
    return rsflow.Camera(657.8, 658.4, 311.2, 245.6, **({"width": 640, "height": 480, "distortion": LENS} | changes))


FISHEYE = camera(distortion=(0.02, -0.006, 1e-05, -0.0003), model="fisheye")


@pytest.mark.parametrize(("name", "format"), [("c.json", None), ("c.yaml", None), ("c.yml", None), ("c.xml", None)])
@pytest.mark.parametrize("own", [camera(), camera(std=STD), FISHEYE, camera(distortion=(0.1,) * 8)])
def test_what_is_saved_is_loaded(tmp_path, name, format, own):
    own.save(tmp_path / name, format=format)
    assert rsflow.Camera.load(tmp_path / name) == own


@pytest.mark.parametrize("own", [camera(distortion=LENS[:4]), FISHEYE])
def test_kalibr_is_saved_and_loaded(tmp_path, own):
    own.save(tmp_path / "camchain.yaml", format="kalibr")
    assert rsflow.Camera.load(tmp_path / "camchain.yaml") == own


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(-1, 1, allow_subnormal=False), min_size=5, max_size=5), st.floats(1e-3, 1e6))
def test_every_number_survives_every_format(tmp_path_factory, lens, focal):
    folder = tmp_path_factory.getbasetemp()
    own = rsflow.Camera(focal, 2 * focal, -3.25, 1e-07, width=17, height=9, distortion=(*lens[:4], lens[4] or 0.5))
    for name, kind in (("c.json", None), ("c.json", "opencv"), ("c.yaml", None), ("c.yml", None), ("c.xml", None)):
        own.save(folder / name, format=kind)
        assert rsflow.Camera.load(folder / name) == own


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencv_reads_what_is_saved_for_it(tmp_path, suffix):
    path = tmp_path / f"c.{suffix}"
    camera().save(path, format="opencv")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert np.array_equal(storage.getNode("camera_matrix").mat(), camera().matrix)
    assert np.array_equal(storage.getNode("distortion_coefficients").mat().ravel(), LENS)
    assert storage.getNode("image_width").real() == 640
    storage.release()


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_what_opencv_writes_is_read(tmp_path, suffix):
    path = tmp_path / f"c.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon")
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", camera().matrix)
    storage.write("distortion_coefficients", np.array(LENS).reshape(5, 1))
    storage.write("image_points", np.zeros((2, 54, 2), np.float32))
    storage.release()
    assert rsflow.Camera.load(path) == camera()


def test_the_names_of_opencvs_interactive_program_are_read(tmp_path):
    path = tmp_path / "c.xml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("cameraMatrix", camera().matrix)
    storage.write("cameraMatrix_std_dev", np.array([0.6, 0.7, 1.1, 1.2]))
    storage.write("dist_coeffs", np.array(LENS))
    storage.write("dist_coeffs_std_dev", np.array([STD[k] for k in ("k1", "k2", "p1", "p2", "k3")]))
    storage.write("cameraResolution", np.array([640, 480]))
    storage.release()
    assert rsflow.Camera.load(path) == camera(std=STD)


def test_an_opencv_file_without_a_size_takes_one(tmp_path):
    path = tmp_path / "c.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("K", camera().matrix)
    storage.write("D", np.array(LENS))
    storage.release()
    with pytest.raises(rsflow.FormatError, match=r"c\.yml: image_width, image_height: the file does not say the size"):
        rsflow.Camera.load(path)
    assert rsflow.Camera.load(path, size=(640, 480)) == camera()


ROS_TOPIC = """\
header:
  frame_id: camera
height: 480
width: 640
distortion_model: plumb_bob
d: [-0.2561, 0.13089, -0.00019, 6e-05, 0.02]
k: [657.8, 0.0, 311.2, 0.0, 658.4, 245.6, 0.0, 0.0, 1.0]
binning_x: 0
---
"""

KALIBR = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.2561, 0.13089, -0.00019, 6e-05]
  distortion_model: radtan
  intrinsics: [657.8, 658.4, 311.2, 245.6]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, 0.1]
  camera_model: omni
  distortion_coeffs: [0, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [1.0, 657.8, 658.4, 311.2, 245.6]
  resolution: [640, 480]
"""


def test_a_ros_message_and_a_kalibr_chain_are_read(tmp_path):
    (tmp_path / "topic.yaml").write_text(ROS_TOPIC)
    assert rsflow.Camera.load(tmp_path / "topic.yaml") == camera()
    chain = tmp_path / "chain.yaml"
    chain.write_text(KALIBR)
    assert rsflow.Camera.load(chain, camera="cam0") == camera(distortion=LENS[:4])
    with pytest.raises(rsflow.FormatError, match=r"chain\.yaml: got the cameras cam0, cam1: say which one"):
        rsflow.Camera.load(chain)
    with pytest.raises(rsflow.FormatError, match="got no camera 'cam7', expected one of cam0, cam1"):
        rsflow.Camera.load(chain, camera="cam7")
    with pytest.raises(rsflow.FormatError, match=r"cam1\.camera_model: got 'omni', expected one of pinhole"):
        rsflow.Camera.load(chain, camera="cam1")


def test_a_saved_ros_file_has_what_ros_reads(tmp_path):
    camera().save(tmp_path / "front: 1.yaml")
    content = yaml.safe_load((tmp_path / "front: 1.yaml").read_text())
    assert content["camera_name"] == "front: 1"
    assert content["distortion_model"] == "plumb_bob"
    assert content["distortion_coefficients"] == {"rows": 1, "cols": 5, "data": list(LENS)}
    assert content["projection_matrix"]["data"] == [657.8, 0, 311.2, 0, 0, 658.4, 245.6, 0, 0, 0, 1, 0]
    assert content["rectification_matrix"]["data"] == np.eye(3).ravel().tolist()


def test_converting_keeps_the_camera(tmp_path):
    camera(std=STD).save(tmp_path / "a.json")
    rsflow.Camera.load(tmp_path / "a.json").save(tmp_path / "b.xml")
    assert rsflow.Camera.load(tmp_path / "b.xml") == camera(std=STD)


def test_a_format_that_cannot_hold_the_camera_says_so(tmp_path):
    with pytest.raises(rsflow.OptionError, match=r"kalibr's radtan cannot hold \('k3',\)"):
        camera().save(tmp_path / "c.yaml", format="kalibr")
    with pytest.raises(rsflow.OptionError, match="ROS camera_info cannot hold 12"):
        camera(distortion=(0.1,) * 12).save(tmp_path / "c.yaml")
    with pytest.raises(rsflow.OptionError, match=r'c\.txt", expected a name that ends in \.json'):
        camera().save(tmp_path / "c.txt")
    with pytest.raises(
        rsflow.OptionError, match='format: got "toml", expected "json", "opencv", "ros", "kalibr" or None'
    ):
        camera().save(tmp_path / "c.txt", format="toml")
    assert list(tmp_path.iterdir()) == []


ROS = "image_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
MATRIX = "camera_matrix: {rows: 3, cols: 3, data: [600, 0, 320, 0, 600, 240, 0, 0, 1]}\n"
OWN = {"format": "rsflow camera", "version": 1, "width": 640, "height": 480, "model": "pinhole"}
OWN |= {"fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0, "distortion": []}
OPENCV = (
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\n"
    "camera_matrix: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ 600., 0., 320.{rest} ]\n"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("just words", "got 'just words', expected keys with values"),
        ("- 1\n- 2\n", r"got \[1, 2\], expected keys with values"),
        ("a: 1\nb: 2\n", "got the keys a, b: not a camera file"),
        ("a: [1, 2\nb: }", "line 2: not valid YAML"),
        ("!!python/object/apply:os.system ['echo hacked']", "not valid YAML: could not determine a constructor"),
        ("k: !!python/name:os.system\n", "not valid YAML: could not determine a constructor"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "line 2: got a YAML alias"),
        ("[" * 5000 + "]" * 5000, "nested deeper than 20 levels"),
        ("\x00\x01\x02", "not valid YAML"),
        (
            ROS + "camera_matrix: {rows: 3, cols: 3, data: [600, 0]}\n",
            "got 2 numbers, expected a list of 9",
        ),
        (ROS + MATRIX.replace("600", ".nan"), r"camera_matrix: got \[nan, 0.*expected a list of 9 finite numbers"),
        (ROS + MATRIX.replace("600", "-600"), r"fx: got -600.0, expected a positive number"),
        (ROS + MATRIX.replace("rows: 3", "rows: 4"), "camera_matrix: got 9 numbers, expected 4 x 3"),
        (ROS + MATRIX.replace("[600, 0, 320", "[600, 5, 320"), "without skew"),
        (ROS.replace("640", "-5") + MATRIX, "width: got -5"),
        (ROS.replace("640", "wide") + MATRIX, "image_width: got 'wide', expected a whole number"),
        (ROS.replace("image_height: 480\n", "") + MATRIX, "image_height: the key is missing, expected a whole number"),
        (ROS.replace("plumb_bob", "magic") + MATRIX, "distortion_model: got 'magic', expected one of plumb_bob"),
        (ROS + MATRIX + "distortion_coefficients: {data: [1, 2, 3]}\n", "got 3 coefficients, expected 0 or 4 or 5"),
        (ROS + MATRIX + "distortion_coefficients: [1, 2, x, 4, 5]\n", "expected a list of finite numbers"),
        (ROS + MATRIX + "binning_x: 2\n", "binning_x: got 2, expected no binning"),
        ('{"format": "rsflow camera", ', "not valid JSON"),
        ("{" * 3 + "[" * 100_000, "not valid JSON|nested"),
        (json.dumps(OWN | {"version": 2}), "version: got 2, expected 1"),
        (json.dumps(OWN | {"fx": float("nan")}), "fx: got nan, expected a finite number"),
        (json.dumps(OWN | {"fx": None}), "fx: the key is missing, expected a finite number"),
        (json.dumps(OWN | {"width": 10**400}), "width: got 1000.*, expected a whole number"),
        (json.dumps(OWN | {"distortion": "none"}), "distortion: got 'none', expected a list of finite numbers"),
        (json.dumps(OWN | {"model": ["pinhole"]}), r"model: got \['pinhole'\], expected one of pinhole, fisheye"),
        (json.dumps(OWN | {"std": {"fx": -1}}), r"std\['fx'\]: got -1"),
        (json.dumps(OWN | {"std": [1]}), r"std: got \[1\], expected keys"),
        (OPENCV.format(rows=3, cols=3, rest=""), "not a valid OpenCV FileStorage"),
        (OPENCV.format(rows=100000, cols=100000, rest=""), "got a matrix of 100000 x 100000 in a file of"),
        (OPENCV.format(rows=-3, cols=-3, rest=""), "got a matrix of -3 x -3"),
        (OPENCV.format(rows=1, cols=3, rest=""), "camera_matrix: got 3 numbers, expected a list of 9"),
        ("%YAML:1.0\n---\n", "not a valid OpenCV FileStorage|not a camera file"),
        ("<?xml version='1.0'?>\n<opencv_storage><a>1</b></opencv_storage>\n", "not a valid OpenCV FileStorage"),
    ],
)
def test_a_file_that_is_broken_or_hostile_is_named(tmp_path, capfd, text, message):
    path = tmp_path / "camera.file"
    path.write_text(text)
    with pytest.raises(rsflow.FormatError, match=message) as caught:
        rsflow.Camera.load(path)
    assert str(caught.value).startswith(str(path))
    assert capfd.readouterr() == ("", "")


def test_a_file_that_is_not_text_or_too_large_is_refused(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_bytes(b"\xff\xfe\x00binary")
    with pytest.raises(rsflow.FormatError, match="not a text file"):
        rsflow.Camera.load(path)
    with path.open("wb") as file:
        file.truncate(100_000_000)
    with pytest.raises(rsflow.FormatError, match="got 100000000 bytes, expected at most 16777216"):
        rsflow.Camera.load(path)
    with pytest.raises(FileNotFoundError):
        rsflow.Camera.load(tmp_path / "missing.yaml")


def test_yaml_without_its_package_names_the_extra(tmp_path, monkeypatch):
    camera().save(tmp_path / "ros.yaml")
    camera().save(tmp_path / "opencv.yml")
    monkeypatch.setitem(__import__("sys").modules, "yaml", None)
    with pytest.raises(rsflow.MissingExtraError, match=r"ros\.yaml needs the package 'yaml'.*rsflow-motion\[yaml\]"):
        rsflow.Camera.load(tmp_path / "ros.yaml")
    assert rsflow.Camera.load(tmp_path / "opencv.yml") == camera()


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_a_damaged_file_is_a_format_error_or_a_camera(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp()
    name, kind = data.draw(
        st.sampled_from([("f.json", "json"), ("f.yaml", "ros"), ("f.yml", "opencv"), ("f.xml", None)])
    )
    camera(std=STD).save(folder / name, format=kind)
    content = bytearray((folder / name).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        if data.draw(st.booleans()):
            content[place] = data.draw(st.integers(0, 255))
        else:
            del content[place : place + data.draw(st.integers(1, 40))]
        if not content:
            break
    (folder / name).write_bytes(bytes(content))
    try:
        assert isinstance(rsflow.Camera.load(folder / name), rsflow.Camera)
    except rsflow.FormatError as error:
        named = str(folder / name) in str(error)
        assert named
