"""Points: where each went from one frame to the next, or through a sequence, and where to start them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks, _core
from .._checks import knobs
from .._checks.knobs import Deformation, Illumination
from .._shared import Shared, alone, anew
from ..errors import OptionError
from .table import TrackTable

__all__ = ["Illumination", "PointStatus", "PointTracker", "TrackTable", "Tracks", "detect_corners", "track_points"]


class PointStatus(IntEnum):
    """Whether a point was tracked, or else the first reason why not. The values are those of lk-core.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> blank = np.full((60, 80), 90, np.uint8)
    >>> tracks = rsflow.track_points(blank, blank, [[40, 30], [200, 30], [np.nan, 30]])
    >>> [rsflow.PointStatus(status).name for status in tracks.status]
    ['LOW_TEXTURE', 'OUT_OF_FRAME', 'NOT_FINITE']
    >>> bool((tracks.status == rsflow.PointStatus.TRACKED).any())
    False
    """

    TRACKED = 0
    """Tracked: position and covariance hold."""
    OUT_OF_FRAME = 1
    """The point is, or went, outside of the frame."""
    LOW_TEXTURE = 2
    """The window has too little texture, or only along one direction, to say where it went."""
    NOT_CONVERGED = 3
    """The steps did not come to rest, or went further than `max_displacement`."""
    HIGH_RESIDUAL = 4
    """What was found does not look like what was sought; or nine in ten of many points are lost, and no neighbour moves
    like this one."""
    FORWARD_BACKWARD = 5
    """Tracked back, the point did not return to where it came from."""
    MASKED = 6
    """A mask excludes the point, or where it went."""
    NOT_FINITE = 7
    """A coordinate of the point is NaN or infinite."""
    NEW = 8
    """Found in this frame by a `PointTracker`: it has a position, but no motion yet."""
    LOW_SUPPORT = 9
    """Fewer than an eighth of the window's pixels count in both frames: others are outside, masked, not finite."""
    AMBIGUOUS = 10
    """The texture repeats: another displacement explains the window as well, is not longer than `max_displacement`, and
    nothing around the window (the end of the pattern, a stain, what else moves with it) tells which one it was."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Where points went: one row for each, whether it was tracked or not.

    Attributes
    ----------
    points : ndarray of float32, shape (N, 2)
        Position (x, y) in the newer frame, in pixels; NaN unless tracked (or new, see `PointTracker`).
    status : ndarray of uint8, shape (N,)
        A `PointStatus` for each point.
    residual : ndarray of float32, shape (N,)
        Root mean square difference of the window between the frames, in grey levels, after the lighting model.
    covariance : ndarray of float32, shape (N, 2, 2)
        Covariance of the position in square pixels; infinite on the diagonal unless tracked.
    forward_backward : ndarray of float32, shape (N,)
        Distance in pixels between where a point came from and where it comes back when it is tracked back;
        NaN if that was not measured.
    deformation : ndarray of float32, shape (N, 2, 2)
        How the surroundings of the point are turned, scaled and sheared: an offset from the point in the older frame,
        multiplied by this matrix, is the offset in the newer one. The identity where a displacement alone explains the
        window; NaN unless tracked.
    origins : ndarray of float32, shape (N, 2)
        Position in the older frame, in pixels; NaN for a new point.
    ids : ndarray of int64, shape (N,)
        The same in every frame of a `PointTracker`, never used again; otherwise the row.
    ages : ndarray of uint32, shape (N,)
        Frames since a `PointTracker` found the point; otherwise 1.

    Examples
    --------
    >>> import rsflow
    >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
    >>> tracks = rsflow.track_points(pair.prev, pair.next, [(48, 32), (500, 10)])
    >>> tracks.valid.tolist(), [rsflow.PointStatus(status).name for status in tracks.status]
    ([True, False], ['TRACKED', 'OUT_OF_FRAME'])
    >>> (tracks.points - tracks.origins)[0].round(1).tolist()
    [2.0, -1.0]
    """

    points: NDArray[np.float32]
    status: NDArray[np.uint8]
    residual: NDArray[np.float32]
    covariance: NDArray[np.float32]
    forward_backward: NDArray[np.float32]
    deformation: NDArray[np.float32]
    origins: NDArray[np.float32]
    ids: NDArray[np.int64]
    ages: NDArray[np.uint32]

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Which points were tracked, shape (N,)."""
        valid: NDArray[np.bool_] = self.status == np.uint8(PointStatus.TRACKED)
        return valid

    @property
    def displacement(self) -> NDArray[np.float32]:
        """Motion (u, v) of each point in pixels, shape (N, 2); NaN unless tracked."""
        return self.points - self.origins

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        names = [status.name.lower() for status in PointStatus]
        counts = np.bincount(self.status, minlength=len(names))
        told = ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True) if count)
        return f"Tracks({len(self)} points: {told or 'none'})"


def track_points(
    prev: NDArray[Any],
    next: NDArray[Any],
    points: ArrayLike,
    *,
    window_size: int | tuple[int, int] = 21,
    levels: int | None = None,
    max_displacement: float | None = None,
    max_iterations: int = 30,
    epsilon: float = 0.01,
    illumination: Illumination = "gain_offset",
    initial: ArrayLike | None = None,
    max_forward_backward: float | None = 0.5,
    deformation: Deformation = "auto",
    mask: NDArray[np.bool_] | None = None,
    next_mask: NDArray[np.bool_] | None = None,
) -> Tracks:
    """Where each point of `prev` is in `next`: pyramidal Lucas-Kanade with the lighting in the least squares.

    Where many points are lost or move unlike their neighbours, as under rotation and zoom, the motion of a window may
    be affine [4]_; that takes some 0.1 ms a point.

    Parameters
    ----------
    prev, next : ndarray, shape (height, width)
        Grey frames of the same size and type: uint8, uint16 or float32. Crops are read in place.
    points : array_like, shape (N, 2)
        Positions (x, y) in `prev` in pixels, pixel centres at integers.
    window_size : int or (width, height), optional
        Side of the window around a point, 3 to 63 pixels. At full resolution one more pixel on each side takes part.
    levels : int, optional
        Levels of the pyramid, the frame itself included. By default they follow from the frame's size and from
        `max_displacement`.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels: longer ones are not valid. By default any. Where
        texture repeats and fills the picture, one below half of its period says which of several displacements it was.
    max_iterations : int, optional
        Steps on one level after which a point counts as not converged.
    epsilon : float, optional
        Length of a step, in pixels, below which a point has converged.
    illumination : {"none", "offset", "gain_offset"}, optional
        What may change in the light of a window.
    initial : array_like, shape (N, 2), optional
        A first guess of each position in `next`, such as a gyroscope gives.
    max_forward_backward : float or None, optional
        How far from its start, in pixels, a point may come back when it is tracked back from `next` to `prev`.
        None does not track back.
    deformation : {"auto", "none", "affine"}, optional
        Whether windows may turn, grow and shear: where many points are lost, fit badly or move unlike their neighbours;
        nowhere; or everywhere.
    mask, next_mask : ndarray of bool, shape (height, width), optional
        True where a pixel of `prev`, and of `next`, counts. Windows use the pixels that count and whose targets do; an
        overlay that is fixed to the sensor is given as both.

    Returns
    -------
    Tracks
        One row for each point, in order. A point that cannot be tracked has a status that says why, NaN for its
        position and infinite variance.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If the arguments do not fit together; the message says which and how.

    References
    ----------
    .. [1] B. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
       IJCAI 1981.
    .. [2] J.-Y. Bouguet, "Pyramidal implementation of the affine Lucas Kanade feature tracker", Intel, 2001.
    .. [3] G. Hager and P. Belhumeur, "Efficient region tracking with parametric models of geometry and
       illumination", PAMI 1998, https://doi.org/10.1109/34.722606.
    .. [4] S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004,
       https://doi.org/10.1023/B:VISI.0000011205.11775.fd.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> y, x = np.mgrid[0:120, 0:160]
    >>> picture = lambda x, y: 120 + 50 * np.sin(x / 3) * np.cos(y / 4) + 30 * np.sin((x + 2 * y) / 7)
    >>> prev, next = (picture(x - u, y).astype(np.float32) for u in (0, 1.5))
    >>> tracks = rsflow.track_points(prev, 0.8 * next + 5, [[60, 50], [90, 70]])
    >>> np.round(tracks.displacement, 1) + 0
    array([[1.5, 0. ],
           [1.5, 0. ]], dtype=float32)
    >>> tracks.valid
    array([ True,  True])
    """
    origins = _checks.points("points", points)
    options = knobs.tracking(
        window_size=window_size,
        levels=levels,
        max_displacement=max_displacement,
        max_iterations=max_iterations,
        epsilon=epsilon,
        illumination=illumination,
        max_forward_backward=max_forward_backward,
        deformation=deformation,
    )
    start = None if initial is None else _checks.points("initial", initial)
    before, after = _checks.pair(prev, next)
    where = _checks.mask_or_none("mask", mask, before.shape)
    where_next = _checks.mask_or_none("next_mask", next_mask, before.shape)
    found = _core.track_points(before, after, origins, start, where, where_next, options)
    count = len(origins)
    return Tracks(**found, origins=origins, ids=np.arange(count, dtype=np.int64), ages=np.ones(count, dtype=np.uint32))


def detect_corners(
    frame: NDArray[Any],
    *,
    max_corners: int = 400,
    quality: float = 0.01,
    min_distance: float = 8,
    mask: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """Find the corners of a frame, which a window can be tracked from, the best first.

    Parameters
    ----------
    frame : ndarray, shape (height, width)
        Grey levels: uint8, uint16 or float32.
    max_corners : int, optional
        The most corners to return; 0 means all.
    quality : float, optional
        The least response of a corner, as a share of the best one's, above 0 and up to 1. The response is the smaller
        eigenvalue of the structure tensor over 3 x 3 pixels [1]_.
    min_distance : float, optional
        The least distance between two corners, in pixels.
    mask : ndarray of bool, shape (height, width), optional
        True where a pixel counts: a corner is one, and is made of gradients of such pixels alone.

    Returns
    -------
    ndarray of float32, shape (N, 2)
        Positions (x, y) in pixels.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If an argument does not fit; the message says which and how.

    References
    ----------
    .. [1] J. Shi and C. Tomasi, "Good features to track", CVPR 1994, https://doi.org/10.1109/CVPR.1994.323794.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> frame = np.zeros((60, 80), np.uint8)
    >>> frame[20:40, 30:50] = 200
    >>> rsflow.detect_corners(frame).shape
    (4, 2)
    """
    options = knobs.corners(max_corners, quality, min_distance)
    frame = _checks.frame("frame", frame)
    return _core.detect_corners(frame, _checks.mask_or_none("mask", mask, frame.shape), *options, 3, None, False)[0]


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
        options = knobs.tracking(
            window_size=window_size,
            levels=levels,
            max_displacement=max_displacement,
            max_iterations=max_iterations,
            epsilon=epsilon,
            illumination=illumination,
            max_forward_backward=max_forward_backward,
            deformation=deformation,
        )
        self._options = (options, *knobs.corners(max_corners, quality, min_distance))
        self._tracker = _core.PointTracker(*self._options)
        fixed = _checks.mask_or_none("mask", mask)
        self._mask = None if fixed is None else fixed.copy()
        self._table = TrackTable() if _checks.flag("record", record) else None
        self._frame = 0
        self._t_s = math.nan

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
