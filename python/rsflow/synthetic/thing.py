"""A thing that moves over the flat ground of `rsflow.synthetic.moving_things`."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ._outlines import SHAPES
from .textures import BANDS

__all__ = ["Thing"]

F64 = NDArray[np.float64]

# Standard deviation of a thing's texture, in grey levels.
THING_LEVELS = 25.0


@dataclass(frozen=True)
class Thing:
    """A thing that moves over flat ground, and how.

    Lengths are in pixels of the ground as the first frame shows it.

    Attributes
    ----------
    x, y : float
        Its middle in frame `first_frame`; (0, 0) is the middle of the first frame's upper left pixel.
    dx, dy : float
        Its motion over the ground, in pixels per frame.
    width, height : float
        Extent of its box.
    shape : {"ellipse", "rectangle", "car", "walker"}
        A car is seen from the side, with a window that shows a level like the ground's; it faces to where it goes. A
        walker's arms and legs move.
    level : float
        Its mean grey level.
    contrast_levels : float
        Standard deviation of its texture in grey levels; 0 for a plain thing.
    kind : str
        Texture, see `rsflow.synthetic.BANDS`.
    turn_deg : float
        Rotation in degrees per frame, from x towards y.
    stops : tuple of (int, int)
        Frames in which it stands: it does not move from frame k - 1 to k for first <= k < last.
    first_frame, last_frame : int, int or None
        It is there from this frame on, and until this one; None is the end.
    seed : int
        Of its texture.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> thing = synthetic.Thing(20.0, 30.0, dx=2.0, stops=((3, 5),))
    >>> [thing.position(frame).tolist() for frame in (0, 2, 3, 4, 5)]
    [[20.0, 30.0], [24.0, 30.0], [24.0, 30.0], [24.0, 30.0], [26.0, 30.0]]
    """

    x: float
    y: float
    dx: float = 1.0
    dy: float = 0.0
    width: float = 30.0
    height: float = 20.0
    shape: str = "ellipse"
    level: float = 170.0
    contrast_levels: float = THING_LEVELS
    kind: str = "fine"
    turn_deg: float = 0.0
    stops: tuple[tuple[int, int], ...] = ()
    first_frame: int = 0
    last_frame: int | None = None
    seed: int = 1_000

    def __post_init__(self) -> None:

        put = functools.partial(object.__setattr__, self)
        for name in ("x", "y", "dx", "dy", "turn_deg"):
            put(name, _checks.number(name, getattr(self, name), least=-1e7, most=1e7))
        for name in ("width", "height"):
            put(name, _checks.number(name, getattr(self, name), least=1e-3, most=1e5, of="pixels"))
        put("level", _checks.number("level", self.level, least=-1e6, most=1e6, of="grey levels"))
        contrast = _checks.number("contrast_levels", self.contrast_levels, least=0, most=1e6, of="grey levels")
        put("contrast_levels", contrast)
        _checks.choice("shape", self.shape, SHAPES)
        _checks.choice("kind", self.kind, BANDS)
        expected = "pairs of frames, the first and the one after the last in which it stands"
        stops = [_checks.integers("stops", pair, 2, expected, least=0, most=10**9)
                 for pair in _checks.iterable("stops", self.stops, expected)]  # fmt: skip
        put("stops", tuple(stops))
        put("first_frame", _checks.integer("first_frame", self.first_frame, least=0, most=10**9))
        put("last_frame", _checks.integer_or_none("last_frame", self.last_frame, least=0, most=10**9))
        put("seed", _checks.integer("seed", self.seed, least=0, most=2**48))

    def present(self, frame: int) -> bool:
        """Whether it is on the ground in a frame, in view or not.

        Parameters
        ----------
        frame : int
            Its number, from 0.
        """
        frame = _frame(frame)
        return frame >= self.first_frame and (self.last_frame is None or frame <= self.last_frame)

    def position(self, frame: int) -> F64:
        """Where its middle is on the ground in a frame, (2,): x and y in pixels of the first frame.

        Parameters
        ----------
        frame : int
            Its number, from 0.

        Returns
        -------
        (2,) float64
        """
        steps = self.steps(frame)
        return np.array([self.x + steps * self.dx, self.y + steps * self.dy])

    def pose(self, frame: int) -> F64:
        """Homography from its box, -1 to 1 along both axes, to the ground in a frame.

        Parameters
        ----------
        frame : int
            Its number, from 0.

        Returns
        -------
        (3, 3) float64
        """
        angle = np.deg2rad(self.turn_deg * (_frame(frame) - self.first_frame))
        half = 0.5 * np.array([self.width, self.height])
        out = np.eye(3)
        out[:2, :2] = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) * half
        out[:2, 2] = self.position(frame)
        return out

    def steps(self, frame: int) -> int:
        """How many times it has moved by (dx, dy) until a frame.

        Parameters
        ----------
        frame : int
            Its number, from 0; frames before its first one give a negative number.

        Returns
        -------
        int
        """
        frame = _frame(frame)
        if frame <= self.first_frame:
            return frame - self.first_frame
        ways = [(max(first, self.first_frame + 1), min(last, frame + 1)) for first, last in sorted(self.stops)]
        stood, until = 0, 0
        for first, last in ways:
            start = max(first, until)
            stood += max(0, last - start)
            until = max(until, last)
        return frame - self.first_frame - stood


def _frame(frame: int) -> int:
    return _checks.integer("frame", frame, least=0, most=10**9)
