"""Dense flow: where every pixel went."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _checks, _core
from ._checks import knobs
from ._checks.knobs import Illumination, Preset
from ._shared import Shared, alone, anew
from .errors import DTypeError, ShapeError

__all__ = ["DenseFlow", "FlowField", "Preset", "dense_flow"]


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

    def plot(self, picture: NDArray[Any] | None = None, **knobs: Any) -> Any:
        """Draw the flow as arrows; see `rsflow.quiver`, which takes the same arguments and raises the same errors.

        Parameters
        ----------
        picture : ndarray, (H, W) or (H, W, 3), optional
            What to draw on; `prev`, for one.
        **knobs
            ``path`` to save it, ``style``, and attributes of `rsflow.QuiverStyle`.

        Returns
        -------
        ndarray of uint8, (height, width, 3)
            The picture, enlarged by the style's zoom; blue, green, red.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> rsflow.dense_flow(pair.prev, pair.next).plot(pair.prev, step=8, zoom=4).shape
        (256, 384, 3)
        """
        from .plotting.quiver_plot import quiver

        return quiver(self, picture=picture, **knobs)

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
        from .io.flow_files import write_flow

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


def dense_flow(
    prev: NDArray[Any],
    next: NDArray[Any],
    *,
    preset: Preset = "balanced",
    illumination: Illumination = "gain_offset",
    max_displacement: float | None = None,
    initial: ArrayLike | FlowField | None = None,
    mask: NDArray[np.bool_] | None = None,
    next_mask: NDArray[np.bool_] | None = None,
    covariance: bool = False,
) -> FlowField:
    """Where every pixel of `prev` went.

    Parameters
    ----------
    prev, next : ndarray (H, W) of uint8, uint16 or float32
        The two frames, grey, of the same size and type.
    preset : {"ultrafast", "fast", "balanced", "accurate"}
        How much time to take for how much accuracy. ``ultrafast`` measures at half the size and interpolates.
    illumination : {"none", "offset", "gain_offset"}
        How light may change: not at all, by an offset within each small window, or besides that by a gain and an
        offset that vary slowly over the picture.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels: longer ones are not sought, and none is valid. By
        default half the frame along each axis. Small values keep repetitive texture from being matched far away.
    initial : array_like (H, W, 2) or FlowField, optional
        A flow to start from; what lies within about 8 pixels of it is found. NaN is taken as zero.
    mask : ndarray (H, W) of bool, optional
        False at pixels of `prev` that are not to be measured and that count for nothing, whatever they hold.
    next_mask : ndarray (H, W) of bool, optional
        The same of `next`: a pixel of `prev` that moves to one where it is False, or beside it, counts for nothing and
        is not `valid`. What stays with the sensor, a rim or letters, is given as both masks.
    covariance : bool
        Whether to say how far the flow of each pixel may be off (`FlowField.covariance`).

    Returns
    -------
    FlowField

    Raises
    ------
    ShapeError
        If a frame is not 2-D, or sizes differ.
    DTypeError
        If a frame has another type, or the two differ, or a mask is not of bool.
    OptionError
        If an option has a value that it does not allow.

    Notes
    -----
    Coarse to fine Lucas-Kanade with shiftable windows and a variational refinement that is smooth relative to the
    affine motion most of the flow follows, the more so where nearly all of it does; the light is part of it: the mean
    of each window is removed from the least squares, and a gain and an offset that vary slowly over the picture are
    measured on coarse levels where that fits better.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> y, x = np.mgrid[0:80, 0:98].astype(np.float32)
    >>> scene = lambda x, y: 128 + 60 * np.sin(0.3 * x + 0.1 * y) + 40 * np.cos(0.35 * y - 0.15 * x)
    >>> field = rsflow.dense_flow(scene(x, y), scene(x - 1.5, y + 0.5))
    >>> field.uv.shape
    (80, 98, 2)
    >>> bool(np.abs(field.mean() - [1.5, -0.5]).max() < 0.02)
    True
    >>> sure = rsflow.dense_flow(scene(x, y), scene(x - 1.5, y + 0.5), covariance=True)
    >>> bool(np.sqrt(sure.covariance[40, 49, 0, 0]) < 0.05)
    True
    """
    options = _options(preset, illumination, max_displacement, covariance)
    before, after = _checks.pair(prev, next)
    start, where = _as_initial(initial), _checks.mask_or_none("mask", mask, before.shape)
    where_next = _checks.mask_or_none("next_mask", next_mask, before.shape)
    return _field(_kept_core(options, before.size).pair(before, after, start, where, where_next))


# One estimator a thread is kept from call to call, for its memory. Frames of more pixels than this give theirs back
# after a call that stands alone; from the second call in a row with the same size on it is kept until another size
# comes.
_KEPT_PIXELS = 1 << 21
_kept = threading.local()


def _options(
    preset: object, illumination: object, max_displacement: object, covariance: object
) -> tuple[str, str, float | None, bool]:
    return (
        knobs.preset(preset),
        knobs.illumination(illumination),
        knobs.max_displacement(max_displacement),
        _checks.flag("covariance", covariance),
    )


def _kept_core(options: tuple[str, str, float | None, bool], pixels: int) -> _core.DenseFlow:
    of_size = pixels if pixels > _KEPT_PIXELS else 0
    key = (options, of_size)
    before, _kept.latest = getattr(_kept, "latest", None), key
    if of_size and key != before:
        return _core.DenseFlow(*options)
    if getattr(_kept, "key", None) != key:
        _kept.core = _core.DenseFlow(*options)
        _kept.key = key
    core: _core.DenseFlow = _kept.core
    return core


class DenseFlow(Shared):
    """Dense flow from frame to frame: each frame is prepared once, and memory is kept.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Parameters
    ----------
    preset, illumination, max_displacement, covariance
        As in `dense_flow`.
    initial : array_like (H, W, 2) or FlowField, optional
        A flow to start from, for the first pair only.
    mask, next_mask : ndarray (H, W) of bool, optional
        Of every pair, as in `dense_flow`.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> flow = rsflow.DenseFlow(preset="fast")
    >>> frame = np.zeros((48, 64), np.uint8)
    >>> print(flow.update(frame))
    None
    >>> flow.update(frame).valid.any()
    np.False_
    """

    def __init__(
        self,
        *,
        preset: Preset = "balanced",
        illumination: Illumination = "gain_offset",
        max_displacement: float | None = None,
        initial: ArrayLike | FlowField | None = None,
        mask: NDArray[np.bool_] | None = None,
        next_mask: NDArray[np.bool_] | None = None,
        covariance: bool = False,
    ) -> None:
        options = _options(preset, illumination, max_displacement, covariance)
        self._options = options
        self._core = _core.DenseFlow(*options)
        self._initial = _as_initial(initial)
        self._mask = _checks.mask_or_none("mask", mask)
        self._next_mask = _checks.mask_or_none("next_mask", next_mask)
        self._shape: tuple[int, ...] | None = None
        self._started = False

    @alone
    def update(self, frame: NDArray[Any]) -> FlowField | None:
        """Return the flow from the frame before to `frame`; None for the first frame.

        Parameters
        ----------
        frame : ndarray (H, W) of uint8, uint16 or float32
            Of the size of the frame before; the type may change.

        Raises
        ------
        ShapeError, DTypeError
            If the frame does not fit; the next frame is then a first one.
        """
        frame = _checks.frame("frame", frame)
        if self._shape is not None and frame.shape != self._shape:
            before, self._shape = self._shape, None
            self._core.reset()
            raise ShapeError(
                f"frame: got {frame.shape}, expected the shape of the frames before, {before}; "
                "the next frame is a first one"
            )
        self._shape = frame.shape
        initial = self._initial if not self._started else None
        parts = self._core.update(frame, initial, self._mask, self._next_mask)
        if parts is None:
            return None
        self._started = True
        return _field(parts)

    @anew
    def reset(self) -> None:
        """Forget the frame before: the next frame is a first one."""
        self._core.reset()
        self._shape = None
        self._started = False

    def _packed(self, state: dict[str, Any]) -> dict[str, Any]:
        return {**state, "_core": self._core.state()}

    def _unpacked(self, state: dict[str, Any]) -> dict[str, Any]:
        core = _core.DenseFlow(*state["_options"])
        core.restore(state["_core"])
        return {**state, "_core": core, "_started": bool(state["_started"])}


def _field(parts: _core._FlowParts) -> FlowField:
    uv, valid, residual, gain, offset, halvings, covariance = parts
    return FlowField(uv, valid, residual, (gain, offset, halvings), covariance)


def _as_initial(initial: ArrayLike | FlowField | None) -> NDArray[np.float32] | None:
    if initial is None:
        return None
    flow = _checks.array("initial", initial, ("height", "width", 2), "numbers, (height, width, 2)")
    # What float32 cannot hold is no start, as NaN is none.
    with np.errstate(over="ignore"):
        return flow.astype(np.float32, copy=False)
