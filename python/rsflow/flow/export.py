"""A flow field as a table, and as a labelled array of xarray."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._extras import require

__all__ = ["dataset", "table"]

# What each variable of a dataset is, and in what unit.
_ATTRIBUTES = {
    "u": ("displacement to the right", "px"),
    "v": ("displacement down", "px"),
    "valid": ("whether the pixel was measured", ""),
    "residual": ("root mean square difference after motion and light", "grey levels"),
    "gain": ("gain of the light, next = gain * prev + offset", ""),
    "offset": ("offset of the light", "grey levels"),
    "var_u": ("variance of u", "px2"),
    "var_v": ("variance of v", "px2"),
    "cov_uv": ("covariance of u and v", "px2"),
}


def table(
    uv: NDArray[np.float32],
    valid: NDArray[np.bool_],
    residual: NDArray[np.float32],
    covariance: NDArray[np.float32] | None,
    step: int,
) -> dict[str, NDArray[Any]]:
    """Give the pixels of every `step`-th row and column, from the middle of the first cell, as columns."""
    rows, columns = (np.arange(min(step // 2, max(size - 1, 0)), size, step) for size in valid.shape)
    y, x = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
    found: dict[str, NDArray[Any]] = {
        "x_px": x,
        "y_px": y,
        "dx_px": uv[y, x, 0],
        "dy_px": uv[y, x, 1],
        "residual": residual[y, x],
        "valid": valid[y, x],
    }
    if covariance is not None:
        found |= {f"std_{axis}_px": np.sqrt(covariance[y, x, k, k]) for k, axis in enumerate("xy")}
    return found


def dataset(variables: Mapping[str, NDArray[Any]]) -> Any:
    """Give arrays (height, width) as a dataset with the coordinates y and x in pixels."""
    xarray = require("xarray", extra="xarray", purpose="FlowField.to_xarray")
    height, width = next(iter(variables.values())).shape
    found = {}
    for name, values in variables.items():
        long_name, units = _ATTRIBUTES[name]
        found[name] = (("y", "x"), values, {"long_name": long_name} | ({"units": units} if units else {}))
    axes = {"y": np.arange(height), "x": np.arange(width)}
    coordinates = {name: (name, values, {"units": "px"}) for name, values in axes.items()}
    title = "Motion from prev to next: what was at (x, y) in prev is at (x + u, y + v) in next"
    return xarray.Dataset(found, coordinates, {"title": title})
