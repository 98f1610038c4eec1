"""Pictures of the report's slider, and the command that makes a run again."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path

import numpy as np
import pytest

import rsflow
from report_materials import film
from rsflow.cli import extract as command
from rsflow.extraction import ExtractSettings, slides
from rsflow.extraction.report.command import commands
from rsflow.extraction.slides import Slides
from rsflow.velocity import Sensors


@pytest.fixture(scope="module")
def seen() -> rsflow.MotionSegmentation:
    segmenter = rsflow.MotionSegmenter(camera_motion="moving")
    return [segmenter.update(frame.image) for frame in rsflow.synthetic.flight_with_object(frames=6)][-1]


def gathered(seen: rsflow.MotionSegmentation, frames: int, picture: np.ndarray) -> Slides:
    out = Slides()
    for number in range(frames):
        if out.next():
            out.add(picture, seen, number, number / 30)
    return out


@pytest.mark.parametrize(("frames", "kept", "stride"), [(1, 1, 1), (48, 48, 1), (49, 25, 2), (1000, 32, 32)])
def test_pictures_are_spread_evenly_and_few(
    seen: rsflow.MotionSegmentation, monkeypatch: pytest.MonkeyPatch, frames: int, kept: int, stride: int
) -> None:
    monkeypatch.setattr(slides, "_outlined", lambda arrowed, seen: arrowed)
    found = gathered(seen, frames, np.zeros((6, 8, 3), np.uint8)).kept()
    assert [slide.frame for slide in found] == list(range(0, frames, stride))[:kept]
    assert len(found) == kept


@pytest.mark.parametrize(
    ("frames", "made", "kept"),
    [(1, 1, 1), (48, 48, 48), (49, 25, 25), (90, 45, 45), (300, 38, 38), (384, 48, 48), (1000, 80, 32)],
)
def test_where_the_length_is_known_hardly_a_picture_is_made_to_be_given_up(
    seen: rsflow.MotionSegmentation, monkeypatch: pytest.MonkeyPatch, frames: int, made: int, kept: int
) -> None:
    done = []
    monkeypatch.setattr(slides, "_outlined", lambda arrowed, seen: done.append(0) or arrowed)
    out = Slides(frames)
    for number in range(frames):
        if out.next():
            out.add(np.zeros((6, 8, 3), np.uint8), seen, number, number / 30)
    assert (len(done), len(out.kept())) == (made, kept)
    unknown = gathered(seen, frames, np.zeros((6, 8, 3), np.uint8)).kept()
    assert [slide.frame for slide in out.kept()] == [slide.frame for slide in unknown]


def test_a_run_of_a_million_frames_that_is_ended_early_has_pictures(
    seen: rsflow.MotionSegmentation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slides, "_outlined", lambda arrowed, seen: arrowed)
    out = Slides(10**6)
    for number in range(100):
        if out.next():
            out.add(np.zeros((6, 8, 3), np.uint8), seen, number, number / 30)
    assert len(out.kept()) == 13


def test_pictures_stay_within_their_bytes(seen: rsflow.MotionSegmentation, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slides, "BUDGET_BYTES", 60_000)
    noise = np.random.default_rng(1).integers(0, 256, (*seen.moving.shape, 3), np.uint8)
    found = gathered(seen, 20, noise).kept()
    assert sum(len(slide.jpeg) for slide in found) <= 60_000
    assert np.unique(np.diff([slide.frame for slide in found])).size == 1


def test_a_picture_has_the_outline_and_leaves_the_videos_alone(seen: rsflow.MotionSegmentation) -> None:
    plain = np.full((*seen.moving.shape, 3), 90, np.uint8)
    drawn = slides._outlined(plain, seen)
    assert (plain == 90).all()
    changed = (drawn != 90).any(axis=2)
    (thing,) = seen.objects
    x, y, width, height = thing.box
    assert changed[max(y - 2, 0) : y + height + 2, max(x - 2, 0) : x + width + 2].any()
    assert not changed[y + height // 2, x + width // 2]
    large = slides._outlined(np.zeros((1440, 2000, 3), np.uint8), seen)
    assert max(large.shape) == slides.LONGEST


def test_a_run_that_goes_on_keeps_its_pictures(seen: rsflow.MotionSegmentation) -> None:
    picture = np.zeros((12, 16, 3), np.uint8)
    first = gathered(seen, 60, picture)
    other = Slides()
    other.restore(first.state())
    for one in (first, other):
        for number in range(60, 130):
            if one.next():
                one.add(picture, seen, number, number / 30)
    assert first.kept() == other.kept()


@pytest.mark.parametrize(
    "settings",
    [
        ExtractSettings(),
        ExtractSettings(start=3, stop=90, stride=2, roi=(0, 8, 64, 48), preset="accurate", videos=False),
        ExtractSettings(lines=[(1, 2.5, 3, 4), (0, 0, 9, 9)], scale_m_per_px=0.02, frame_rate=25.0),
        ExtractSettings(
            camera="my cam.yaml", height_m=0.2, height_std_m=0.0, mask=Path("m.png"), max_displacement=12.0,
            sensors=Sensors(rates="gyro.csv", rate_std_rad_s=0.01, mount="x-right", readout_s=0.02, log_start_s=-4.5),
        ),
    ],
)  # fmt: skip
def test_the_command_on_the_page_says_the_settings(settings: ExtractSettings, tmp_path: Path) -> None:
    import argparse

    source = tmp_path / "a film; rm -rf.mp4"
    source.touch()
    material = film(3)
    summary = {**material.summary, "source": str(source)}
    said, text = commands(dataclasses.replace(material, settings=settings, summary=summary))
    assert said.startswith("In a terminal")
    install, call = text.split("\n")
    assert install == "pip install rsflow-motion==0.0"
    words = shlex.split(call)
    assert words[:2] == ["rsflow", "extract"]
    parser = argparse.ArgumentParser()
    command.add_arguments(parser)
    parsed = parser.parse_args(words[2:])
    options = {name: value for name, value in command.options(parsed).items() if name not in ("overwrite", "resume")}
    again = ExtractSettings(**options, times=parsed.times)
    assert parsed.source == str(source)
    plain = {name: str(value) for name, value in again.flat().items()}
    assert plain == {name: str(list(v) if isinstance(v, list) else v) for name, v in settings.flat().items()} | {
        "lines": plain["lines"]
    }
    assert np.allclose(again.lines, settings.lines) if settings.lines else not again.lines


def test_what_a_terminal_cannot_say_is_said_in_python() -> None:
    material = film(3)
    settings = ExtractSettings(camera=rsflow.synthetic.flight(frames=2).camera, height_m=0.2)
    summary = {**material.summary, "source": "list of 3 arrays"}
    said, text = commands(dataclasses.replace(material, settings=settings, summary=summary))
    assert said.startswith("In Python")
    assert "rsflow.extract(<the frames>, 'out', camera=<Camera>, height_m=0.2)" in text
