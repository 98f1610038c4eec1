"""Boards to be printed: drawn, read back, measured in millimetres, found and calibrated with."""

from __future__ import annotations

import re
import shlex
import struct
import sys
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pypdfium2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rsflow
from calibration_helpers import TRUTH, poses, rays
from rsflow.calibration import Board, find_corners, print_board
from rsflow.cli import main

# What printers leave white, and the white around a board in squares that is promised.
EDGE_MM, QUIET = 6.35, 0.375
PAGES = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "Letter": (215.9, 279.4)}


def page_of(path: Path, dots_per_mm: float) -> np.ndarray:
    """Render the only page of a PDF, in grey."""
    with pypdfium2.PdfDocument(path) as document:
        assert len(document) == 1
        picture = document[0].render(scale=dots_per_mm * 25.4 / 72, grayscale=True).to_numpy()
    return np.ascontiguousarray(picture.reshape(picture.shape[:2]))


def text_of(path: Path) -> str:
    with pypdfium2.PdfDocument(path) as document:
        return document[0].get_textpage().get_text_bounded()


def dots_per_mm_of(png: Path) -> float:
    data = png.read_bytes()
    x, y, unit = struct.unpack(">IIB", data[data.index(b"pHYs") + 4 :][:9])
    assert (x, unit) == (y, 1)
    return x / 1000


def grid_of(points: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray, float]:
    """Fit the board's corners in metres to points in millimetres: both axes a square, and the largest distance left."""
    flat = board.points()[:, :2].astype(float) / board.square_size_m
    design = np.column_stack([flat, np.ones(len(flat))])
    solution = np.linalg.lstsq(design, points, rcond=None)[0]
    return solution[0], solution[1], float(np.abs(design @ solution - points).max())


def expect_squares(points_mm: np.ndarray, board: Board) -> None:
    along, across, left = grid_of(points_mm, board)
    side = 1000 * board.square_size_m
    assert abs(np.linalg.norm(along) / side - 1) < 1e-3
    assert abs(np.linalg.norm(across) / side - 1) < 1e-3
    assert abs(along @ across) < 1e-3 * side**2
    assert left < 0.03


CASES = [("A4", (9, 6), 0.025), ("Letter", (9, 6), 0.025), ("A3", (6, 9), 0.036), ("A4", (5, 4), 0.012)]


@pytest.mark.parametrize(("page", "size", "square"), CASES)
def test_squares_of_a_pdf_have_their_size(tmp_path, page, size, square):
    lines = print_board(tmp_path / "board.pdf", board=size, square_size_m=square, page=page)
    picture = page_of(tmp_path / "board.pdf", 8.0)
    assert sorted(np.array(picture.shape) / 8.0) == pytest.approx(PAGES[page], abs=0.2)
    board = Board(size, square)
    expect_squares(find_corners(picture, board).points / 8.0, board)
    text = text_of(tmp_path / "board.pdf")
    for line in lines:
        assert line in " ".join(text.split())


@pytest.mark.parametrize(("page", "size", "square"), CASES)
def test_squares_of_a_png_have_their_size(tmp_path, page, size, square):
    print_board(tmp_path / "board.png", board=size, square_size_m=square, page=page)
    picture = cv2.imread(str(tmp_path / "board.png"), cv2.IMREAD_GRAYSCALE)
    board = Board(size, square)
    expect_squares(find_corners(picture, board).points / dots_per_mm_of(tmp_path / "board.png"), board)


def test_squares_of_an_svg_have_their_size(tmp_path):
    print_board(tmp_path / "board.svg", board=(9, 6), square_size_m=0.025)
    text = (tmp_path / "board.svg").read_text()
    size = [float(value) * 25.4 / 72 for value in re.search(r'width="([\d.]+)pt" height="([\d.]+)pt"', text).groups()]
    assert size == pytest.approx((297.0, 210.0), rel=1e-6)
    # The board is the shape of 35 squares; the picture's unit is a point.
    (shape,) = (path for path in re.findall(r' d="(M[^"]+)"', text) if path.count("M") == 35)
    corners = numbers(shape) * 25.4 / 72
    assert np.ptp(corners, axis=0) == pytest.approx((250.0, 175.0), rel=1e-6)
    sides = np.unique(np.diff(np.unique(corners[:, 0].round(3))).round(2))
    assert sides.tolist() == [25.0]


def numbers(path: str) -> np.ndarray:
    return np.array(re.findall(r"-?\d+\.?\d*", path), float).reshape(-1, 2)


@pytest.mark.parametrize("legacy", [False, True])
def test_corners_and_markers_of_a_charuco_board_are_where_calibrate_expects_them(tmp_path, legacy):
    options = {"pattern": "charuco", "marker_size_m": 0.022, "dictionary": "DICT_5X5_50", "legacy_pattern": legacy}
    print_board(tmp_path / "board.pdf", board=(8, 6), square_size_m=0.028, **options)
    picture = page_of(tmp_path / "board.pdf", 8.0)
    board = Board((8, 6), 0.028, **options)
    found = find_corners(picture, board)
    assert found.ids.tolist() == list(range(board.corners))
    expect_squares(found.points / 8.0, board)
    other = Board((8, 6), 0.028, **options | {"legacy_pattern": not legacy})
    assert find_corners(picture, other) is None


@settings(max_examples=25, deadline=None)
@given(
    page=st.sampled_from(sorted(PAGES)),
    size=st.tuples(st.integers(3, 20), st.integers(3, 20)),
    share=st.floats(0.1, 1.0),
)
def test_any_board_fits_its_page_with_white_around_it(tmp_path_factory, page, size, share):
    path = tmp_path_factory.mktemp("any") / "board.pdf"
    largest = largest_that_fits(path, page, size)
    square_mm = max(0.5, 1000 * share * largest)
    print_board(path, board=size, square_size_m=square_mm / 1000, page=page)
    scale = 4.0
    dark = page_of(path, scale) < 200
    rows, columns = np.flatnonzero(dark.any(axis=1)) / scale, np.flatnonzero(dark.any(axis=0)) / scale
    height, width = np.array(dark.shape) / scale
    # A dot of rounding.
    edge = EDGE_MM - 1 / scale
    assert min(rows[0], columns[0], height - rows[-1], width - columns[-1]) > edge
    (left, top), (right, bottom) = board_within(dark, scale, size, square_mm)
    quiet = max(QUIET * square_mm, EDGE_MM) - 1 / scale
    around = dark.copy()
    around[int(top * scale) : int(bottom * scale) + 2, int(left * scale) : int(right * scale) + 2] = False
    low, high = np.maximum(((top, left) - np.array(quiet)) * scale, 0), (np.array((bottom, right)) + quiet) * scale
    assert not around[int(low[0]) : int(high[0]), int(low[1]) : int(high[1])].any()


def board_within(dark, scale, size, square_mm):
    """Upper left and lower right corner of the board: it is centred in what the strip leaves, which shows no ruler."""
    middle = np.array(dark.shape)[::-1] / scale / 2
    extent = (np.array(size) + 1) * square_mm / 2
    strip = (15.5 + 6.35) / 2
    # The strip is to the right or below: of the two, where the board's edge is.
    for shift in ((strip, 0), (0, strip)):
        low, high = middle - shift - extent, middle - shift + extent
        inside = dark[round(low[1] * scale) + 1 : round(high[1] * scale) - 1, round(low[0] * scale) + 1]
        if inside.size and low.min() > 0 and 0.3 < inside.mean() < 0.7:
            return low, high
    raise AssertionError(f"no board of {size} on the page")


def largest_that_fits(path, page, size) -> float:
    with pytest.raises(rsflow.OptionError, match="expected at most") as refused:
        print_board(path, board=size, square_size_m=0.2, page=page)
    assert not path.exists()
    return float(re.search(r"at most ([\d.]+) for", str(refused.value))[1])


@pytest.mark.parametrize("page", sorted(PAGES))
@pytest.mark.parametrize("size", [(9, 6), (4, 13), (7, 7)])
def test_the_largest_square_that_is_named_fits_and_no_larger_one(tmp_path, page, size):
    path = tmp_path / "board.svg"
    largest = largest_that_fits(path, page, size)
    print_board(path, board=size, square_size_m=largest, page=page)
    assert path.exists()
    with pytest.raises(rsflow.OptionError, match=f"got {largest + 2e-4:g}, expected at most {largest:g} for"):
        print_board(path, board=size, square_size_m=largest + 2e-4, page=page)


def test_a_page_that_takes_the_board_is_named(tmp_path):
    with pytest.raises(rsflow.OptionError, match=r'expected at most 0\.025\d for 10 x 7 squares on A4; page="A3"'):
        print_board(tmp_path / "board.pdf", board=(9, 6), square_size_m=0.03)
    with pytest.raises(rsflow.OptionError, match=r"on A4$"):
        print_board(tmp_path / "board.pdf", board=(9, 6), square_size_m=0.1)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"page": "a4"}, 'page: got "a4", expected "A4", "A3" or "Letter"'),
        ({"board": (2, 6)}, r"board: got \(2, 6\), expected"),
        ({"square_size_m": 0.0}, "square_size_m: got 0.0, expected"),
        ({"square_size_m": 25}, "square_size_m: got 25, expected at most 0.025"),
        (
            {"pattern": "charuco", "board": (20, 20), "square_size_m": 0.008},
            "dictionary: got DICT_4X4_50 of 50 markers, expected one of at least 200",
        ),
    ],
)
def test_what_cannot_be_printed_is_refused(tmp_path, options, words):
    with pytest.raises(rsflow.OptionError, match=words):
        print_board(tmp_path / "board.pdf", **options)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(rsflow.OptionError, match="expected a name that ends in"):
        print_board(tmp_path / "board.jpg")


def test_settings_of_matplotlib_do_not_scale_the_page(tmp_path):
    print_board(tmp_path / "plain.pdf")
    theirs = {"savefig.bbox": "tight", "figure.dpi": 37, "font.size": 30, "path.snap": True, "axes.facecolor": "0.5"}
    with matplotlib.rc_context(theirs):
        print_board(tmp_path / "theirs.pdf")
        assert matplotlib.rcParams["savefig.bbox"] == "tight"
    assert (tmp_path / "theirs.pdf").read_bytes() == (tmp_path / "plain.pdf").read_bytes()


def test_without_matplotlib_the_extra_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib.style", None)
    assert main(["calibrate", "--print-board", str(tmp_path / "board.pdf")]) == 1
    assert "pip install 'rsflow-motion[plot]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def views_of(page: np.ndarray, dots_per_mm: float, board: Board) -> list[np.ndarray]:
    """Pictures that the known camera takes of a printed page on a dark table."""
    corners = find_corners(page, board).points.reshape(board.size[1], board.size[0], 2)
    shown = 30 + page.astype(np.float32) * (175 / 255)
    result = []
    for number, (turn, middle) in enumerate(poses(12)):
        rotation = cv2.Rodrigues(turn)[0]
        # From the page in dots, about the board's middle, to the camera in metres.
        scale = 1e-3 / dots_per_mm
        centre = corners.reshape(-1, 2).mean(axis=0)
        plane = np.column_stack([rotation[:, 0] * scale, rotation[:, 1] * scale, middle])
        plane[:, 2] -= plane[:, :2] @ centre
        where = cv2.perspectiveTransform(rays(), np.linalg.inv(plane)).astype(np.float32)
        fine = cv2.remap(shown, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=60)
        image = cv2.GaussianBlur(cv2.resize(fine, TRUTH.size, interpolation=cv2.INTER_AREA), (0, 0), 0.6)
        image += np.random.default_rng(number).normal(0, 2, image.shape)
        result.append(np.clip(np.round(image), 0, 255).astype(np.uint8))
    return result


def test_a_camera_is_calibrated_with_the_printed_board_by_the_command_that_stands_on_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = ["calibrate", "--print-board", "board.pdf", "--board", "8x6", "--square", "0.025"]
    assert main(arguments) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[-1] == "wrote board.pdf"
    command = next(line for line in out if line.startswith("rsflow calibrate "))
    for number, view in enumerate(views_of(page_of(Path("board.pdf"), 4.0), 4.0, Board((8, 6), 0.025))):
        cv2.imwrite(f"view{number:02}.png", view)
    assert main(shlex.split(command.replace("PICTURES", "'view*.png'"))[1:]) == 0
    camera = rsflow.Camera.load("camera.yaml")
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(camera, name) - getattr(TRUTH, name)) < 4 * camera.std[name]
    assert camera.std["fx"] < 0.005 * camera.fx


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["board", "--print-board", "b.pdf"], "argument SOURCE: not allowed with argument --print-board"),
        (["--print-board", "b.pdf", "-o", "c.yaml"], "argument -o/--output: not allowed"),
        (["pictures", "--board", "9x6", "--square", "0.025", "--page", "A3"], "--page: not allowed without"),
        (["--board", "9x6"], "the following arguments are required: SOURCE, --square"),
        (["--print-board", "b.pdf", "--page", "B5"], "got 'B5', expected"),
    ],
)
def test_arguments_that_do_not_go_together_are_wrong_usage(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *arguments]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_command_prints_json(tmp_path, capsys):
    path = tmp_path / "board.svg"
    assert main(["calibrate", "--print-board", str(path), "--page", "Letter", "--json"]) == 0
    import json

    told = json.loads(capsys.readouterr().out)
    assert told["file"] == str(path)
    assert "--board 9x6 --square 0.025" in told["instructions"][2]
