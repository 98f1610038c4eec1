"""Scenes with exactly known motion and light, to judge an estimator or to test a set-up of your own.

`shifted_pair` gives two frames with an exact sub-pixel displacement, `motions_pair` two whose parts shift, turn and
zoom each in its own way, `layers_pair` two of a scene that is hard to measure (fast things that hide each other,
blurred by their motion, in fog) with its dense flow, `flight` what a camera sees that flies over flat, textured ground,
`flight_with_object` the same with things that move on the ground and a mask of where they are, `moving_things`
what moves before a camera that stands or moves, with masks, numbers, ways and speeds, `chessboard_views` what a camera
sees of a board that it is calibrated with. `textured_pair`, `particle_pair` and `speckle_pair` are ground, particles in
a fluid and speckle on a material that any displacement moves, a function of the place; `homography_motion` is that of
a turn, a zoom or a change of perspective.

A flight takes the conditions of a set-up piece by piece. On the ground: `tiled_floor`, `checkered_floor`,
`striped_floor`, `patchy_floor`, `disc_floor`, `contrast_levels`, `moving_shadow`, `water`. On the camera: `readout_s`
(rolling shutter), `exposure_s`, `dirt`, `fixed_pattern`, `VehiclePart`. After it: `dropped`, `repeated`, `encoded`.
Beside it, what instruments say of it: `Gyro`, `RangeFinder`, `Clock`.

Everything is seeded: the same arguments give the same pixels.
"""

from __future__ import annotations

from .boards import chessboard_views
from .deformed import DeformedPair, homography_motion, particle_pair, speckle_pair, textured_pair
from .flights import Flight, flight, flight_with_object
from .floors import checkered_floor, disc_floor, patchy_floor, striped_floor, tiled_floor
from .ground_effects import GroundEffect, moving_shadow, water
from .instruments import Clock, Gyro, GyroLog, RangeFinder, RangeLog
from .layers import LayersPair, layers_pair
from .lighting import (
    LIGHTING,
    Lighting,
    auto_exposure,
    flicker,
    gain,
    gamma,
    light_switch,
    offset,
    passing_clouds,
    ramp,
    shadow,
    spotlight,
)
from .motions import MotionsPair, Part, motions_pair
from .moving_object import MovingObject
from .moving_things import MovingThings, moving_things
from .on_sensor import VehiclePart, combined, dirt, fixed_pattern
from .recording import dropped, encoded, repeated
from .sensor import WEBCAM, Sensor
from .textures import BANDS, ShiftedPair, Texture, shifted_pair, texture
from .thing import Thing

__all__ = [
    "BANDS",
    "LIGHTING",
    "WEBCAM",
    "Clock",
    "DeformedPair",
    "Flight",
    "GroundEffect",
    "Gyro",
    "GyroLog",
    "LayersPair",
    "Lighting",
    "MotionsPair",
    "MovingObject",
    "MovingThings",
    "Part",
    "RangeFinder",
    "RangeLog",
    "Sensor",
    "ShiftedPair",
    "Texture",
    "Thing",
    "VehiclePart",
    "auto_exposure",
    "checkered_floor",
    "chessboard_views",
    "combined",
    "dirt",
    "disc_floor",
    "dropped",
    "encoded",
    "fixed_pattern",
    "flicker",
    "flight",
    "flight_with_object",
    "gain",
    "gamma",
    "homography_motion",
    "layers_pair",
    "light_switch",
    "motions_pair",
    "moving_shadow",
    "moving_things",
    "offset",
    "particle_pair",
    "passing_clouds",
    "patchy_floor",
    "ramp",
    "repeated",
    "shadow",
    "shifted_pair",
    "speckle_pair",
    "spotlight",
    "striped_floor",
    "texture",
    "textured_pair",
    "tiled_floor",
    "water",
]
