"""The parts of a long source made one: a run that has come to its last frame, which then ends as any other."""

from __future__ import annotations

import contextlib
import csv
import itertools
import json
import math
import os
import shutil
import zlib
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._results.folder import read_json
from ..errors import RsflowError
from ..video.sinks import CLOCK
from .checkpoint import Draft, Saved
from .claim import Claim
from .columns import OBJECTS
from .file_names import NAMES
from .parts import NOTE
from .same_things import Joint, added, pairs
from .slides import Slides
from .tables import CsvTable
from .workspace import PARKED, parked

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .settings import ExtractSettings

__all__ = ["NotOneError", "join_parts"]

_TABLES = ("motion", "objects", "velocity", "trajectory")


class NotOneError(RsflowError):
    """Parts that do not fit together: the source is to be read in one piece."""


def join_parts(
    source: Any, settings: ExtractSettings, folder: Path, parts: Sequence[Path], *, overwrite: bool
) -> list[dict[str, int]]:
    """Put parts together to a run in `folder` that is at its end: ``extract(..., resume=True)`` completes it.

    Parameters
    ----------
    source, settings, overwrite
        As for `rsflow.extract`.
    folder : Path
        Of the result; made if it is missing.
    parts : sequence of Path
        Folders of `extract_part`, in order. What follows a part whose source failed is left out.

    Returns
    -------
    list of dict of str to int
        How many rows each part has in each table.

    Raises
    ------
    NotOneError
        If two parts saw different pictures in the frames of their overlap, or frames were lost: the source is then to
        be read in one piece.
    """
    notes = [read_json(part / NOTE) for part in parts]
    failed = next((k for k, note in enumerate(notes) if note["failure"]), len(parts) - 1)
    parts, notes = parts[: failed + 1], notes[: failed + 1]
    _expect_one(notes)
    claim = Claim(folder, source, settings, overwrite=overwrite)
    saved = [Saved(part / PARKED) for part in parts]
    folder.mkdir(parents=True, exist_ok=True)
    with parked(folder) as place:
        (place / "identity.json").write_text(json.dumps(claim.identity.as_dict()), encoding="utf-8")
        draft = Draft.of(saved[-1])
        draft.add("identity", claim.identity.as_dict())
        draft.add("seconds", sum(float(one.value("seconds")) for one in saved))
        handed = bool(notes) and all(note["handed"] for note in notes[1:])
        moved = np.eye(3)
        states: dict[str, tuple[int, int, int]] = {}
        rows: list[dict[str, int]] = [{} for _ in parts]
        for name in saved[-1].value("tables"):
            if name == "objects" and not handed:
                states[name], moved = _objects(place, saved, notes, rows)
            else:
                states[name] = _table(place, name, saved, rows)
        draft.add("tables", states)
        views = _views(place, saved)
        # The scene of the last part is over the picture that the part began with.
        scene = views["pictures"]["scene"]
        pictures = {**views["pictures"], "scene": {**scene, "first": scene["first"] @ np.linalg.pinv(moved)}}
        if not handed:
            pictures["slides"] = Slides.joined([one.value("views")["pictures"]["slides"] for one in saved])
        views["pictures"] = pictures
        draft.add("views", views)
        draft.write(place / "checkpoint.npz")
    return rows


def _expect_one(notes: Sequence[dict[str, Any]]) -> None:
    for before, after in itertools.pairwise(notes):
        seen = before["pictures"]
        both = seen.keys() & after["pictures_before"].keys()
        if not both or any(seen[frame] != after["pictures_before"][frame] for frame in both):
            raise NotOneError(f"the frames before {after['begin']} differ where they are decoded from elsewhere")
        if before["last"] >= after["begin"]:
            raise NotOneError(f"parts overlap at frame {after['begin']}")
    if any(note["lost"] for note in notes):
        raise NotOneError("frames cannot be decoded")


def _table(place: Path, name: str, saved: Sequence[Saved], rows: list[dict[str, int]]) -> tuple[int, int, int]:
    """Write the rows of all parts below each other, byte for byte; give the state of the table."""
    total = size = check = 0
    with (place / NAMES[name]).open("wb") as whole:
        for k, one in enumerate(saved):
            count, end, _ = one.value("tables")[name]
            rows[k][name] = count
            total += count
            with (one.folder / NAMES[name]).open("rb") as part:
                # The header stands once.
                skipped = len(part.readline()) if k else 0
                part.seek(skipped)
                left = end - skipped
                while left and (data := part.read(min(left, 1 << 20))):
                    whole.write(data)
                    check = zlib.crc32(data, check)
                    size, left = size + len(data), left - len(data)
        whole.flush()
        os.fsync(whole.fileno())
    return total, size, check


def _objects(
    place: Path, saved: Sequence[Saved], notes: Sequence[dict[str, Any]], rows: list[dict[str, int]]
) -> tuple[tuple[int, int, int], NDArray[np.float64]]:
    """Write the rows of what moves, each thing under one number; see `same_things`.

    Gives the state of the table, and what takes places of the last part to the picture of the first frame.
    """
    table = CsvTable(place / NAMES["objects"], tuple(OBJECTS), place=place / NAMES["objects"])
    joint = Joint({}, 1)
    # The last rows as they were written: those of the overlap with the next part.
    tail: deque[dict[str, Any]] = deque()
    to_first = moved = np.eye(3)
    for k, (one, note) in enumerate(zip(saved, notes, strict=True)):
        if k:
            begin = int(note["begin"])
            numbers = pairs(tail, note["objects_before"])
            last = max((int(row["frame"]) for row in note["objects_before"]), default=begin)
            joint = Joint(
                dict(numbers),
                joint.next_id,
                added(numbers, _at(tail, last), _at(note["objects_before"], last)),
                to_first @ np.linalg.pinv(np.array(note["to_first"], np.float64)),
            )
        count = 0
        keep_from = _keep_from(notes, k)
        tail.clear()
        for row in _rows(one.folder / NAMES["objects"], one.value("tables")["objects"][0]):
            changed = joint.changed(row)
            table.append(changed)
            count += 1
            if int(row["frame"]) >= keep_from:
                tail.append(changed)
        rows[k]["objects"] = count
        moved = np.eye(3) if joint.to_first is None else joint.to_first
        to_first = moved @ np.array(note["to_first_end"], np.float64)
    table.close()
    return table.state(), moved


def _keep_from(notes: Sequence[dict[str, Any]], k: int) -> float:
    """Give the first frame of part `k` that the next part saw too."""
    if k + 1 == len(notes):
        return math.inf
    return min((int(frame) for frame in notes[k + 1]["pictures_before"]), default=math.inf)


def _at(rows: Sequence[dict[str, Any]] | deque[dict[str, Any]], frame: int) -> dict[int, dict[str, Any]]:
    return {int(row["id"]): row for row in rows if int(row["frame"]) == frame}


def _rows(path: Path, count: int) -> Iterator[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        for _, row in zip(range(count), csv.DictReader(file), strict=False):
            yield row


def _views(place: Path, saved: Sequence[Saved]) -> dict[str, Any]:
    """Bring the pieces of all videos together; give the state of the views at the end of the last part."""
    states = [one.value("views") for one in saved]
    whole: dict[str, Any] = dict(states[-1])
    best = max(range(len(states)), key=lambda k: (states[k]["score"], -k))
    for name in ("posters", "poster_frame", "score"):
        whole[name] = states[best][name]
    whole["clips"] = {}
    for name in states[-1]["clips"]:
        pieces: list[tuple[str, int, int]] = []
        begin_s, last_s = math.nan, -math.inf
        for one, state in zip(saved, states, strict=True):
            clip = state["clips"][name]
            first_s, end_s = clip["times"]
            if not clip["parts"]:
                continue
            begin_s = first_s if math.isnan(begin_s) else begin_s
            shift_s = 0.0
            if first_s <= last_s:
                # A source without times: each part counts from 0.
                frames = sum(count for _, count, _ in pieces)
                shift_s = last_s + (last_s - begin_s) / max(frames - 1, 1) - first_s
            for piece, frames, tick in clip["parts"]:
                target = f"{name}-{len(pieces):05d}{Path(piece).suffix}"
                _given(one.folder / Path(piece).name, place / target)
                pieces.append((target, frames, tick + round((first_s + shift_s - begin_s) * CLOCK)))
            last_s = end_s + shift_s
        whole["clips"][name] = states[-1]["clips"][name] | {"parts": pieces, "times": (begin_s, last_s)}
    return whole


def _given(source: Path, target: Path) -> None:
    """Give a file under another name too, without its bytes where the file system can."""
    with contextlib.suppress(OSError):
        os.link(source, target)
        return
    shutil.copyfile(source, target)
