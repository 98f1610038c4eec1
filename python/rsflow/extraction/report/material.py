"""What a report page is made from: what an extraction has gathered, without the extraction."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..answers import Answer
from ..series import Series
from ..settings import ExtractSettings
from ..slides import Slide

if TYPE_CHECKING:
    from ..outputs import Outputs

__all__ = ["Ground", "Material"]

# Gives the scene without what moves as the first frame shows it: from a corner, in a size, at a scale.
Ground = Callable[[tuple[float, float], tuple[int, int], float], "NDArray[np.uint8] | None"]


@dataclass(frozen=True)
class Material:
    """Everything that the page shows.

    Attributes
    ----------
    summary : dict
        As in ``summary.json``.
    answers : sequence of Answer
    series : dict of str to Series
        Of the tables.
    files : dict of str to Path
        That the run has left so far.
    settings : ExtractSettings
    posters : dict of str to bytes
        A JPEG of each view.
    poster_frame : int, optional
    arrow_scale : float
        How many pixels long one pixel of motion is drawn.
    slides : sequence of Slide
    ground : callable, optional
        See `Ground`.
    """

    summary: Mapping[str, Any]
    answers: Sequence[Answer]
    series: Mapping[str, Series]
    files: Mapping[str, Path]
    settings: ExtractSettings
    posters: Mapping[str, bytes]
    poster_frame: int | None = None
    arrow_scale: float = 1.0
    slides: Sequence[Slide] = ()
    ground: Ground | None = None

    @classmethod
    def of(
        cls, outputs: Outputs, summary: Mapping[str, Any], answers: Sequence[Answer], files: Mapping[str, Path]
    ) -> Material:
        """Take what a run has gathered."""
        views = outputs.views
        given = summary, answers, outputs.series, files, outputs.settings
        if views is None:
            return cls(*given, posters={})
        posters = {name: data for name in views.posters if (data := views.jpeg(name)) is not None}
        return cls(*given, posters, views.poster_frame, views.style.scale, views.slides(), views.ground)

    @property
    def still(self) -> bool:
        """Whether the camera stood still."""
        return bool(self.summary["camera_still"])

    @property
    def mounted(self) -> bool:
        """Whether velocities are in the axes of a body that the camera is mounted on."""
        return self.settings.sensors is not None and self.settings.sensors.mount is not None
