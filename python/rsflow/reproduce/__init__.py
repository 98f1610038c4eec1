"""The report's experiments again: its tables 4-1, 4-2 and 4-3 beside what rsflow measures.

The report, "Extract motion from picture sequence", crops two windows of 60 x 60 pixels from a photograph, brightens the
second and compares known with calculated displacement, with and without compensation of the light (tables 4-1 and
4-2); then it flies a webcam over the ground and compares velocities (table 4-3). Its figures are data of this package.
"""

from __future__ import annotations

from .flights import Group, RealMotion, groups, real_motion
from .printed import FocalLength, implied_focal_length, report
from .windows import CONDITIONS, Condition, SyntheticMotion, photographs, synthetic_motion, textures

__all__ = [
    "CONDITIONS",
    "Condition",
    "FocalLength",
    "Group",
    "RealMotion",
    "SyntheticMotion",
    "groups",
    "implied_focal_length",
    "photographs",
    "real_motion",
    "report",
    "synthetic_motion",
    "textures",
]
