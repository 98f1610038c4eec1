"""Grids over a sequence: pair by pair, or against the first frame."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._checks.knobs import GridShape, Illumination
from .._shared import Shared, alone, anew
from ..camera import Camera
from .carry import carried
from .data import GridStatus
from .lens import without_distortion
from .measure import displacement_grid
from .result import Grid

__all__ = ["GridSequence", "Reference", "composed"]

Reference = Literal["previous", "first"]


class GridSequence(Shared):
    """Measure frame after frame: each against the one before it, or all against the first.

    Against the first frame a new reference is taken where the correlation has fallen: the frame before is measured from
    then on, and its own displacement is added, node by node where the material has gone.

    Parameters
    ----------
    reference : {"previous", "first"}
        What each frame is compared with: for fluids the one before, for materials the first one.
    renew_below : float
        With ``"first"``: the median correlation below which the frame before becomes the reference, 0 to 1.
    mask : ndarray of bool, shape (height, width), optional
        True where a pixel counts: of every frame with ``"previous"``, of the first one with ``"first"``, where it is
        carried to each new reference by what was measured.
    window_size, step, shape, robust, illumination, max_displacement, scale_m_px, camera
        As `displacement_grid` takes them.
    dt_s : float, optional
        Seconds from one frame to the next. With ``"first"`` a grid's own `dt_s` is the time since the first frame, and
        its velocity the mean one since then.

    Examples
    --------
    >>> import rsflow
    >>> sequence = rsflow.GridSequence(reference="first")
    >>> for strain in (0.0, 0.01, 0.02):
    ...     scene = rsflow.synthetic.speckle_pair(lambda x, y: (strain * x, 0 * y), size=(96, 96), seed=1)
    ...     grid = sequence.update(scene.next)
    >>> bool(abs(grid.strain().xx.mean() - 0.02) < 5e-4), sequence.renewals
    (True, 0)
    """

    def __init__(
        self,
        *,
        reference: Reference = "previous",
        renew_below: float = 0.8,
        window_size: int = 32,
        step: int = 16,
        shape: GridShape = "affine",
        robust: bool = False,
        mask: NDArray[np.bool_] | None = None,
        illumination: Illumination = "gain_offset",
        max_displacement: float | None = None,
        scale_m_px: float | None = None,
        dt_s: float | None = None,
        camera: Camera | None = None,
    ) -> None:
        self._by: Reference = _checks.choice("reference", reference, get_args(Reference))
        self._renew_below = _checks.number("renew_below", renew_below, least=0, most=1)
        self._mask = _checks.mask_or_none("mask", mask)
        self._options: dict[str, Any] = {
            **{"window_size": window_size, "step": step, "shape": shape, "robust": robust},
            **{"illumination": illumination, "max_displacement": max_displacement},
            **{"scale_m_px": scale_m_px},
        }
        self._dt_s = _checks.number_or_none("dt_s", dt_s, above=0, of="seconds")
        self._camera = camera
        # What does not fit is told at once.
        side = max(_checks.integer("window_size", window_size, least=8, most=256, of="pixels"), 1)
        blank = np.zeros((side, side), np.uint8)
        displacement_grid(blank, blank, camera=camera, **self._options)
        self._forget()

    def __repr__(self) -> str:
        return f"GridSequence(reference={self._by!r}, {self._frames} frames, {self.renewals} renewals)"

    def _forget(self) -> None:
        self._frames = 0
        self._reference: NDArray[Any] | None = None
        self._previous: NDArray[Any] | None = None
        # From the first frame to the reference, and to the frame before.
        self._base: Grid | None = None
        self._reference_mask = self._mask
        self._last: Grid | None = None
        self._step: Grid | None = None
        self._renewals = 0

    @anew
    def reset(self) -> None:
        """Begin anew: the next frame is the first one."""
        self._forget()

    @property
    def renewals(self) -> int:
        """How often a new reference was taken."""
        return self._renewals

    @alone
    def update(self, frame: NDArray[Any]) -> Grid | None:
        """Take in the next frame.

        Parameters
        ----------
        frame : ndarray, shape (height, width)
            Grey levels: uint8, uint16 or float32; of the size and type of those before.

        Returns
        -------
        Grid or None
            From the frame before, or from the first one; None for the first frame.
        """
        frame = _checks.frame("frame", frame)
        if self._reference is None:
            if self._mask is not None:
                _checks.mask("mask", self._mask, frame.shape)
            self._reference = self._previous = frame.copy()
            self._frames = 1
            return None
        _checks.pair(self._reference, frame, ("the first frame", "frame"))
        grid = self._against_previous(frame) if self._by == "previous" else self._against_first(frame)
        if self._camera is not None:
            grid = without_distortion(grid, self._camera)
        if self._dt_s is not None:
            grid = dataclasses.replace(grid, dt_s=self._dt_s * (self._frames if self._by == "first" else 1))
        self._frames += 1
        self._previous = frame.copy()
        return grid

    def _against_previous(self, frame: NDArray[Any]) -> Grid:
        assert self._previous is not None
        return displacement_grid(self._previous, frame, mask=self._mask, next_mask=self._mask, **self._options)

    def _against_first(self, frame: NDArray[Any]) -> Grid:
        grid = self._from_reference(frame)
        known = grid.correlation[grid.valid]
        fell = not known.size or float(np.median(known)) < self._renew_below
        if fell and self._step is not None:
            self._base, self._reference, self._step = self._last, self._previous, None
            self._renewals += 1
            if self._mask is not None and self._base is not None:
                self._reference_mask = carried(self._mask, self._base)
            grid = self._from_reference(frame)
        self._step = grid
        self._last = grid if self._base is None else composed(self._base, grid)
        return self._last

    def _from_reference(self, frame: NDArray[Any]) -> Grid:
        assert self._reference is not None
        mask = self._reference_mask
        return displacement_grid(self._reference, frame, initial=self._step, mask=mask, **self._options)


def composed(first: Grid, second: Grid) -> Grid:
    """Add to each node's displacement of `first` what `second` says of the place that it has come to.

    Both variances count; a node is valid where both say something.
    """
    places = np.stack([first.x, first.y], axis=-1).astype(np.float64) + first.raw
    further = second.at(np.where(first.valid[..., None], places, np.nan).reshape(-1, 2))
    rows, columns = first.status.shape
    added = further.displacement.reshape(rows, columns, 2)
    both = first.valid & np.isfinite(added).all(axis=-1)
    status = np.where(first.valid & ~both, np.uint8(GridStatus.NOT_FOUND), first.status)
    one = np.eye(2)
    gradient = (one + further.gradient.reshape(rows, columns, 2, 2)) @ (one + first.gradient) - one
    lost = np.where(np.eye(6, dtype=bool), np.inf, 0.0)
    covariance = first.joint_covariance + further.joint_covariance.reshape(rows, columns, 6, 6)
    return dataclasses.replace(
        first,
        raw=(first.raw + added).astype(np.float32),
        gradient=gradient.astype(np.float32),
        joint_covariance=np.where(both[..., None, None], covariance, lost).astype(np.float32),
        status=status.astype(np.uint8),
        correlation=_nearest(second, places, second.correlation),
        residual=_nearest(second, places, second.residual),
    )


def _nearest(grid: Grid, places: NDArray[np.float64], values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Give the values of the nodes next to places; NaN without one."""
    rows, columns = values.shape
    if not values.size:
        return np.full(places.shape[:2], np.nan, np.float32)
    at = (places - (grid.x[0, 0], grid.y[0, 0])) / grid.step
    known = np.isfinite(at).all(axis=-1)
    column, row = (np.rint(np.where(known, at[..., k], 0.0)).astype(np.int64) for k in range(2))
    found = values[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
    return np.where(known, found, np.float32(np.nan))
