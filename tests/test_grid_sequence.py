"""Grids of a sequence: references, masks that are carried along, means, places over time."""

from __future__ import annotations

import csv
import dataclasses
import xml.etree.ElementTree as ElementTree

import cv2
import numpy as np
import pytest

import rsflow
from rsflow import synthetic
from rsflow.grid.carry import carried

SIZE = (160, 128)


@pytest.fixture(scope="module")
def grid():
    scene = synthetic.speckle_pair(lambda x, y: (0.01 * x, 0 * y), size=SIZE, seed=3)
    return rsflow.displacement_grid(scene.prev, scene.next)


def stretched(strain, seed=4):
    return synthetic.speckle_pair(lambda x, y: (strain * (x - 80), -0.3 * strain * (y - 64)), size=SIZE, seed=seed)


def test_a_sequence_against_the_first_frame_takes_new_references():
    sequences = {renew: rsflow.GridSequence(reference="first", renew_below=renew) for renew in (0.0, 1.0)}
    strains, deviations = [0.0, 0.015, 0.03, 0.045], []
    for renew, sequence in sequences.items():
        for strain in strains:
            grid = sequence.update(stretched(strain).next)
        # Always, and never, a new reference; each sees the whole strain.
        assert sequence.renewals == (len(strains) - 2 if renew else 0)
        truth = stretched(strains[-1]).truth(grid.x, grid.y)
        wrong = np.stack([grid.u, grid.v], -1) - truth
        assert grid.valid.mean() > 0.8
        assert abs(wrong)[grid.valid].max() < 0.05
        assert abs(grid.strain().xx[grid.valid].mean() - 0.045) < 1e-3
        deviations.append(np.median(grid.std[grid.valid]))
        assert 0.5 < (abs(wrong) < grid.std)[grid.valid].mean() < 0.9
        assert f"{sequence.renewals} renewals" in repr(sequence)
        sequence.reset()
        assert sequence.update(stretched(0.0).next) is None
    # Each new reference adds its variance to that of a longer step.
    assert 1.05 < deviations[1] / deviations[0] < 2.2


def test_time_and_lens_hold_against_the_first_frame():
    camera = rsflow.Camera(
        fx=150.0, fy=150.0, cx=79.5, cy=63.5, width=160, height=128, distortion=(-0.25, 0.05, 0, 0, 0)
    )
    options = {"scale_m_px": 1e-4, "dt_s": 0.5}
    for renew in (0.0, 1.0):
        plain = rsflow.GridSequence(reference="first", renew_below=renew)
        seen = rsflow.GridSequence(reference="first", renew_below=renew, camera=camera, **options)
        for strain in (0.0, 0.01, 0.02):
            frame = stretched(strain).next
            a, b = plain.update(frame), seen.update(frame)
        # The lens is taken out of the sum, not of each part.
        whole = rsflow.grid.lens.without_distortion(a, camera)
        assert np.array_equal(whole.raw, b.raw)
        assert np.array_equal(whole.joint_covariance, b.joint_covariance)
        assert b.dt_s == 1.0
        assert np.array_equal(b.velocity_m_s[..., 0], b.u.astype(np.float64) * 1e-4, equal_nan=True)


@pytest.mark.parametrize(
    "moves",
    [
        lambda x, y: (7.3 + 0 * x, -4.6 + 0 * y),
        lambda x, y: (0.2 * (x - 80) + 5, -0.1 * (y - 64)),
        lambda x, y: (-0.7 * (x - 80) - 0.9 * (y - 64), 0.9 * (x - 80) - 0.7 * (y - 64)),
        lambda x, y: (3e-3 * (x - 80) ** 2 / 2, 2 * np.sin(x / 25)),
    ],
)
def test_a_mask_is_carried_by_what_was_measured(grid, moves):
    keep = np.zeros(SIZE[::-1], bool)
    keep[40:90, 50:120] = True
    u, v = moves(grid.x.astype(float), grid.y.astype(float))
    valid = np.hypot(grid.x - 80, grid.y - 64) > 10
    status = np.where(valid, 0, 1).astype(np.uint8)
    raw = np.stack([u, v], -1).astype(np.float32)
    found = carried(keep, dataclasses.replace(grid, raw=raw, status=status))
    # Drawn finely forward, each pixel of the new frame is where some of the mask came to.
    x, y = np.meshgrid(np.arange(49.5, 119.5, 0.1), np.arange(39.5, 89.5, 0.1))
    u, v = moves(x, y)
    column, row = np.rint(x + u).astype(int), np.rint(y + v).astype(int)
    inside = (column >= 0) & (column < SIZE[0]) & (row >= 0) & (row < SIZE[1])
    truth = np.zeros_like(keep)
    truth[row[inside], column[inside]] = True
    edge = cv2.dilate(truth.view(np.uint8), np.ones((5, 5))) != cv2.erode(truth.view(np.uint8), np.ones((5, 5)))
    assert np.array_equal(found[~edge], truth[~edge])
    assert (found != truth).mean() < 0.03
    nothing = dataclasses.replace(grid, raw=raw, status=np.ones_like(status))
    assert not carried(keep, nothing).any()


def test_a_new_reference_keeps_the_mask():
    # A specimen that slides and stretches before a background that stands still.
    behind = synthetic.speckle_pair(lambda x, y: (0 * x, 0 * y), size=SIZE, seed=9).next
    first = np.zeros(SIZE[::-1], bool)
    first[30:98, 30:90] = True
    y, x = np.mgrid[: SIZE[1], : SIZE[0]].astype(float)
    sequence = rsflow.GridSequence(reference="first", renew_below=1.0, mask=first)
    for k in range(4):
        motion = lambda x, y, k=k: (4.0 * k + 0.01 * k * (x - 60), 0 * y)  # noqa: E731
        start = (x - 4.0 * k + 0.6 * k) / (1 + 0.01 * k)
        shown = (start >= 29.5) & (start < 89.5) & (y > 29.5) & (y < 97.5)
        specimen = synthetic.speckle_pair(motion, size=SIZE, seed=5).next
        grid = sequence.update(np.where(shown, specimen, behind))
    assert sequence.renewals == 2
    wrong = np.stack([grid.u - motion(grid.x, grid.y)[0], grid.v], -1)[grid.valid]
    assert grid.valid.sum() >= 15
    assert abs(wrong).max() < 0.15
    assert np.sqrt((wrong**2).mean()) < 0.03


def test_a_sequence_of_pairs_has_a_mean_that_fluctuates():
    sequence, found = rsflow.GridSequence(window_size=24, step=12), rsflow.grid.GridStatistics()
    rng = np.random.default_rng(2)
    steps = 1.0 + 0.3 * rng.standard_normal(8)
    places = np.concatenate([[0.0], np.cumsum(steps)])
    for place in places:
        frame = synthetic.particle_pair(lambda x, y, place=place: (place, 0.0), size=(96, 80), seed=6).next
        grid = sequence.update(frame)
        if grid is not None:
            found.add(grid)
    inside = (slice(1, -1), slice(1, -1))
    assert (found.count[inside] == len(steps)).all()
    assert abs(found.mean[inside] - (steps.mean(), 0.0)).max() < 0.02
    fluctuation = found.fluctuation[inside]
    assert abs(fluctuation[..., 0, 0] - steps.var(ddof=1)).max() < 0.02
    assert fluctuation[..., 1, 1].max() < 0.001
    assert (found.noise[inside][..., 0, 0] < 1e-3).all()
    with pytest.raises(rsflow.ShapeError, match="grid: got"):
        found.add(rsflow.displacement_grid(frame, frame))


def test_a_sequence_says_what_does_not_fit():
    with pytest.raises(rsflow.OptionError, match="dt_s: got"):
        rsflow.GridSequence(reference="first", dt_s=-1.0)
    with pytest.raises(rsflow.DTypeError, match="camera: got"):
        rsflow.GridSequence(reference="first", camera=3)
    with pytest.raises(rsflow.OptionError, match="window_size"):
        rsflow.GridSequence(window_size=3)
    sequence = rsflow.GridSequence()
    sequence.update(np.zeros((64, 64), np.uint8))
    with pytest.raises(rsflow.ShapeError, match="frame: got"):
        sequence.update(np.zeros((64, 65), np.uint8))


@pytest.fixture(scope="module")
def probed():
    sequence = rsflow.GridSequence(reference="first")
    probes = rsflow.grid.GridProbes(
        [(60, 50), (2, 2)], lines=[((40, 40), (120, 100))], extensometers=[((40, 64), (120, 64))], spacing=20
    )
    for strain in (0.0, 0.01, 0.02):
        grid = sequence.update(stretched(strain).next)
        if grid is not None:
            probes.add(grid, t_s=100 * strain)
    return probes, grid


def test_probes_lines_and_extensometers_go_over_time(probed, tmp_path):
    probes, grid = probed
    table = probes.to_table()
    # Two points, six places of a line of 100 pixels, an extensometer.
    assert repr(probes) == "GridProbes(8 places, 1 extensometers, 2 grids)"
    assert {len(column) for column in table.values()} == {18}
    assert np.array_equal(np.unique(table["t_s"]), [1.0, 2.0])
    last = {name: column[9:] for name, column in table.items()}
    assert np.allclose(last["along_px"][2:8], [0, 20, 40, 60, 80, 100])
    there = last["name"] == "line 1"
    places = np.stack([last["x_px"], last["y_px"]], -1)[there]
    samples = grid.at(places)
    assert np.array_equal(last["u_px"][there], samples.displacement[:, 0])
    assert np.array_equal(last["std_v_px"][there], np.sqrt(samples.covariance[:, 1, 1]))
    assert np.array_equal(last["strain_yy"][there], samples.gradient[:, 1, 1])
    ways = samples.joint_covariance[:, [3, 4]][:, :, [3, 4]]
    assert np.allclose(last["std_strain_xy"][there] ** 2, ways.sum(axis=(1, 2)) / 4)
    assert np.allclose(last["std_vorticity"][there] ** 2, ways[:, 0, 0] + ways[:, 1, 1] - 2 * ways[:, 0, 1], rtol=1e-6)
    assert np.isnan(last["u_px"][1])
    gauge = grid.extension((40, 64), (120, 64))
    assert (last["extension"][8], last["std_extension"][8]) == (gauge.strain, gauge.std)
    up = probes.to_table(y_up=True)
    turned = {"v_px", "strain_xy", "vorticity"}
    for name in set(table) - {"y_px", "name"}:
        assert np.array_equal(up[name], (-1 if name in turned else 1) * table[name], equal_nan=True)
    assert np.array_equal(up["y_px"], SIZE[1] - 1 - table["y_px"])
    probes.save(tmp_path / "probes.csv", y_up=True)
    lines = (tmp_path / "probes.csv").read_text(encoding="utf-8").splitlines()
    assert "y up" in lines[0]
    rows = list(csv.DictReader(lines[1:]))
    assert float(rows[17]["extension"]) == pytest.approx(gauge.strain, rel=1e-6)
    assert rows[10]["name"] == "point 2"


def test_probes_are_drawn_with_their_deviation(probed, tmp_path):
    pytest.importorskip("matplotlib")
    probes, _ = probed
    ax = probes.plot("xx", path=tmp_path / "probes.svg")
    assert ElementTree.parse(tmp_path / "probes.svg").getroot().tag.endswith("svg")
    curves = {line.get_label(): line.get_ydata() for line in ax.get_lines()}
    assert set(curves) == {"point 1", "point 2", "line 1"}
    assert np.allclose(curves["line 1"], [0.01, 0.02], atol=1e-3)
    assert len(ax.collections) == 3
    (right,) = (other for other in ax.figure.axes if other is not ax)
    assert np.allclose(right.get_lines()[0].get_ydata(), [0.01, 0.02], atol=1e-3)
    alone = rsflow.grid.GridProbes(extensometers=[((40, 64), (120, 64))])
    assert alone.plot().get_ylabel() == "extension"
    assert alone.to_table()["u_px"].size == 0


def test_probes_of_windows_that_shift_have_no_strain():
    frame = synthetic.speckle_pair(lambda x, y: (0 * x, 0 * y), size=(96, 96), seed=1).next
    probes = rsflow.grid.GridProbes([(48, 48)])
    probes.add(rsflow.displacement_grid(frame, frame, shape="translation"))
    table = probes.to_table()
    assert table["std_u_px"][0] < 0.1
    assert np.isnan(table["strain_xx"][0])
    assert np.isnan(table["t_s"][0])
    assert table["grid"][0] == 1
    pytest.importorskip("matplotlib")
    assert probes.plot().get_xlabel() == "grid"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rsflow.grid.GridProbes(), "points: got none"),
        (lambda: rsflow.grid.GridProbes(3), "points: got"),
        (lambda: rsflow.grid.GridProbes(lines=[((1, 2), (1, 2))]), "lines: got"),
        (lambda: rsflow.grid.GridProbes(lines=[((1, 2), (1e9, 2))]), "lines: got"),
        (lambda: rsflow.grid.GridProbes(lines=3), "lines: got"),
        (lambda: rsflow.grid.GridProbes(extensometers=[(1, 2, 3, 4)]), "extensometers: got"),
        (lambda: rsflow.grid.GridProbes([(1, 2)], spacing=0), "spacing: got 0"),
        (lambda: rsflow.grid.GridProbes([(1, 2)]).add(3), "grid: got"),
        (lambda: rsflow.grid.GridProbes([(1, 2)]).plot("std"), "what: got"),
        (lambda: rsflow.grid.GridProbes([(1, 2)]).plot(ax=3), "ax: got"),
        (lambda: rsflow.grid.GridProbes([(1, 2)]).save("a.xls"), "path: got"),
    ],
)
def test_probes_that_do_not_fit_are_told(call, message):
    with pytest.raises(rsflow.RsflowError, match=message):
        call()
