"""`rsflow grid`: two pictures, a sequence, units, formats."""

from __future__ import annotations

import csv
import json

import cv2
import numpy as np
import pytest

from rsflow import synthetic
from rsflow.cli import main


@pytest.fixture
def here(tmp_path, monkeypatch):
    for k in range(4):
        scene = synthetic.speckle_pair(lambda x, y, k=k: (0.01 * k * x, 0.5 * k + 0 * y), size=(128, 96), seed=1)
        cv2.imwrite(str(tmp_path / f"p{k}.png"), scene.next)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_two_pictures_have_a_grid_in_units(here, capsys):
    options = ["--scale", "0.05mm/px", "--dt", "2ms", "--y-up", "--plot", "speed"]
    assert main(["grid", "p0.png", "p1.png", "-o", "out", *options]) == 0
    assert "1 pair, 35 of 35 nodes measured" in capsys.readouterr().out
    assert {path.name for path in (here / "out").iterdir()} == {
        ".rsflow.json",
        "grid_000001.csv",
        "grid_000001.png",
        "grids.csv",
    }
    found = rows(here / "out" / "grid_000001.csv")
    u, v, speed = (np.array([float(row[name]) for row in found]) for name in ("u_px", "v_px", "vx_m_s"))
    assert np.allclose(speed, u * 5e-5 / 2e-3, rtol=1e-5)
    # Half a pixel down the picture.
    assert abs(v + 0.5).max() < 0.02
    (summary,) = rows(here / "out" / "grids.csv")
    assert abs(float(summary["strain_xx"]) - 0.01) < 5e-4
    assert float(summary["v_px"]) == pytest.approx(-0.5, abs=0.01)


@pytest.mark.parametrize(("reference", "strains"), [("first", (0.01, 0.02, 0.03)), ("previous", (0.01, 0.01, 0.01))])
def test_a_sequence_is_compared_with_its_reference(here, capsys, reference, strains):
    assert main(["grid", "p*.png", "-o", "out", "--reference", reference, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["pairs"] == 3
    found = [float(row["strain_xx"]) for row in rows(here / "out" / "grids.csv")]
    assert np.allclose(found, strains, atol=6e-4)
    # The same again is written over, something else is not.
    assert main(["grid", "p*.png", "-o", "out", "--reference", reference]) == 0
    assert main(["grid", "p*.png", "-o", "out", "--step", "20"]) == 1
    assert "other settings" in capsys.readouterr().err


def test_velocities_against_the_first_picture_are_means_since_it(here):
    options = ["--reference", "first", "--dt", "2ms", "--scale", "0.05mm/px"]
    assert main(["grid", "p*.png", "-o", "out", *options]) == 0
    path = here / "out" / "grid_000003.csv"
    assert "; 0.006 s between the frames" in path.read_text(encoding="utf-8").splitlines()[0]
    for row in rows(path):
        assert float(row["vy_m_s"]) == pytest.approx(float(row["v_px"]) * 5e-5 / 6e-3, rel=1e-5)


def test_places_are_followed_over_time(here):
    places = ["--probe", "40,40", "--probe", "60,50", "--line", "30,40,90,40", "--extensometer", "30,60,90,60"]
    options = ["--reference", "first", "--dt", "2s", "--y-up", "--plot", "xx"]
    assert main(["grid", "p*.png", "-o", "out", *places, *options]) == 0
    assert (here / "out" / "probes.png").exists()
    found = rows(here / "out" / "probes.csv")
    gauge = [row for row in found if row["name"] == "extensometer 1"]
    assert [float(row["t_s"]) for row in gauge] == [2.0, 4.0, 6.0]
    assert np.allclose([float(row["extension"]) for row in gauge], [0.01, 0.02, 0.03], atol=1e-3)
    second = [row for row in found if row["name"] == "point 2"]
    assert float(second[0]["y_px"]) == 95 - 50
    assert np.allclose([float(row["v_px"]) for row in second], [-0.5, -1.0, -1.5], atol=0.03)
    # Other places are another result; without any there is no such file.
    assert main(["grid", "p*.png", "-o", "out", "--probe", "40,40", *options]) == 1
    assert main(["grid", "p*.png", "-o", "numbered", "--probe", "40,40", "--plot", "speed"]) == 0
    found = rows(here / "numbered" / "probes.csv")
    assert [(row["grid"], row["t_s"]) for row in found] == [("1", "nan"), ("2", "nan"), ("3", "nan")]
    assert main(["grid", "p*.png", "-o", "rated", "--probe", "40,40", "--rate", "10"]) == 0
    found = rows(here / "rated" / "probes.csv")
    assert np.allclose([float(row["t_s"]) for row in found], [0.1, 0.2, 0.3])
    assert main(["grid", "p*.png", "-o", "bare"]) == 0
    assert not (here / "bare" / "probes.csv").exists()


def test_a_mask_leaves_nodes_out(here):
    mask = np.full((96, 128), 255, np.uint8)
    mask[:, 64:] = 0
    cv2.imwrite("mask.png", mask)
    assert main(["grid", "p0.png", "p1.png", "-o", "out", "--mask", "mask.png"]) == 0
    lost = [row for row in rows(here / "out" / "grid_000001.csv") if float(row["x_px"]) > 85]
    assert lost
    assert all(row["status"] == "low_support" for row in lost)


def test_polygons_say_what_counts(here):
    (here / "corners.json").write_text("[[0.0, 0], [63, 0], [63, 95], [0, 95]]")
    (here / "corners.csv").write_text("x,y\n0,0\n63,0\n63,95\n0,95\n")
    mask = np.zeros((96, 128), np.uint8)
    mask[:, :64] = 255
    cv2.imwrite("mask.png", mask)
    wide = ["--polygon=-20,-20,160,-20,160,160,-20,160"]
    ways = [
        ["--mask", "mask.png"],
        ["--polygon", "0,0, 63,0, 63,95, 0,95"],
        ["--polygon", "corners.json"],
        ["--polygon", "corners.csv"],
        ["--polygon", "0,0,63,0,63,50,0,50", "--polygon", "0,45,63,45,63,95,0,95"],
        [*wide, "--mask", "mask.png"],
    ]
    found = []
    for k, way in enumerate(ways):
        assert main(["grid", "p0.png", "p1.png", "-o", f"out{k}", *way]) == 0
        found.append((here / f"out{k}" / "grid_000001.csv").read_text(encoding="utf-8"))
    assert "low_support" in found[0]
    assert "measured" in found[0]
    assert len(set(found)) == 1
    # Other corners are another result.
    (here / "corners.csv").write_text("0,0\n40,0\n40,95\n0,95\n")
    assert main(["grid", "p0.png", "p1.png", "-o", "out3", "--polygon", "corners.csv"]) == 1


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ("1,2,3", "polygon: got '1,2,3'"),
        ("1,2,3,4", "polygon: got 2 corners"),
        ("1,2,3,4,5,a", "expected x0,y0"),
        ("1,2,3,4,5,nan", "expected finite corners"),
        ("1,2,3,4,5,1e6", "within 100000 pixels"),
        ("500,500,600,500,600,600", "expected some within the frames, 128 x 96"),
        ("none.json", "none.json: cannot be read"),
        ("bad.json", "polygon: got 'bad.json'"),
        ("bad.csv", "polygon: got 'bad.csv'"),
        ("p0.csv", "cannot be read"),
    ],
)
def test_a_polygon_that_is_none_is_told(here, capsys, corners, message):
    (here / "bad.json").write_text('{"x": 1}')
    (here / "bad.csv").write_text("x,y\n1,2\n3,4,5\n6,7\n")
    (here / "p0.csv").write_bytes((here / "p0.png").read_bytes())
    assert main(["grid", "p0.png", "p1.png", "-o", "out", "--polygon", corners]) == 1
    assert message in capsys.readouterr().err
    assert not (here / "out" / "grids.csv").exists()


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        (["p0.png"], 1, "expected at least two"),
        (["p0.png", "p1.png", "p2.png"], 2, "got 3 sources"),
        (["p0.png", "p1.png", "--scale", "5"], 2, "got '5', expected a length a pixel"),
        (["p0.png", "p1.png", "--dt", "-1ms"], 2, "expected"),
        (["p0.png", "p1.png", "--window", "5"], 1, "--window: got 5"),
        (["p0.png", "p1.png", "--probe", "1,2,3"], 2, "expected 2 numbers in pixels"),
        (["p0.png", "p1.png", "--line", "1,2,1,2"], 2, "expected ends at different places"),
        (["p0.png", "p1.png", "--extensometer", "1,2,x,4"], 2, "expected 4 numbers in pixels"),
        (["p0.png", "p1.png", "--plot", "depth"], 2, "got 'depth', expected"),
        (["p0.png", "p1.png", "--window", "97"], 1, "--window: got 97 pixels, expected windows that fit into the"),
        (["p0.png", "p1.png", "--probe", "128,5"], 1, "--probe: got (128, 5), expected a place within the frames, 128"),
        (["p0.png", "p1.png", "--line", "5,5,9,96"], 1, "--line: got (9, 96), expected a place within"),
        (["p0.png", "p1.png", "--extensometer", "5,-1,9,9"], 1, "--extensometer: got (5, -1), expected a place"),
    ],
)
def test_what_does_not_fit_is_one_line(here, capsys, line, code, message):
    assert main(["grid", *line, "-o", "out"]) == code
    assert message in capsys.readouterr().err
    assert not (here / "out" / "grids.csv").exists()


def test_what_was_not_measured_is_told_with_its_reason(here, capsys):
    cv2.imwrite(str(here / "blank.png"), np.full((96, 128), 90, np.uint8))
    assert main(["grid", "blank.png", "blank.png", "-o", "out", "--dt", "2ms"]) == 0
    told = capsys.readouterr().out
    assert "0 of 35 nodes measured\n  35 low_texture: " in told
    (summary,) = rows(here / "out" / "grids.csv")
    assert float(summary["t_s"]) == 0.002
