"""Places of a sequence of grids over time: probes, lines and extensometers."""

from __future__ import annotations

import csv
import os
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._extras import require
from .._shared import Shared, alone
from ..errors import DTypeError, OptionError
from ..io.atomic import writing
from .result import Grid

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PROBE_QUANTITIES", "GridProbes", "ProbeQuantity"]

F64 = NDArray[np.float64]

ProbeQuantity = Literal["u", "v", "xx", "yy", "xy", "vorticity", "divergence"]

PROBE_QUANTITIES: tuple[str, ...] = get_args(ProbeQuantity)

# Each as a sum of u, v, du/dx, du/dy, dv/dx, dv/dy; whether it turns with y; its label.
_QUANTITIES: dict[str, tuple[tuple[float, ...], bool, str]] = {
    "u": ((1, 0, 0, 0, 0, 0), False, "u (px, to the right)"),
    "v": ((0, 1, 0, 0, 0, 0), True, "v (px, down)"),
    "xx": ((0, 0, 1, 0, 0, 0), False, "small strain xx"),
    "yy": ((0, 0, 0, 0, 0, 1), False, "small strain yy"),
    "xy": ((0, 0, 0, 0.5, 0.5, 0), True, "small strain xy"),
    "vorticity": ((0, 0, 0, -1, 1, 0), True, "vorticity dv/dx - du/dy"),
    "divergence": ((0, 0, 1, 0, 0, 1), False, "divergence du/dx + dv/dy"),
}
# Ends farther away are a mistake.
_FARTHEST_PX = 1e5
_NAMES = {"u": "u_px", "v": "v_px", "xx": "strain_xx", "yy": "strain_yy", "xy": "strain_xy"}


class GridProbes(Shared):
    """Follow places over grids: probes, lines and extensometers, each with its deviation.

    The places are those of the older frame of each grid: with ``GridSequence(reference="first")`` they go with the
    material, pair by pair they stand still in the picture.

    Parameters
    ----------
    points : array_like, shape (N, 2)
        Probes (x, y), in pixels.
    lines, extensometers : array_like, shape (N, 2, 2)
        Both ends (x, y) of each, in pixels. Of a line there are places from end to end.
    spacing : float
        Pixels between the places of a line, at most; 1 or more.

    Examples
    --------
    >>> import rsflow
    >>> sequence = rsflow.GridSequence(reference="first")
    >>> probes = rsflow.grid.GridProbes([(60, 50)], extensometers=[((20, 50), (100, 50))])
    >>> for strain in (0.0, 0.01, 0.02):
    ...     scene = rsflow.synthetic.speckle_pair(lambda x, y: (strain * x, 0 * y), size=(128, 96), seed=1)
    ...     grid = sequence.update(scene.next)
    ...     if grid is not None:
    ...         probes.add(grid)
    >>> table = probes.to_table()
    >>> [(str(name), round(float(found), 3)) for name, found in zip(table["name"], table["extension"])]
    [('point 1', nan), ('extensometer 1', 0.01), ('point 1', nan), ('extensometer 1', 0.02)]
    """

    def __init__(
        self,
        points: ArrayLike = (),
        *,
        lines: ArrayLike = (),
        extensometers: ArrayLike = (),
        spacing: float = 8.0,
    ) -> None:
        spaced = _checks.number("spacing", spacing, least=1, of="pixels")
        kept = _checks.coordinates("points", points).astype(np.float64)
        self._names: list[str] = [f"point {k + 1}" for k in range(len(kept))]
        self._along: list[float] = [0.0] * len(kept)
        places = [kept]
        for k, ends in enumerate(_ends("lines", lines)):
            length = float(np.hypot(*(ends[1] - ends[0])))
            shares = np.linspace(0.0, 1.0, max(int(np.ceil(length / spaced)), 1) + 1)
            places.append(ends[0] + shares[:, None] * (ends[1] - ends[0]))
            self._names += [f"line {k + 1}"] * len(shares)
            self._along += (shares * length).tolist()
        self._places: F64 = np.concatenate(places).reshape(-1, 2)
        self._extensometers = _ends("extensometers", extensometers)
        if not len(self._places) and not self._extensometers:
            raise OptionError("points: got none, expected a point, a line or an extensometer")
        self._times: list[float] = []
        self._found: list[tuple[F64, F64, F64]] = []
        self._height = 0

    def __repr__(self) -> str:
        gauges = len(self._extensometers)
        return f"GridProbes({len(self._places)} places, {gauges} extensometers, {len(self._times)} grids)"

    @alone
    def add(self, grid: Grid, t_s: float | None = None) -> None:
        """Take in a grid.

        Parameters
        ----------
        grid : Grid
            The next one.
        t_s : float, optional
            Its time in seconds, if it is known.
        """
        _checks.instance("grid", grid, Grid, "a Grid")
        time = _checks.number_or_none("t_s", t_s, of="seconds")
        samples = grid.at(self._places)
        six = np.concatenate([samples.displacement, samples.gradient.reshape(-1, 4)], axis=1)
        values, deviations = [], []
        for weights, _, _ in _QUANTITIES.values():
            # Others may not be known: of windows that only shift, the derivatives.
            used = np.flatnonzero(weights)
            factors = np.array(weights)[used]
            values.append(six[:, used] @ factors)
            with np.errstate(invalid="ignore"):
                part = samples.joint_covariance[:, used[:, None], used]
                deviations.append(np.sqrt(np.einsum("i,nij,j->n", factors, part, factors)))
        gauges = [grid.extension(*ends) for ends in self._extensometers]
        extended = np.array([(gauge.strain, gauge.std) for gauge in gauges], np.float64).reshape(-1, 2)
        self._found.append((np.stack(values, axis=-1), np.stack(deviations, axis=-1), extended))
        self._times.append(np.nan if time is None else time)
        self._height = grid.size[1]

    def to_table(self, *, y_up: bool = False) -> dict[str, NDArray[Any]]:
        """Give columns of equal length: a row for each grid and place or extensometer.

        Parameters
        ----------
        y_up : bool
            As in `Grid.save`.

        Returns
        -------
        dict of str to ndarray
            ``grid``, counted from 1; ``t_s, name``; ``x_px, y_px``, of an extensometer its middle; ``along_px``, from
            the first end of a line; ``u_px, v_px, strain_xx, strain_yy, strain_xy`` (small), ``vorticity, divergence``
            and ``extension``, each followed by its deviation, ``std_...``. What is not known is NaN.
        """
        sign = -1.0 if _checks.flag("y_up", y_up) else 1.0
        times, gauges = len(self._times), len(self._extensometers)
        rows = len(self._names) + gauges
        middles = np.array([ends.mean(axis=0) for ends in self._extensometers]).reshape(-1, 2)
        places = np.concatenate([self._places, middles])
        y = (self._height - 1) - places[:, 1] if y_up else places[:, 1]
        names = np.array([*self._names, *(f"extensometer {k + 1}" for k in range(gauges))])
        along = np.array([*self._along, *[np.nan] * gauges], np.float64)
        table: dict[str, NDArray[Any]] = {
            "grid": np.repeat(np.arange(1, times + 1), rows),
            "t_s": np.repeat(np.array(self._times, np.float64), rows),
            "name": np.tile(names, times),
            **{
                key: np.tile(part, times)
                for key, part in zip(("x_px", "y_px", "along_px"), (*places.T[:1], y, along), strict=True)
            },
        }
        unknown, none = np.full(gauges, np.nan), np.full(len(self._names), np.nan)
        for k, (word, (_, turns, _)) in enumerate(_QUANTITIES.items()):
            name = _NAMES.get(word, word)
            factor = sign if turns else 1.0
            table[name] = factor * _joined([(value[:, k], unknown) for value, _, _ in self._found])
            table[f"std_{name}"] = _joined([(std[:, k], unknown) for _, std, _ in self._found])
        for k, name in enumerate(("extension", "std_extension")):
            table[name] = _joined([(none, extended[:, k]) for _, _, extended in self._found])
        return table

    def save(self, path: str | os.PathLike[str], *, y_up: bool = False) -> None:
        """Write the table; its first line says which way the axes point.

        Parameters
        ----------
        path : path
            ``.csv``.
        y_up : bool
            As in `Grid.save`.

        Raises
        ------
        OptionError
            If the suffix is another.
        OSError
            If the file cannot be written; an older file of that name then stays.
        """
        file = _checks.file_name("path", path, (".csv",))
        table = self.to_table(y_up=y_up)
        up = "up from the lowest row" if y_up else "down from the highest row"
        with writing(file) as partial, partial.open("w", newline="", encoding="utf-8") as opened:
            opened.write(f"# places in the older frame; x to the right, y {up}; u along x, v along y; pixels\n")
            writer = csv.writer(opened)
            writer.writerow(table)
            for row in zip(*(column.tolist() for column in table.values()), strict=True):
                writer.writerow(f"{value:.7g}" if isinstance(value, float) else value for value in row)

    def plot(
        self, what: ProbeQuantity = "u", *, ax: Axes | None = None, path: str | os.PathLike[str] | None = None
    ) -> Axes:
        """Draw one quantity of each probe over time, the mean of a line, and extensions on an axis of their own.

        Bands reach one deviation to both sides; of a line, whose places share windows, the root mean square of theirs.

        Parameters
        ----------
        what : str
            ``"u"``, ``"v"``, small strain ``"xx"``, ``"yy"``, ``"xy"``, ``"vorticity"`` or ``"divergence"``.
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default in a figure of its own.
        path : path, optional
            Where to save it: ``.png``, ``.svg`` or ``.pdf``.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed: ``pip install 'rsflow-motion[plot]'``.
        """
        drawn: Any = ax
        word: str = _checks.choice("what", what, get_args(ProbeQuantity))
        file = None if path is None else _checks.file_name("path", path, (".png", ".svg", ".pdf"))
        if drawn is None:
            figure = require("matplotlib.figure", extra="plot", purpose="GridProbes.plot").Figure(
                figsize=(7.0, 4.0), layout="constrained"
            )
            drawn = figure.subplots()
        elif not all(hasattr(drawn, name) for name in ("plot", "fill_between", "twinx")):
            raise _checks.refused("ax", drawn, "axes of matplotlib, or None for new ones", DTypeError)
        table, name = self.to_table(), _NAMES.get(word, word)
        timed = bool(np.isfinite(table["t_s"]).all())
        drawn.set(xlabel="time (s)" if timed else "grid", ylabel=_QUANTITIES[word][2])
        curves = dict.fromkeys(self._names)
        for curve in curves:
            _draw(drawn, table, curve, name, "-")
        if self._extensometers:
            right = drawn.twinx() if self._names else drawn
            right.set_ylabel("extension")
            for k in range(len(self._extensometers)):
                _draw(right, table, f"extensometer {k + 1}", "extension", f"C{(len(curves) + k) % 10}--")
            if self._names:
                right.legend(loc="lower right", fontsize="small")
        drawn.legend(loc="upper left", fontsize="small")
        if file is not None:
            with writing(file) as partial:
                drawn.figure.savefig(partial, dpi=150)
        done: Axes = drawn
        return done


def _ends(name: str, lines: ArrayLike) -> list[F64]:
    """Take both ends of lines, at different places."""
    if isinstance(lines, (list, tuple)) and not lines:
        return []
    found = _checks.array(name, lines, ("N", 2, 2), "(N, 2, 2), x and y of both ends of each", finite=True)
    ends = found.astype(np.float64)
    for line in ends:
        if np.array_equal(line[0], line[1]) or not (np.abs(line) <= _FARTHEST_PX).all():
            raise OptionError(f"{name}: got {line.tolist()}, expected different places within {_FARTHEST_PX:g} pixels")
    return list(ends)


def _joined(parts: list[tuple[F64, F64]]) -> F64:
    """Join what each grid says of places and of extensometers."""
    return np.concatenate([np.concatenate(part) for part in parts]) if parts else np.zeros(0)


def _draw(ax: Any, table: dict[str, NDArray[Any]], curve: str, name: str, style: str) -> None:
    """Draw a curve with its band: means over the rows of one grid, over time where all times are known."""
    mine = table["name"] == curve
    numbers, first = np.unique(table["grid"][mine], return_index=True)
    times = table["t_s"][mine][first] if np.isfinite(table["t_s"]).all() else numbers
    middle, spread = np.full(len(times), np.nan), np.full(len(times), np.nan)
    for k, number in enumerate(numbers):
        rows = mine & (table["grid"] == number) & np.isfinite(table[name])
        if rows.any():
            middle[k] = table[name][rows].mean()
            spread[k] = np.sqrt(np.mean(table[f"std_{name}"][rows] ** 2))
    (line,) = ax.plot(times, middle, style, marker=".", label=curve)
    ax.fill_between(times, middle - spread, middle + spread, alpha=0.25, color=line.get_color(), linewidth=0)
