"""What report pages are made from, for tests, without an extraction."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from rsflow.extraction import ExtractSettings
from rsflow.extraction.answers import answers
from rsflow.extraction.columns import MOTION, OBJECTS, WORDS
from rsflow.extraction.report import Material
from rsflow.extraction.series import Series
from rsflow.extraction.summary import as_json, camera_figures, key_figures
from rsflow.extraction.things import thing_figures


def series_of(columns: dict[str, Any], names: dict[str, str]) -> Series:
    """A table whose other columns are nan and ""."""
    count = len(next(iter(columns.values())))
    series = Series([name for name in names if name not in WORDS], [name for name in names if name in WORDS])
    for name in names:
        values = columns.get(name)
        if name in WORDS:
            series.words(name).extend(["ok"] * count if values is None else values)
        else:
            series._numbers[name].extend(np.full(count, np.nan) if values is None else np.asarray(values, np.float64))
    return series


def film(frames: int, *, things: int = 3, speed: float = 0.0, seed: int = 0) -> Material:
    """A film at 30 frames a second with things that cross it one after the other, each in view for some time."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames) / 30
    step = speed + rng.normal(0, 0.02, frames)
    status = ["first_frame", *["ok"] * (frames - 1)]
    bad = np.zeros(frames, bool)
    bad[frames // 3 : frames // 3 + max(frames // 50, 2)] = True
    step[bad | (np.arange(frames) == 0)] = np.nan
    for at in np.flatnonzero(bad):
        status[at] = "no_texture"
    std = np.where(np.isfinite(step), 0.05, np.inf)
    motion = {
        "frame": np.arange(frames), "t_s": t, "dt_s": np.full(frames, 1 / 30), "dx_px": step, "dy_px": step / 2,
        "dx_std_px": std, "dy_std_px": std, "gain": 1 + rng.normal(0, 0.01, frames), "objects": np.full(frames, things),
        "flow_median_px": np.abs(step), "flow_p95_px": np.abs(step) * 2, "flow_valid_share": np.full(frames, 0.9),
        "moving_share": np.full(frames, 0.03), "status": status, "segmentation_status": status,
    }  # fmt: skip
    rows: dict[str, Any] = {
        name: [] for name in ("frame", "id", "x_px", "y_px", "area_px", "speed_px_s", "speed_std_px_s")
    }
    life = max(frames // 60, min(frames, 20))
    for number in range(things * (frames // life)):
        when = np.arange(life) + (number // max(things, 1)) * life
        along = np.arange(life) / life
        rows["frame"].append(when)
        rows["id"].append(np.full(life, number + 1))
        rows["x_px"].append(640 * along)
        rows["y_px"].append(60 + (number * 97) % 380 + 40 * np.sin(6 * along))
        rows["area_px"].append(np.full(life, 300.0))
        rows["speed_px_s"].append(np.full(life, 20.0 + number % 50) + rng.normal(0, 1, life))
        rows["speed_std_px_s"].append(np.full(life, 1.5))
    columns = {name: np.concatenate(values) if values else np.zeros(0) for name, values in rows.items()}
    order = np.argsort(columns["frame"], kind="stable")
    tables = {
        "motion": series_of(motion, MOTION),
        "objects": series_of({name: values[order] for name, values in columns.items()}, OBJECTS),
    }
    return material(tables)


def material(tables: dict[str, Series], **more: Any) -> Material:
    """Everything of a page from its tables."""
    settings = ExtractSettings()
    figures = key_figures(tables["motion"], None, None) | camera_figures(tables["motion"], "static")
    figures |= thing_figures(tables["objects"], tables["motion"])
    figures |= {"camera_motion_reason": "found so", "lines": []}
    summary = as_json(
        figures
        | {
            "source": "street.mp4", "version": "0.0", "date": "2026-01-01 12:00", "size": [640, 480], "complete": True,
            "problems": [], "notes": ["Something to know first."], "settings": settings.as_text(), "build": "",
            "camera_motion": "static", "timestamps": "file", "seconds": 1.0, "frames_per_second": 30.0, "threads": 1,
            "video_codec": "h264",
        }
    )  # fmt: skip
    assert math.isfinite(summary["frames"])
    made = Material(summary, answers(figures), tables, {"motion": Path("motion.csv")}, settings, posters={})
    return dataclasses.replace(made, **more)
