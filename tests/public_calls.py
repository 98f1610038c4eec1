"""Every public callable of rsflow, found by walking its modules, and for each the arguments of a call that works.

Long because it is one table, with a call for each.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import functools
import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import rsflow
from odd_values import HEIGHT, WIDTH
from rsflow import Camera, Frame, bench, objects, reproduce, synthetic, velocity
from rsflow.camera import board as boards
from rsflow.camera import calibration
from rsflow.extraction import ExtractSettings, Measured
from rsflow.interop import flow_sensor, mavlink, ros
from rsflow.synthetic import Flight, Sensor

# Not for callers of the package: the command line has a test of its own.
_NOT_WALKED = {"rsflow.cli"}


def modules(package: ModuleType = rsflow) -> Iterator[ModuleType]:
    """Yield the public modules; a package without names of its own is only the way to those inside it."""
    if hasattr(package, "__all__"):
        yield package
    if package is not rsflow and hasattr(package, "__all__"):
        return
    for found in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        if found.name.rpartition(".")[2].startswith("_") or found.name in _NOT_WALKED:
            continue
        module = importlib.import_module(found.name)
        if found.ispkg and not hasattr(module, "__all__"):
            yield from modules(module)
        elif hasattr(module, "__all__"):
            yield module


def public() -> dict[str, Any]:
    """Give each public function, class and method by the first name that it is reached by."""
    found: dict[str, Any] = {}
    seen: set[int] = set()
    for module in modules():
        for name in sorted(module.__all__):
            value = getattr(module, name)
            if not (inspect.isclass(value) or inspect.isroutine(value)) or id(value) in seen:
                continue
            if getattr(value, "_is_protocol", False):
                continue
            seen.add(id(value))
            path = f"{module.__name__}.{name}"
            found[path] = value
            if inspect.isclass(value):
                found |= {f"{path}.{member}": method for member, method in _methods(value)}
    return found


def _methods(kind: type) -> Iterator[tuple[str, Any]]:
    for name in dir(kind):
        owner = next((base for base in kind.__mro__ if name in vars(base)), object)
        if name.startswith("_") or not owner.__module__.startswith("rsflow"):
            continue
        value = inspect.getattr_static(kind, name)
        if isinstance(value, property):
            if value.fset is not None:
                yield f"{name} = ", value
        elif callable(getattr(kind, name)) and not isinstance(value, kind):
            yield name, getattr(kind, name)


@functools.cache
def frame(number: int = 0) -> np.ndarray[Any, Any]:
    """A frame with texture; each number is one pixel further to the right."""
    picture = synthetic.texture((HEIGHT, WIDTH + 8), "fine", seed=1)
    return np.ascontiguousarray(np.clip(picture[:, 8 - number : 8 - number + WIDTH], 0, 255).astype(np.uint8))


@functools.cache
def live_run() -> tuple[rsflow.live.LiveFrame, rsflow.live.LiveSummary]:
    seen: list[rsflow.live.LiveFrame] = []
    done = rsflow.live.watch([frame(0), frame(1)], on_frame=seen.append)
    return seen[-1], done


@functools.cache
def field() -> rsflow.FlowField:
    return rsflow.dense_flow(frame(0), frame(1))


CAMERA = Camera(40.0, 40.0, 15.5, 11.5, width=WIDTH, height=HEIGHT)
BOARD = boards.Board((4, 3), 0.02)
BOARD_CAMERA = (150.0, 150.0, 79.5, 59.5)
THING = objects.TrackedObject(1, 5.0, 5.0, (2, 2, 6, 6), 30, 1.0, 0.0, 3)
PART = synthetic.Part(dx=1.0, box=(4.0, 4.0, 12.0, 12.0))


@functools.cache
def flight() -> Flight:
    return synthetic.flight(CAMERA, frames=2, seed=1)


@functools.cache
def segmentation() -> rsflow.MotionSegmentation:
    segmenter = rsflow.MotionSegmenter()
    segmenter.update(frame(0))
    return segmenter.update(frame(1))


@functools.cache
def a_velocity() -> rsflow.Velocity:
    estimator = rsflow.VelocityEstimator(CAMERA, height_m=0.2)
    estimator.update(flight().images[0], 0.0)
    return estimator.update(flight().images[1], 0.1)


@functools.cache
def a_contact() -> rsflow.Contact:
    return rsflow.time_to_contact(flight().images[0], flight().images[1], 0.1)


@functools.cache
def a_scale_check() -> rsflow.ScaleCheck:
    return rsflow.check_scale(flight(), CAMERA, **RATE_LOG)


@functools.cache
def filtered() -> rsflow.FilteredVelocity:
    return rsflow.VelocityFilter().update(a_velocity())


@functools.cache
def a_probe() -> rsflow.grid.GridProbes:
    found = rsflow.grid.GridProbes([(16.0, 12.0)])
    found.add(a_grid())
    return found


def a_grid() -> rsflow.Grid:
    return rsflow.displacement_grid(frame(0), frame(1), window_size=16, step=8)


@functools.cache
def tracks() -> rsflow.Tracks:
    return rsflow.track_points(frame(0), frame(1), [(16, 12), (10, 10)])


@functools.cache
def a_calibration() -> rsflow.Calibration:
    view = calibration.View("a", True, corners=np.zeros((12, 2), np.float32), ids=np.arange(12), rms=0.1)
    camera = Camera(60.0, 60.0, 39.5, 29.5, width=80, height=60, std={"fx": 0.1, "fy": 0.1, "cx": 0.1, "cy": 0.1})
    return rsflow.Calibration(camera, 0.1, (view,), BOARD, {"fx": 0.1}, {"fx": 0.0}, {"fx": 0.0}, np.eye(9), 0.5, 0.0)


def _stretch(x: Any, y: Any) -> tuple[Any, Any]:
    return 0.01 * x, 0.0 * y


@functools.cache
def _deformed() -> synthetic.DeformedPair:
    return synthetic.speckle_pair(_stretch, size=(24, 20), seed=1)


def extraction(folder: Path) -> rsflow.Extraction:
    return rsflow.Extraction(folder, True, {}, {})


def _board_height() -> rsflow.calibration.BoardHeight:
    return rsflow.calibration.BoardHeight(0.5, 0.001, 0.5, np.array([0.0, 0.0, 1.0]), 0.001, 0.1)


@functools.cache
def _board_view() -> np.ndarray[Any, Any]:
    camera = rsflow.Camera(*BOARD_CAMERA, width=160, height=120)
    return synthetic.chessboard_views(camera, board=BOARD.size, count=1)[0]


def _fields(record: Any) -> dict[str, Any]:
    return {item.name: getattr(record, item.name) for item in dataclasses.fields(record) if item.init}


def _ready(kind: Any, *updates: Any, **options: Any) -> Any:
    """A streaming object that has seen these frames."""
    made = kind(**options)
    for update in updates:
        made.update(*update) if isinstance(update, tuple) else made.update(update)
    return made


def _reading() -> flow_sensor.FlowReading:
    return flow_sensor.flow_reading(a_velocity(), forward="top", height_m=0.2)


def _autopilot(folder: Path) -> mavlink.MavlinkWriter:
    return mavlink.MavlinkWriter(f"px4:{folder / 'made.tlog'}", forward="top")


def _bag(folder: Path) -> ros.RosBagWriter:
    return ros.RosBagWriter(folder / "made_bag", forward="top", overwrite=True)


def _writer(folder: Path) -> rsflow.VideoWriter:
    return rsflow.VideoWriter(folder / "made.mp4", frame_rate=25)


def _object_table(folder: Path) -> objects.ObjectTable:
    return OPENED.enter_context(objects.ObjectTable(folder / "objects.csv"))


def _heights() -> velocity.Heights:
    return velocity.Heights("frame", np.array([0.0, 1.0]), np.array([0.2, 0.3]))


def _rates() -> velocity.Rates:
    return velocity.Rates(np.array([0.0, 0.1]), np.array([[0.0, 0.1, 0.2], [0.0, 0.1, 0.3]]))


def _attitudes() -> velocity.Attitudes:
    return velocity.Attitudes(np.array([0.0, 0.1]), np.array([[0.0, 0.1, 1.0], [0.0, 0.1, 1.0]]))


def _condition_row() -> bench.ConditionRow:
    return bench.ConditionRow("level flight", 39, 0.03, -0.01, 1.0, 0.0, 0.69, 0.95)


def _velocity_bench() -> bench.VelocityBench:
    return bench.VelocityBench((_condition_row(),), (_latency_row(),), "avx2", 1, {})


def _segmentation_bench() -> bench.SegmentationBench:
    row = bench.SegmentationRow("hand-held", "rsflow", 0.95, 0.96, 0.94, 0.001, 0.0, 2.5)
    return bench.SegmentationBench((row,), "avx2", 1, 2, 90, (320, 240), {})


def _extract_bench() -> bench.ExtractBench:
    row = bench.ExtractRow((64, 48), "everything", 2.0, 3.0, 0.2, 0.3)
    part = bench.PartRow((64, 48), "dense flow", 0.3)
    return bench.ExtractBench((row,), (part,), 2, "avx2", 90, {})


def _kind_row() -> bench.KindRow:
    return bench.KindRow("points", "light", "steady", "rsflow track_points", 0.006, 0.013, 0.96, 0.0, 0.95, 2.6, 1.0)


def _kinds_bench() -> bench.KindsBench:
    size = bench.SizeRow("points", (64, 48), "rsflow track_points", 0.4, 1.0)
    return bench.KindsBench((_kind_row(),), (size,), "a CPU", "avx2", 1, 3, {})


def _latency_row() -> bench.LatencyRow:
    return bench.LatencyRow((64, 64), "rsflow", "frame to velocity", 0.4, 0.7)


def _bench_row() -> bench.Row:
    return bench.Row("points", "a", "rsflow", 0.1, 0.2, 1.0, 3.0)


# What the calls need open; the test that makes them closes it.
OPENED = contextlib.ExitStack()


class Inline(concurrent.futures.Executor):
    """Run a job at once, in the caller's thread."""

    def submit(self, job: Callable[..., Any], /, *args: Any, **options: Any) -> concurrent.futures.Future[Any]:
        done: concurrent.futures.Future[Any] = concurrent.futures.Future()
        done.set_result(job(*args, **options))
        return done


Call = tuple[Callable[..., Any], dict[str, Any]]
RATE_LOG: dict[str, Any] = {"t_s": np.arange(10) * 0.1, "rate_rad_s": np.zeros((10, 3))}
PAIR = {"prev": frame(0), "next": frame(1)}
LIT = {"illumination": "none"}
JOB: dict[str, Any] = {"overwrite": True, "stride": 1, "videos": False, "progress": False, "frame_rate": 30}

# By qualified name: what makes the function and the arguments of a call that works.
CALLS: dict[str, Callable[[Path], Call]] = {
    "rsflow.Calibration": lambda _: (rsflow.Calibration, _fields(a_calibration())),
    "rsflow.Calibration.advice": lambda _: (a_calibration().advice, {}),
    "rsflow.Calibration.to_dict": lambda _: (a_calibration().to_dict, {}),
    "rsflow.Calibration.coverage": lambda _: (a_calibration().coverage, {}),
    "rsflow.Calibration.draw": lambda folder: (a_calibration().draw, {"folder": folder / "drawn"}),
    "rsflow.Calibration.save": lambda folder: (a_calibration().save, {"path": folder / "camera.json"}),
    "rsflow.Calibration.summary": lambda _: (a_calibration().summary, {}),
    "rsflow.Camera": lambda _: (Camera, _fields(CAMERA)),
    "rsflow.Camera.cropped": lambda _: (CAMERA.cropped, {"roi": (0, 0, 8, 8)}),
    "rsflow.Camera.distort_points": lambda _: (CAMERA.distort_points, {"points": [(1.0, 2.0)]}),
    "rsflow.Camera.from_matrix": lambda _: (
        Camera.from_matrix,
        {"matrix": CAMERA.matrix, "width": WIDTH, "height": HEIGHT},
    ),
    "rsflow.Camera.load": lambda folder: (Camera.load, {"path": folder / "camera.json"}),
    "rsflow.Camera.save": lambda folder: (CAMERA.save, {"path": folder / "saved.json"}),
    "rsflow.Camera.scaled": lambda _: (CAMERA.scaled, {"width": WIDTH // 2, "height": HEIGHT // 2}),
    "rsflow.Camera.to_dict": lambda _: (CAMERA.to_dict, {}),
    "rsflow.Camera.undistort_points": lambda _: (CAMERA.undistort_points, {"points": [(1.0, 2.0)]}),
    "rsflow.Calibration.to_table": lambda _: (a_calibration().to_table, {}),
    "rsflow.CalibrationError": lambda _: (rsflow.CalibrationError, {}),
    "rsflow.CaptureError": lambda _: (rsflow.CaptureError, {}),
    "rsflow.Contact": lambda _: (rsflow.Contact, _fields(a_contact())),
    "rsflow.Contact.to_dict": lambda _: (a_contact().to_dict, {}),
    "rsflow.ContactStatus": lambda _: (rsflow.ContactStatus, {"value": 0}),
    "rsflow.DTypeError": lambda _: (rsflow.DTypeError, {}),
    "rsflow.DenseFlow": lambda _: (rsflow.DenseFlow, {}),
    "rsflow.DenseFlow.reset": lambda _: (rsflow.DenseFlow().reset, {}),
    "rsflow.DenseFlow.update": lambda _: (_ready(rsflow.DenseFlow, frame(0)).update, {"frame": frame(1)}),
    "rsflow.Extraction": lambda folder: (rsflow.Extraction, _fields(extraction(folder))),
    "rsflow.Extraction.to_table": lambda folder: (
        rsflow.Extraction(folder, True, {"motion": folder / "heights.csv"}, {}).to_table,
        {"name": "motion"},
    ),
    "rsflow.ExtractionInterrupted": lambda folder: (
        rsflow.ExtractionInterrupted,
        {"message": "stopped", "extraction": extraction(folder)},
    ),
    "rsflow.FilterStatus": lambda _: (rsflow.FilterStatus, {"value": 0}),
    "rsflow.FilteredVelocity": lambda _: (rsflow.FilteredVelocity, _fields(filtered())),
    "rsflow.FilteredVelocity.to_dict": lambda _: (filtered().to_dict, {}),
    "rsflow.FlowField": lambda _: (rsflow.FlowField, _fields(field())),
    "rsflow.FlowField.mean": lambda _: (field().mean, {}),
    "rsflow.FlowField.plot": lambda folder: (field().plot, {"path": folder / "plot.png"}),
    "rsflow.FlowField.save": lambda folder: (field().save, {"path": folder / "flow.npy"}),
    "rsflow.FlowField.to_table": lambda _: (field().to_table, {"step": 4}),
    "rsflow.FlowField.to_xarray": lambda _: (field().to_xarray, {}),
    "rsflow.FlowField.warp": lambda _: (field().warp, {"frame": frame(1)}),
    "rsflow.Grid": lambda _: (rsflow.Grid, _fields(a_grid())),
    "rsflow.Grid.at": lambda _: (a_grid().at, {"points": [(16.0, 12.0)]}),
    "rsflow.Grid.extension": lambda _: (a_grid().extension, {"a": (10.0, 10.0), "b": (20.0, 12.0)}),
    "rsflow.Grid.plot": lambda folder: (a_grid().plot, {"what": "u", "path": folder / "grid.svg"}),
    "rsflow.Grid.save": lambda folder: (a_grid().save, {"path": folder / "grid.csv"}),
    "rsflow.Grid.to_xarray": lambda _: (a_grid().to_xarray, {}),
    "rsflow.Grid.replaced": lambda _: (a_grid().replaced, {}),
    "rsflow.Grid.strain": lambda _: (a_grid().strain, {"kind": "green"}),
    "rsflow.Grid.to_table": lambda _: (a_grid().to_table, {}),
    "rsflow.GridSequence": lambda _: (rsflow.GridSequence, {"window_size": 16, "step": 8}),
    "rsflow.GridSequence.reset": lambda _: (rsflow.GridSequence().reset, {}),
    "rsflow.GridSequence.update": lambda _: (
        _ready(rsflow.GridSequence, frame(0), window_size=16, step=8).update,
        {"frame": frame(1)},
    ),
    "rsflow.GridStatus": lambda _: (rsflow.GridStatus, {"value": 0}),
    "rsflow.HeightFromSpeed": lambda _: (
        rsflow.HeightFromSpeed,
        _fields(rsflow.height_from_speed(a_velocity(), 0.1, speed_std_m_s=0.01)),
    ),
    "rsflow.HeightStatus": lambda _: (rsflow.HeightStatus, {"value": "ok"}),
    "rsflow.InternalError": lambda _: (rsflow.InternalError, {}),
    "rsflow.OutOfMemoryError": lambda _: (rsflow.OutOfMemoryError, {}),
    "rsflow.FormatError": lambda _: (rsflow.FormatError, {}),
    "rsflow.Frame": lambda _: (Frame, {"image": frame(), "t_s": 0.0, "index": 0}),
    "rsflow.Frame.to_dict": lambda _: (Frame(frame(), 0.0, 0).to_dict, {}),
    "rsflow.Frames": lambda _: (
        rsflow.Frames,
        {
            "reader": rsflow.frames([frame()])._reader,
            **dict.fromkeys(("roi", "stop", "times", "frame_rate")),
            **{"grey": True, "color": False, "start": 0, "stride": 1},
        },
    ),
    "rsflow.Frames.close": lambda _: (rsflow.frames([frame()]).close, {}),
    "rsflow.MissingExtraError": lambda _: (rsflow.MissingExtraError, {}),
    "rsflow.MotionSegmentation": lambda _: (rsflow.MotionSegmentation, _fields(segmentation())),
    "rsflow.MotionSegmentation.moving_view": lambda _: (segmentation().moving_view, {}),
    "rsflow.MotionSegmentation.static_view": lambda _: (segmentation().static_view, {}),
    "rsflow.MotionSegmentation.to_dict": lambda _: (segmentation().to_dict, {}),
    "rsflow.MotionSegmentation.to_table": lambda _: (segmentation().to_table, {}),
    "rsflow.MotionSegmenter": lambda _: (rsflow.MotionSegmenter, {}),
    "rsflow.MotionSegmenter.reset": lambda _: (rsflow.MotionSegmenter().reset, {}),
    "rsflow.MotionSegmenter.update": lambda _: (
        _ready(rsflow.MotionSegmenter, frame(0)).update,
        {"image": frame(1)},
    ),
    "rsflow.OptionError": lambda _: (rsflow.OptionError, {}),
    "rsflow.PartialExtractionError": lambda folder: (
        rsflow.PartialExtractionError,
        {"message": "broke off", "extraction": extraction(folder)},
    ),
    "rsflow.PointStatus": lambda _: (rsflow.PointStatus, {"value": 0}),
    "rsflow.PointTracker": lambda _: (rsflow.PointTracker, {}),
    "rsflow.PointTracker.reset": lambda _: (rsflow.PointTracker().reset, {}),
    "rsflow.PointTracker.to_table": lambda _: (rsflow.PointTracker(record=True).to_table, {}),
    "rsflow.PointTracker.update": lambda _: (
        _ready(rsflow.PointTracker, frame(0), record=True).update,
        {"frame": frame(1)},
    ),
    "rsflow.QuiverStyle": lambda _: (rsflow.QuiverStyle, {}),
    "rsflow.QuiverStyle.fitted": lambda _: (rsflow.QuiverStyle.fitted, {"fields": field()}),
    "rsflow.RsflowError": lambda _: (rsflow.RsflowError, {}),
    "rsflow.ShapeError": lambda _: (rsflow.ShapeError, {}),
    "rsflow.SegmentationStatus": lambda _: (rsflow.SegmentationStatus, {"value": "ok"}),
    "rsflow.Shift": lambda _: (rsflow.Shift, _fields(rsflow.estimate_shift(**PAIR))),
    "rsflow.Shift.to_dict": lambda _: (rsflow.estimate_shift(**PAIR).to_dict, {}),
    "rsflow.ShiftStatus": lambda _: (rsflow.ShiftStatus, {"value": 0}),
    "rsflow.Tracks": lambda _: (rsflow.Tracks, _fields(tracks())),
    "rsflow.Tracks.draw": lambda _: (tracks().draw, {"frame": frame(1)}),
    "rsflow.Tracks.to_table": lambda _: (tracks().to_table, {}),
    "rsflow.ScaleCheck": lambda _: (rsflow.ScaleCheck, _fields(a_scale_check())),
    "rsflow.ScaleCheck.report": lambda _: (a_scale_check().report, {}),
    "rsflow.ScaleCheck.to_dict": lambda _: (a_scale_check().to_dict, {}),
    "rsflow.ScaleStatus": lambda _: (rsflow.ScaleStatus, {"value": "checked"}),
    "rsflow.TimeToContact": lambda _: (rsflow.TimeToContact, {"camera": CAMERA}),
    "rsflow.TimeToContact.reset": lambda _: (rsflow.TimeToContact().reset, {}),
    "rsflow.TimeToContact.update": lambda _: (
        rsflow.TimeToContact().update,
        {"image": frame(0), "t_s": 0.0, "rate_rad_s": (0.0, 0.0, 0.0)},
    ),
    "rsflow.check_scale": lambda _: (rsflow.check_scale, {"source": flight(), "camera": CAMERA, **RATE_LOG}),
    "rsflow.height_from_speed": lambda _: (
        rsflow.height_from_speed,
        {"velocity": a_velocity(), "speed_m_s": 0.1, "speed_std_m_s": 0.01},
    ),
    "rsflow.scale.Estimate": lambda _: (rsflow.scale.Estimate, {"value": 1.0, "std": 0.1, "low": 0.8, "high": 1.2}),
    "rsflow.time_to_contact": lambda _: (rsflow.time_to_contact, {**PAIR, "dt_s": 0.1}),
    "rsflow.Velocity": lambda _: (rsflow.Velocity, _fields(a_velocity())),
    "rsflow.Velocity.budget": lambda _: (a_velocity().budget, {}),
    "rsflow.Velocity.to_dict": lambda _: (a_velocity().to_dict, {}),
    "rsflow.VelocityEstimator": lambda _: (rsflow.VelocityEstimator, {"camera": CAMERA}),
    "rsflow.VelocityFilter": lambda _: (rsflow.VelocityFilter, {"common": ("height",)}),
    "rsflow.VelocityFilter.reset": lambda _: (rsflow.VelocityFilter().reset, {}),
    "rsflow.VelocityFilter.update": lambda _: (
        rsflow.VelocityFilter(gyro_bias_std_rad_s=0.1).update,
        {
            "velocity": a_velocity(),
            "rate_rad_s": (0.0, 0.0, 0.1),
            "residual_rate_rad_s": (0.0, 0.0, 0.1),
            "residual_rate_covariance": np.eye(3),
            "height_m": 0.2,
            "down": (0.0, 0.0, 1.0),
        },
    ),
    "rsflow.VelocityEstimator.reset": lambda _: (rsflow.VelocityEstimator(CAMERA).reset, {}),
    "rsflow.VelocityEstimator.update": lambda _: (
        _ready(rsflow.VelocityEstimator, (flight().images[0], 0.0), camera=CAMERA).update,
        {"image": flight().images[1], "t_s": 0.1, "height_m": 0.2},
    ),
    "rsflow.VelocityStatus": lambda _: (rsflow.VelocityStatus, {"value": 0}),
    "rsflow.VideoWriter": lambda folder: (rsflow.VideoWriter, {"path": folder / "made.mp4", "frame_rate": 25}),
    "rsflow.VideoWriter.discard": lambda folder: (_writer(folder).discard, {}),
    "rsflow.VideoWriter.finish": lambda folder: (_writer(folder).finish, {}),
    "rsflow.VideoWriter.write": lambda folder: (_writer(folder).write, {"picture": frame()}),
    "rsflow.build_info": lambda _: (rsflow.build_info, {}),
    "rsflow.calibrate": lambda _: (
        rsflow.calibrate,
        {"images": "nowhere.mp4", "board": (4, 3), "square_size_m": 0.02, "time_budget_s": 1.0},
    ),
    "rsflow.dense_flow": lambda _: (rsflow.dense_flow, {**PAIR}),
    "rsflow.detect_corners": lambda _: (rsflow.detect_corners, {"frame": frame()}),
    "rsflow.estimate_shift": lambda _: (rsflow.estimate_shift, {**PAIR}),
    "rsflow.extract": lambda folder: (
        rsflow.extract,
        {"source": "nowhere.mp4", "out": folder / "job", **JOB},
    ),
    "rsflow.extract_many": lambda folder: (
        rsflow.extract_many,
        {"sources": ["nowhere.mp4"], "out": folder, "executor": Inline()},
    ),
    "rsflow.flow_to_color": lambda _: (rsflow.flow_to_color, {"field": field()}),
    "rsflow.frames": lambda _: (rsflow.frames, {"source": [frame(0), frame(1)]}),
    "rsflow.get_num_threads": lambda _: (rsflow.get_num_threads, {}),
    "rsflow.quiver": lambda _: (rsflow.quiver, {"field": field()}),
    "rsflow.read_flow": lambda folder: (rsflow.read_flow, {"path": folder / "flow.npz"}),
    "rsflow.set_num_threads": lambda _: (rsflow.set_num_threads, {"threads": rsflow.get_num_threads()}),
    "rsflow.displacement_grid": lambda _: (rsflow.displacement_grid, {**PAIR, "window_size": 16, "step": 8}),
    "rsflow.grid.Extension": lambda _: (rsflow.grid.Extension, {"length_px": 10.0, "strain": 0.01, "std": 0.001}),
    "rsflow.grid.Samples": lambda _: (rsflow.grid.Samples, _fields(a_grid().at([(16.0, 12.0)]))),
    "rsflow.grid.GridProbes": lambda _: (rsflow.grid.GridProbes, {"points": [(16.0, 12.0)], "spacing": 4.0}),
    "rsflow.grid.GridProbes.add": lambda _: (a_probe().add, {"grid": a_grid(), "t_s": 1.0}),
    "rsflow.grid.GridProbes.plot": lambda folder: (a_probe().plot, {"what": "u", "path": folder / "probes.svg"}),
    "rsflow.grid.GridProbes.save": lambda folder: (a_probe().save, {"path": folder / "probes.csv"}),
    "rsflow.grid.GridProbes.to_table": lambda _: (a_probe().to_table, {}),
    "rsflow.grid.GridStatistics": lambda _: (rsflow.grid.GridStatistics, {}),
    "rsflow.grid.GridStatistics.add": lambda _: (rsflow.grid.GridStatistics().add, {"grid": a_grid()}),
    "rsflow.grid.Replaced": lambda _: (rsflow.grid.Replaced, _fields(a_grid().replaced())),
    "rsflow.grid.Strain": lambda _: (rsflow.grid.Strain, _fields(a_grid().strain())),
    "rsflow.track_points": lambda _: (rsflow.track_points, {**PAIR, "points": [(16, 12)]}),
    "rsflow.write_flow": lambda folder: (rsflow.write_flow, {"path": folder / "written.npy", "field": field()}),
    "rsflow.batch.BatchItem": lambda folder: (
        rsflow.batch.BatchItem,
        {"source": 0, "folder": folder, "status": rsflow.batch.BatchStatus.DONE, "error": "", "summary": {}},
    ),
    "rsflow.batch.BatchItem.to_dict": lambda folder: (
        rsflow.batch.BatchItem(0, folder, rsflow.batch.BatchStatus.DONE, "", {}).to_dict,
        {},
    ),
    "rsflow.batch.BatchStatus": lambda _: (rsflow.batch.BatchStatus, {"value": "done"}),
    "rsflow.batch.folder_names": lambda _: (rsflow.batch.folder_names, {"sources": ["a.mp4", 0]}),
    "rsflow.bench.Bench": lambda _: (
        bench.Bench,
        {"rows": (_bench_row(),), "cpu_level": "avx2", "threads": 1, "rounds": 1, "versions": {}},
    ),
    "rsflow.bench.Bench.conditions": lambda _: (bench.Bench((_bench_row(),), "avx2", 1, 1, {}).conditions, {}),
    "rsflow.bench.Bench.tables": lambda _: (bench.Bench((_bench_row(),), "avx2", 1, 1, {}).tables, {}),
    "rsflow.bench.ConditionRow": lambda _: (bench.ConditionRow, _fields(_condition_row())),
    "rsflow.bench.ExtractBench": lambda _: (bench.ExtractBench, _fields(_extract_bench())),
    "rsflow.bench.ExtractBench.tables": lambda _: (_extract_bench().tables, {}),
    "rsflow.bench.ExtractRow": lambda _: (bench.ExtractRow, _fields(_extract_bench().rows[0])),
    "rsflow.bench.PartRow": lambda _: (bench.PartRow, _fields(_extract_bench().parts[0])),
    "rsflow.bench.KindRow": lambda _: (bench.KindRow, _fields(_kind_row())),
    "rsflow.bench.KindsBench": lambda _: (bench.KindsBench, _fields(_kinds_bench())),
    "rsflow.bench.KindsBench.conditions": lambda _: (_kinds_bench().conditions, {}),
    "rsflow.bench.KindsBench.tables": lambda _: (_kinds_bench().tables, {}),
    "rsflow.bench.LatencyRow": lambda _: (bench.LatencyRow, _fields(_latency_row())),
    "rsflow.bench.Row": lambda _: (bench.Row, _fields(_bench_row())),
    "rsflow.bench.SegmentationBench": lambda _: (bench.SegmentationBench, _fields(_segmentation_bench())),
    "rsflow.bench.SegmentationBench.tables": lambda _: (_segmentation_bench().tables, {}),
    "rsflow.bench.SegmentationRow": lambda _: (bench.SegmentationRow, _fields(_segmentation_bench().rows[0])),
    "rsflow.bench.SizeRow": lambda _: (bench.SizeRow, _fields(_kinds_bench().sizes[0])),
    "rsflow.bench.VelocityBench": lambda _: (bench.VelocityBench, _fields(_velocity_bench())),
    "rsflow.bench.VelocityBench.tables": lambda _: (_velocity_bench().tables, {}),
    "rsflow.bench.measure": lambda _: (bench.measure, {"threads": 1, "rounds": 1, "quick": True}),
    "rsflow.bench.measure_kinds": lambda _: (
        bench.measure_kinds,
        {"only": [], "rounds": 1, "quick": True},
    ),
    "rsflow.bench.measure_segmentation": lambda _: (
        bench.measure_segmentation,
        {"only": [], "clips": 1, "quick": True},
    ),
    "rsflow.bench.measure_velocity": lambda _: (
        bench.measure_velocity,
        {"only": ["level"], "flights": 1, "rounds": 0, "quick": True, "progress": None},
    ),
    "rsflow.bench.with_tables": lambda _: (
        bench.with_tables,
        {"text": f"{bench.BEGIN}\n{bench.END}\n", "bench": bench.Bench((_bench_row(),), "avx2", 1, 1, {})},
    ),
    "rsflow.calibration.Board": lambda _: (boards.Board, _fields(BOARD)),
    "rsflow.calibration.Board.points": lambda _: (BOARD.points, {}),
    "rsflow.calibration.Board.smaller": lambda _: (boards.Board((5, 4), 0.02).smaller, {}),
    "rsflow.calibration.Corners": lambda _: (
        boards.Corners,
        {"points": np.zeros((1, 2), np.float32), "ids": np.zeros(1, np.int64), "plain": np.zeros((1, 2), np.float32)},
    ),
    "rsflow.calibration.find_corners": lambda _: (boards.find_corners, {"image": frame(), "board": BOARD}),
    "rsflow.calibration.BoardHeight": lambda _: (rsflow.calibration.BoardHeight, _fields(_board_height())),
    "rsflow.calibration.BoardHeight.to_dict": lambda _: (_board_height().to_dict, {}),
    "rsflow.calibration.height_over_board": lambda _: (
        rsflow.calibration.height_over_board,
        {"image": _board_view(), "camera": rsflow.Camera(*BOARD_CAMERA, width=160, height=120), "board": BOARD},
    ),
    "rsflow.calibration.print_board": lambda folder: (
        rsflow.calibration.print_board,
        {"path": folder / "printed.svg", "board": (4, 3), "square_size_m": 0.02},
    ),
    "rsflow.calibration.View": lambda _: (calibration.View, {"name": "a", "used": True}),
    "rsflow.calibration.View.to_dict": lambda _: (calibration.View("a", True).to_dict, {}),
    "rsflow.camera.format_of": lambda _: (rsflow.camera.formats.format_of, {"path": "camera.json"}),
    "rsflow.camera.load_camera": lambda folder: (
        rsflow.camera.formats.load_camera,
        {"path": folder / "camera.json"},
    ),
    "rsflow.camera.save_camera": lambda folder: (
        rsflow.camera.formats.save_camera,
        {"camera": CAMERA, "path": folder / "saved.json"},
    ),
    "rsflow.extraction.ExtractSettings": lambda _: (ExtractSettings, {}),
    "rsflow.extraction.ExtractSettings.flat": lambda _: (ExtractSettings().flat, {}),
    "rsflow.extraction.ExtractSettings.as_text": lambda _: (ExtractSettings().as_text, {}),
    "rsflow.extraction.ExtractSettings.validate": lambda _: (ExtractSettings().validate, {}),
    "rsflow.extraction.Measured": lambda _: (
        Measured,
        dict.fromkeys(("frame", "flow", "segmentation", "velocity", "motion", "objects", "velocity_row")),
    ),
    "rsflow.interop.flow_sensor.FlowReading": lambda _: (flow_sensor.FlowReading, _fields(_reading())),
    "rsflow.interop.flow_sensor.flow_reading": lambda _: (
        flow_sensor.flow_reading,
        {"velocity": a_velocity(), "forward": "top", "height_m": 0.2},
    ),
    "rsflow.interop.flow_sensor.quality_of": lambda _: (flow_sensor.quality_of, {"noise_rad_s": 0.2}),
    "rsflow.interop.mavlink.MavlinkWriter": lambda folder: (
        mavlink.MavlinkWriter,
        {"target": f"px4:{folder / 'made.tlog'}", "forward": "top"},
    ),
    "rsflow.interop.mavlink.MavlinkWriter.close": lambda folder: (_autopilot(folder).close, {}),
    "rsflow.interop.mavlink.MavlinkWriter.discard": lambda folder: (_autopilot(folder).discard, {}),
    "rsflow.interop.mavlink.MavlinkWriter.write": lambda folder: (
        _autopilot(folder).write,
        {"velocity": a_velocity(), "height_m": 0.2},
    ),
    "rsflow.interop.ros.RosBagWriter": lambda folder: (
        ros.RosBagWriter,
        {"folder": folder / "made_bag", "forward": "top", "overwrite": True},
    ),
    "rsflow.interop.ros.RosBagWriter.close": lambda folder: (_bag(folder).close, {}),
    "rsflow.interop.ros.RosBagWriter.discard": lambda folder: (_bag(folder).discard, {}),
    "rsflow.interop.ros.RosBagWriter.write": lambda folder: (
        _bag(folder).write,
        {"velocity": a_velocity(), "height_m": 0.2},
    ),
    "rsflow.interop.opencv.DISOpticalFlow": lambda _: (rsflow.interop.opencv.DISOpticalFlow, {}),
    "rsflow.interop.opencv.DISOpticalFlow.calc": lambda _: (
        rsflow.interop.opencv.DISOpticalFlow().calc,
        {"I0": frame(0), "I1": frame(1), "flow": None},
    ),
    "rsflow.interop.opencv.DISOpticalFlow.collectGarbage": lambda _: (
        rsflow.interop.opencv.DISOpticalFlow().collectGarbage,
        {},
    ),
    "rsflow.interop.opencv.DISOpticalFlow.create": lambda _: (rsflow.interop.opencv.DISOpticalFlow.create, {}),
    "rsflow.interop.opencv.DISOpticalFlow_create": lambda _: (rsflow.interop.opencv.DISOpticalFlow_create, {}),
    "rsflow.interop.opencv.DenseFlow": lambda _: (rsflow.interop.opencv.DenseFlow, {}),
    "rsflow.interop.opencv.DenseFlow.calc": lambda _: (
        rsflow.interop.opencv.DenseFlow().calc,
        {"I0": frame(0), "I1": frame(1), "flow": None},
    ),
    "rsflow.interop.opencv.DenseFlow.collectGarbage": lambda _: (
        rsflow.interop.opencv.DenseFlow().collectGarbage,
        {},
    ),
    "rsflow.interop.opencv.buildOpticalFlowPyramid": lambda _: (
        rsflow.interop.opencv.buildOpticalFlowPyramid,
        {"img": frame(), "winSize": (5, 5), "maxLevel": 1},
    ),
    "rsflow.interop.opencv.calcOpticalFlowFarneback": lambda _: (
        rsflow.interop.opencv.calcOpticalFlowFarneback,
        {
            "prev": frame(0),
            "next": frame(1),
            "flow": None,
            "pyr_scale": 0.5,
            "levels": 3,
            "winsize": 15,
            "iterations": 3,
            "poly_n": 5,
            "poly_sigma": 1.2,
            "flags": 0,
        },
    ),
    "rsflow.interop.opencv.calcOpticalFlowPyrLK": lambda _: (
        rsflow.interop.opencv.calcOpticalFlowPyrLK,
        {
            "prevImg": frame(0),
            "nextImg": frame(1),
            "prevPts": np.array([[[16.0, 12.0]]], np.float32),
            "nextPts": None,
            "winSize": (5, 5),
        },
    ),
    "rsflow.interop.opencv.goodFeaturesToTrack": lambda _: (
        rsflow.interop.opencv.goodFeaturesToTrack,
        {"image": frame(), "maxCorners": 5, "qualityLevel": 0.1, "minDistance": 2.0},
    ),
    "rsflow.io.read_flow_times": lambda folder: (rsflow.io.read_flow_times, {"path": folder / "flow.npz"}),
    "rsflow.live.LiveFrame": lambda _: (rsflow.live.LiveFrame, _fields(live_run()[0])),
    "rsflow.live.LiveSummary": lambda _: (rsflow.live.LiveSummary, _fields(live_run()[1])),
    "rsflow.live.LiveSummary.text": lambda _: (live_run()[1].text, {}),
    "rsflow.live.LiveSummary.to_dict": lambda _: (live_run()[1].to_dict, {}),
    "rsflow.live.watch": lambda _: (rsflow.live.watch, {"source": "nowhere.mp4"}),
    "rsflow.live.LiveReading": lambda _: (
        rsflow.live.LiveReading,
        _fields(next(iter(rsflow.live.readings([frame(0), frame(1)])))),
    ),
    "rsflow.live.LiveReading.to_dict": lambda _: (
        next(iter(rsflow.live.readings([frame(0), frame(1)]))).to_dict,
        {},
    ),
    "rsflow.live.readings": lambda _: (
        lambda **given: list(rsflow.live.readings(**given)),
        {"source": [frame(), frame(1)]},
    ),
    "rsflow.objects.CountingLine": lambda _: (objects.CountingLine, {"x0": 1.0, "y0": 2.0, "x1": 3.0, "y1": 4.0}),
    "rsflow.objects.CountingLine.to_dict": lambda _: (objects.CountingLine(0, 0, 1, 1).to_dict, {}),
    "rsflow.objects.CountingLine.text": lambda _: (objects.CountingLine(0, 0, 1, 1).text, {}),
    "rsflow.objects.CountingLine.update": lambda _: (objects.CountingLine(0, 0, 1, 1).update, {"objects": [THING]}),
    "rsflow.objects.ObjectStatistics": lambda _: (objects.ObjectStatistics, {}),
    "rsflow.objects.ObjectStatistics.picture": lambda _: (objects.ObjectStatistics().picture, {"background": frame()}),
    "rsflow.objects.ObjectStatistics.to_dict": lambda _: (objects.ObjectStatistics().to_dict, {}),
    "rsflow.objects.ObjectStatistics.update": lambda _: (
        objects.ObjectStatistics().update,
        {"frame": 0, "objects": [THING], "hidden": [THING], "size": (WIDTH, HEIGHT)},
    ),
    "rsflow.objects.ObjectTable": lambda folder: (objects.ObjectTable, {"path": folder / "objects.csv"}),
    "rsflow.objects.ObjectTable.write": lambda folder: (
        _object_table(folder).write,
        {"frame": 0, "t_s": 0.0, "objects": [THING]},
    ),
    "rsflow.objects.ObjectTracker": lambda _: (objects.ObjectTracker, {}),
    "rsflow.objects.ObjectTracker.update": lambda _: (
        objects.ObjectTracker().update,
        {"mask": frame() > 100, "motion": np.zeros((HEIGHT, WIDTH, 2)), "camera_motion": np.eye(3)},
    ),
    "rsflow.objects.TrackedObject": lambda _: (objects.TrackedObject, _fields(THING)),
    "rsflow.objects.TrackedObject.to_dict": lambda _: (THING.to_dict, {}),
    "rsflow.plotting.color_wheel": lambda _: (rsflow.plotting.color_wheel, {}),
    "rsflow.plotting.fitted_max_flow": lambda _: (rsflow.plotting.fitted_max_flow, {"fields": field()}),
    "rsflow.plotting.flow_over_picture": lambda _: (
        rsflow.plotting.flow_over_picture,
        {"field": field(), "picture": frame()},
    ),
    "rsflow.reproduce.Condition": lambda _: (reproduce.Condition, {"name": "plain"}),
    "rsflow.reproduce.FocalLength": lambda _: (
        reproduce.FocalLength,
        {"rows_px": np.zeros(1), "mean_px": 1.0, "spread_px": 1.0, "calibrated_px": 1.0},
    ),
    "rsflow.reproduce.Group": lambda _: (reproduce.Group, dict.fromkeys(_names(reproduce.Group), 1.0)),
    "rsflow.reproduce.RealMotion": lambda _: (reproduce.RealMotion, dict.fromkeys(_names(reproduce.RealMotion), 1.0)),
    "rsflow.reproduce.SyntheticMotion": lambda _: (
        reproduce.SyntheticMotion,
        dict.fromkeys(_names(reproduce.SyntheticMotion)),
    ),
    "rsflow.reproduce.groups": lambda _: (
        reproduce.groups,
        {"rows": [reproduce.RealMotion(**dict.fromkeys(_names(reproduce.RealMotion), 1.0))]},
    ),
    "rsflow.reproduce.implied_focal_length": lambda _: (reproduce.implied_focal_length, {}),
    "rsflow.reproduce.photographs": lambda _: (reproduce.photographs, {}),
    "rsflow.reproduce.real_motion": lambda _: (reproduce.real_motion, {"frames": 2}),
    "rsflow.reproduce.report": lambda _: (reproduce.report, {}),
    "rsflow.reproduce.synthetic_motion": lambda _: (
        reproduce.synthetic_motion,
        {"pictures": {}, "condition": reproduce.CONDITIONS[0]},
    ),
    "rsflow.reproduce.textures": lambda _: (reproduce.textures, {}),
    "rsflow.synthetic.DeformedPair": lambda _: (synthetic.DeformedPair, _fields(_deformed())),
    "rsflow.synthetic.DeformedPair.gradient": lambda _: (_deformed().gradient, {"x": 1.0, "y": 2.0}),
    "rsflow.synthetic.DeformedPair.truth": lambda _: (_deformed().truth, {"x": 1.0, "y": 2.0}),
    "rsflow.synthetic.particle_pair": lambda _: (
        synthetic.particle_pair,
        {"displacement": _stretch, "size": (24, 20), "seed": 1},
    ),
    "rsflow.synthetic.speckle_pair": lambda _: (
        synthetic.speckle_pair,
        {"displacement": _stretch, "size": (24, 20), "seed": 1},
    ),
    "rsflow.synthetic.Clock": lambda _: (synthetic.Clock, {"jitter_s": 0.001}),
    "rsflow.synthetic.Clock.read": lambda _: (synthetic.Clock(jitter_s=0.001).read, {"times_s": [0.0, 0.1]}),
    "rsflow.synthetic.Flight": lambda _: (Flight, _fields(flight())),
    "rsflow.synthetic.Flight.flow": lambda _: (flight().flow, {"index": 1}),
    "rsflow.synthetic.Gyro": lambda _: (synthetic.Gyro, {"rate_hz": 200.0}),
    "rsflow.synthetic.Gyro.log": lambda _: (synthetic.Gyro(rate_hz=200.0).log, {"flight": flight()}),
    "rsflow.synthetic.GyroLog": lambda _: (synthetic.GyroLog, _fields(_gyro_log())),
    "rsflow.synthetic.GyroLog.between": lambda _: (_gyro_log().between, {"times_s": [0.0, 0.01]}),
    "rsflow.synthetic.GyroLog.save": lambda folder: (_gyro_log().save, {"path": folder / "gyro.csv"}),
    "rsflow.synthetic.LayersPair": lambda _: (synthetic.LayersPair, _fields(_layers())),
    "rsflow.synthetic.MotionsPair": lambda _: (synthetic.MotionsPair, _fields(_motions())),
    "rsflow.synthetic.MotionsPair.clear": lambda _: (_motions().clear, {"points": [(8, 8)], "radius": 2}),
    "rsflow.synthetic.MotionsPair.truth": lambda _: (_motions().truth, {"points": [(8, 8)]}),
    "rsflow.synthetic.MovingObject": lambda _: (
        synthetic.MovingObject,
        {"center_m": (0.0, 0.0), "size_m": (0.02, 0.02), "velocity_m_s": (0.01, 0.0)},
    ),
    "rsflow.synthetic.MovingObject.covers": lambda _: (
        synthetic.MovingObject((0.0, 0.0), (0.02, 0.02), (0.01, 0.0)).covers,
        {"x": np.zeros(2), "y": np.zeros(2), "t_s": 0.0},
    ),
    "rsflow.synthetic.MovingThings": lambda _: (synthetic.MovingThings, _fields(_moving_things())),
    "rsflow.synthetic.Part": lambda _: (synthetic.Part, {}),
    "rsflow.synthetic.Part.covers": lambda _: (PART.covers, {"points": np.zeros((1, 2))}),
    "rsflow.synthetic.Part.move": lambda _: (PART.move, {"points": np.zeros((1, 2))}),
    "rsflow.synthetic.Part.trace": lambda _: (PART.trace, {"points": np.zeros((1, 2))}),
    "rsflow.synthetic.RangeFinder": lambda _: (synthetic.RangeFinder, {"rate_hz": 20.0}),
    "rsflow.synthetic.RangeFinder.log": lambda _: (synthetic.RangeFinder(rate_hz=20.0).log, {"flight": flight()}),
    "rsflow.synthetic.RangeLog": lambda _: (synthetic.RangeLog, _fields(_range_log())),
    "rsflow.synthetic.RangeLog.at": lambda _: (_range_log().at, {"times_s": [0.0, 0.01]}),
    "rsflow.synthetic.RangeLog.save": lambda folder: (_range_log().save, {"path": folder / "ranges.csv"}),
    "rsflow.synthetic.Sensor": lambda _: (Sensor, {}),
    "rsflow.synthetic.Sensor.blur": lambda _: (Sensor(blur_px=0.7).blur, {"image": frame().astype(float)}),
    "rsflow.synthetic.Sensor.expose": lambda _: (
        Sensor().expose,
        {"image": frame().astype(float), "rng": np.random.default_rng(1)},
    ),
    "rsflow.synthetic.ShiftedPair": lambda _: (synthetic.ShiftedPair, _fields(synthetic.shifted_pair(1, 0, seed=1))),
    "rsflow.synthetic.Texture": lambda _: (synthetic.Texture, {"coefficients": np.ones((4, 4)), "oversample": 2.0}),
    "rsflow.synthetic.Texture.make": lambda _: (synthetic.Texture.make, {"period": 16}),
    "rsflow.synthetic.Texture.sample": lambda _: (
        synthetic.Texture.make(period=16).sample,
        {"x": np.zeros(2), "y": np.zeros(2)},
    ),
    "rsflow.synthetic.Thing": lambda _: (synthetic.Thing, {"x": 20.0, "y": 15.0}),
    "rsflow.synthetic.Thing.pose": lambda _: (synthetic.Thing(20.0, 15.0).pose, {"frame": 2}),
    "rsflow.synthetic.Thing.position": lambda _: (synthetic.Thing(20.0, 15.0).position, {"frame": 2}),
    "rsflow.synthetic.Thing.present": lambda _: (synthetic.Thing(20.0, 15.0).present, {"frame": 2}),
    "rsflow.synthetic.Thing.steps": lambda _: (synthetic.Thing(20.0, 15.0).steps, {"frame": 2}),
    "rsflow.synthetic.VehiclePart": lambda _: (synthetic.VehiclePart, {"share": 0.3}),
    "rsflow.synthetic.VehiclePart.mask": lambda _: (synthetic.VehiclePart(0.3).mask, {"width": 16, "height": 12}),
    "rsflow.synthetic.auto_exposure": lambda _: (synthetic.auto_exposure, {"amplitude": 0.1}),
    "rsflow.synthetic.checkered_floor": lambda _: (synthetic.checkered_floor, {"period": 16}),
    "rsflow.synthetic.chessboard_views": lambda _: (
        synthetic.chessboard_views,
        {"camera": CAMERA, "board": (4, 3), "count": 1},
    ),
    "rsflow.synthetic.combined": lambda _: (synthetic.combined, {}),
    "rsflow.synthetic.dirt": lambda _: (synthetic.dirt, {"depth": 0.4}),
    "rsflow.synthetic.disc_floor": lambda _: (synthetic.disc_floor, {"period": 16, "largest": 5.0}),
    "rsflow.synthetic.dropped": lambda _: (synthetic.dropped, {"flight": flight(), "frames": [1]}),
    "rsflow.synthetic.encoded": lambda _: (synthetic.encoded, {"flight": flight(), "jpeg_quality": 80}),
    "rsflow.synthetic.fixed_pattern": lambda _: (synthetic.fixed_pattern, {"levels": 2.0}),
    "rsflow.synthetic.flight": lambda _: (synthetic.flight, {"camera": CAMERA, "frames": 1}),
    "rsflow.synthetic.flight_with_object": lambda _: (synthetic.flight_with_object, {"camera": CAMERA}),
    "rsflow.synthetic.flicker": lambda _: (synthetic.flicker, {"amplitude": 0.1}),
    "rsflow.synthetic.gain": lambda _: (synthetic.gain, {"factor": 0.7}),
    "rsflow.synthetic.gamma": lambda _: (synthetic.gamma, {"exponent": 0.7}),
    "rsflow.synthetic.homography_motion": lambda _: (synthetic.homography_motion, {"matrix": np.eye(3)}),
    "rsflow.synthetic.layers_pair": lambda _: (
        synthetic.layers_pair,
        {"size": (WIDTH, HEIGHT), "median_px": 3.0, "things": 2},
    ),
    "rsflow.synthetic.light_switch": lambda _: (synthetic.light_switch, {"factor": 0.6, "from_s": 1.0}),
    "rsflow.synthetic.motions_pair": lambda _: (
        synthetic.motions_pair,
        {"parts": [synthetic.Part()], "size": (32, 24)},
    ),
    "rsflow.synthetic.moving_shadow": lambda _: (synthetic.moving_shadow, {"factor": 0.5}),
    "rsflow.synthetic.moving_things": lambda _: (
        synthetic.moving_things,
        {"things": 1, "frames": 2, "size": (WIDTH, HEIGHT)},
    ),
    "rsflow.synthetic.offset": lambda _: (synthetic.offset, {"levels": 5.0}),
    "rsflow.synthetic.passing_clouds": lambda _: (synthetic.passing_clouds, {"factor": 0.6}),
    "rsflow.synthetic.patchy_floor": lambda _: (synthetic.patchy_floor, {"period": 64}),
    "rsflow.synthetic.ramp": lambda _: (synthetic.ramp, {"start": 0.0, "stop": 5.0}),
    "rsflow.synthetic.repeated": lambda _: (synthetic.repeated, {"flight": flight(), "frames": [1]}),
    "rsflow.synthetic.shadow": lambda _: (synthetic.shadow, {"factor": 0.7}),
    "rsflow.synthetic.shifted_pair": lambda _: (synthetic.shifted_pair, {"dx": 1.0, "dy": 0.0, "size": (16, 12)}),
    "rsflow.synthetic.spotlight": lambda _: (synthetic.spotlight, {"levels": 20.0}),
    "rsflow.synthetic.striped_floor": lambda _: (synthetic.striped_floor, {"period": 16}),
    "rsflow.synthetic.tiled_floor": lambda _: (synthetic.tiled_floor, {"period": 16}),
    "rsflow.synthetic.texture": lambda _: (synthetic.texture, {"shape": (12, 16)}),
    "rsflow.synthetic.textured_pair": lambda _: (
        synthetic.textured_pair,
        {"displacement": _stretch, "ground": synthetic.Texture.make(period=16), "size": (24, 20)},
    ),
    "rsflow.synthetic.water": lambda _: (synthetic.water, {"ripple": 0.1}),
    "rsflow.tracking.TrackTable": lambda _: (rsflow.tracking.TrackTable, {}),
    "rsflow.tracking.TrackTable.add": lambda _: (
        rsflow.tracking.TrackTable().add,
        {"tracks": tracks(), "frame": 0, "t_s": 0.0, "dt_s": 0.1},
    ),
    "rsflow.tracking.TrackTable.clear": lambda _: (rsflow.tracking.TrackTable().clear, {}),
    "rsflow.tracking.TrackTable.save": lambda folder: (rsflow.tracking.TrackTable().save, {"path": folder / "t.csv"}),
    "rsflow.tracking.TrackTable.to_dict": lambda _: (rsflow.tracking.TrackTable().to_dict, {}),
    "rsflow.velocity.Attitudes": lambda _: (velocity.Attitudes, _fields(_attitudes())),
    "rsflow.velocity.Attitudes.down": lambda _: (_attitudes().down, {"t_s": 0.0}),
    "rsflow.velocity.Attitudes.read": lambda folder: (velocity.Attitudes.read, {"path": folder / "down.csv"}),
    "rsflow.velocity.Heights": lambda _: (velocity.Heights, _fields(_heights())),
    "rsflow.velocity.Heights.at": lambda _: (_heights().at, {"frame": 0, "t_s": 0.0}),
    "rsflow.velocity.Heights.read": lambda folder: (velocity.Heights.read, {"path": folder / "heights.csv"}),
    "rsflow.velocity.Heights.std_at": lambda _: (_heights().std_at, {"frame": 0, "t_s": 0.0}),
    "rsflow.velocity.Rates": lambda _: (velocity.Rates, _fields(_rates())),
    "rsflow.velocity.Rates.mean": lambda _: (_rates().mean, {"begin_s": 0.0, "end_s": 0.1}),
    "rsflow.velocity.Rates.read": lambda folder: (velocity.Rates.read, {"path": folder / "rates.csv"}),
    "rsflow.velocity.Sensors": lambda _: (velocity.Sensors, {}),
    "rsflow.velocity.Sensors.validate": lambda _: (velocity.Sensors().validate, {}),
    "rsflow.velocity.mounting": lambda _: (velocity.mounting, {"mount": "x-right"}),
    "rsflow.velocity.plot_velocity": lambda folder: (
        velocity.plot_velocity,
        {"path": folder / "v.png", "rows": [velocity.velocity_row(a_velocity(), frame=1, height_m=0.2)]},
    ),
    "rsflow.velocity.velocity_row": lambda _: (
        velocity.velocity_row,
        {"velocity": a_velocity(), "frame": 1, "height_m": 0.2},
    ),
    "rsflow.velocity.write_velocity_csv": lambda folder: (
        velocity.write_velocity_csv,
        {"path": folder / "v.csv", "rows": [velocity.velocity_row(a_velocity(), frame=1, height_m=0.2)]},
    ),
    "rsflow.velocity.write_velocity_parquet": lambda folder: (
        velocity.write_velocity_parquet,
        {"path": folder / "v.parquet", "rows": [velocity.velocity_row(a_velocity(), frame=1, height_m=0.2)]},
    ),
    "rsflow.video.encoder": lambda _: (rsflow.video.encoder, {}),
    "rsflow.video.write_lossless": lambda folder: (
        rsflow.video.write_lossless,
        {"path": folder / "lossless.avi", "pictures": [frame()], "frame_rate": 25},
    ),
}


def _names(kind: Any) -> list[str]:
    return [item.name for item in dataclasses.fields(kind)]


@functools.cache
def _moving_things() -> synthetic.MovingThings:
    return synthetic.moving_things(1, frames=2, size=(WIDTH, HEIGHT))


@functools.cache
def _gyro_log() -> synthetic.GyroLog:
    return synthetic.Gyro(rate_hz=200.0).log(flight())


def _range_log() -> synthetic.RangeLog:
    return synthetic.RangeFinder(rate_hz=200.0).log(flight())


@functools.cache
def _layers() -> synthetic.LayersPair:
    return synthetic.layers_pair(size=(WIDTH, HEIGHT), median_px=3.0, things=2, seed=1)


def _motions() -> synthetic.MotionsPair:
    return synthetic.motions_pair([synthetic.Part(), PART], size=(WIDTH, HEIGHT), seed=1)


def make_files(folder: Path) -> None:
    """Put the files there that the calls above read."""
    CAMERA.save(folder / "camera.json")
    rsflow.write_flow(folder / "flow.npz", field(), t0_s=0.0, t1_s=0.1)
    (folder / "heights.csv").write_text("frame,height_m\n0,0.2\n1,0.3\n")
    (folder / "rates.csv").write_text("t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s\n0,0,0,0.1\n1,0,0,0.1\n")
    (folder / "down.csv").write_text("t_s,down_x,down_y,down_z\n0,0,0,1\n1,0,0,1\n")
    (folder / "latin1.txt").write_bytes("Höhe\n".encode("latin-1"))
