"""Everything known about one frame of a live run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .._display import fields

if TYPE_CHECKING:
    from ..extraction.pipeline import Measured
    from .reading import LiveReading

__all__ = ["LiveFrame"]


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """The figures of one frame, with how late they are.

    Attributes
    ----------
    measured : rsflow.extraction.Measured
        The frame with its flow, what moves, velocity, and the rows of the tables.
    reading : LiveReading or None
        Displacement and velocity as numbers; None for a first frame, and for the first one after a gap.
    delay_s : float
        From when the frame came to when its figures were known, in seconds; NaN of a file, which is not waited for,
        and of the first frames, which tell whether the camera moves.
    frame_rate_hz : float
        Frames measured in the last second.
    not_measured : int
        Frames so far that the source gave and nobody was ready for.
    after_gap : bool
        The source was away: nothing is compared with the frame before.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> seen = []
    >>> _ = rsflow.live.watch(flight, on_frame=seen.append)
    >>> [(frame.measured.frame.index, frame.reading is None) for frame in seen]
    [(0, True), (1, False), (2, False)]
    """

    measured: Measured
    reading: LiveReading | None
    delay_s: float
    frame_rate_hz: float
    not_measured: int
    after_gap: bool

    __repr__ = fields
