"""Results as rows and columns, which `pandas.DataFrame` takes; flow as labelled arrays; flow in axes of matplotlib."""

from __future__ import annotations

import csv
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

import public_calls
import rsflow
from rsflow.batch import BatchItem, BatchStatus
from rsflow.extraction import columns
from rsflow.objects import OBJECT_COLUMNS

PAIR = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
FIELD = rsflow.dense_flow(PAIR.prev, PAIR.next, covariance=True)


def segmented():
    segmenter = rsflow.MotionSegmenter(camera_motion="moving")
    for frame in rsflow.synthetic.flight_with_object(frames=4):
        seen = segmenter.update(frame.image)
    return seen


ROWS = {
    "shift": lambda: rsflow.estimate_shift(PAIR.prev, PAIR.next),
    "velocity": public_calls.a_velocity,
    "segmentation": segmented,
    "camera": lambda: rsflow.Camera(30, 30, 9, 9, width=20, height=20, distortion=(0.1, 0, 0, 0), std={"fx": 0.5}),
    "frame": lambda: rsflow.Frame(PAIR.prev, 0.5, 3, name="a.png"),
    "batch": lambda: BatchItem("a.mp4", public_calls.Path("out"), BatchStatus.DONE, "", {"frames": 7}),
    "object": lambda: public_calls.THING,
    "view": lambda: public_calls.a_calibration().views[0],
}
TABLES = {
    "tracks": lambda: rsflow.track_points(PAIR.prev, PAIR.next, [(48, 32), (500, 10)]).to_table(),
    "no tracks": lambda: rsflow.track_points(PAIR.prev, PAIR.next, []).to_table(),
    "flow": lambda: FIELD.to_table(step=8),
    "objects": lambda: segmented().to_table(),
    "no objects": lambda: rsflow.MotionSegmenter().update(PAIR.prev).to_table(),
    "calibration": lambda: public_calls.a_calibration().to_table(),
}


@pytest.mark.parametrize("name", ROWS)
def test_one_thing_is_a_row_of_plain_values(name):
    row = ROWS[name]().to_dict()
    assert row
    assert all(type(value) in (str, int, float, bool) for value in row.values()), row
    if "status" in row:
        assert row["status"] == row["status"].lower()


@pytest.mark.parametrize("name", TABLES)
def test_several_are_columns_of_equal_length(name):
    table = TABLES[name]()
    assert {column.ndim for column in table.values()} == {1}
    assert len({len(column) for column in table.values()}) == 1
    assert all(column.dtype.kind in "fiubU" for column in table.values())


@pytest.mark.parametrize("name", [*ROWS, *TABLES])
def test_pandas_takes_them(name):
    pandas = pytest.importorskip("pandas")
    if name in ROWS:
        row = ROWS[name]().to_dict()
        frame = pandas.DataFrame([row, row])
        assert frame.shape == (2, len(row))
        assert list(frame.columns) == list(row)
    else:
        table = TABLES[name]()
        frame = pandas.DataFrame(table)
        assert frame.shape == (len(next(iter(table.values()))), len(table))


def test_rows_and_columns_are_those_of_the_files(tmp_path):
    """One name for one thing: what a result calls its values is what the files call them."""
    assert list(TABLES["objects"]()) == list(OBJECT_COLUMNS[2:])
    shift, velocity = ROWS["shift"]().to_dict(), ROWS["velocity"]().to_dict()
    assert set(list(shift)[:7]) < set(columns.MOTION)
    assert set(velocity) - {"speed_m_s"} <= set(columns.VELOCITY)
    assert tuple(columns.VELOCITY) == rsflow.velocity.COLUMNS
    tracker = rsflow.PointTracker(max_corners=20, record=True)
    for k, image in enumerate((PAIR.prev, PAIR.next)):
        tracks = tracker.update(image, t_s=0.1 * k)
    table = tracker.to_table().to_dict()
    rows = table["frame"] == 1
    for name, column in tracks.to_table().items():
        np.testing.assert_array_equal(table[name][rows], column)


def test_the_values_are_those_of_the_result():
    shift = ROWS["shift"]()
    row = shift.to_dict()
    assert (row["dx_px"], row["gain"], row["status"]) == (shift.dx, shift.gain, "valid")
    assert row["dx_std_px"] ** 2 == pytest.approx(shift.covariance[0, 0])
    blank = np.full((60, 60), 90, np.uint8)
    nothing = rsflow.estimate_shift(blank, blank).to_dict()
    assert np.isnan(nothing["dx_px"])
    assert np.isinf(nothing["dx_std_px"])
    table = TABLES["flow"]()
    at = table["y_px"], table["x_px"]
    np.testing.assert_array_equal(table["dx_px"], FIELD.uv[..., 0][at])
    np.testing.assert_array_equal(table["valid"], FIELD.valid[at])
    np.testing.assert_allclose(table["std_y_px"] ** 2, FIELD.covariance[..., 1, 1][at], rtol=1e-5)
    assert len(FIELD.to_table()["x_px"]) == 96 * 64
    assert FIELD.to_table(step=1000)["x_px"].tolist() == [95]
    np.testing.assert_array_equal(FIELD.angle_rad, FIELD.angle)
    velocity = public_calls.a_velocity()
    assert velocity.speed_m_s == pytest.approx(np.hypot(velocity.vx_m_s, velocity.vy_m_s))
    seen = segmented()
    assert seen.to_dict()["moving_share"] == pytest.approx(seen.moving.mean())
    assert seen.to_table()["vx_px_per_frame"].tolist() == [thing.vx_px_per_frame for thing in seen.objects]


def test_an_extraction_gives_its_tables(tmp_path):
    flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    done = rsflow.extract(flight.images, tmp_path / "out", frame_rate=30, videos=False)
    table = done.to_table()
    with done.files["motion"].open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(table) == list(rows[0])
    assert table["status"].tolist() == [row["status"] for row in rows]
    assert table["dx_px"][1:].tolist() == [float(row["dx_px"]) for row in rows[1:]]
    objects = done.to_table("objects")
    assert list(objects) == list(OBJECT_COLUMNS)
    assert {len(column) for column in objects.values()} == {0}
    with pytest.raises(rsflow.OptionError, match=r'name: got "velocity", expected "motion"'):
        done.to_table("velocity")


def test_flow_as_a_dataset():
    xarray = pytest.importorskip("xarray")
    data = FIELD.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert dict(data.sizes) == {"y": 64, "x": 96}
    np.testing.assert_array_equal(data.u, FIELD.uv[..., 0])
    np.testing.assert_array_equal(data.var_v, FIELD.covariance[..., 1, 1])
    assert (data.v.attrs["units"], data.x.attrs["units"]) == ("px", "px")
    assert float(data.u.sel(x=40, y=30)) == FIELD.uv[30, 40, 0]
    assert "var_u" not in rsflow.dense_flow(PAIR.prev, PAIR.next).to_xarray()


def test_without_xarray_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(rsflow.MissingExtraError) as caught:
        FIELD.to_xarray()
    assert str(caught.value) == (
        "FlowField.to_xarray needs the package 'xarray', which is not installed: pip install 'rsflow-motion[xarray]'"
    )


def test_flow_in_axes_of_matplotlib():
    axes = Figure().subplots()
    assert FIELD.plot(PAIR.prev, ax=axes, step=8, scale=3.0) is axes
    (quiver,) = [part for part in axes.collections if hasattr(part, "U")]
    (picture,) = axes.images
    np.testing.assert_array_equal(picture.get_array()[..., 0], PAIR.prev)
    at = quiver.Y.astype(int), quiver.X.astype(int)
    np.testing.assert_allclose(quiver.U, 3.0 * FIELD.uv[..., 0][at], rtol=1e-5)
    np.testing.assert_allclose(quiver.V, 3.0 * FIELD.uv[..., 1][at], rtol=1e-5)
    assert (axes.get_xlim(), axes.get_ylim()) == ((-0.5, 95.5), (63.5, -0.5))
    axes.figure.canvas.draw()
    short = FIELD.plot(ax=Figure().subplots(), step=8, scale=3.0, max_length=1.0)
    (quiver,) = [part for part in short.collections if hasattr(part, "U")]
    np.testing.assert_allclose(np.hypot(quiver.U, quiver.V), 1.0, rtol=1e-5)
    assert not short.images


def test_what_axes_do_not_take():
    axes = Figure().subplots()
    with pytest.raises(rsflow.DTypeError, match=r"ax: got Figure, expected axes of matplotlib"):
        FIELD.plot(ax=Figure())
    with pytest.raises(rsflow.OptionError, match=r'path: got "a.png", expected None with ax'):
        FIELD.plot(ax=axes, path="a.png")
    with pytest.raises(rsflow.OptionError, match="quiver: got the knob 'colour'"):
        FIELD.plot(ax=axes, colour=1)
    with pytest.raises(
        rsflow.ShapeError, match=r"picture: got shape \(60, 96\), expected that of the flow, \(64, 96\)"
    ):
        FIELD.plot(PAIR.prev[:60], ax=axes)


def test_points_over_the_picture():
    tracks = rsflow.track_points(PAIR.prev, PAIR.next, [(48, 32), (500, 10)])
    before = PAIR.next.copy()
    drawn = tracks.draw(PAIR.next)
    np.testing.assert_array_equal(PAIR.next, before)
    changed = np.argwhere((drawn != PAIR.next[..., None]).any(axis=2))
    assert len(changed) > 0
    assert np.abs(changed - (31, 50)).max() <= 4
    with pytest.raises(rsflow.ShapeError, match="frame: got shape"):
        tracks.draw(PAIR.next[0])


def test_a_colour_frame_is_told_what_to_do_by_every_streaming_object():
    colour = np.zeros((60, 80, 3), np.uint8)
    for update, name in (
        (rsflow.MotionSegmenter().update, "image"),
        (rsflow.DenseFlow().update, "frame"),
        (rsflow.PointTracker().update, "frame"),
    ):
        with pytest.raises(rsflow.ShapeError, match=rf"{name}: got colour, .* cv2\.cvtColor\({name}, cv2"):
            update(colour)
