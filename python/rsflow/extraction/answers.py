"""What a person asks first: how fast, where, how many, how sure. In sentences for a terminal, as facts for the page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .columns import meaning
from .things import LASTING_FRAMES, brief_text, count_text, speed_text, value_text

__all__ = ["Answer", "Fact", "answers", "way_text"]

Figures = Mapping[str, Any]

# A smaller share of the picture is written as 0.0 %.
_LEAST_SHARE = 5e-4


@dataclass(frozen=True)
class Fact:
    """A value with its unit, and what it is of."""

    value: str
    what: str


@dataclass(frozen=True)
class Answer:
    """The answer to one question.

    Attributes
    ----------
    question : str
    facts : tuple of Fact
        What is shown large.
    more : tuple of str
        Sentences that say what the facts leave out.
    sentences : tuple of str
        All of it in words.
    """

    question: str
    facts: tuple[Fact, ...]
    more: tuple[str, ...]
    sentences: tuple[str, ...]

    def line(self) -> str:
        """Give it as a line of a terminal."""
        return f"{self.question.rstrip('?')}: {' '.join(self.sentences)}"


class _Said:
    """Gathers an answer."""

    def __init__(self) -> None:
        self.facts: list[Fact] = []
        self.more: list[str] = []
        self.sentences: list[str] = []

    def fact(self, value: str, what: str) -> None:
        self.facts.append(Fact(value, what))

    def say(self, sentence: str, *, more: bool = False) -> None:
        """Add a sentence; the page has it too where the facts do not hold it (`more`)."""
        self.sentences.append(sentence)
        if more:
            self.more.append(sentence)

    def answer(self, question: str) -> Answer:
        return Answer(question, tuple(self.facts), tuple(self.more), tuple(self.sentences))


def answers(figures: Figures, lines: Sequence[str] = ()) -> list[Answer]:
    """Answer the four questions from the key figures; `lines` say what crossed which line."""
    return [
        _fast(figures).answer("How fast?"),
        _where(figures).answer("Where?"),
        _many(figures, lines).answer("How many?"),
        _sure(figures).answer("How sure?"),
    ]


def _fast(figures: Figures) -> _Said:
    said = _Said()
    if figures["camera_still"]:
        # Of a camera at rest a sum of displacements is a sum of errors.
        said.fact("stood still", "the camera")
        said.say(f"The camera stood still ({figures['camera_motion_reason']}).")
    if figures.get("velocity_measured"):
        said.fact(
            value_text(figures["speed_median_m_s"], figures["speed_std_median_m_s"], "m/s"),
            "the camera over the ground, median",
        )
        unstated = figures.get("speed_std_without")
        without = f", without that of {', '.join(unstated)}, which was not stated" if unstated else ""
        said.say(
            f"The camera went at {figures['speed_median_m_s']:.4g} m/s over the ground (median, standard deviation of "
            f"one frame {figures['speed_std_median_m_s']:.2g} m/s{without}; "
            f"at most {figures['speed_max_m_s']:.4g} m/s)."
        )
    elif "velocity_measured" in figures:
        said.fact("not known", "the camera over the ground")
        said.say("How fast the camera went over the ground could not be measured.")
    elif not figures["camera_still"] and figures["frames"] > 1:
        speed, std, unit = (figures[f"picture_speed_{name}"] for name in ("median", "std_median", "unit"))
        said.fact(value_text(speed, std, unit), "the picture as a whole, median")
        went = f"; the picture as a whole went at {value_text(speed, std, unit)} (median)" if speed > 0 else ""
        said.say(f"The camera was {figures['camera_motion_reason']}{went}.")
    count = figures["lasting_objects"]
    if count:
        speed, unit = figures["thing_speed_median"], figures["thing_speed_unit"]
        of = f"things that move, median of {count}" if count > 1 else "the thing that moved"
        said.fact(value_text(speed, figures["thing_speed_std_median"], unit), of)
        if count > 1 and math.isfinite(speed):
            fastest = value_text(figures["fastest_thing_speed"], figures["fastest_thing_speed_std"], unit)
            said.fact(fastest, f"the fastest, number {figures['fastest_thing']}")
        said.say(speed_text(dict(figures)))
    if not said.facts:
        said.fact("not known", "there is no pair of frames")
    return said


def _where(figures: Figures) -> _Said:
    said = _Said()
    if figures.get("velocity_measured"):
        _way(said, figures)
    elif not figures["camera_still"] and figures["frames"] > 1:
        x, y = figures["displacement_sum_px"]
        text = _sum_text(figures)
        if math.isfinite(x):
            about = "about " if figures["displacement_unmeasured"] else ""
            said.fact(f"{about}{_place(x, y, 'px', 0)}", "the picture as a whole, in sum")
        else:
            said.fact("not known", "where the picture as a whole went")
        said.say(text[0].upper() + text[1:] + ".", more=bool(figures["displacement_unmeasured"]))
    headings: Mapping[str, int] = figures["headings"]
    if headings:
        count = sum(headings.values())
        first, most = max(headings.items(), key=lambda item: item[1])
        went = f"to the {first}" if first in _SIDES else first
        said.fact(went, f"most things: {most} of {count}" if count > 1 else "the thing that moved")
        parts = [f"{number} {_went(name, number)}" for name, number in headings.items()]
        of_all = f"Of {count} things {', '.join(parts)}."
        said.say(of_all if count > 1 else f"The thing that moved {_went(first, 1)}.", more=count > 1)
    if not said.facts:
        said.fact("nowhere", "nothing moved on its own, nor did the camera")
        said.say("Nothing moved on its own, nor did the camera.")
    return said


_SIDES = ("right", "left")


def _went(heading: str, number: int) -> str:
    if heading.startswith("about"):
        return f"stayed about where {'it was' if number == 1 else 'they were'}"
    return f"went {heading}"


def _way(said: _Said, figures: Figures) -> None:
    """Lead with what was measured; what is assumed for the rest stands by itself."""
    missing = figures["distance_unmeasured"]
    if not missing:
        said.fact(value_text(figures["distance_m"], figures["distance_std_m"], "m"), "way of the camera")
    else:
        lost = f"{missing} frames ({figures['distance_unmeasured_s']:.2f} s)"
        what = f"way travelled where it was measured; {lost} were not"
        said.fact(f"{figures['distance_measured_m']:.4g} m", what)
        if figures["distance_m"] is None or not math.isfinite(figures["distance_m"]):
            said.fact("not known", "way travelled in all")
        else:
            total = f"{figures['distance_m']:.3g} ± {figures['distance_std_m']:.1g} m"
            said.fact(total, "way travelled in all, if the motion went on as beside in what was not measured")
    end = ""
    if math.isfinite(figures["end_x_m"]):
        names = ("along x", "along y") if figures["mounted"] else None
        x, y, digits = figures["end_x_m"], figures["end_y_m"], _digits(figures["distance_measured_m"])
        if round(x, digits) == round(y, digits) == 0:
            said.fact("at its start", "where it ended")
            end = "; it ended at its start"
        else:
            place = _place(x, y, "m", digits, names)
            said.fact(place, "where it ended, from its start")
            end = f"; it ended {place} of its start"
    said.say(f"The camera's way was {way_text(figures)}{end}.")


def _digits(length: float) -> int:
    """Places after the point for a way of this length in metres."""
    return min(max(3 - math.floor(math.log10(length)) - 1, 0), 6) if length > 0 and math.isfinite(length) else 3


def _place(x: float, y: float, unit: str, digits: int, names: tuple[str, str] | None = None) -> str:
    """Say where something is: how far to the right or left, and how far down or up."""
    if names is not None:
        return f"{x:+.{digits}f} {unit} {names[0]}, {y:+.{digits}f} {unit} {names[1]}"
    across = f"{abs(x):.{digits}f} {unit} {'right' if x >= 0 else 'left'}"
    return f"{across}, {abs(y):.{digits}f} {unit} {'down' if y >= 0 else 'up'}"


def _many(figures: Figures, lines: Sequence[str]) -> _Said:
    said = _Said()
    count = figures["lasting_objects"]
    said.fact(
        f"{count} thing{'' if count == 1 else 's'}" if count else "none",
        f"moved on {'its' if count == 1 else 'their'} own, for {LASTING_FRAMES} frames or more",
    )
    if count and math.isfinite(figures["at_once_median"]):
        said.fact(f"{figures['at_once_median']:.0f}", f"at once, median; at most {figures['at_once_max']}")
    said.say(count_text(dict(figures)), more=not count and bool(figures["objects"]))
    if count and (brief := brief_text(dict(figures))):
        said.say(brief)
    for line in lines:
        said.say(line, more=True)
    if math.isfinite(figures["moving_share"]) and (count or figures["moving_share"] >= _LEAST_SHARE):
        said.say(f"{100 * figures['moving_share']:.1f} % of the picture moves on its own on average.", more=True)
    return said


def _sure(figures: Figures) -> _Said:
    said = _Said()
    pairs, measured = max(figures["frames"] - 1, 0), figures["measured"]
    frames = f"{figures['frames']} frame{'' if figures['frames'] == 1 else 's'}"
    time = f" over {figures['duration_s']:.2f} s" if math.isfinite(figures["duration_s"]) else ""
    if "velocity_measured" in figures:
        seen = figures["velocity_measured"]
        said.fact(f"{seen} of {pairs}", "velocities could be measured")
        said.say(f"A velocity was measured in {seen} of {pairs} pairs of frames.")
        if unstated := figures.get("speed_std_without"):
            said.more.append(f"The deviations leave out that of {', '.join(unstated)}, which was not stated.")
    said.fact(f"{measured} of {pairs}", f"pairs of frames could be compared, of {frames}{time}")
    said.say(f"{frames}{time}; the displacement was measured in {measured} of {pairs} pairs.")
    std = figures["displacement_std_median_px"]
    if math.isfinite(std):
        said.fact(f"± {std:.2g} px", "the displacement of one frame, median")
        said.say(f"Its standard deviation in one frame is {std:.2g} px (median).")
    reasons = [
        f"{count} pair{'' if count == 1 else 's'} ({meaning(status)})"
        for status, count in figures["statuses"].items()
        if status not in ("ok", "first_frame", "")
    ]
    if reasons:
        said.say(f"Not measured: {'; '.join(reasons)}.", more=True)
    if math.isfinite(figures["flow_valid_share"]):
        said.say(f"{100 * figures['flow_valid_share']:.0f} % of the motion of single pixels is valid.")
    return said


def _sum_text(figures: Figures) -> str:
    x, y = figures["displacement_sum_px"]
    pairs, missing = max(figures["frames"] - 1, 0), figures["displacement_unmeasured"]
    time = figures["displacement_unmeasured_s"]
    part = f"{missing} of {pairs} pairs" + (f" ({time:.2f} s)" if math.isfinite(time) else "")
    if not math.isfinite(x):
        mx, my = figures["displacement_sum_measured_px"]
        others = f"; the others add up to {_towards(mx, my)}" if missing < pairs else ""
        return f"how far the picture went in sum is not known, since {part} could not be measured{others}"
    dx, dy = figures["displacement_sum_std_px"]
    if not missing:
        return f"in sum the picture went {_towards(x, y)}"
    mx, my = figures["displacement_sum_measured_px"]
    seen, carried = figures["displacement_from_dense_flow"], figures["displacement_from_neighbours"]
    origins = [
        *([f"with the camera's motion in the dense flow for {seen} of them"] if seen else []),
        *([f"if the motion went on as beside in {carried} of them, which nothing shows"] if carried else []),
    ]
    return (
        f"where it was measured the picture went {_towards(mx, my)}; {part} could not be measured: in sum about "
        f"{_towards(x, y)}, with a standard deviation of {_rounded(dx)} and {_rounded(dy)} px, {' and '.join(origins)}"
    )


def _towards(x: float, y: float) -> str:
    across, along = round(x, 2), round(y, 2)
    return (
        f"{abs(across):.2f} px to the {'right' if across >= 0 else 'left'} and "
        f"{abs(along):.2f} px {'down' if along >= 0 else 'up'}"
    )


def _rounded(value: float) -> str:
    """Write a number with two digits that count, never as a power."""
    return f"{float(f'{value:.2g}'):.12g}"


def way_text(figures: Figures) -> str:
    """Say the length of the way, and what of it was not measured."""
    way, std, missing = figures["distance_m"], figures["distance_std_m"], figures["distance_unmeasured"]
    if not missing:
        return f"{way:.4g} m in all"
    time = figures["distance_unmeasured_s"]
    lost = f"{missing} frames ({time:.2f} s) without a velocity"
    if way is None or not math.isfinite(way):
        return f"{figures['distance_measured_m']:.4g} m where it was measured, in all unknown for {lost}"
    return (
        f"{figures['distance_measured_m']:.4g} m where it was measured; for {lost} nothing was: about {way:.4g} m in "
        f"all (standard deviation {std:.2g} m) if the motion went on as beside"
    )
