"""The end of an extraction: key figures, notes, background, summary.json and the report page."""

from __future__ import annotations

import datetime
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core import __version__, build_info, get_num_threads
from ..io.atomic import writing
from ..velocity.result import not_stated
from .answers import Answer, answers
from .crossings import crossings
from .file_names import NAMES, partial_name
from .outputs import remove_partial
from .probe import STILL_PX
from .report import Material, build, page
from .result import Extraction
from .summary import as_json, camera_figures, key_figures
from .things import thing_figures

if TYPE_CHECKING:
    from .outputs import Outputs
    from .pipeline import Pipeline

__all__ = ["Ending", "close"]


@dataclass(frozen=True)
class Ending:
    """How a run ended: why early ("" where it did not), after which frame, and after how many seconds."""

    reason: str
    last: int | None
    seconds: float


def close(outputs: Outputs, pipeline: Pipeline, ending: Ending) -> tuple[Extraction, Exception | None]:
    """Complete and name all files; give the result and the first error on the way, if there was one."""
    files, trouble = outputs.finish(ended_well=not ending.reason)
    complete = not ending.reason and trouble is None
    summary, answered = _summary(outputs, pipeline, ending, complete, trouble)
    names = {name: NAMES[name] if complete else partial_name(Path(NAMES[name])).name for name in NAMES}

    def step(name: str, write: Callable[[Path], object]) -> bool:
        nonlocal trouble
        path = outputs.folder / names[name]
        try:
            with writing(path) as partial:
                write(partial)
        except OSError as error:
            trouble = trouble or error
            return False
        files[name] = path
        return True

    # On a disk that is full the room that is left goes to what explains the rest.
    background = outputs.views.background() if trouble is None and outputs.views is not None else None
    if background is not None:
        step("background", lambda path: path.write_bytes(_png(background)))
    # The summary names itself and the page among the files: both come after it is put together.
    summary["files"] = {name: path.name for name, path in files.items()} | {
        name: names[name] for name in ("summary", "report")
    }
    step("summary", lambda path: path.write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n"))
    report = build(Material.of(outputs, summary, answered, files))
    if not step("report", lambda path: path.write_text(page(report), encoding="utf-8", errors="backslashreplace")):
        step("report", lambda path: path.write_text(page(report.bare()), encoding="utf-8", errors="backslashreplace"))
    if complete:
        remove_partial(outputs.folder)
        outputs.claim.remove_stale(files)
        outputs.released = trouble is None
    order = {name: files[name] for name in NAMES if name in files}
    return Extraction(outputs.folder, complete, order, summary), trouble


def _png(picture: Any) -> bytes:
    import cv2

    _, data = cv2.imencode(".png", picture)
    return bytes(data.tobytes())


def _summary(
    outputs: Outputs, pipeline: Pipeline, ending: Ending, complete: bool, trouble: Exception | None
) -> tuple[dict[str, Any], list[Answer]]:
    """Give the summary, and the answers that its lines are of."""
    series, stream = outputs.series, outputs.stream
    figures = key_figures(series["motion"], series.get("velocity"), series.get("trajectory"))
    if "velocity" in series:
        figures["speed_std_without"] = list(pipeline.unstated)
        figures["gyro"] = None if pipeline.ground is None else pipeline.ground.gyro()
        figures["speed_variance_shares"] = {} if pipeline.ground is None else pipeline.ground.shares.shares()
    if outputs.trajectory is not None:
        figures |= outputs.trajectory.figures()
        sensors = outputs.settings.sensors
        figures["mounted"] = sensors is not None and sensors.mount is not None
    figures |= camera_figures(series["motion"], pipeline.decision.motion)
    figures |= thing_figures(series["objects"], series["motion"], still=figures["camera_still"])
    figures["camera_motion_reason"] = pipeline.decision.reason
    lines = crossings(series["objects"], outputs.settings)
    figures["lines"] = [line.to_dict() for line in lines]
    answered = answers(figures, [line.text() for line in lines])
    said = [answer.line() for answer in answered]
    problems = []
    if not complete:
        problems.append(f"The run ended early: {ending.reason or trouble}. What is here was finished until then.")
    if not complete and ending.last is not None:
        problems.append(
            "The same command with --resume goes on."
            if outputs.resumable
            else f"Go on into another folder with --start {ending.last}; its first row repeats frame {ending.last}."
        )
    summary = {
        "version": __version__,
        "build": ", ".join(f"{name} {value}" for name, value in build_info().items() if name != "version"),
        "date": datetime.datetime.now().astimezone().isoformat(sep=" ", timespec="seconds"),
        "source": stream.source,
        "identity": outputs.claim.identity.as_dict(),
        "complete": complete,
        "reason": ending.reason or ("" if trouble is None else str(trouble)),
        "next_start": None if complete else ending.last,
        "size": list(stream.size or (0, 0)),
        "frame_rate": stream.frame_rate,
        "timestamps": stream.timestamps,
        "camera_motion": pipeline.decision.motion,
        **figures,
        "seconds": ending.seconds,
        "frames_per_second": figures["frames"] / max(ending.seconds, 1e-9),
        "threads": get_num_threads(),
        "video_codec": None if outputs.views is None else outputs.views.codec,
        "settings": outputs.settings.as_text(),
        "answers": said,
        "text": " ".join(said),
        "problems": problems,
        "notes": [*stream.notes, *pipeline.notes, *_notes(outputs, pipeline)],
    }
    return as_json(summary), answered


def _notes(outputs: Outputs, pipeline: Pipeline) -> list[str]:
    """Say what a reader should know before trusting the figures."""
    motion, notes = outputs.series["motion"], []
    if pipeline.mask is not None:
        notes.append(
            f"{100 * (1 - pipeline.mask.mean()):.1f} % of the pixels do not count, as the mask says: nothing is "
            "measured, drawn as moving or listed there, and shares are of the others."
        )
    length = np.hypot(motion["dx_px"], motion["dy_px"])
    if len(motion) == 1:
        notes.append("There is one frame: a motion needs two.")
    if pipeline.decision.motion == "static":
        moved = int((length > 2 * STILL_PX).sum())
        if moved > 0.05 * len(motion):
            notes.append(
                f"The camera was taken as resting, yet the picture as a whole moved in {moved} frames: "
                "run again with --camera-motion moving."
            )
    if not np.isfinite(motion["t_s"]).all():
        notes.append("The source has no times: give --rate for seconds and velocities.")
    views = outputs.views
    if views is not None and views.codec == "mp4v":
        notes.append("Browsers do not play the videos' codec: pip install 'rsflow-motion[video]' brings H.264.")
    valid = motion["flow_valid_share"]
    if np.isfinite(valid).any() and float(np.nanmean(valid)) < 0.5:
        notes.append(
            f"Only {100 * float(np.nanmean(valid)):.0f} % of the dense flow is valid: too little texture, overexposed "
            "or dark areas, or motion that is too large."
        )
    if pipeline.unstated:
        hint = "" if "height" not in pipeline.unstated else "; state the height's with height_std_m, or --height-std"
        said = not_stated(pipeline.unstated)
        notes.append(f"{said[0].upper()}{said[1:]}{hint}.")
    if "velocity" in outputs.series and not np.isfinite(outputs.series["velocity"]["vx_m_s"]).any():
        notes.append("No velocity could be measured: see the statuses below.")
    speed = np.nanmax(length, initial=0.0)
    if math.isfinite(speed) and outputs.stream.size and speed > 0.3 * min(outputs.stream.size):
        notes.append("The picture moves by up to a third of its size between frames: a higher frame rate would help.")
    return notes
