"""Grids in files: tables, OpenPIV's text, NetCDF through xarray, VTK through meshio."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._extras import require
from ..errors import MissingExtraError
from ..io.atomic import writing
from .data import GridData, GridStatus

__all__ = ["SUFFIXES", "axes_words", "dataset", "save"]

SUFFIXES = (".csv", ".parquet", ".txt", ".nc", ".vtu")

# What each variable of a dataset is, and in what unit.
_ATTRIBUTES = {
    "u": ("displacement along x", "px"),
    "v": ("displacement along y", "px"),
    "std_u": ("standard deviation of u", "px"),
    "std_v": ("standard deviation of v", "px"),
    "cov_uv": ("covariance of u and v", "px2"),
    "du_dx": ("derivative of u along x", "1"),
    "du_dy": ("derivative of u along y", "1"),
    "dv_dx": ("derivative of v along x", "1"),
    "dv_dy": ("derivative of v along y", "1"),
    "vorticity": ("dv/dx - du/dy of one interval", "1"),
    "divergence": ("du/dx + dv/dy of one interval", "1"),
    "residual": ("root mean square difference after motion and light", "grey levels"),
    "correlation": ("correlation of both windows, motion and light taken out", "1"),
    "gain": ("gain of the light, next = gain * prev + offset", "1"),
    "offset": ("offset of the light", "grey levels"),
    "status": ("0 where measured, else why not: see flag_meanings", "1"),
}


def axes_words(grid: GridData, *, y_up: bool) -> str:
    """Say which way the axes point, in what unit."""
    up = "up from the centre of the lowest row" if y_up else "down from the centre of the highest row"
    text = f"x to the right from the centre of the leftmost column, y {up}; u along x, v along y; pixels"
    text += f"; windows of {grid.window_size} px every {grid.step} px, which is the gauge length of gradients"
    if grid.scale_m_px is not None:
        text += f"; {grid.scale_m_px:g} m a pixel"
    if grid.dt_s is not None:
        text += f"; {grid.dt_s:g} s between the frames"
    return text


def save(grid: GridData, path: Path, *, y_up: bool) -> None:
    """Write a grid in the format that the suffix says."""
    table = grid.to_table(y_up=y_up)
    kind = path.suffix.lower()
    if kind == ".csv":
        with writing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
            file.write(f"# {axes_words(grid, y_up=y_up)}\n")
            writer = csv.writer(file)
            writer.writerow(table)
            writer.writerows(zip(*(_texts(values) for values in table.values()), strict=True))
    elif kind == ".parquet":
        arrow = require("pyarrow", extra="parquet", purpose="writing Parquet")
        parquet = require("pyarrow.parquet", extra="parquet", purpose="writing Parquet")
        rows = arrow.table({name: arrow.array(values) for name, values in table.items()})
        rows = rows.replace_schema_metadata({"axes": axes_words(grid, y_up=y_up)})
        with writing(path) as partial:
            parquet.write_table(rows, partial)
    elif kind == ".txt":
        _openpiv(grid, table, path)
    elif kind == ".nc":
        _netcdf(grid, path, y_up=y_up)
    else:
        _vtk(grid, table, path)


def _openpiv(grid: GridData, table: dict[str, NDArray[Any]], path: Path) -> None:
    """Write x, y, u, v, flags and mask as OpenPIV's `tools.save` does; flag 1 where a node is not valid."""
    flags = (~grid.valid).astype(np.float64).ravel()
    columns = [table[name].astype(np.float64) for name in ("x_px", "y_px", "u_px", "v_px")]
    rows = np.column_stack([*columns, flags, np.zeros(flags.size)])
    with writing(path) as partial, partial.open("w", encoding="utf-8") as file:
        np.savetxt(file, rows, fmt="%.6e", delimiter="\t", header="x\ty\tu\tv\tflags\tmask")


def dataset(grid: GridData, *, y_up: bool) -> Any:
    """Give a grid as a dataset of xarray over y and x."""
    xarray = require("xarray", extra="xarray", purpose="Grid.to_xarray")
    table = grid.to_table(y_up=y_up)
    rows, columns = grid.status.shape
    sign = -1.0 if y_up else 1.0
    values: dict[str, NDArray[Any]] = {
        name.removesuffix("_px").removesuffix("_px2"): column.reshape(rows, columns)
        for name, column in table.items()
        if name not in ("x_px", "y_px", "status") and not name.endswith(("_m", "_m_s"))
    }
    values |= {"vorticity": sign * grid.vorticity, "divergence": grid.divergence, "status": grid.status}
    found: dict[str, tuple[tuple[str, str], NDArray[Any], dict[str, Any]]] = {}
    for name, array in values.items():
        long_name, units = _ATTRIBUTES[name]
        found[name] = (("y", "x"), array, {"long_name": long_name, "units": units})
    words = [member.word for member in GridStatus]
    found["status"][2].update(flag_values=np.arange(len(words), dtype=np.uint8), flag_meanings=" ".join(words))
    x, y = table["x_px"].reshape(rows, columns), table["y_px"].reshape(rows, columns)
    axes = {"y": y[:, 0] if columns else y.ravel(), "x": x[0] if rows else x.ravel()}
    coordinates = {name: (name, array, {"units": "px"}) for name, array in axes.items()}
    attributes: dict[str, Any] = {"title": "Displacement from prev to next", "axes": axes_words(grid, y_up=y_up)}
    attributes |= {"window_size_px": grid.window_size, "step_px": grid.step, "shape_function": grid.shape}
    known = {"scale_m_px": grid.scale_m_px, "dt_s": grid.dt_s}
    attributes |= {name: value for name, value in known.items() if value is not None}
    return xarray.Dataset(found, coordinates, attributes)


def _netcdf(grid: GridData, path: Path, *, y_up: bool) -> None:
    data = dataset(grid, y_up=y_up)
    with writing(path) as partial:
        try:
            data.to_netcdf(partial)
        except (ValueError, ImportError) as error:
            if "netcdf" not in str(error).lower():
                raise
            raise MissingExtraError(
                "writing NetCDF needs netCDF4 or scipy, and neither is installed: pip install 'rsflow-motion[netcdf]'"
            ) from None


def _vtk(grid: GridData, table: dict[str, NDArray[Any]], path: Path) -> None:
    """Write the nodes as points and the squares between them as cells, for ParaView."""
    meshio = require("meshio", extra="vtk", purpose="writing VTK")
    rows, columns = grid.status.shape
    nodes = np.arange(rows * columns).reshape(rows, columns)
    squares = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=-1).reshape(-1, 4)
    flat = np.zeros(rows * columns)
    points = np.column_stack([table["x_px"], table["y_px"], flat]).astype(np.float64)
    data = {"displacement_px": np.column_stack([table["u_px"], table["v_px"], flat]).astype(np.float64)}
    skipped = ("x_px", "y_px", "u_px", "v_px", "status")
    data |= {name: values.astype(np.float64) for name, values in table.items() if name not in skipped}
    data["status"] = grid.status.ravel().astype(np.int32)
    mesh = meshio.Mesh(points, [("quad", squares)], point_data=data)
    with writing(path) as partial:
        mesh.write(partial, file_format="vtu")


def _texts(values: NDArray[Any]) -> list[str]:
    """Write a column as text, to a millionth of what float32 holds."""
    if values.dtype.kind != "f":
        return [str(value) for value in values.tolist()]
    return [f"{value:.7g}" for value in values.tolist()]


def save_path(path: object) -> Path:
    """Take the name of a file to write a grid into."""
    return _checks.file_name("path", path, SUFFIXES)
