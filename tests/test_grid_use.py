"""What is done with a grid: probes, extensometers, files, plots."""

from __future__ import annotations

import csv
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

import rsflow
from rsflow import synthetic

SIZE = (160, 128)


def bent(x, y):
    return 0.01 * x + 2e-4 * (x - 60) ** 2, -0.004 * y + 1.5 + 1e-4 * x * y


@pytest.fixture(scope="module")
def scene():
    return synthetic.speckle_pair(bent, size=SIZE, seed=3)


@pytest.fixture(scope="module")
def grid(scene):
    keep = np.ones(SIZE[::-1], bool)
    keep[:40, :50] = False
    return rsflow.displacement_grid(scene.prev, scene.next, shape="quadratic", mask=keep, scale_m_px=5e-5, dt_s=2e-3)


def test_probes_are_between_the_nodes(scene, grid):
    rng = np.random.default_rng(1)
    points = rng.uniform((60, 50), (140, 110), (50, 2))
    found = grid.at(points)
    wrong = found.displacement - scene.truth(points[:, 0], points[:, 1])
    std = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert np.abs(wrong).max() < 0.03
    assert (abs(wrong) < 2 * std).mean() > 0.85
    assert np.abs(found.gradient - scene.gradient(points[:, 0], points[:, 1])).max() < 0.006
    # At a node it is that node's.
    row, column = 5, 6
    node = grid.at([(grid.x[row, column], grid.y[row, column])])
    assert np.allclose(node.displacement[0], [grid.u[row, column], grid.v[row, column]], atol=1e-6)
    # Beyond the grid, and where nothing was measured, nothing is known.
    far = grid.at([(2.0, 2.0), (1000.0, 20.0), (np.nan, 4.0)])
    assert np.isnan(far.displacement).all()
    assert np.isinf(far.covariance[:, 0, 0]).all()


def test_an_extensometer_has_a_deviation(scene, grid):
    a, b = np.array([60.0, 80.0]), np.array([140.0, 90.0])
    found = grid.extension(a, b)
    ends = np.stack([a, b]) + scene.truth(*np.stack([a, b]).T)
    truth = np.hypot(*(ends[1] - ends[0])) / np.hypot(*(b - a)) - 1
    assert abs(found.strain - truth) < 4 * found.std
    assert 1e-5 < found.std < 5e-4
    assert "over 80.6 px" in repr(found)
    with pytest.raises(rsflow.OptionError, match="b: got"):
        grid.extension(a, a)
    assert np.isnan(grid.extension(a, (2.0, 2.0)).strain)


def test_every_file_says_where_its_axes_point(tmp_path, grid):
    for y_up in (False, True):
        path = tmp_path / "grid.csv"
        grid.save(path, y_up=y_up)
        lines = path.read_text(encoding="utf-8").splitlines()
        assert lines[0].startswith("# x to the right")
        assert ("y up" in lines[0]) == y_up
        assert "5e-05 m a pixel; 0.002 s" in lines[0]
        rows = list(csv.DictReader(lines[1:]))
        assert len(rows) == grid.u.size
        at = int(np.flatnonzero(grid.valid.ravel())[20])
        sign = -1 if y_up else 1
        assert float(rows[at]["v_px"]) == pytest.approx(sign * grid.v.ravel()[at], rel=1e-5)
        place = (SIZE[1] - 1 - grid.y.ravel()[at]) if y_up else grid.y.ravel()[at]
        assert float(rows[at]["y_px"]) == place
        assert float(rows[at]["vx_m_s"]) == pytest.approx(grid.velocity_m_s.reshape(-1, 2)[at, 0], rel=1e-5)
        # What is not valid is not a number.
        lost = [row for row in rows if row["status"] != "measured"]
        assert lost
        assert all(row["u_px"] == "nan" for row in lost)


def test_turned_axes_turn_what_has_a_sign(grid):
    down, up = grid.to_table(), grid.to_table(y_up=True)
    for name, sign in {
        "du_dx": 1,
        "du_dy": -1,
        "dv_dx": -1,
        "dv_dy": 1,
        "cov_uv_px2": -1,
        "u_px": 1,
        "v_px": -1,
    }.items():
        assert np.array_equal(up[name], sign * down[name], equal_nan=True)


def test_openpiv_reads_its_text(tmp_path, grid):
    path = tmp_path / "grid.txt"
    grid.save(path, y_up=True)
    x, y, u, _, flags, mask = np.loadtxt(path).T
    assert path.read_text().startswith("# x\ty\tu\tv\tflags\tmask\n")
    assert np.allclose(x, grid.x.ravel())
    assert np.allclose(y, SIZE[1] - 1 - grid.y.ravel())
    assert np.allclose(u, grid.u.ravel(), equal_nan=True, rtol=1e-5)
    assert np.array_equal(flags == 1, ~grid.valid.ravel())
    assert not mask.any()


def test_parquet_has_the_table(tmp_path, grid):
    parquet = pytest.importorskip("pyarrow.parquet")
    grid.save(tmp_path / "grid.parquet")
    table = parquet.read_table(tmp_path / "grid.parquet")
    assert np.array_equal(table["u_px"].to_numpy(), grid.u.ravel(), equal_nan=True)
    assert b"y down" in table.schema.metadata[b"axes"]


def test_netcdf_has_units(tmp_path, grid):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("scipy")
    grid.save(tmp_path / "grid.nc")
    with xarray.open_dataset(tmp_path / "grid.nc") as data:
        assert data.u.attrs["units"] == "px"
        assert data.attrs["dt_s"] == 2e-3
        assert np.allclose(data.u, grid.u, equal_nan=True)
        assert np.allclose(data.vorticity, grid.vorticity, equal_nan=True)
        assert np.array_equal(data.x, grid.x[0])
        words = data.status.attrs["flag_meanings"].split()
        assert words == [status.word for status in rsflow.GridStatus]
    up = grid.to_xarray(y_up=True)
    assert np.array_equal(up.vorticity, -grid.vorticity, equal_nan=True)


def test_vtk_has_points_and_squares(tmp_path, grid):
    meshio = pytest.importorskip("meshio")
    grid.save(tmp_path / "grid.vtu")
    mesh = meshio.read(tmp_path / "grid.vtu")
    assert len(mesh.points) == grid.u.size
    rows, columns = grid.u.shape
    assert len(mesh.cells_dict["quad"]) == (rows - 1) * (columns - 1)
    assert np.allclose(mesh.point_data["displacement_px"][:, 0], grid.u.ravel(), equal_nan=True)


@pytest.mark.parametrize(
    "what", ["speed", "u", "v", "std", "xx", "yy", "xy", "std_xx", "vorticity", "divergence", "correlation"]
)
def test_quantities_are_drawn(tmp_path, scene, grid, what):
    pytest.importorskip("matplotlib")
    ax = grid.plot(what, picture=scene.prev, path=tmp_path / "plot.svg")
    assert ElementTree.parse(tmp_path / "plot.svg").getroot().tag.endswith("svg")
    assert ax.get_ylim() == (SIZE[1] - 0.5, -0.5)
    assert any(type(part).__name__ == "QuiverKey" for part in ax.get_children())
    bare = grid.plot(what, arrows=False)
    assert not any(type(part).__name__ == "Quiver" for part in bare.get_children())


def test_a_grid_of_nothing_is_written_and_drawn(tmp_path):
    blank = np.zeros((40, 40), np.uint8)
    for frame in (blank, blank[:20]):
        grid = rsflow.displacement_grid(frame, frame)
        grid.save(tmp_path / "grid.csv")
        grid.save(tmp_path / "grid.txt")
        if grid.u.size:
            grid.plot("xx", path=tmp_path / "grid.png")
        assert grid.to_xarray().u.shape == grid.u.shape
        assert np.isnan(grid.at([(20.0, 20.0)]).displacement).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda grid, folder: grid.save(folder / "grid.xls"), "path: got"),
        (lambda grid, folder: grid.plot("depth"), "what: got"),
        (lambda grid, folder: grid.plot(ax=3), "ax: got"),
        (lambda grid, folder: grid.at([(1.0, 2.0, 3.0)]), "points: got"),
        (lambda grid, folder: grid.save(folder / "grid.csv", y_up="yes"), "y_up: got"),
    ],
)
def test_what_does_not_fit_is_told(tmp_path, grid, call, message):
    with pytest.raises(rsflow.RsflowError, match=message):
        call(grid, tmp_path)
