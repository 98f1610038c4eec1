"""Scenes with exactly known motion and light, to judge an estimator or to test a set-up of your own.

`shifted_pair` gives two frames with an exact sub-pixel displacement, `motions_pair` two whose parts shift, turn and
zoom each in its own way, `layers_pair` two of a scene that is hard to measure (fast things that hide each other,
blurred by their motion, in fog) with its dense flow, `flight` what a camera sees that flies over flat, textured ground,
`flight_with_object` the same with things that move on the ground and a mask of where they are, `chessboard_views` what
a camera sees of a board that it is calibrated with.
Everything is seeded: the same arguments give the same pixels.
"""

from __future__ import annotations

from .boards import chessboard_views
from .flights import Flight, MovingObject, flight, flight_with_object
from .layers import LayersPair, layers_pair
from .lighting import LIGHTING, Lighting, auto_exposure, gain, gamma, offset, ramp, shadow, spotlight
from .motions import MotionsPair, Part, motions_pair
from .sensor import WEBCAM, Sensor
from .textures import BANDS, ShiftedPair, Texture, shifted_pair, texture

__all__ = [
    "BANDS",
    "LIGHTING",
    "WEBCAM",
    "Flight",
    "LayersPair",
    "Lighting",
    "MotionsPair",
    "MovingObject",
    "Part",
    "Sensor",
    "ShiftedPair",
    "Texture",
    "auto_exposure",
    "chessboard_views",
    "flight",
    "flight_with_object",
    "gain",
    "gamma",
    "layers_pair",
    "motions_pair",
    "offset",
    "ramp",
    "shadow",
    "shifted_pair",
    "spotlight",
    "texture",
]
