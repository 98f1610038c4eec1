"""The displacement of one window, or of a whole frame, with its covariance.

docs/explanation/algorithms.md, section "Displacement of a window: estimate_shift".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from . import _checks, _core
from ._checks import knobs
from ._display import measured
from ._results.status import Status

__all__ = ["Shift", "ShiftStatus", "estimate_shift"]


class ShiftStatus(Status):
    """Whether a displacement could be measured, and if not, why.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> blank = np.full((60, 60), 90, np.uint8)
    >>> shift = rsflow.estimate_shift(blank, blank)
    >>> print(shift.status, "--", shift.status.explanation)
    NO_TEXTURE -- the window shows no structure that stands out of the noise
    >>> shift.status == rsflow.ShiftStatus.NO_TEXTURE, shift.status.valid, int(shift.status)
    (True, False, 3)
    """

    VALID = 0, "Measured."
    TOO_SMALL = 1, "The window, or what a mask or NaN leave of it, has too few pixels."
    TOO_LITTLE_OVERLAP = 2, "At the displacement found, the frames share too little of the window."
    NO_TEXTURE = 3, "The window shows no structure that stands out of the noise."
    APERTURE = (
        4,
        "The window shows structure in one direction only: motion along it cannot be seen. The displacement across it "
        "is given, with infinite variance along it, unless the structure repeats: see `Shift.direction`.",
    )
    NO_MATCH = (
        5,
        "Nothing in the other frame looks like the window: a scene cut, or motion beyond `max_displacement`.",
    )
    NOT_CONVERGED = 6, "The iteration did not settle."
    AMBIGUOUS = (
        7,
        "The window repeats: another displacement within `max_displacement` explains the frames as well.",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Shift:
    """The displacement of a window from one frame to the next.

    Attributes
    ----------
    dx, dy : float
        Displacement in pixels, x to the right and y down; NaN where not measured. Where the window deforms it is that
        of the centre of the window in `prev`.
    covariance : ndarray of float64, shape (2, 2)
        Covariance of (dx, dy) in square pixels; infinite where not measured.
    gain, offset : float
        ``next = gain * prev + offset`` on average over the window, offset in grey levels; NaN where not valid.
    residual : float
        Root mean square of ``next - prev`` after motion and light, in grey levels; NaN where not valid.
    status : ShiftStatus
        Whether the displacement could be measured, and if not, why.
    direction : ndarray of float64, shape (2,)
        Of a window with structure in one direction only (`ShiftStatus.APERTURE`) whose displacement across the
        structure was measured: the unit vector (x, y) across it. `dx` and `dy` are then the displacement along this
        vector, the smallest that explains the frames, and `covariance` is infinite along the structure. NaN otherwise.
    direction_variance : float
        Variance of the displacement along `direction`, in square pixels; infinite without one.
    gradient : ndarray of float64, shape (2, 2)
        ``[[du/dx, du/dy], [dv/dx, dv/dy]]`` with ``deformation="affine"``: what was (x, y) from the centre of the
        window in `prev` moved by ``(dx, dy) + gradient @ (x, y)``. Zero without it; NaN where not measured.
    joint_covariance : ndarray of float64, shape (6, 6)
        Covariance of (dx, dy, du/dx, du/dy, dv/dx, dv/dy), in pixels and pixels per pixel; zero for the gradient
        without ``deformation="affine"``; infinite where not measured.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> blank = np.full((60, 60), 128, np.uint8)
    >>> shift = rsflow.estimate_shift(blank, blank)
    >>> shift.valid, shift.status.name, shift.dx, float(shift.covariance[0, 0])
    (False, 'NO_TEXTURE', nan, inf)
    """

    dx: float
    dy: float
    covariance: npt.NDArray[np.float64]
    gain: float
    offset: float
    residual: float
    status: ShiftStatus
    direction: npt.NDArray[np.float64]
    direction_variance: float
    gradient: npt.NDArray[np.float64]
    joint_covariance: npt.NDArray[np.float64]

    def __repr__(self) -> str:
        if self.valid:
            dx, dy = (measured(value, math.sqrt(self.covariance[k, k])) for k, value in enumerate((self.dx, self.dy)))
            light = f"gain={self.gain:.4g}, offset={self.offset:.4g}, residual={self.residual:.3g}"
            return f"Shift(dx={dx}, dy={dy} px, {light}, {self.status})"
        if math.isfinite(self.direction_variance):
            x, y = self.direction
            along = measured(self.dx * x + self.dy * y, math.sqrt(self.direction_variance))
            return f"Shift({along} px along ({x:.3f}, {y:.3f}) alone, {self.status}: {self.status.explanation})"
        return f"Shift({self.status}: {self.status.explanation})"

    def to_dict(self) -> dict[str, float | str]:
        """Give it as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to float or str
            Displacement, standard deviations and covariance by the names that ``motion.csv`` has; ``du_dx`` and so on
            of `gradient`; the status in lower case. What was not measured is NaN, its deviation infinite.

        Examples
        --------
        >>> import rsflow
        >>> pair = rsflow.synthetic.shifted_pair(2.0, -1.0, seed=1)
        >>> row = rsflow.estimate_shift(pair.prev, pair.next).to_dict()
        >>> round(row["dx_px"], 1), row["status"], list(row)[:4]
        (2.0, 'valid', ['dx_px', 'dy_px', 'dx_std_px', 'dy_std_px'])
        """
        (du_dx, du_dy), (dv_dx, dv_dy) = self.gradient.tolist()
        direction_x, direction_y = self.direction.tolist()
        return {
            "dx_px": self.dx,
            "dy_px": self.dy,
            "dx_std_px": math.sqrt(self.covariance[0, 0]),
            "dy_std_px": math.sqrt(self.covariance[1, 1]),
            "dxdy_cov_px2": float(self.covariance[0, 1]),
            "gain": self.gain,
            "offset": self.offset,
            "residual": self.residual,
            "status": self.status.word,
            "direction_x": direction_x,
            "direction_y": direction_y,
            "direction_std_px": math.sqrt(self.direction_variance),
            "du_dx": du_dx,
            "du_dy": du_dy,
            "dv_dx": dv_dx,
            "dv_dy": dv_dy,
        }

    @property
    def gradient_covariance(self) -> npt.NDArray[np.float64]:
        """Covariance of (du/dx, du/dy, dv/dx, dv/dy), shape (4, 4)."""
        return self.joint_covariance[2:, 2:]

    @property
    def valid(self) -> bool:
        """Whether the displacement was measured."""
        return self.status is ShiftStatus.VALID


_STATUS = tuple(ShiftStatus)


def estimate_shift(
    prev: npt.NDArray[np.generic],
    next: npt.NDArray[np.generic],
    *,
    roi: Sequence[int] | None = None,
    mask: npt.NDArray[np.bool_] | None = None,
    next_mask: npt.NDArray[np.bool_] | None = None,
    illumination: knobs.Illumination = "gain_offset",
    deformation: knobs.ShiftDeformation = "none",
    max_displacement: float | None = None,
) -> Shift:
    """Measure how far a window, or the whole frame, moved from `prev` to `next`.

    Parameters
    ----------
    prev, next : ndarray, shape (height, width)
        Two grey frames of one type: uint8, uint16 or float32. Pixels that are NaN are left out.
    roi : (x, y, width, height), optional
        The window in `prev`, in pixels; the whole frame by default. It says which content is followed: `next` is read
        outside of it as far as the motion goes, so that the shared part does not shrink.
    mask, next_mask : ndarray of bool, shape (height, width), optional
        True where a pixel of `prev`, and of `next`, may be used. A pixel is used where it and its target count; an
        overlay that is fixed to the sensor is given as both.
    illumination : {"gain_offset", "offset", "none"}
        How light may change: ``next = gain * prev + offset``, ``next = prev + offset`` or not at all. Both may vary
        slowly over the window.
    deformation : {"none", "affine"}
        How the window may deform: not at all, or by a displacement that varies linearly over it, as in a turn, a zoom
        or a shear; `Shift.gradient` then says how. With "none" a window that does deform gives the displacement of its
        centre, where a linear motion accounts for all of it, and no gradient.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels: longer ones are not sought, and none is valid. By
        default half the window along each axis. What ends up less than a pixel beyond counts as within. A pattern that
        repeats within this reach is `ShiftStatus.AMBIGUOUS`: below half a period it is measured.

    Returns
    -------
    Shift
        The displacement with its covariance and status. What cannot be measured is NaN with infinite covariance and a
        status that says why; it is never zero.

    Raises
    ------
    DTypeError
        If a frame or `mask` has a type that is not supported, or the frames differ in type.
    ShapeError
        If a frame is not two-dimensional, or sizes differ.
    OptionError
        If `roi` is not four integers or not inside of the frame, or another option is outside of what it allows.

    Notes
    -----
    Least squares after Lucas and Kanade [1]_ on frames that are sampled half a displacement towards each other, with
    the light as further unknowns of each part of the window, from a start found by phase correlation [2]_. Swapping
    the frames negates the result.

    References
    ----------
    .. [1] B. D. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
       IJCAI, 1981.
    .. [2] C. D. Kuglin and D. C. Hines, "The phase correlation image alignment method", Proc. Int. Conf. Cybernetics
       and Society, 1975.

    Examples
    --------
    >>> import numpy as np
    >>> import rsflow
    >>> y, x = np.mgrid[0:60, 0:60].astype(np.float32)
    >>> def scene(x, y):
    ...     return 100 + 40 * np.sin(0.4 * x + 0.005 * y**2) * np.cos(0.3 * y + 0.003 * x**2)
    >>> shift = rsflow.estimate_shift(scene(x, y), 1.2 * scene(x - 2.25, y + 1.5))
    >>> shift.valid, round(shift.dx, 2), round(shift.dy, 2), round(shift.gain, 2)
    (True, 2.25, -1.5, 1.2)
    """
    window = None if roi is None else _checks.region("roi", roi)
    light = knobs.illumination(illumination)
    shape = knobs.shift_deformation(deformation)
    reach = knobs.max_displacement(max_displacement)
    before, after = _checks.pair(prev, next)
    where = _checks.mask_or_none("mask", mask, before.shape)
    where_next = _checks.mask_or_none("next_mask", next_mask, before.shape)
    found, (direction, direction_variance), (gradient, joint_covariance) = _core.estimate_shift(
        before, after, window, where, where_next, light, shape, reach
    )
    dx, dy, covariance, gain, offset, residual, status = found
    # lk-core looks as far along each axis, and gives what is found a pixel more, as here.
    if reach is not None and math.hypot(dx, dy) > reach + 1:
        return Shift(
            dx=math.nan,
            dy=math.nan,
            covariance=np.diag([math.inf] * 2),
            gain=math.nan,
            offset=math.nan,
            residual=math.nan,
            status=ShiftStatus.NO_MATCH,
            direction=np.full(2, math.nan),
            direction_variance=math.inf,
            gradient=np.full((2, 2), math.nan),
            joint_covariance=np.diag([math.inf] * 6),
        )
    return Shift(
        dx=dx,
        dy=dy,
        covariance=covariance,
        gain=gain,
        offset=offset,
        residual=residual,
        status=_STATUS[status],
        direction=np.array(direction),
        direction_variance=direction_variance,
        gradient=gradient,
        joint_covariance=joint_covariance,
    )
