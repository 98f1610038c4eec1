"""What the tests of the main job share."""

import csv
from pathlib import Path

import numpy as np

from rsflow import synthetic
from rsflow.extraction.file_names import partial_name

HEIGHT_M = 0.2
FILES = {
    "report.html",
    "motion.csv",
    "objects.csv",
    "flow.mp4",
    "moving.mp4",
    "static.mp4",
    "background.png",
    "summary.json",
}


def made_flight():
    """A short flight in light that drifts, with a thing that moves."""
    return synthetic.flight_with_object(
        frames=16,
        height_m=HEIGHT_M,
        velocity_m_s=(0.04, -0.015, 0.0),
        exposure_drift=synthetic.auto_exposure(0.1),
        seed=3,
    )


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def numbers(rows, name):
    return np.array([float(row[name]) for row in rows])


def names_in(folder):
    return {path.name for path in folder.iterdir()}


def partials(names):
    return {partial_name(Path(name)).name for name in names}
