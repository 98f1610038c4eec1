"""The pictures of each frame: its motion as arrows, what moves, and what stands still."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._display import displayed
from ..plotting import arrows, drawing
from ..segmentation.patches import hatched
from ..segmentation.scene import StaticScene, frames_ahead
from .motion_arrows import draw_motion
from .slides import Slides

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..capture.stream import Frame
    from ..plotting import QuiverStyle
    from ..segmentation.result import MotionSegmentation
    from .pipeline import Measured

__all__ = ["Drawn", "Pictures"]


# Grey level of what is not known of the ground.
_UNKNOWN = 136


@dataclass(frozen=True)
class Drawn:
    """A picture: of which view, with which frame it was drawn (-1: after the last), and the time of what it shows."""

    view: str
    picture: NDArray[np.uint8]
    frame: int
    t_s: float


class Pictures:
    """Draw frame after frame.

    Parameters
    ----------
    style : QuiverStyle
        Of the arrows, for all frames.
    rate : float
        Frames a second.
    frames : int, optional
        How many are expected.
    """

    def __init__(self, style: QuiverStyle, rate: float, frames: int | None = None) -> None:
        self.style = style
        self._scene = StaticScene(look_ahead=frames_ahead(rate))
        # Number and time of the frames whose static picture is not complete.
        self._waiting: deque[tuple[int, float]] = deque()
        self._before: Frame | None = None
        self._seen_before: MotionSegmentation | None = None
        # The pictures that are kept for the report's slider.
        # The last frame has no arrows, and no picture there.
        self.slides = Slides(None if frames is None else frames - 1)

    def draw(self, measured: Measured, *, wanted: bool) -> list[Drawn]:
        """Take a frame; give the pictures that are complete, of this frame or earlier ones, none if it is not `wanted`.

        Arrows stand on the frame that they start from.
        """
        frame, seen = measured.frame, measured.segmentation
        before, self._before = self._before, frame
        seen_before, self._seen_before = self._seen_before, seen
        slide = before is not None and self.slides.next() and seen_before is not None
        arrowed = None
        if before is not None and measured.flow is not None and (wanted or slide):
            arrowed = draw_motion(_shown(before), measured.flow, seen, self.style)
            if slide and seen_before is not None:
                self.slides.add(arrowed, seen_before, before.index, before.t_s)
        if not wanted:
            self.learn(frame, seen)
            return []
        drawn = [Drawn("moving", seen.moving_view(frame.color), frame.index, frame.t_s)]
        if before is not None and arrowed is not None:
            drawn.insert(0, Drawn("flow", arrowed, frame.index, before.t_s))
        self._waiting.append((frame.index, frame.t_s))
        return drawn + self._static(self._scene.add(seen, frame.color))

    def learn(self, frame: Frame, seen: MotionSegmentation) -> None:
        """Take a frame of which nothing is drawn."""
        self._before, self._seen_before = frame, seen
        self._scene.learn(seen, frame.color)

    def complete(self) -> list[Drawn]:
        """Give the pictures that still wait, with what is known."""
        return self._static(self._scene.finish())

    def last(self) -> list[Drawn]:
        """Give what ends the view of the motion: from the last frame nothing goes on, it has no arrows."""
        before, self._before = self._before, None
        if before is None:
            return []
        out = drawing.magnified(_shown(before), self.style.zoom)
        if self.style.key:
            arrows.draw_key(out, self.style)
        return [Drawn("flow", out, -1, before.t_s)]

    def _static(self, pictures: list[NDArray[np.uint8]]) -> list[Drawn]:
        return [Drawn("static", picture, *self._waiting.popleft()) for picture in pictures]

    def background(self) -> NDArray[np.uint8] | None:
        """Give the scene of all frames, as the last one would show it; hatched where nothing is known."""
        best = self._scene.best()
        return None if best is None else hatched(*best)

    def ground(self, corner: tuple[float, float], size: tuple[int, int], scale: float) -> NDArray[np.uint8] | None:
        """Give the scene as the first frame would show it (`StaticScene.ground`), grey where it is not known."""
        found = self._scene.ground(corner, size, scale)
        if found is None:
            return None
        picture, known = found
        picture[~known] = _UNKNOWN
        return picture

    def state(self) -> dict[str, Any]:
        """Give what `restore` needs, after `complete`."""
        return {"scene": self._scene.state(), "slides": self.slides.state()}

    def restore(self, state: Mapping[str, Any], before: Frame) -> None:
        """Go on as after the frame `before`."""
        self._scene.restore(state["scene"])
        self.slides.restore(state["slides"])
        self._before = before


def _shown(frame: Frame) -> NDArray[np.uint8]:
    """Give the picture of a frame to draw on."""
    return displayed(frame.image if frame.color is None else frame.color)
