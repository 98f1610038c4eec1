"""What the tests of sources in parts share."""

import csv
import math

import rsflow
from rsflow import synthetic
from rsflow.batch.work import OF_WHAT_MOVES
from rsflow.extraction import columns

FRAMES = 60
# What is told of each pair of frames; the other columns are of what moves.
OF_PAIRS = [name for name in columns.MOTION if name not in OF_WHAT_MOVES]


METRIC = {"camera": "camera.json", "height_m": 0.2, "videos": False}


def made_clip(folder):
    """A clip of a flight with a thing that moves, in light that drifts; beside it its camera and a gyro's log."""
    flight = synthetic.flight_with_object(
        frames=FRAMES,
        height_m=0.2,
        velocity_m_s=(0.03, -0.01, 0.0),
        exposure_drift=synthetic.auto_exposure(0.1),
        seed=3,
    )
    with rsflow.VideoWriter(folder / "clip.mp4", frame_rate=30) as video:
        for image in flight.images:
            video.write(image)
    flight.camera.save(folder / "camera.json")
    # A gyro with a bias, which the estimator learns.
    rows = [f"{k / 200:.4f},0.01,-0.02,{0.03 * math.sin(k / 40):.5f}" for k in range(600)]
    (folder / "gyro.csv").write_text("\n".join(["t_s,rate_x_rad_s,rate_y_rad_s,rate_z_rad_s", *rows]) + "\n")
    return folder / "clip.mp4"


def columns_of(path, names):
    with path.open(newline="", encoding="utf-8") as file:
        return [[row[name] for name in names] for row in csv.DictReader(file)]


def same_measurements(done, whole):
    assert done.complete
    assert columns_of(done.files["motion"], OF_PAIRS) == columns_of(whole.files["motion"], OF_PAIRS)
    for name in ("velocity", "trajectory"):
        if name in whole.files:
            assert done.files[name].read_bytes() == whole.files[name].read_bytes(), name
    assert done.files.keys() == whole.files.keys()
