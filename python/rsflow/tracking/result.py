"""What is known of points in a frame: their status, position and motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks, _display
from .._results.status import Status

__all__ = ["PointStatus", "Tracks"]


class PointStatus(Status):
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

    TRACKED = 0, "Tracked: position and covariance hold."
    OUT_OF_FRAME = 1, "The point is, or went, outside of the frame."
    LOW_TEXTURE = 2, "The window has too little texture, or only along one direction, to say where it went."
    NOT_CONVERGED = 3, "The steps did not come to rest, or went further than `max_displacement`."
    HIGH_RESIDUAL = (
        4,
        "What was found does not look like what was sought; or nine in ten of many points are lost, and no neighbour "
        "moves like this one.",
    )
    FORWARD_BACKWARD = 5, "Tracked back, the point did not return to where it came from."
    MASKED = 6, "A mask excludes the point, or where it went."
    NOT_FINITE = 7, "A coordinate of the point is NaN or infinite."
    NEW = 8, "Found in this frame by a `PointTracker`: it has a position, but no motion yet."
    LOW_SUPPORT = (
        9,
        "Fewer than an eighth of the window's pixels count in both frames: others are outside, masked, not finite.",
    )
    AMBIGUOUS = (
        10,
        "The texture repeats: another displacement explains the window as well, is not longer than `max_displacement`, "
        "and nothing around the window (the end of the pattern, a stain, what else moves with it) tells which one it "
        "was.",
    )


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
    >>> tracks.valid.tolist(), tracks.status_names.tolist()
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

    @property
    def status_names(self) -> NDArray[np.str_]:
        """The statuses by name, shape (N,).

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> rsflow.track_points(pair.prev, pair.next, [(48, 32), (500, 10)]).status_names.tolist()
        ['TRACKED', 'OUT_OF_FRAME']
        """
        return np.array([status.name for status in PointStatus])[self.status]

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Give the points as columns of equal length, for ``pandas.DataFrame``: a row for each.

        Returns
        -------
        dict of str to ndarray
            ``id, age, x_px, y_px, dx_px, dy_px, std_x_px, std_y_px, residual, status``: position, motion since the
            frame before, standard deviations of the position, residual in grey levels and the status in lower case.
            What was not measured is NaN.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> table = rsflow.track_points(pair.prev, pair.next, [(48, 32), (500, 10)]).to_table()
        >>> table["dx_px"].round(1).tolist(), table["status"].tolist()
        ([2.0, nan], ['tracked', 'out_of_frame'])
        """
        motion = self.displacement
        deviation = np.sqrt(self.covariance[:, [0, 1], [0, 1]])
        deviation[~np.isfinite(deviation)] = np.nan
        return {
            "id": self.ids,
            "age": self.ages,
            "x_px": self.points[:, 0],
            "y_px": self.points[:, 1],
            "dx_px": motion[:, 0],
            "dy_px": motion[:, 1],
            "std_x_px": deviation[:, 0],
            "std_y_px": deviation[:, 1],
            "residual": self.residual,
            "status": np.array([status.word for status in PointStatus])[self.status],
        }

    def draw(self, frame: NDArray[Any]) -> NDArray[np.uint8]:
        """Draw the points over the newer frame: a disc each, and a line from where it was in the older one.

        Parameters
        ----------
        frame : ndarray, shape (height, width) or (height, width, 3)
            What to draw on, grey or blue, green, red; it stays as it is.

        Returns
        -------
        ndarray of uint8, shape (height, width, 3)
            Blue, green, red. A point of a `PointTracker` has the same colour in every frame; points without a position
            are left out.

        Raises
        ------
        ShapeError, DTypeError
            If it is no picture.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, size=(96, 64), seed=1)
        >>> tracks = rsflow.track_points(pair.prev, pair.next, [(48, 32), (70, 20)])
        >>> picture = tracks.draw(pair.next)
        >>> picture.shape, bool((picture[31, 50] != pair.next[31, 50]).any())
        ((64, 96, 3), True)
        """
        from ..plotting.points import draw_points

        return draw_points(_checks.picture("frame", frame), self.points, self.origins, self.ids)

    def _repr_html_(self) -> str:
        known = self.points[np.isfinite(self.points).all(axis=1)]
        if len(known) == 0:
            return _display.html(repr(self), None)
        from ..plotting.points import draw_points

        # The frame is not kept: a dark ground that reaches from the corner of the picture to the last of the points.
        width, height = (np.clip(known.max(axis=0), 1, 8191) + 9).astype(int)
        ground = np.full((height, width), 24, np.uint8)
        return _display.html(repr(self), draw_points(ground, self.points, self.origins, self.ids))

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        names = [status.name.lower() for status in PointStatus]
        counts = np.bincount(self.status, minlength=len(names))
        told = ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True) if count)
        moved = np.hypot(*self.displacement[self.valid].T)
        median = f"; median motion {float(np.median(moved)):.2f} px" if len(moved) else ""
        return f"Tracks({len(self)} points: {told or 'none'}{median})"
