"""Dense flow of a pair of frames, and of a sequence.

docs/explanation/algorithms.md, section "Dense flow: dense_flow".
"""

from __future__ import annotations

import threading
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks, _core
from .._checks import knobs
from .._checks.knobs import Illumination, Preset
from .._display import options
from .._shared import Shared, alone, anew
from ..errors import ShapeError
from .field import FlowField

__all__ = ["DenseFlow", "dense_flow"]

_Options: TypeAlias = tuple[Preset, Illumination, float | None, bool]


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
        The two frames, grey, of the same size and type. Pixels that are not finite count for nothing, and so do single
        ones far outside of the grey levels of the others (hot pixels), up to one in 10,000: mask more than that.
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
    wanted = _options(preset, illumination, max_displacement, covariance)
    before, after = _checks.pair(prev, next)
    start, where = _as_initial(initial), _checks.mask_or_none("mask", mask, before.shape)
    where_next = _checks.mask_or_none("next_mask", next_mask, before.shape)
    return _field(_kept_core(wanted, before.size).pair(before, after, start, where, where_next))


# One estimator a thread is kept from call to call, for its memory. Frames of more pixels than this give theirs back
# after a call that stands alone; from the second call in a row with the same size on it is kept until another size
# comes.
_KEPT_PIXELS = 1 << 21
_kept = threading.local()


def _options(preset: object, illumination: object, max_displacement: object, covariance: object) -> _Options:
    return (
        knobs.preset(preset),
        knobs.illumination(illumination),
        knobs.max_displacement(max_displacement),
        _checks.flag("covariance", covariance),
    )


def _kept_core(wanted: _Options, pixels: int) -> _core.DenseFlow:
    of_size = pixels if pixels > _KEPT_PIXELS else 0
    key = (wanted, of_size)
    before, _kept.latest = getattr(_kept, "latest", None), key
    if of_size and key != before:
        return _core.DenseFlow(*wanted)
    if getattr(_kept, "key", None) != key:
        _kept.core = _core.DenseFlow(*wanted)
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
        self._options = _options(preset, illumination, max_displacement, covariance)
        self._core = _core.DenseFlow(*self._options)
        self._initial = _as_initial(initial)
        self._mask = _checks.mask_or_none("mask", mask)
        self._next_mask = _checks.mask_or_none("next_mask", next_mask)
        self._shape: tuple[int, ...] | None = None
        self._started = False

    def __repr__(self) -> str:
        preset, light, reach, covariance = self._options
        mask = self._mask is not None or self._next_mask is not None
        told = options(preset=preset, illumination=light, max_displacement=reach, covariance=covariance, mask=mask)
        before = "no frame yet" if self._shape is None else f"frames of {self._shape[1]} x {self._shape[0]}"
        return f"DenseFlow({told}): {before}"

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
