"""How sure the page is: what was not measured and why, and what the deviations come from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .. import columns
from ..series import runs
from .material import Material
from .parts import Part, Table, Text

__all__ = ["budget", "validity"]

_USUAL = ("ok", "first_frame")
_SERIES = (
    ("displacement of the picture", "motion", "status"),
    ("what moves and what stands still", "motion", "segmentation_status"),
    ("velocity over the ground", "velocity", "status"),
)


def validity(material: Material) -> list[Part]:
    """Say for each estimator how many frames it could measure, and at which frames not, and why."""
    rows: list[tuple[str, ...]] = []
    lacking = 0
    for name, series, column in _SERIES:
        if series not in material.series:
            continue
        data = material.series[series]
        words = np.array(data.words(column))
        # What was not measured stands first.
        for status, count in sorted(data.counts(column).items(), key=lambda item: (item[0] in _USUAL, item[0] != "ok")):
            if status:
                lacking += count if status not in _USUAL else 0
                which = runs(data["frame"], words == status) if status != "ok" else ""
                rows.append((name, str(count), columns.meaning(status), which, status))
    title = "What could not be measured, and why"
    said = (
        "What cannot be measured is nan in the tables with an infinite standard deviation: never zero, never a guess."
    )
    if not lacking:
        said = f"Every pair of frames was measured. {said}"
    header = ("of", "frames", "outcome", "which", "status")
    parts: list[Part] = [Table(title, header, rows, said, frozenset({1}), stacks=True)]
    if material.settings.height_m is None:
        parts.append(
            Text(
                "Metres per second over the ground were not asked for: they need a calibrated camera and its height "
                "(--camera and --height)."
            )
        )
    return parts


def budget(material: Material) -> list[Part]:
    """Say what share of the velocities' variance comes from each cause."""
    shares: Mapping[str, float] = material.summary.get("speed_variance_shares") or {}
    if not shares:
        return []
    rows = [(name, f"{100 * share:.1f}") for name, share in shares.items()]
    rows += [(name, "not stated") for name in material.summary.get("speed_std_without") or ()]
    said = (
        "Of the variance of the speed over ground, over all frames with a velocity. What was not stated is missing"
        " in it: the speed is only as exact as that."
    )
    return [
        Table(
            "Where the uncertainty of the speed comes from", ("cause", "% of the variance"), rows, said, frozenset({1})
        )
    ]
