"""How a camera is mounted, in words."""

from __future__ import annotations

import numpy as np
import pytest

import rsflow
from rsflow.velocity import mounting


@pytest.mark.parametrize(
    ("mount", "camera_x", "camera_z"),
    [
        ("x-right", (0, 1, 0), (0, 0, 1)),
        ("x-forward", (1, 0, 0), (0, 0, 1)),
        ("X-Right, Y-Back", (0, 1, 0), (0, 0, 1)),
        ("y-back", (0, 1, 0), (0, 0, 1)),
        ("x-right,z-forward", (0, 1, 0), (1, 0, 0)),
        ("yaw=90", (0, 1, 0), (0, 0, 1)),
        ("yaw=-45", (np.sqrt(0.5), -np.sqrt(0.5), 0), (0, 0, 1)),
        ("0,-1,0, 1,0,0, 0,0,1", (0, 1, 0), (0, 0, 1)),
    ],
)
def test_mountings(mount: str, camera_x: tuple[float, ...], camera_z: tuple[float, ...]) -> None:
    R = mounting(mount)
    assert pytest.approx(camera_x, abs=1e-12) == R @ (1, 0, 0)
    assert pytest.approx(camera_z, abs=1e-12) == R @ (0, 0, 1)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert mounting(R) == pytest.approx(R)


@pytest.mark.parametrize(
    "mount",
    [
        "",
        "right",
        "x-right,x-left",
        "z-down",
        "x-right,y-right",
        "x-down",
        "yaw=",
        "yaw=nan",
        "1,2,3",
        "1 0 0 0 1 0 0 0 -1",
    ],
)
def test_what_is_no_mounting(mount: str) -> None:
    with pytest.raises(rsflow.OptionError, match=r"mount: got .*, expected an axis of the picture and where it points"):
        mounting(mount)
