"""What tests of logs of sensors share: a motion, and tables written and read."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np


def turning(t_s: Any) -> np.ndarray:
    t = np.asarray(t_s, dtype=np.float64)
    return np.stack([0.5 * np.sin(7 * t), 0.4 * np.cos(5 * t), 0.3 + 0 * t], axis=-1)


def written(path: Path, header: str, *columns: Any) -> Path:
    rows = np.column_stack([np.asarray(column) for column in columns])
    text = "\n".join(",".join(repr(float(value)) for value in row) for row in rows)
    path.write_text(f"{header}\n{text}\n", encoding="utf-8")
    return path


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def velocities(path: Path) -> np.ndarray:
    return np.array([[float(row[f"v{axis}_m_s"]) for axis in "xyz"] for row in table(path)])
