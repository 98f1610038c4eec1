"""Masks of what is fixed to the sensor: velocity, points, what moves, extraction and the commands leave it out."""

from __future__ import annotations

import csv
import json
import os
import signal
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import PointStatus, cli, synthetic
from rsflow.capture.masks import FixedMask, read_mask
from rsflow.errors import CaptureError, DTypeError, OptionError, ShapeError
from rsflow.extraction import checkpoint

SHAPE = (144, 176)
KINDS = ("below", "around", "letters", "middle")


def overlay_mask(kind: str, share: float, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """False where an overlay of this kind covers about this share of the picture."""
    height, width = shape
    keep = np.ones(shape, bool)
    if kind == "below":
        keep[height - round(height * share) :] = False
    elif kind == "middle":
        down, across = (round(side * (1 - share**0.5) / 2) for side in shape)
        keep[down:-down, across:-across] = False
    elif kind == "around":
        inside = (1 - share) ** 0.5
        down, across = (round(side * (1 - inside) / 2) for side in shape)
        keep[:] = False
        keep[down:-down, across:-across] = True
    else:
        rng = np.random.default_rng(4)
        while keep.mean() > 1 - share:
            y, x = rng.integers(0, height - 8), rng.integers(0, width - 16)
            keep[y : y + 8, x : x + 16] = False
    return keep


def overlay(shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """What stands before the scene and does not move: a texture with sharp edges."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    return np.where((x // 5 + y // 7 + (x * y) // 90) % 2, 235, 20).astype(np.uint8)


def blinking(k: int, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """A clock: blocks that are others in each frame."""
    blocks = np.random.default_rng(100 + k).integers(0, 2, (shape[0] // 4, shape[1] // 4), np.uint8)
    return np.kron(blocks * np.uint8(255), np.ones((4, 4), np.uint8))


def still_scene(frames: int) -> list[np.ndarray]:
    """A camera at rest before a scene at rest, with noise."""
    rng = np.random.default_rng(3)
    ground = 120 + 30 * synthetic.texture(SHAPE, "fine", seed=1)
    return [np.clip(np.round(ground + rng.normal(0, 1, SHAPE)), 0, 255).astype(np.uint8) for _ in range(frames)]


def same_arrays(first: object, second: object, names: tuple[str, ...]) -> None:
    for name in names:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


# --- velocity -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.25, 0.46])
@pytest.mark.parametrize("kind", KINDS)
def test_velocity_beside_an_overlay_is_as_right_as_it_says(kind: str, share: float) -> None:
    keep = overlay_mask(kind, share)
    assert abs(keep.mean() - (1 - share)) < 0.03
    over = {True: [], False: []}
    for climb in (0.0, 0.15):
        f = synthetic.flight(frames=6, velocity_m_s=(0.05, 0.02, climb), seed=3)
        for masked in (True, False):
            estimator = rsflow.VelocityEstimator(f.camera, height_std_m=0.0, mask=keep if masked else None)
            for k, frame in enumerate(f):
                seen = np.where(keep, frame.image, overlay())
                v = estimator.update(seen, frame.t_s, height_m=float(f.height_m[k]))
                if k and (v.valid or masked):
                    assert v.valid
                    error = np.array([v.vx_m_s, v.vy_m_s]) - f.velocity_m_s[k][:2]
                    over[masked].append(np.abs(error) / np.sqrt(np.diag(v.covariance)[:2]))
    assert np.mean(np.concatenate(over[True]) < 2) > 0.85
    assert np.max(over[True]) < 5
    if share > 0.4:
        # Without the mask the overlay is what most points stand on: at rest, and sure of it.
        assert np.median(over[False]) > 10


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_velocity_does_not_depend_on_what_the_mask_leaves_out(dtype: type) -> None:
    keep = overlay_mask("letters", 0.3)
    f = synthetic.flight(frames=4, velocity_m_s=(0.05, 0.02, 0.1), rate_rad_s=(0.1, -0.2, 0.4), seed=5)
    found = []
    for number in range(3):
        rng = np.random.default_rng(number)
        estimator = rsflow.VelocityEstimator(f.camera, mask=keep)
        for k, frame in enumerate(f):
            covered = rng.integers(0, 256, SHAPE).astype(dtype)
            if dtype is np.float32 and number == 2:
                covered[:] = np.nan
            seen = np.where(keep, frame.image.astype(dtype), covered)
            rate = f.rate_rad_s[k] if k else None
            v = estimator.update(seen, frame.t_s, height_m=float(f.height_m[k]), rate_rad_s=rate)
        assert v.valid
        found.append((v.vx_m_s, v.vy_m_s, v.vz_m_s, *v.covariance.ravel(), v.n_points))
    assert found[1] == found[0]
    assert found[2] == found[0]


def test_a_picture_without_pixels_that_count_has_no_velocity() -> None:
    f = synthetic.flight(frames=2, seed=1)
    estimator = rsflow.VelocityEstimator(f.camera, height_m=0.2, mask=np.zeros(SHAPE, bool))
    estimator.update(f.images[0], 0.0)
    v = estimator.update(f.images[1], 0.1)
    assert v.status.name == "NO_TEXTURE"
    assert np.isnan(v.vx_m_s)


def test_a_mask_that_does_not_fit_is_told() -> None:
    camera = synthetic.flight(frames=1).camera
    with pytest.raises(ShapeError, match=r"mask: got shape \(10, 20\), expected that of the camera's pictures, \(144"):
        rsflow.VelocityEstimator(camera, mask=np.ones((10, 20), bool))
    for wrong in (np.ones(SHAPE), np.ones(SHAPE, np.uint8), "mask.png", [[True]]):
        for make in (lambda mask: rsflow.VelocityEstimator(camera, mask=mask), rsflow.MotionSegmenter,
                     rsflow.PointTracker):  # fmt: skip
            with pytest.raises(DTypeError, match=r"mask: got .*, expected a bool array"):
                make(mask=wrong)
    with pytest.raises(DTypeError, match=r"True where to measure; of a picture of numbers mask != 0$"):
        rsflow.PointTracker(mask=np.full(SHAPE, 255, np.uint8))
    for stream in (rsflow.MotionSegmenter(mask=np.ones((9, 9), bool)), rsflow.PointTracker(mask=np.ones((9, 9), bool))):
        with pytest.raises(ShapeError, match=r"mask: got shape \(9, 9\), expected that of the frames, \(144, 176\)"):
            stream.update(np.zeros(SHAPE, np.uint8))


def test_the_callers_array_may_change_afterwards() -> None:
    keep = overlay_mask("middle", 0.3)
    frames = still_scene(3)
    streams = [rsflow.PointTracker(mask=keep), rsflow.PointTracker(mask=keep.copy())]
    segmenters = [rsflow.MotionSegmenter(mask=keep), rsflow.MotionSegmenter(mask=keep.copy())]
    keep[:] = False
    for frame in frames:
        found = [stream.update(frame) for stream in streams]
        same_arrays(*found, ("points", "status"))
        same_arrays(*(segmenter.update(frame) for segmenter in segmenters), ("moving", "residual", "mask"))
    assert found[0].valid.any()


# --- points ---------------------------------------------------------------------------------------------------------


def test_a_tracker_leaves_out_what_its_mask_and_the_frames_mask_leave_out() -> None:
    keep, later = overlay_mask("below", 0.3), overlay_mask("middle", 0.2)
    f = synthetic.flight(frames=4, velocity_m_s=(0.05, 0.02, 0.0), seed=2)
    fixed, each = rsflow.PointTracker(mask=keep), rsflow.PointTracker()
    for k, frame in enumerate(f):
        seen = np.where(keep, frame.image, overlay())
        with_mask = fixed.update(seen, mask=later if k == 3 else None)
        by_hand = each.update(seen, mask=keep & later if k == 3 else keep)
        same_arrays(with_mask, by_hand, ("points", "status", "covariance", "ids"))
        at = np.round(with_mask.points[with_mask.valid | (with_mask.status == PointStatus.NEW)]).astype(int)
        assert (keep & later if k == 3 else keep)[at[:, 1], at[:, 0]].all()
    assert with_mask.valid.sum() > 20


# --- what moves -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("camera_motion", ["static", "moving"])
@pytest.mark.parametrize("kind", ["corner", *KINDS])
def test_a_blinking_clock_that_is_masked_does_not_move(kind: str, camera_motion: str) -> None:
    keep = np.ones(SHAPE, bool)
    if kind == "corner":
        keep[6:34, 80:164] = False
    else:
        keep = overlay_mask(kind, 0.4)
    masked = rsflow.MotionSegmenter(camera_motion=camera_motion, mask=keep)
    plain = rsflow.MotionSegmenter(camera_motion=camera_motion)
    moving = 0
    for k, frame in enumerate(still_scene(8)):
        seen = np.where(keep, frame, blinking(k))
        result = masked.update(seen)
        assert not result.moving.any()
        assert result.objects == ()
        assert not result.labels.any()
        assert np.isnan(result.residual[~keep]).all()
        assert np.isnan(result.background[~keep]).all()
        np.testing.assert_array_equal(result.mask, keep)
        np.testing.assert_array_equal(result.static_view()[..., 0][~keep], seen[~keep])
        moving = max(moving, int(plain.update(seen).moving.sum()))
    assert result.valid
    if camera_motion == "static":
        assert np.isfinite(result.background[keep]).all()
    assert np.nanmedian(result.residual) < 0.1
    if kind == "corner":
        # Without the mask the clock is what moves.
        assert moving > 0.5 * np.count_nonzero(~keep)


def test_a_thing_beside_the_overlay_is_found_and_ends_at_it() -> None:
    keep = overlay_mask("around", 0.3)
    flight = synthetic.flight_with_object(frames=8)
    segmenter, plain = rsflow.MotionSegmenter(mask=keep), rsflow.MotionSegmenter()
    scores: dict[bool, list[float]] = {True: [], False: []}
    for k, frame in enumerate(flight):
        seen = np.where(keep, frame.image, blinking(k))
        for masked, result in ((True, segmenter.update(seen)), (False, plain.update(frame.image))):
            if masked:
                assert not result.moving[~keep].any()
                assert not result.labels[~keep].any()
            truth = (flight.masks[k] > 0) & keep
            both = result.moving & keep
            scores[masked].append(np.count_nonzero(both & truth) / np.count_nonzero(both | truth))
    # As well as without an overlay.
    assert np.mean(scores[True][3:]) > np.mean(scores[False][3:]) - 0.05
    assert np.mean(scores[True][3:]) > 0.6


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("camera_motion", ["static", "moving"])
def test_segmentation_does_not_depend_on_what_the_mask_leaves_out(camera_motion: str, dtype: type) -> None:
    keep = overlay_mask("letters", 0.2)
    flight = synthetic.flight_with_object(frames=6)
    found: list[list[rsflow.MotionSegmentation]] = []
    for number in range(3):
        rng = np.random.default_rng(number)
        segmenter = rsflow.MotionSegmenter(camera_motion=camera_motion, mask=keep)
        results = []
        for frame in flight:
            covered = rng.integers(0, 256, SHAPE).astype(dtype)
            if dtype is np.float32 and number == 2:
                covered[:] = np.nan
            results.append(segmenter.update(np.where(keep, frame.image.astype(dtype), covered)))
        found.append(results)
    assert any(result.moving.any() for result in found[0]) or camera_motion == "static"
    for results in found[1:]:
        for one, other in zip(results, found[0], strict=True):
            same_arrays(one, other, ("moving", "residual", "labels", "background", "camera_motion"))
            assert repr(one.objects) == repr(other.objects)


def test_filling_takes_the_nearest_pixel_that_counts() -> None:
    rng = np.random.default_rng(1)
    for keep in (rng.random((23, 31)) < 0.05, np.ones((5, 6), bool), np.zeros((5, 6), bool), rng.random((1, 9)) < 0.5):
        picture = rng.random(keep.shape).astype(np.float32)
        filled = picture.copy()
        FixedMask(keep).fill(filled)
        np.testing.assert_array_equal(filled[keep], picture[keep])
        if not keep.any():
            assert (filled == 0).all()
            continue
        rows, columns = np.nonzero(keep)
        for y, x in zip(*np.nonzero(~keep), strict=True):
            apart = np.hypot(rows - y, columns - x)
            # OpenCV's distance is of steps of 1, 1.4 and 2.2 pixels.
            near = apart <= apart.min() * 1.05 + 1e-6
            assert filled[y, x] in picture[rows[near], columns[near]]


# --- the commands and the main job ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Pictures of a flight under an overlay that covers 46 %, its camera, and the mask."""
    folder = tmp_path_factory.mktemp("overlay")
    (folder / "pictures").mkdir()
    keep = overlay_mask("letters", 0.46)
    flight = synthetic.flight_with_object(frames=26, height_m=0.2, velocity_m_s=(0.04, -0.015, 0.0), seed=3)
    for k, image in enumerate(flight.images):
        cv2.imwrite(str(folder / "pictures" / f"{k:03d}.png"), np.where(keep, image, overlay()))
    flight.camera.save(folder / "camera.json")
    # Dark blue is not black.
    colour = np.zeros((*SHAPE, 3), np.uint8)
    colour[keep] = (3, 0, 0)
    cv2.imwrite(str(folder / "mask.png"), colour)
    cv2.imwrite(str(folder / "small.png"), np.full((20, 30), 255, np.uint8))
    (folder / "text.png").write_text("no picture")
    return folder


@pytest.fixture
def here(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(made)
    return made


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def column(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([float(row[name]) for row in rows[1:]])


def test_a_mask_file_is_what_is_not_black(here: Path) -> None:
    np.testing.assert_array_equal(read_mask("mask.png"), overlay_mask("letters", 0.46))
    with_alpha = np.zeros((4, 5, 4), np.uint8)
    with_alpha[..., 3] = 255
    with_alpha[1, 2, 1] = 1
    cv2.imwrite("alpha.png", with_alpha)
    assert np.argwhere(read_mask("alpha.png")).tolist() == [[1, 2]]
    with pytest.raises(CaptureError, match=r"text\.png"):
        read_mask("text.png")


METRIC = ["--camera", "camera.json", "--height", "0.2", "--height-std", "0"]
COMMANDS = {
    "velocity": ["velocity", "pictures", "--rate", "30", *METRIC],
    "track": ["track", "pictures", "--no-video"],
    "segment": ["segment", "pictures"],
    "extract": ["extract", "pictures", "--no-videos", "-q"],
    "batch": ["batch", "pictures", "--no-videos", "-q", "--jobs", "1"],
    "live": ["live", "pictures"],
    "flow": ["flow", "pictures"],
    "flow of a pair": ["flow", "pictures/000.png", "pictures/001.png"],
    "shift": ["shift", "pictures/000.png", "pictures/001.png"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_a_mask_file_that_does_not_fit_is_one_line(
    here: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if command in ("live", "shift") else ["-o", str(tmp_path / "out.flo" if "pair" in command else tmp_path)]
    for name, said in (
        ("small.png", "small.png: got 30 x 20 pixels, expected those of the "),
        ("text.png", "text.png: cannot be decoded as a picture"),
        ("none.png", "none.png: no such file or folder"),
    ):
        assert cli.main([*COMMANDS[command], *out, "--mask", name]) == 1
        printed = capsys.readouterr()
        told = printed.out if command == "batch" else printed.err
        if command == "batch":
            continue
        assert said in told
        assert told.count("\n") == 1
        assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == []


def test_the_velocity_command_leaves_the_mask_out(here: Path, tmp_path: Path) -> None:
    arguments = ["velocity", "pictures", "--rate", "30", *METRIC]
    assert cli.main([*arguments, "--mask", "mask.png", "-o", str(tmp_path / "with")]) == 0
    assert cli.main([*arguments, "-o", str(tmp_path / "without")]) == 0
    speed = {name: column(rows_of(tmp_path / name / "velocity.csv"), "vx_m_s") for name in ("with", "without")}
    assert np.abs(speed["with"] - 0.04).max() < 0.002
    assert np.nanmedian(np.abs(speed["without"] - 0.04)) > 0.02
    # Another mask is another run.
    cv2.imwrite("other.png", np.full(SHAPE, 255, np.uint8))
    assert cli.main([*arguments, "--mask", "other.png", "-o", str(tmp_path / "with")]) == 1


def test_the_track_command_leaves_the_mask_out(here: Path, tmp_path: Path) -> None:
    keep = read_mask("mask.png")
    assert cli.main(["track", "pictures", "--no-video", "--mask", "mask.png", "-o", str(tmp_path)]) == 0
    rows = [row for row in rows_of(tmp_path / "tracks.csv") if row["status"] in ("tracked", "new")]
    at = np.array([[float(row["y_px"]), float(row["x_px"])] for row in rows]).round().astype(int)
    assert len(at) > 300
    assert keep[at[:, 0], at[:, 1]].all()
    steps = [float(row["dx_px"]) for row in rows if row["status"] == "tracked"]
    assert np.median(steps) == pytest.approx(-1.2, abs=0.05)


def test_the_segment_command_leaves_the_mask_out(
    here: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keep = read_mask("mask.png")
    arguments = ["segment", "pictures", "--masks", "--json", "--mask", "mask.png", "-o", str(tmp_path)]
    assert cli.main(arguments) == 0
    moving = np.array([read_mask(path) for path in sorted((tmp_path / "masks").glob("*.png"))])
    assert moving.any()
    assert not moving[:, ~keep].any()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[-1]["moving_share"] == pytest.approx(moving[-1].sum() / keep.sum())


def test_live_readings_leave_the_mask_out(here: Path) -> None:
    keep = read_mask("mask.png")
    roi = (8, 8, 152, 120)
    images = [frame.image for frame in rsflow.frames("pictures")]
    for mask in (keep, "mask.png"):
        readings = list(rsflow.live.readings(images, roi=roi, mask=mask))
        assert np.median([reading.dx_px for reading in readings]) == pytest.approx(-1.2, abs=0.05)
    assert abs(np.median([reading.dx_px for reading in rsflow.live.readings(images, roi=roi)])) < 0.2


@pytest.mark.parametrize("roi", [None, (8, 8, 152, 120)])
def test_an_extraction_leaves_the_mask_out(here: Path, tmp_path: Path, roi: tuple[int, int, int, int] | None) -> None:
    keep = read_mask("mask.png")
    seen: list[rsflow.extraction.Measured] = []
    options = {"camera": "camera.json", "height_m": 0.2, "height_std_m": 0.0, "frame_rate": 30, "roi": roi}
    done = rsflow.extract("pictures", tmp_path, mask="mask.png", on_frame=seen.append, **options)
    if roi is not None:
        keep = keep[8:128, 8:160]
    motion = rows_of(tmp_path / "motion.csv")
    assert np.abs(column(motion, "dx_px") + 1.2).max() < 0.1
    assert np.abs(column(motion, "flow_median_x_px") + 1.2).max() < 0.1
    assert np.abs(column(motion, "camera_dx_px") + 1.2).max() < 0.1
    assert np.abs(column(rows_of(tmp_path / "velocity.csv"), "vx_m_s") - 0.04).max() < 0.002
    for measured in seen[1:]:
        assert not measured.flow.valid[~keep].any()
        assert np.isnan(measured.flow.uv[~keep]).all()
        assert not measured.segmentation.moving[~keep].any()
        share = np.count_nonzero(measured.flow.valid) / np.count_nonzero(keep)
        assert measured.motion["flow_valid_share"] == pytest.approx(share)
        share = np.count_nonzero(measured.segmentation.moving) / np.count_nonzero(keep)
        assert measured.motion["moving_share"] == pytest.approx(share)
    assert f"{100 * (1 - keep.mean()):.1f} % of the pixels do not count" in "".join(done.summary["notes"])
    assert done.summary["settings"]["mask"] == "mask.png"
    # The overlay is not part of the scene behind it.
    behind = cv2.imread(str(tmp_path / "background.png"), cv2.IMREAD_GRAYSCALE)
    shown = overlay()[: behind.shape[0], : behind.shape[1]] if roi is None else overlay()[8:128, 8:160]
    assert np.mean(np.abs(behind.astype(int) - shown)[~keep] < 3) < 0.1
    # An array is a mask as well, and as good.
    again = rsflow.extract("pictures", tmp_path / "array", mask=read_mask("mask.png"), videos=False, **options)
    assert (again.folder / "motion.csv").read_bytes() == (tmp_path / "motion.csv").read_bytes()


def test_a_run_goes_on_with_the_same_mask_alone(here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("_EVERY_S", 0.0), ("_SHARE", 1e9), ("_GROWTH", 0.0)):
        monkeypatch.setattr(checkpoint, name, value)
    keep = read_mask("mask.png")
    other = keep.copy()
    other[0, 0] ^= True
    cv2.imwrite(str(tmp_path / "m.png"), keep * np.uint8(255))
    options = {"camera": "camera.json", "height_m": 0.2, "frame_rate": 30, "videos": False}

    def press(measured: rsflow.extraction.Measured) -> None:
        if measured.frame.index == 15:
            os.kill(os.getpid(), signal.SIGINT)

    for number, (mask, others) in enumerate(((keep, (other, None, "mask.png")), (tmp_path / "m.png", (None, other)))):
        out = tmp_path / f"out{number}"
        whole = rsflow.extract("pictures", tmp_path / f"whole{number}", mask=mask, **options)
        with pytest.raises(rsflow.ExtractionInterrupted):
            rsflow.extract("pictures", out, mask=mask, on_frame=press, **options)
        for wrong in others:
            with pytest.raises(OptionError, match="other settings"):
                rsflow.extract("pictures", out, mask=wrong, resume=True, **options)
        if number == 1:
            # The file was changed meanwhile.
            cv2.imwrite(str(tmp_path / "m.png"), other * np.uint8(255))
            with pytest.raises(OptionError, match="other settings"):
                rsflow.extract("pictures", out, mask=mask, resume=True, **options)
            cv2.imwrite(str(tmp_path / "m.png"), keep * np.uint8(255))
        rsflow.extract("pictures", out, mask=mask, resume=True, **options)
        for table in ("motion.csv", "objects.csv", "velocity.csv", "trajectory.csv"):
            assert (out / table).read_bytes() == (whole.folder / table).read_bytes(), table


def test_a_batch_takes_a_mask(here: Path, tmp_path: Path) -> None:
    arguments = ["batch", "pictures", "-o", str(tmp_path), "--no-videos", "-q", "--jobs", "1", "--mask"]
    assert cli.main([*arguments, "mask.png"]) == 0
    assert np.abs(column(rows_of(tmp_path / "pictures" / "motion.csv"), "dx_px") + 1.2).max() < 0.1


def test_an_extraction_is_not_written_over_its_mask(here: Path, tmp_path: Path) -> None:
    mask = tmp_path / "background.png"
    mask.write_bytes(Path("mask.png").read_bytes())
    with pytest.raises(OptionError, match=r"cannot write .*background\.png"):
        rsflow.extract("pictures", tmp_path, mask=mask, videos=False)
