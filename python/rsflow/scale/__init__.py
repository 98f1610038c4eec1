"""Checks of scale: a set-up against a gyro or a known speed, height from a known speed, time to contact."""

from __future__ import annotations

from .check import check_scale
from .contact import Contact, ContactStatus, TimeToContact, time_to_contact
from .estimate import Estimate
from .height import HeightFromSpeed, HeightStatus, height_from_speed
from .result import ScaleCheck, ScaleStatus

__all__ = [
    "Contact",
    "ContactStatus",
    "Estimate",
    "HeightFromSpeed",
    "HeightStatus",
    "ScaleCheck",
    "ScaleStatus",
    "TimeToContact",
    "check_scale",
    "height_from_speed",
    "time_to_contact",
]
