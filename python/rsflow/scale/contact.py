"""Time to contact: when a camera reaches the plane before it, from how that grows; no length is needed."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks
from .._display import measured, options
from .._results.status import Status
from ..camera import Camera
from ..errors import ShapeError
from .pairs import follow
from .plane_motion import PlaneMotion, fit_plane_motion

__all__ = ["Contact", "ContactStatus", "TimeToContact", "time_to_contact"]

F64 = NDArray[np.float64]

# By how much of itself the distance should become less between the two pictures that are compared: enough to be
# measured, little enough for windows that do not grow.
_CLOSED = 0.08
# Pixels that points may move between them, as a share of the picture's width.
_MOVED = 0.15
# Deviations from which a distance surely grows or shrinks.
_SURE = 3.0
# Focal length that is assumed without a camera, in widths of the picture, and the factor it may be wrong by.
_FOCAL, _FACTOR = 0.9, 1.6
# Lens distortion, as k1, that is taken to be possible without a camera; error, relative, that more of it leaves.
_LENS, _DISTORTION = 0.2, 0.02
_LEAST_POINTS = 12


class ContactStatus(Status):
    """What became of a time to contact.

    Examples
    --------
    >>> import rsflow
    >>> print(rsflow.ContactStatus.RECEDING, rsflow.ContactStatus.OK.valid)
    RECEDING True
    """

    OK = 0, "The distance shrinks: the time holds."
    FIRST_FRAME = 1, "There is no frame before this one."
    NOT_APPROACHING = 2, "The distance does not shrink by more than noise: contact is not before `low_s`."
    RECEDING = 3, "The distance grows."
    TOO_FEW_POINTS = 4, "Too few points could be followed."
    INCONSISTENT = 5, "Fewer than half of the points move as one plane does."
    TIME_NOT_INCREASING = 6, "The frame is not later than the one before."
    REPEATED_FRAME = 7, "The picture is the one before, to the last grey level."


@dataclass(frozen=True)
class Contact:
    """When the camera reaches the plane that it sees, if it goes on as it does.

    Attributes
    ----------
    t_s : float
        Time of the frame, from which the time to contact counts.
    time_to_contact_s : float
        Distance to the plane over the speed at which it shrinks; infinite where it does not, NaN where not measured.
    std_s : float
        Its standard deviation; infinite where there is none.
    low_s, high_s : float
        The 95 % interval, which is longer upwards: of one over the time. `low_s` holds for `NOT_APPROACHING` too.
    closing_1_s, closing_std_1_s : float
        One over the time to contact, which is also known where there is none: negative where the distance grows.
    divergence_1_s : float
        Of the flow at the optical axis (the middle of the picture without a camera): how fast areas there grow. For a
        plane square to the axis that is approached along it: twice `closing_1_s`.
    status : ContactStatus
    n_points : int
        That move as one plane does.
    baseline_s : float
        Time between the two pictures that were compared.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=2, height_m=1.0, velocity_m_s=(0.0, 0.0, 1.0), seed=1)
    >>> contact = rsflow.time_to_contact(*flight.images, 1 / 30)
    >>> contact.valid, round(contact.time_to_contact_s, 1)
    (True, 1.0)
    """

    t_s: float
    time_to_contact_s: float
    std_s: float
    low_s: float
    high_s: float
    closing_1_s: float
    closing_std_1_s: float
    divergence_1_s: float
    status: ContactStatus
    n_points: int
    baseline_s: float

    def __repr__(self) -> str:
        if not self.valid:
            return f"Contact(t={self.t_s:.6g} s, {self.status}: {self.status.explanation})"
        told = measured(self.time_to_contact_s, self.std_s)
        return f"Contact(t={self.t_s:.6g} s, in {told} s, {self.n_points} points, {self.status})"

    @property
    def valid(self) -> bool:
        """Whether there is a time: the status is `OK`."""
        return self.status is ContactStatus.OK

    def to_dict(self) -> dict[str, float | int | str]:
        """Give it as a row, for ``pandas.DataFrame`` a list of such."""
        row = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return row | {"status": self.status.word}


def time_to_contact(
    prev: NDArray[Any],
    next: NDArray[Any],
    dt_s: float,
    *,
    camera: Camera | None = None,
    rate_rad_s: ArrayLike | None = None,
    rate_std_rad_s: float = 0.01,
    mask: NDArray[np.bool_] | None = None,
) -> Contact:
    """When the camera reaches the plane that fills the picture, from two pictures.

    The plane may be slanted, the camera may move sideways and turn; the turn is fitted where no rate is given. What
    counts is how the distance to the plane shrinks, which two views of a plane tell without any length [1]_. A stream
    of frames is better given to `TimeToContact`, which compares pictures far enough apart.

    Parameters
    ----------
    prev, next : ndarray, shape (height, width)
        Grey frames of the same size and type: uint8, uint16 or float32.
    dt_s : float
        Time between them.
    camera : Camera, optional
        Without one, a focal length from half to one and a half of the picture's width is taken to be possible, and the
        lens's distortion is fitted. What that leaves is in the deviation: little for a plane square to the way.
    rate_rad_s : (3,) array_like, optional
        Mean angular rate of the camera between the frames, in its own axes; fitted where not given.
    rate_std_rad_s : float, optional
        Its standard deviation.
    mask : ndarray of bool, shape (height, width), optional
        True where a pixel counts: on the plane, if it does not fill the picture.

    Returns
    -------
    Contact

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If an argument does not fit; the message says which and how.

    References
    ----------
    .. [1] D. Lee, "A theory of visual control of braking based on information about time-to-collision", Perception
       1976, https://doi.org/10.1068/p050437; O. Faugeras and F. Lustman, "Motion and structure from motion in a
       piecewise planar environment", IJPRAI 1988, https://doi.org/10.1142/S0218001488000285.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=2, height_m=1.0, velocity_m_s=(0.1, 0.0, 0.5), seed=1)
    >>> contact = rsflow.time_to_contact(*flight.images, 1 / 30, camera=flight.camera)
    >>> round(contact.time_to_contact_s, 1), contact.status.name
    (2.0, 'OK')
    """
    before, after = _checks.pair(prev, next)
    dt_s = _checks.number("dt_s", dt_s, above=0, most=1e9, of="seconds")
    estimator = TimeToContact(camera, rate_std_rad_s=rate_std_rad_s, mask=mask)
    estimator.update(before, 0.0)
    return estimator.update(after, dt_s, rate_rad_s=rate_rad_s)


class TimeToContact:
    """Time to contact over a stream of frames.

    Each frame is compared with an earlier one, so long before that the distance has become some 8 % less where it
    shrinks that fast, up to `longest_baseline_s`: the growth of a picture from one frame to the next is too small to
    measure well.

    Parameters
    ----------
    camera : Camera, optional
        As for `time_to_contact`: not needed, but better where the plane is slanted or the lens distorts.
    rate_std_rad_s : float, optional
        Standard deviation of the rates that `update` is given.
    longest_baseline_s : float, optional
        The longest time between two pictures that are compared. The time to contact is that of the mean speed over
        it: where speed changes, shorter follows sooner.
    mask : ndarray of bool, shape (height, width), optional
        True where a pixel counts.

    Examples
    --------
    >>> import rsflow
    >>> flight = rsflow.synthetic.flight(frames=10, height_m=1.0, velocity_m_s=(0.0, 0.1, 0.5), seed=1)
    >>> estimator = rsflow.TimeToContact(flight.camera)
    >>> for frame in flight:
    ...     contact = estimator.update(frame.image, frame.t_s)
    >>> round(contact.time_to_contact_s, 1), round(contact.t_s + contact.time_to_contact_s, 1)  # at 2 s
    (1.7, 2.0)
    """

    def __init__(
        self,
        camera: Camera | None = None,
        *,
        rate_std_rad_s: float = 0.01,
        longest_baseline_s: float = 0.5,
        mask: NDArray[np.bool_] | None = None,
    ) -> None:
        self.camera = None if camera is None else _checks.instance("camera", camera, Camera, "an rsflow.Camera")
        self.rate_std_rad_s = _checks.number("rate_std_rad_s", rate_std_rad_s, least=0, most=1e3, of="radians a second")
        self.longest_baseline_s = _checks.number(
            "longest_baseline_s", longest_baseline_s, above=0, most=60, of="seconds"
        )
        self.mask = None if mask is None else _checks.mask("mask", mask).copy()
        self._frames: deque[tuple[NDArray[Any], float, F64 | None]] = deque()
        self._last: Contact | None = None
        self._moved_px_s = 0.0

    def __repr__(self) -> str:
        told = options(camera=self.camera is not None, longest_baseline_s=self.longest_baseline_s)
        return f"TimeToContact({told}, {len(self._frames)} frames kept)"

    def reset(self) -> Self:
        """Forget the frames so far, as after a cut."""
        self._frames.clear()
        self._last, self._moved_px_s = None, 0.0
        return self

    def update(self, image: NDArray[Any], t_s: float, *, rate_rad_s: ArrayLike | None = None) -> Contact:
        """Take the next frame.

        Parameters
        ----------
        image : ndarray, shape (height, width)
        t_s : float
            Its time in seconds.
        rate_rad_s : (3,) array_like, optional
            Mean angular rate of the camera since the frame before, in its own axes; NaN where not known.

        Returns
        -------
        Contact
        """
        image = _checks.frame("image", image)
        t_s = _checks.number("t_s", t_s, of="seconds")
        rate = None
        if rate_rad_s is not None:
            given = _checks.array("rate_rad_s", rate_rad_s, (3,), "three rates in radians a second")
            rate = given.astype(np.float64) if np.isfinite(given).all() else None
        self._expect(image)
        if not self._frames:
            self._frames.append((image.copy(), t_s, None))
            return _without(ContactStatus.FIRST_FRAME, t_s)
        newest, before_s, _ = self._frames[-1]
        if not t_s > before_s:
            return _without(ContactStatus.TIME_NOT_INCREASING, t_s)
        if np.array_equal(image, newest):
            return _without(ContactStatus.REPEATED_FRAME, t_s)
        turn = None if rate is None else rate * (t_s - before_s)
        self._frames.append((image.copy(), t_s, turn))
        while self._frames[0][1] < t_s - self.longest_baseline_s * (1 + 1e-9) and len(self._frames) > 2:
            self._frames.popleft()
        contact = self._measured(image, t_s)
        if contact.n_points:
            self._last = contact
        return contact

    def _expect(self, image: NDArray[Any]) -> None:
        if self._frames:
            _checks.pair(self._frames[-1][0], image, ("the frame before", "image"))
        if self.mask is not None:
            _checks.mask("mask", self.mask, image.shape)
        if self.camera is not None and (self.camera.height, self.camera.width) != image.shape:
            expected = f"{self.camera.width} x {self.camera.height}"
            raise ShapeError(
                f"image: got {image.shape[1]} x {image.shape[0]} pixels, expected those of the camera, {expected}: "
                "see Camera.scaled and Camera.cropped"
            )

    def _measured(self, image: NDArray[Any], t_s: float) -> Contact:
        """Compare with the best of the kept frames, and with ever later ones where that fails."""
        place = self._begin(t_s, image.shape[1])
        failed = ContactStatus.TOO_FEW_POINTS
        while place < len(self._frames) - 1:
            found = self._compared(place, image, t_s)
            if isinstance(found, Contact):
                return found
            failed = found
            # Half as long ago.
            place = max(place + 1, (place + len(self._frames) - 1) // 2)
        return _without(failed, t_s)

    def _begin(self, t_s: float, width: int) -> int:
        """Place of the frame to compare with."""
        wanted = self.longest_baseline_s
        if self._last is not None:
            closing = abs(self._last.closing_1_s) + self._last.closing_std_1_s
            wanted = min(wanted, _CLOSED / max(closing, 1e-9), _MOVED * width / max(self._moved_px_s, 1e-9))
        times = np.array([t for _, t, _ in self._frames])[:-1]
        return int(np.argmin(np.abs(t_s - times - wanted)))

    def _compared(self, place: int, image: NDArray[Any], t_s: float) -> Contact | ContactStatus:
        earlier, then_s, _ = self._frames[place]
        dt = t_s - then_s
        before, after, std = follow(earlier, image, self.mask)
        if len(before) < _LEAST_POINTS:
            return ContactStatus.TOO_FEW_POINTS
        turns = [turn for _, _, turn in list(self._frames)[place + 1 :]]
        turn = None
        if all(part is not None for part in turns):
            total = np.sum([part for part in turns if part is not None], axis=0)
            turn = (total, self.rate_std_rad_s * dt)
        motion, extra = self._fitted(before, after, std, turn, image.shape)
        if motion is None:
            return ContactStatus.INCONSISTENT
        self._moved_px_s = float(np.median(np.linalg.norm(after - before, axis=1))) / dt
        closed, sigma = motion.closed, float(np.hypot(motion.closed_std, extra))
        # At the mean speed over the time between the pictures, and the distance at its end.
        rate = closed / (1 - closed) / dt
        rate_std = sigma / (1 - closed) ** 2 / dt
        divergence = float(np.log(max(motion.grown, 1e-12))) / dt
        figures = (rate, rate_std, divergence)
        low = 1 / (rate + 1.96 * rate_std) if rate + 1.96 * rate_std > 0 else np.inf
        if rate > _SURE * rate_std:
            high = 1 / (rate - 1.96 * rate_std)
            status, time, time_std = ContactStatus.OK, 1 / rate, rate_std / rate**2
        else:
            receding = rate < -_SURE * rate_std
            status = ContactStatus.RECEDING if receding else ContactStatus.NOT_APPROACHING
            time, time_std, high = np.inf, np.inf, np.inf
        return Contact(t_s, time, time_std, low, high, *figures, status, motion.n_points, dt)

    def _fitted(
        self, before: F64, after: F64, std: F64, turn: tuple[F64, float] | None, shape: tuple[int, ...]
    ) -> tuple[PlaneMotion | None, float]:
        """Fit the motion, and say what not knowing the camera adds to the deviation of how far the plane came near."""
        if self.camera is not None:
            rays = [np.asarray(self.camera.undistort_points(p, normalized=True), np.float64) for p in (before, after)]
            seen = np.isfinite(rays[0]).all(axis=1) & np.isfinite(rays[1]).all(axis=1)
            focal = float(np.sqrt(self.camera.fx * self.camera.fy))
            return (
                fit_plane_motion(rays[0][seen], rays[1][seen], std[seen] / focal, turn=turn, focal_px=focal),
                0.0,
            )
        middle = np.array([(shape[1] - 1) / 2, (shape[0] - 1) / 2])
        found: list[PlaneMotion] = []
        for factor in (1.0, 1 / _FACTOR, _FACTOR):
            focal = _FOCAL * shape[1] * factor
            motion = fit_plane_motion(
                (before - middle) / focal,
                (after - middle) / focal,
                std / focal,
                turn=turn,
                lens=(0.0, _LENS * factor**2),
                focal_px=focal,
            )
            if motion is None:
                return None, 0.0
            found.append(motion)
        apart = max(abs(motion.closed - found[0].closed) for motion in found[1:])
        return found[0], float(np.hypot(apart, _DISTORTION * found[0].closed))


def _without(status: ContactStatus, t_s: float) -> Contact:
    return Contact(t_s, np.nan, np.inf, 0.0, np.inf, np.nan, np.inf, np.nan, status, 0, np.nan)
