"""Points through a sequence: followed from frame to frame, the lost ones replaced."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks, _core
from .._checks import knobs
from .._checks.knobs import Deformation, Illumination
from .._display import options
from .._shared import Shared, alone, anew
from ..errors import OptionError
from .result import Tracks
from .table import TrackTable

__all__ = ["PointTracker"]


class PointTracker(Shared):
    """Points through a sequence, with persistent ids; those that are lost are replaced.

    Each frame's pyramid is built once. Where at least four of five points are lost at once, the frame is taken for the
    first of another scene: all points are declared lost and new ones are found.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Parameters
    ----------
    max_corners : int, optional
        How many points to keep; new ones are found in the empty cells of a grid when a tenth is missing.
    quality, min_distance : float, optional
        As for `detect_corners`.
    window_size, levels, max_displacement, max_iterations, epsilon, illumination, max_forward_backward : optional
        As for `track_points`.
    deformation : {"auto", "none", "affine"}, optional
        As for `track_points`.
    mask : ndarray of bool, shape (height, width), optional
        True where a pixel of every frame counts, as for an overlay that is fixed to the sensor.
    record : bool, optional
        Keep what `to_table` needs: some 100 bytes for each point and frame.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> y, x = np.mgrid[0:120, 0:160]
    >>> picture = (120 + 60 * np.sin(x * x / 900 + y / 5) * np.cos(y * y / 700 - x / 6)).astype(np.uint8)
    >>> tracker = rsflow.PointTracker(max_corners=50)
    >>> first = tracker.update(picture)
    >>> second = tracker.update(np.roll(picture, 2, axis=1))
    >>> sorted(set(second.ids[second.valid]) - set(first.ids))
    []
    >>> np.round(np.median(second.displacement[second.valid], axis=0))
    array([2., 0.], dtype=float32)
    """

    def __init__(
        self,
        *,
        max_corners: int = 400,
        quality: float = 0.01,
        min_distance: float = 8,
        window_size: int | tuple[int, int] = 21,
        levels: int | None = None,
        max_displacement: float | None = None,
        max_iterations: int = 30,
        epsilon: float = 0.01,
        illumination: Illumination = "gain_offset",
        max_forward_backward: float | None = 0.5,
        deformation: Deformation = "auto",
        mask: NDArray[np.bool_] | None = None,
        record: bool = False,
    ) -> None:
        tracking = knobs.tracking(
            window_size=window_size,
            levels=levels,
            max_displacement=max_displacement,
            max_iterations=max_iterations,
            epsilon=epsilon,
            illumination=illumination,
            max_forward_backward=max_forward_backward,
            deformation=deformation,
        )
        self._options = (tracking, *knobs.corners(max_corners, quality, min_distance))
        self._tracker = _core.PointTracker(*self._options)
        fixed = _checks.mask_or_none("mask", mask)
        self._mask = None if fixed is None else fixed.copy()
        self._table = TrackTable() if _checks.flag("record", record) else None
        self._frame = 0
        self._t_s = math.nan

    def __repr__(self) -> str:
        knobs, max_corners, quality, min_distance = self._options
        found = {"max_corners": max_corners, "quality": quality, "min_distance": min_distance}
        shown = {name: value for name, value in knobs.items() if name in ("window_size", "levels", "max_displacement")}
        told = options(**found, **shown, mask=self._mask is not None, record=self._table is not None)
        return f"PointTracker({told}): {self._frame} frame{'' if self._frame == 1 else 's'}"

    @alone
    def update(self, frame: NDArray[Any], *, t_s: float | None = None, mask: NDArray[np.bool_] | None = None) -> Tracks:
        """Take the next frame.

        Parameters
        ----------
        frame : ndarray, shape (height, width)
            Grey levels: uint8, uint16 or float32, of the size of the frames before.
        t_s : float, optional
            Its time in seconds, for the speeds of `to_table`; NaN where it is not known.
        mask : ndarray of bool, shape (height, width), optional
            True where a pixel of this frame counts, if the tracker's own mask says so too. Windows use the pixels that
            count and whose targets do.

        Returns
        -------
        Tracks
            A row for each point that the frame before had, tracked or lost, then one for each new point, with the
            status ``PointStatus.NEW``; the first frame has only new ones.

        Raises
        ------
        ShapeError, DTypeError
            If the frame is not one, or not of the size of those before, or a mask not of the frame's.
        """
        frame = _checks.frame("frame", frame)
        where = _checks.mask_or_none("mask", mask, frame.shape)
        fixed = _checks.mask_or_none("mask", self._mask, frame.shape)
        if fixed is not None:
            where = fixed if where is None else fixed & where
        time = math.nan if t_s is None else _checks.number("t_s", t_s, of="seconds", or_nan=True, or_none=True)
        tracks = Tracks(**self._tracker.update(frame, where))
        if self._table is not None:
            self._table.add(tracks, frame=self._frame, t_s=time, dt_s=time - self._t_s)
        self._frame += 1
        self._t_s = time
        return tracks

    def to_table(self) -> TrackTable:
        """Give all tracks so far as a table, which saves itself as CSV or Parquet.

        Returns
        -------
        TrackTable
            A row for each point and frame, with speeds in pixels per second.

        Raises
        ------
        OptionError
            If the tracker was not made with ``record=True``.
        """
        if self._table is None:
            raise OptionError("record: got False, expected PointTracker(record=True), which keeps what a table needs")
        return self._table

    @property
    def scene_cut(self) -> bool:
        """Whether the last frame was taken for the first of another scene."""
        return self._tracker.scene_cut

    @anew
    def reset(self) -> None:
        """Forget the frame before and its points; ids, the count of frames and the table go on."""
        self._tracker.reset()
        self._t_s = math.nan

    def _packed(self, state: dict[str, Any]) -> dict[str, Any]:
        return {**state, "_tracker": self._tracker.state()}

    def _unpacked(self, state: dict[str, Any]) -> dict[str, Any]:
        tracker = _core.PointTracker(*state["_options"])
        tracker.restore(state["_tracker"])
        mask = _checks.mask_or_none("mask", state["_mask"])
        numbers = {"_frame": int(state["_frame"]), "_t_s": float(state["_t_s"])}
        return {**state, "_tracker": tracker, "_mask": mask, **numbers}
