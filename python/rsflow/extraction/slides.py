"""Small pictures of some frames for the report page: arrows and outlines, evenly over the run, within a budget."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..plotting import drawing, labels

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from ..segmentation.result import MotionSegmentation

__all__ = ["BUDGET_BYTES", "LONGEST", "MOST", "Slide", "Slides", "when"]

# At most so many pictures, of so many bytes together, each of so many pixels on its longer side.
MOST, BUDGET_BYTES, LONGEST = 48, 2_000_000, 560
_QUALITY = 72
# Where the length is known the first stride is for it, up to this: a run that is ended early has pictures too.
_WIDEST_FIRST = 8
# Light that is left of what a mask leaves out.
_LEFT_OUT = 0.4


@dataclass(frozen=True)
class Slide:
    """A JPEG picture, of which frame and when, and how many things are in it."""

    jpeg: bytes
    frame: int
    t_s: float
    things: int


class Slides:
    """Keep every first, second, fourth ... picture: where there are too many, every other one is given up.

    The run need not be known to its end for that; where it is, to have as many as `expected` frames with a picture,
    none is made only to be given up.
    """

    def __init__(self, expected: int | None = None) -> None:
        self._kept: list[Slide] = []
        # A power of two, as it stays: parts of a run are joined by it.
        self._stride = 1
        while expected is not None and self._stride < _WIDEST_FIRST and expected > MOST * self._stride:
            self._stride *= 2
        self._seen = 0

    def next(self) -> bool:
        """Count a frame; say whether its picture is wanted."""
        number, self._seen = self._seen, self._seen + 1
        return number % self._stride == 0

    @staticmethod
    def joined(states: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Give the state of runs that follow each other, as of one: evenly over all, within the budget."""
        stride = max(state["stride"] for state in states)
        slides = [slide for state in states for slide in state["slides"][:: stride // state["stride"]]]
        while len(slides) > 1 and _too_many([len(slide[0]) for slide in slides]):
            slides, stride = slides[::2], 2 * stride
        return {"slides": slides, "stride": stride, "seen": sum(state["seen"] for state in states)}

    def add(self, arrowed: NDArray[np.uint8], seen: MotionSegmentation, frame: int, t_s: float) -> None:
        """Keep a frame: its picture with arrows, of any size, and what moves in it."""
        self._kept.append(Slide(_jpeg(_outlined(arrowed, seen)), frame, t_s, len(seen.objects)))
        while len(self._kept) > 1 and _too_many([len(slide.jpeg) for slide in self._kept]):
            self._kept = self._kept[::2]
            self._stride *= 2

    def kept(self) -> list[Slide]:
        """Give the pictures, in their order."""
        return list(self._kept)

    def state(self) -> dict[str, Any]:
        """Give what `restore` needs."""
        slides = [(np.frombuffer(slide.jpeg, np.uint8), slide.frame, slide.t_s, slide.things) for slide in self._kept]
        return {"slides": slides, "stride": self._stride, "seen": self._seen}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on as before."""
        self._kept = [Slide(np.asarray(jpeg).tobytes(), *rest) for jpeg, *rest in state["slides"]]
        self._stride, self._seen = state["stride"], state["seen"]


def _too_many(sizes: Sequence[int]) -> bool:
    """Whether pictures of so many bytes are more than the page has room for."""
    return len(sizes) > MOST or sum(sizes) > BUDGET_BYTES


def _outlined(arrowed: NDArray[np.uint8], seen: MotionSegmentation) -> NDArray[np.uint8]:
    """Make it small and draw around what moves: each thing in its colour with its number."""
    import cv2

    height, width = seen.moving.shape
    scale = min(1.0, LONGEST / max(arrowed.shape[:2]))
    size = (max(1, round(arrowed.shape[1] * scale)), max(1, round(arrowed.shape[0] * scale)))
    # Another array also of the same size: the picture itself goes into the video.
    out = np.asarray(cv2.resize(arrowed, size, interpolation=cv2.INTER_AREA), np.uint8)
    if seen.mask is not None:
        # What does not count is darkened.
        left_out = cv2.resize((~seen.mask).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
        out[left_out] = (out[left_out] * _LEFT_OUT).astype(np.uint8)
    stretch = np.array([size[0] / width, size[1] / height])
    boxes, names, inks = [], [], []
    for thing in seen.objects:
        color = drawing.distinct_color(thing.id)
        left, top, wide, high = thing.box
        # The labels of a thing may reach beyond its box by nothing: its box is that of its pixels.
        part = np.s_[max(top, 0) : max(top + high, 0), max(left, 0) : max(left + wide, 0)]
        own = (seen.labels[part] == thing.id).astype(np.uint8)
        if own.size:
            found, _ = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
            corner = (max(left, 0), max(top, 0))
            around = [(one.reshape(-1, 2) + corner + 0.5) * stretch - 0.5 for one in found if len(one) > 2]
            drawing.rimmed(out, drawing.Strokes([np.concatenate([one, one[:1]]) for one in around], color, 1))
        ends = np.rint(np.array([(left, top), (left + wide, top + high)]) * stretch).astype(int)
        boxes.append((int(ends[0, 0]), int(ends[0, 1]), int(ends[1, 0]), int(ends[1, 1])))
        names.append(str(thing.id))
        inks.append(color)
    labels.draw_labels(out, boxes, names, inks)
    return out


def _jpeg(picture: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".jpg", picture, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
    return data.tobytes() if done else b""


def when(slide: Slide) -> str:
    """Say which frame a picture shows."""
    time = f", {slide.t_s:.2f} s" if math.isfinite(slide.t_s) else ""
    return f"frame {slide.frame}{time}"
