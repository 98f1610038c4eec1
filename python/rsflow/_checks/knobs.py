"""Knobs that several estimators share, so that each means the same, and fails the same, wherever it is given."""

from __future__ import annotations

from typing import Literal, TypedDict, get_args

import numpy as np

from .messages import refused
from .options import FLOAT32_MAX, choice, flag, integer, integers, number, number_or_none, whole

Illumination = Literal["none", "offset", "gain_offset"]
Deformation = Literal["auto", "none", "affine"]
ShiftDeformation = Literal["none", "affine"]
GridShape = Literal["translation", "affine", "quadratic"]
Preset = Literal["ultrafast", "fast", "balanced", "accurate"]


class TrackOptions(TypedDict):
    """The options of tracking as lk-core's binding takes them."""

    window_size: tuple[int, int]
    levels: int | None
    max_displacement: float | None
    max_iterations: int
    epsilon: float
    illumination: Illumination
    deformation: Deformation
    max_forward_backward: float | None


class GridOptions(TypedDict):
    """The options of a measuring grid as lk-core's binding takes them."""

    window_size: int
    step: int
    shape: GridShape
    robust: bool
    illumination: Illumination
    max_displacement: float | None


def illumination(value: object) -> Illumination:
    """Take what the light may do."""
    word: Illumination = choice("illumination", value, get_args(Illumination))
    return word


def deformation(value: object) -> Deformation:
    """Take whether windows may turn, grow and shear."""
    word: Deformation = choice("deformation", value, get_args(Deformation))
    return word


def shift_deformation(value: object) -> ShiftDeformation:
    """Take how the one window of a shift may deform."""
    word: ShiftDeformation = choice("deformation", value, get_args(ShiftDeformation))
    return word


def preset(value: object) -> Preset:
    """Take how much time to spend on how much accuracy."""
    word: Preset = choice("preset", value, get_args(Preset))
    return word


def max_displacement(value: object) -> float | None:
    """Take the longest displacement to look for: a length in pixels, above 0, or None.

    Examples
    --------
    >>> max_displacement(0)
    Traceback (most recent call last):
    rsflow.errors.OptionError: max_displacement: got 0, expected a positive number of pixels, or None
    """
    found = number_or_none("max_displacement", value, above=0, most=FLOAT32_MAX, of="pixels")
    if found is not None and np.float32(found) == 0:
        raise refused("max_displacement", value, "a positive number of pixels that float32 can hold, or None")
    return found


def corners(max_corners: object, quality: object, min_distance: object) -> tuple[int, float, float]:
    """Take how many corners to find, how strong and how far apart; their ranges are checked by lk-core."""
    return (
        integer("max_corners", max_corners),
        number("quality", quality, most=FLOAT32_MAX),
        number("min_distance", min_distance, most=FLOAT32_MAX, of="pixels"),
    )


def grid(*, window_size: object, step: object, shape: object, robust: object, **shared: object) -> GridOptions:
    """Take the options of a measuring grid as lk-core's binding wants them."""
    word: GridShape = choice("shape", shape, get_args(GridShape))
    return {
        "window_size": integer("window_size", window_size, least=8, most=256, of="pixels"),
        "step": integer("step", step, least=1, of="pixels"),
        "shape": word,
        "robust": flag("robust", robust),
        "illumination": illumination(shared["illumination"]),
        "max_displacement": max_displacement(shared["max_displacement"]),
    }


def tracking(
    *,
    window_size: object,
    levels: object,
    max_iterations: object,
    epsilon: object,
    max_forward_backward: object,
    **shared: object,
) -> TrackOptions:
    """Take the options of tracking as lk-core's binding wants them; their ranges are checked by lk-core."""
    return {
        "window_size": _window_size(window_size),
        "levels": None if levels is None else integer("levels", levels, or_none=True),
        "max_displacement": max_displacement(shared["max_displacement"]),
        "max_iterations": integer("max_iterations", max_iterations),
        "epsilon": number("epsilon", epsilon, most=FLOAT32_MAX, of="pixels"),
        "illumination": illumination(shared["illumination"]),
        "deformation": deformation(shared["deformation"]),
        "max_forward_backward": number_or_none(
            "max_forward_backward", max_forward_backward, most=FLOAT32_MAX, of="pixels"
        ),
    }


def _window_size(value: object) -> tuple[int, int]:
    """Take the side of a square window, or its width and height."""
    expected = "an integer of pixels, or (width, height)"
    side = whole(value)
    if side is not None:
        value = (side, side)
    width, height = integers("window_size", value, 2, expected)
    return width, height
