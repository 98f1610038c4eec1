"""The report's own figures: its tables as they are printed, and the focal length that follows from them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._display import fields

__all__ = ["WINDOW", "FocalLength", "implied_focal_length", "report"]

# Side of the report's windows, in pixels.
WINDOW = 60


@lru_cache(maxsize=1)
def report() -> Mapping[str, Any]:
    """Read the report's calibration and tables, as they are printed.

    Examples
    --------
    >>> len(report()["table_4_1_with_illumination_correction"])
    39
    """
    text = resources.files("rsflow").joinpath("data/report.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


@dataclass(frozen=True, eq=False)
class FocalLength:
    """The focal length in pixels that the report's printed velocities follow from.

    Attributes
    ----------
    rows_px : (24,) float64
        Height x flow x frame rate / velocity of each row of table 4-3.
    mean_px, spread_px : float
        Their mean and standard deviation.
    calibrated_px : float
        What the report's own calibration says (figure 4-1), at 640 x 480.

    Examples
    --------
    >>> from rsflow.reproduce import implied_focal_length
    >>> implied_focal_length().rows_px.shape
    (24,)
    """

    rows_px: NDArray[np.float64]
    mean_px: float
    spread_px: float
    calibrated_px: float

    __repr__ = fields


def implied_focal_length() -> FocalLength:
    """Solve the report's equation 2.11 for the focal length in every row of its table 4-3.

    Returns
    -------
    FocalLength

    Examples
    --------
    >>> f = implied_focal_length()
    >>> round(f.mean_px, 1), round(f.spread_px, 2), round(f.calibrated_px, 1)
    (1217.3, 0.04, 657.8)
    """
    rows = np.array([
        row["height_cm"] * row["flow_px"] * row["frames_per_second"] / row["estimated_velocity_cm_s"]
        for row in report()["table_4_3_real_motion"]
    ])  # fmt: skip
    calibrated = float(np.mean(report()["calibration"]["focal_length_px"]))
    return FocalLength(rows, float(rows.mean()), float(rows.std(ddof=1)), calibrated)
