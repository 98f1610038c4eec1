"""Grids as plots of matplotlib: maps of a quantity, with arrows and a key."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._display import displayed
from .._extras import require
from ..errors import DTypeError
from ..io.atomic import writing
from .data import GridData

__all__ = ["QUANTITIES", "Quantity", "plot_grid"]

Quantity = Literal[
    "speed", "u", "v", "std", "xx", "yy", "xy", "std_xx", "std_yy", "std_xy", "vorticity", "divergence", "correlation"
]

QUANTITIES: tuple[str, ...] = get_args(Quantity)

_LABELS = {
    "speed": "displacement (px)",
    "u": "u (px, to the right)",
    "v": "v (px, down)",
    "std": "standard deviation (px)",
    "xx": "small strain xx",
    "yy": "small strain yy",
    "xy": "small strain xy",
    "std_xx": "deviation of strain xx",
    "std_yy": "deviation of strain yy",
    "std_xy": "deviation of strain xy",
    "vorticity": "vorticity dv/dx - du/dy",
    "divergence": "divergence du/dx + dv/dy",
    "correlation": "correlation",
}
# Of either sign, drawn about zero.
_SIGNED = ("u", "v", "xx", "yy", "xy", "vorticity", "divergence")
# Share of the values, from either end, that the colours do not reach for.
_TAIL = 0.01
_WIDTH_IN = 7.0


def plot_grid(
    grid: GridData,
    what: object,
    *,
    picture: NDArray[Any] | None,
    arrows: object,
    ax: Any,
    path: object,
) -> Any:
    """Draw a map of `what` and arrows; see `Grid.plot`."""
    word: str = _checks.choice("what", what, get_args(Quantity))
    with_arrows = _checks.flag("arrows", arrows)
    file = None if path is None else _checks.file_name("path", path, (".png", ".svg", ".pdf"))
    figure = None
    if ax is None:
        figure_module = require("matplotlib.figure", extra="plot", purpose="Grid.plot")
        width, height = grid.size
        figure = figure_module.Figure(
            figsize=(_WIDTH_IN, _WIDTH_IN * max(height, 1) / max(width, 1)), layout="constrained"
        )
        ax = figure.subplots()
    elif not all(hasattr(ax, name) for name in ("pcolormesh", "quiver", "set_aspect")):
        raise _checks.refused("ax", ax, "axes of matplotlib, or None for new ones", DTypeError)
    if picture is not None:
        ax.imshow(displayed(_checks.picture("picture", picture))[..., ::-1])
    values = _values(grid, word)
    _map(ax, grid, values, word, opaque=picture is None)
    if with_arrows and grid.valid.any():
        _arrows(ax, grid)
    width, height = grid.size
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    ax.set_aspect("equal")
    if file is not None:
        _save(ax.figure if figure is None else figure, file)
    return ax


def _save(figure: Any, file: Path) -> None:
    with writing(file) as partial:
        figure.savefig(partial, dpi=150)


def _values(grid: GridData, what: str) -> NDArray[np.float64]:
    if what in ("u", "v", "vorticity", "divergence"):
        return np.asarray(getattr(grid, what), np.float64)
    if what == "speed":
        return np.hypot(grid.u, grid.v).astype(np.float64)
    if what in ("std", "correlation"):
        found = np.sqrt((grid.std**2).sum(axis=-1)) if what == "std" else grid.correlation
        return np.where(grid.valid, found, np.nan).astype(np.float64)
    return np.asarray(getattr(grid.strain(), what), np.float64)


def _map(ax: Any, grid: GridData, values: NDArray[np.float64], what: str, *, opaque: bool) -> None:
    """Draw squares around the nodes, their colours within all but the farthest values."""
    known = values[np.isfinite(values)]
    if not known.size:
        return
    low, high = np.quantile(known, [_TAIL, 1.0 - _TAIL])
    if what in _SIGNED:
        high = max(abs(low), abs(high))
        low = -high
    if not high > low:
        low, high = low - 1e-6, high + 1e-6
    colours = "RdBu_r" if what in _SIGNED else "viridis"
    drawn = ax.pcolormesh(
        grid.x,
        grid.y,
        np.ma.masked_invalid(values),
        cmap=colours,
        vmin=low,
        vmax=high,
        shading="nearest",
        alpha=1.0 if opaque else 0.6,
    )
    ax.figure.colorbar(drawn, ax=ax, label=_LABELS[what], shrink=0.8)


def _arrows(ax: Any, grid: GridData) -> None:
    """Draw an arrow at each node that is valid, the long ones about as long as a step, and a key."""
    length = np.hypot(grid.u, grid.v)[grid.valid]
    longest = float(np.quantile(length, 0.95)) or 1.0
    scale = longest / grid.step
    at = grid.valid
    drawn = ax.quiver(
        grid.x[at], grid.y[at], grid.u[at], grid.v[at], angles="xy", scale_units="xy", scale=scale, width=0.0025
    )
    digit = 10.0 ** np.floor(np.log10(longest))
    value = float(digit * np.floor(longest / digit))
    ax.quiverkey(drawn, 0.88, 1.03, value, f"{value:g} px", labelpos="E")
