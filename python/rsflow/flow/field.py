"""A flow field: where every pixel went, with the light that changed and how far each pixel is to be trusted."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks, _display
from ..errors import DTypeError, ShapeError
from . import export

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset

__all__ = ["FlowField"]

# Of the pixels whose motion a printed line tells.
_LOOKED_AT = 10_000


@dataclass(frozen=True, eq=False)
class FlowField:
    """Where every pixel of a frame went. ``np.asarray(field)`` is `uv`.

    Attributes
    ----------
    uv : ndarray of float32, shape (H, W, 2)
        Displacement from `prev` to `next` in pixels, x right and y down. It is given everywhere but where there was
        nothing to measure (masked out, not finite, a frame of one row or column): there it is NaN. Where `valid` is
        False it is carried over from the surroundings, at best.
    valid : ndarray of bool, shape (H, W)
        Whether the pixel was measured: there is texture in both directions, in its window or, where that is drowned in
        noise or blurred, in a larger one of a coarse level that agrees; it stays inside of the picture, no edge of
        motion is near, and what is left after motion and light is small.
    residual : ndarray of float32, shape (H, W)
        Root mean square difference within the pixel's window after motion and light, in grey levels.
    covariance : ndarray of float32, shape (H, W, 2, 2), or None
        Covariance of x and y of `uv` in squared pixels, if it was asked for: infinite where the flow is not valid, NaN
        where nothing was to be measured. Errors of pixels within some tens of pixels of each other are not independent:
        the mean over a region is not surer by the root of its pixels.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
    >>> field = rsflow.dense_flow(pair.prev, pair.next)
    >>> np.asarray(field).shape, np.round(field.mean(), 1).tolist()
    ((64, 96, 2), [2.0, -1.0])
    >>> round(float(np.median(field.magnitude[field.valid])), 1)
    2.2
    """

    uv: NDArray[np.float32]
    valid: NDArray[np.bool_]
    residual: NDArray[np.float32]
    _light: tuple[NDArray[np.float32], NDArray[np.float32], int] = field(repr=False)
    covariance: NDArray[np.float32] | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        height, width = self.uv.shape[:2]
        # A look at some ten thousand pixels: it is printed, and must not take longer than the flow did.
        step = max(1, math.isqrt(self.valid.size // _LOOKED_AT))
        known = self.uv[::step, ::step][self.valid[::step, ::step]]
        if len(known) == 0:
            return f"FlowField({width} x {height}, none valid)"
        x, y = known.mean(axis=0, dtype=np.float64)
        median = float(np.median(np.hypot(known[:, 0], known[:, 1])))
        share = float(self.valid.mean())
        return f"FlowField({width} x {height}, {share:.0%} valid: mean ({x:+.2f}, {y:+.2f}) px, median {median:.2f} px)"

    def _repr_html_(self) -> str:
        from ..plotting import fitted_max_flow, flow_to_color

        if self.valid.size == 0:
            return _display.html(repr(self), None)
        return _display.html(repr(self), flow_to_color(self, max_flow=fitted_max_flow(self), legend=True))

    @cached_property
    def gain(self) -> NDArray[np.float32]:
        """Gain of the light, ``next = gain * prev + offset``, to about 5 %, shape (H, W); 1 where light is steady."""
        return self._at_every_pixel(self._light[0])

    @cached_property
    def offset(self) -> NDArray[np.float32]:
        """Offset of the light that belongs to `gain`, in grey levels, shape (H, W).

        An offset alone is taken out window by window and may not be found here.
        """
        return self._at_every_pixel(self._light[1])

    @cached_property
    def magnitude(self) -> NDArray[np.float32]:
        """Length of each displacement in pixels, shape (H, W)."""
        return np.asarray(np.hypot(self.uv[..., 0], self.uv[..., 1]))

    @property
    def angle_rad(self) -> NDArray[np.float32]:
        """The same as `angle`, with its unit in the name."""
        return self.angle

    @cached_property
    def angle(self) -> NDArray[np.float32]:
        """Direction of each displacement in radians from x (right) towards y (down), -pi to pi, shape (H, W)."""
        return np.asarray(np.arctan2(self.uv[..., 1], self.uv[..., 0]))

    def mean(self) -> NDArray[np.float32]:
        """Mean displacement (x, y) of the valid pixels; NaN if there is none.

        Examples
        --------
        >>> import numpy as np, rsflow
        >>> frame = np.random.default_rng(1).uniform(0, 255, (48, 64)).astype(np.float32)
        >>> rsflow.dense_flow(frame, frame).mean()
        array([0., 0.], dtype=float32)
        """
        if not self.valid.any():
            return np.full(2, np.nan, np.float32)
        return np.asarray(self.uv[self.valid].mean(axis=0, dtype=np.float64), dtype=np.float32)

    def warp(self, frame: ArrayLike) -> NDArray[Any]:
        """Give `frame`, which looks like `next`, as it looks from `prev`: each pixel from where the flow says it went.

        Parameters
        ----------
        frame : array_like, (H, W) or (H, W, channels)
            uint8, uint16, float32 or float64.

        Returns
        -------
        ndarray
            Shape and type of `frame`, bilinear. Where the flow is NaN or leads out of the picture: NaN in a picture of
            floats, 0 in one of integers.

        Raises
        ------
        ShapeError
            If the size is not that of the flow.
        DTypeError
            If the type is another.

        Examples
        --------
        >>> import numpy as np, rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> field = rsflow.dense_flow(pair.prev, pair.next)
        >>> before = np.abs(pair.next.astype(float) - pair.prev)[8:-8, 8:-8].mean()
        >>> after = np.abs(field.warp(pair.next).astype(float) - pair.prev)[8:-8, 8:-8].mean()
        >>> bool(after < 0.2 * before)
        True
        """
        import cv2

        types = "uint8, uint16, float32 or float64"
        picture = _checks.array("frame", frame, ..., f"a picture of {types}", kinds="fiub")
        if picture.ndim not in (2, 3) or picture.shape[:2] != self.uv.shape[:2]:
            raise ShapeError(f"frame: got shape {picture.shape}, expected the flow's {self.uv.shape[:2]}, or colour")
        if picture.dtype not in (np.uint8, np.uint16, np.float32, np.float64):
            raise DTypeError(f"frame: got dtype {picture.dtype}, expected {types}")
        if picture.size == 0:
            return picture.copy()
        height, width = self.uv.shape[:2]
        x = self.uv[..., 0] + np.arange(width, dtype=np.float32)
        y = self.uv[..., 1] + np.arange(height, dtype=np.float32)[:, None]
        # Written so that NaN is outside too.
        outside = ~((x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1))
        x[outside] = y[outside] = 0
        warped: NDArray[Any] = cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(
            picture.shape
        )
        warped[outside] = np.nan if picture.dtype.kind == "f" else 0
        return warped

    @overload
    def plot(self, picture: NDArray[Any] | None = None, *, ax: None = None, **knobs: Any) -> NDArray[np.uint8]: ...
    @overload
    def plot(self, picture: NDArray[Any] | None = None, *, ax: Axes, **knobs: Any) -> Axes: ...
    def plot(self, picture: NDArray[Any] | None = None, *, ax: Any = None, **knobs: Any) -> Any:
        """Draw the flow as arrows: a picture, or into axes of matplotlib.

        Parameters
        ----------
        picture : ndarray, (H, W) or (H, W, 3), optional
            What to draw on; `prev`, for one.
        ax : matplotlib.axes.Axes, optional
            Where to draw; the axes are then in pixels, y down.
        **knobs
            ``path`` to save it, ``style``, and attributes of `rsflow.QuiverStyle`, as `rsflow.quiver` takes them; with
            `ax` no ``path``, and ``zoom`` means nothing.

        Returns
        -------
        ndarray of uint8, (height, width, 3), or Axes
            The picture, enlarged by the style's zoom; blue, green, red. With `ax` that.

        Raises
        ------
        ShapeError, DTypeError, OptionError
            As `rsflow.quiver`; and if `ax` is not axes of matplotlib, or there is a ``path`` beside it.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> field = rsflow.dense_flow(pair.prev, pair.next)
        >>> field.plot(pair.prev, step=8, zoom=4).shape
        (256, 384, 3)
        >>> from matplotlib.figure import Figure
        >>> axes = field.plot(pair.prev, ax=Figure().subplots(), step=8)
        >>> [float(end) for end in (*axes.get_xlim(), *axes.get_ylim())]
        [-0.5, 95.5, 63.5, -0.5]
        """
        from ..plotting import quiver

        if ax is None:
            return quiver(self, picture=picture, **knobs)
        from ..plotting.axes import quiver_into

        return quiver_into(ax, self, picture=picture, **knobs)

    def to_table(self, *, step: int = 1) -> dict[str, NDArray[Any]]:
        """Give the flow as columns of equal length, for ``pandas.DataFrame``: a row for each pixel of a grid.

        Parameters
        ----------
        step : int
            Distance between the pixels of the grid; 1 is every pixel.

        Returns
        -------
        dict of str to ndarray
            ``x_px, y_px, dx_px, dy_px, residual, valid``, and ``std_x_px, std_y_px`` of a flow with covariance.

        Raises
        ------
        OptionError
            If `step` is no integer of at least 1.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> table = rsflow.dense_flow(pair.prev, pair.next).to_table(step=32)
        >>> table["x_px"].tolist(), table["y_px"].tolist(), table["dx_px"].round(1).tolist()
        ([16, 48, 80, 16, 48, 80], [16, 16, 16, 48, 48, 48], [2.0, 2.0, 2.0, 2.0, 2.0, 2.0])
        """
        step = _checks.integer("step", step, least=1, of="pixels")
        return export.table(self.uv, self.valid, self.residual, self.covariance, step)

    def to_xarray(self) -> Dataset:
        """Give the flow as a dataset of xarray: labelled arrays over y and x in pixels, with units.

        Returns
        -------
        xarray.Dataset
            ``u, v, valid, residual, gain, offset``, and ``var_u, var_v, cov_uv`` of a flow with covariance; the arrays
            are those of the field, not copied.

        Raises
        ------
        MissingExtraError
            If xarray is not installed: ``pip install 'rsflow-motion[xarray]'``.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> data = rsflow.dense_flow(pair.prev, pair.next).to_xarray()
        >>> dict(data.sizes), data.u.attrs["units"], round(float(data.u.where(data.valid).mean()), 1)
        ({'y': 64, 'x': 96}, 'px', 2.0)
        """
        variables = {"u": self.uv[..., 0], "v": self.uv[..., 1], "valid": self.valid, "residual": self.residual}
        variables |= {"gain": self.gain, "offset": self.offset}
        if self.covariance is not None:
            c = self.covariance
            variables |= {"var_u": c[..., 0, 0], "var_v": c[..., 1, 1], "cov_uv": c[..., 0, 1]}
        data: Dataset = export.dataset(variables)
        return data

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the flow; what is not valid is unknown in the file.

        Parameters
        ----------
        path : path
            The suffix says the format, see `rsflow.write_flow`, which raises the same errors.

        Examples
        --------
        >>> import numpy as np, pathlib, rsflow, tempfile
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> field = rsflow.dense_flow(pair.prev, pair.next)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     field.save(pathlib.Path(folder, "motion.flo"))
        ...     uv = rsflow.read_flow(pathlib.Path(folder, "motion.flo"))
        >>> np.array_equal(np.isfinite(uv[..., 0]), field.valid)
        True
        """
        from ..io.flow_files import write_flow

        write_flow(path, self)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """`uv`, for numpy."""
        if copy is None:
            return np.asarray(self.uv, dtype=dtype)
        return np.array(self.uv, dtype=dtype, copy=copy)

    def _at_every_pixel(self, grid: NDArray[np.float32]) -> NDArray[np.float32]:
        height, width = self.uv.shape[:2]
        scale = 2.0 ** -self._light[2]

        def axis(size: int, cells: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
            at = np.minimum(np.arange(size) * scale, cells - 1)
            low = at.astype(np.intp)
            return low, np.minimum(low + 1, cells - 1), (at - low).astype(np.float32)

        top, bottom, down = axis(height, grid.shape[0])
        left, right, across = axis(width, grid.shape[1])
        rows = grid[top] + down[:, None] * (grid[bottom] - grid[top])
        return np.asarray(rows[:, left] + across * (rows[:, right] - rows[:, left]), dtype=np.float32)
