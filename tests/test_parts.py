"""A video that is cut into parts, each measured by itself, and joined: the tables of one run, to the byte."""

import functools
import itertools
import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import given as drawn
from hypothesis import strategies as st

import rsflow
from parts_helpers import METRIC, columns_of, made_clip, same_measurements
from rsflow.extraction.joining import NotOneError, join_parts
from rsflow.extraction.parts import NOTE, NoFrameError, Span, extract_part, is_part, scout, spans
from rsflow.extraction.same_things import pairs
from rsflow.extraction.settings import ExtractSettings
from rsflow.velocity import Sensors


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    return made_clip(tmp_path_factory.mktemp("parts"))


VARIANTS = {
    "plain": {"videos": False, "camera_motion": "moving"},
    "metric": METRIC,
    "gyro": {**METRIC, "sensors": Sensors(rates="gyro.csv", rate_std_rad_s=0.01), "start": 3, "illumination": "offset"},
    "videos": {**METRIC, "videos": True},
    "strided": {**METRIC, "stride": 2, "roi": (8, 8, 160, 128), "start": 1, "stop": 58},
    "still": {"videos": False, "camera_motion": "static", "frame_rate": 10.0},
}


@pytest.fixture(scope="module")
def whole(clip):
    """Give what a run in one piece gives."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(clip.parent)
        yield functools.cache(lambda name: rsflow.extract(clip, clip.parent / name, **VARIANTS[name]))


def cut(clip, given, begins, folder, *, overlap):
    """Measure the parts that begin at these frames, and join them."""
    options = ExtractSettings(**given)
    begins = [given.get("start", 0), *begins]
    seed, parts = None, []
    for number, (begin, end) in enumerate(itertools.pairwise([*begins, given.get("stop")])):
        span = Span(number, begin, end)
        part = folder / f"part-{number}"
        part.mkdir()
        if number and overlap is None:
            seed = parts[-1]
        elif number:
            found = folder / f"seed-{number}"
            found.mkdir()
            scout(clip, options, span, found, seed)
            seed = found
        extract_part(clip, options, span, part, seed=seed, overlap=overlap)
        assert is_part(part, clip, options, span, overlap)
        assert not is_part(part, clip, ExtractSettings(**given, preset="balanced"), span, overlap)
        parts.append(part)
    rows = join_parts(clip, options, folder / "out", parts, overwrite=False)
    assert len(rows) == len(parts)
    return rsflow.extract(clip, folder / "out", **given, resume=True)


def same_all(done, whole, but=()):
    for name in ("motion", "objects", "velocity", "trajectory"):
        if name in whole.files:
            assert done.files[name].read_bytes() == whole.files[name].read_bytes(), name
    changing = ("date", "seconds", "frames_per_second", "settings", *but)
    first, second = (json.loads(one.files["summary"].read_text()) for one in (done, whole))
    assert {name: first[name] for name in first if name not in changing} == {
        name: second[name] for name in second if name not in changing
    }


@settings(max_examples=4, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
@drawn(
    name=st.sampled_from(["plain", "metric", "gyro", "strided", "still"]),
    wanted=st.lists(st.integers(18, 50), min_size=1, max_size=2, unique=True),
    overlap=st.sampled_from([None, 1, 7, 20]),
)
def test_parts_joined_are_one_run(clip, whole, name, wanted, overlap):
    given, whole = VARIANTS[name], whole(name)
    stride, start = given.get("stride", 1), given.get("start", 0)
    begins = sorted({start + (begin - start) // stride * stride for begin in wanted})
    if stride > 1 and begins[0] < 30:
        # The first part decides from twelve pairs.
        begins = [start + 30 // stride * stride]
    with tempfile.TemporaryDirectory() as folder:
        done = cut(clip, given, begins, Path(folder), overlap=overlap)
        same_measurements(done, whole)
        if overlap is None:
            same_all(done, whole)


def test_videos_of_parts_are_one(clip, whole, tmp_path):
    given, whole = VARIANTS["videos"], whole("videos")
    done = cut(clip, given, [25, 42], tmp_path, overlap=16)
    same_measurements(done, whole)
    for name in ("flow", "moving", "static"):
        with rsflow.frames(done.files[name]) as one, rsflow.frames(whole.files[name]) as other:
            assert [frame.t_s for frame in one] == pytest.approx([frame.t_s for frame in other], abs=2e-5)
    # The thing that moves keeps its number and its age over both cuts.
    counts = []
    for one in (done, whole):
        rows = columns_of(one.files["objects"], ["id", "frame", "age_frames", "x_ground_px", "y_ground_px"])
        counts.append({int(row[1]): (int(row[0]), int(row[2]), float(row[3]), float(row[4])) for row in rows})
    both = counts[0].keys() & counts[1].keys()
    assert len(both) >= 0.95 * len(counts[1])
    for frame in both:
        (id_0, age_0, *place_0), (id_1, age_1, *place_1) = counts[0][frame], counts[1][frame]
        assert id_0 == id_1
        assert abs(age_0 - age_1) <= 3
        assert np.abs(np.subtract(place_0, place_1)).max() < 2.0


def test_spans():
    assert [spans_of(100, 40), spans_of(79, 40)] == [[(0, 40), (40, None)], []]
    assert spans_of(130, 40, start=5, stride=3) == []
    assert spans_of(250, 40, start=5, stride=3) == [(5, 125), (125, None)]


def spans_of(count, part_frames, **given):
    pictures = [np.zeros((8, 8), np.uint8)] * count
    found = spans(pictures, ExtractSettings(**given), part_frames)
    return [(span.begin, span.end) for span in found]


def test_a_part_behind_the_end_is_none(clip, tmp_path):
    options = ExtractSettings(videos=False)
    (tmp_path / "seed").mkdir()
    scout(clip, options, Span(1, 40, None), tmp_path / "seed", None)
    (tmp_path / "part").mkdir()
    with pytest.raises(NoFrameError, match="got no frame 99"):
        extract_part(clip, options, Span(1, 100, None), tmp_path / "part", seed=tmp_path / "seed", overlap=5)
    assert not (tmp_path / "part" / NOTE).exists()


def test_pictures_that_differ_are_not_joined(clip, tmp_path):
    options = ExtractSettings(videos=False)
    for number, (begin, end) in enumerate([(0, 30), (30, None)]):
        part, seed = tmp_path / f"{number}", tmp_path / f"seed{number}"
        part.mkdir()
        seed.mkdir()
        if number:
            scout(clip, options, Span(number, begin, end), seed, None)
        extract_part(clip, options, Span(number, begin, end), part, seed=seed if number else None, overlap=5)
    note = json.loads((tmp_path / "1" / NOTE).read_text())
    frames = list(note["pictures_before"])
    assert frames == ["25", "26", "27", "28", "29"]
    note["pictures_before"][frames[2]] += 1
    (tmp_path / "1" / NOTE).write_text(json.dumps(note))
    with pytest.raises(NotOneError, match="differ where they are decoded"):
        join_parts(clip, options, tmp_path / "out", [tmp_path / "0", tmp_path / "1"], overwrite=False)


def test_a_source_that_fails_gives_what_a_run_in_one_piece_gives(tmp_path):
    import cv2

    (tmp_path / "pictures").mkdir()
    scene = np.random.default_rng(1).integers(0, 255, (64, 120), np.uint8)
    for k in range(44):
        size = 60 if k == 40 else 64
        cv2.imwrite(str(tmp_path / "pictures" / f"{k:02d}.png"), cv2.GaussianBlur(scene, (0, 0), 2)[:size, k : k + 64])
    given = {"videos": False, "frame_rate": 30}
    with pytest.raises(rsflow.PartialExtractionError) as whole:
        rsflow.extract(tmp_path / "pictures", tmp_path / "whole", **given)
    with pytest.raises(rsflow.PartialExtractionError) as parts:
        cut(tmp_path / "pictures", given, [17, 34], tmp_path, overlap=None)
    # A later part names another picture of the size before.
    assert str(parts.value).split(" as ")[0] == str(whole.value).split(" as ")[0]
    same_all(parts.value.extraction, whole.value.extraction, but=("reason", "problems"))


def row(frame, number, left, top, width=10, height=10):
    return dict(
        zip(
            ("frame", "id", "left_px", "top_px", "width_px", "height_px"),
            (frame, number, left, top, width, height),
            strict=True,
        )
    )


def test_things_are_the_same_where_their_boxes_agree():
    earlier = [row(f, 4, f, 0) for f in range(20)] + [row(f, 7, 100 - f, 50) for f in range(20)] + [row(0, 9, 0, 0)]
    later = [row(f, 1, 101 - f, 51) for f in range(12, 20)] + [row(f, 2, f + 1, 0) for f in range(10, 20)]
    later += [row(f, 3, 200, 200) for f in range(10, 20)]
    assert pairs(earlier, later) == {1: 7, 2: 4}
    # In the frames that both saw, and of one alone there is no agreement.
    assert pairs([row(3, 1, 0, 0)], [row(19, 1, 0, 0)]) == {}
    assert pairs(earlier, []) == {}
    # Two that claim one: the better one gets it.
    assert pairs([row(5, 1, 0, 0)], [row(5, 1, 3, 0), row(5, 2, 1, 0)]) == {2: 1}
