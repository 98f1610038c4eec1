"""What `rsflow.calibrate` gives: a camera, how well it is known, and what would make it better."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from .. import _checks, _display
from ..camera.model import CameraFormat
from . import report
from .figures import Figures
from .views import VIEW_COLUMNS

__all__ = ["Calibration"]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Calibration(Figures):
    """What `calibrate` found.

    Attributes
    ----------
    camera : Camera
        The camera, with the deviations of its parameters in `Camera.std`.
    rms : float
        Root mean square distance between all corners and the model, in pixels.
    views : tuple of View
        Every picture looked at, used or not, in order.
    board : Board
        The board.
    std_views : dict of str to float
        The part of each deviation that comes from the corners' errors, between views and between corners of the board,
        with poses and the shape of the board unknown.
    std_repair : dict of str to float
        The part that comes from corners that had to be set right: how far the parameter moves without that.
    std_model : dict of str to float
        The part of a lens model that does not fit: how far fx, fy, cx and cy move with the one that `doubts` names.
    covariance : (P, P) float64
        Of fx, fy, cx, cy and the distortion coefficients, all parts together.
    tilt_span_rad : float
        Largest angle between the board's normals in two of the used views.
    board_bend_m : float
        Height of the board's bend over its plane, as it was fitted, in metres.
    doubts : tuple of str
        Signs in the residuals that another model would fit: more coefficients, another lens, a rolling shutter; empty
        where they look like noise.

    Examples
    --------
    >>> import rsflow
    >>> camera = rsflow.Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> views = rsflow.synthetic.chessboard_views(camera, count=4)
    >>> found = rsflow.calibrate(views, board=(8, 6), square_size_m=0.025, coefficients=0)
    >>> abs(found.camera.fx - 300) < 4 * found.std["fx"], found.rms < 0.1
    (True, True)
    >>> len(found.used), found.rejected, found.per_view_errors.shape
    (4, {}, (4,))
    >>> found.advice()[0]
    'add views: 4 were used, 10 to 20 make deviations reliable'
    >>> found.summary().split(",")[0], int(found.coverage().sum()), found.to_dict()["rms_px"] == found.rms
    ('camera 320 x 240', 192, True)
    >>> found.to_table()["corners"].tolist()
    [48, 48, 48, 48]
    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     found.save(pathlib.Path(folder, "camera.yml"))
    ...     [path.name for path in found.draw(folder)]
    ['frame-0.corners.png', 'frame-1.corners.png', 'frame-2.corners.png', 'frame-3.corners.png', 'coverage.png']
    """

    def __repr__(self) -> str:
        return report.line(self)

    def _repr_html_(self) -> str:
        return _display.html(repr(self), report.coverage_picture(self))

    def advice(self) -> tuple[str, ...]:
        """Say what would make this calibration better, most important first; empty where nothing would."""
        return report.advice(self)

    def summary(self) -> str:
        """Give the result, its views and the advice as text."""
        return report.summary(self)

    def to_dict(self) -> dict[str, Any]:
        """Give everything but the corners as plain values, for JSON."""
        return report.to_dict(self)

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Give the views as columns of equal length, for ``pandas.DataFrame``: a row for each.

        Returns
        -------
        dict of str to ndarray
            ``name, used, reason, corners, repaired, rms_px, tilt_rad, influence``; see the class for an example.
        """
        return _display.columns((view.to_dict() for view in self.views), VIEW_COLUMNS)

    def save(self, path: str | os.PathLike[str], *, format: CameraFormat | None = None) -> None:
        """Write the camera; see `Camera.save`.

        Parameters
        ----------
        path, format
            As there; the errors are the same.
        """
        self.camera.save(path, format=format)

    def draw(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write a picture of each view with the corners found, and one of the coverage; give their paths.

        Arrows show found minus modelled position, fifty times enlarged. A view without a board is written as it is,
        with the reason.

        Parameters
        ----------
        folder : path
            Made if it is missing.

        Returns
        -------
        list of Path

        Raises
        ------
        OSError
            If a picture cannot be written.
        """
        return report.draw(self, _checks.path("folder", folder))
