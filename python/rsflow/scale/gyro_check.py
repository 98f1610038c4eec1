"""A clip of a camera that turns in place against a gyro: all figures, what is wrong, and what cannot be told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from . import words
from .axes import ordered
from .estimate import UNKNOWN, Estimate, estimated, in_unit
from .gyro_fit import (
    BIAS,
    DELAY,
    LEAST_CHANGE,
    LOG_FOCAL,
    MOUNT,
    ROWS,
    GyroFit,
    GyroState,
    fit_gyro,
)
from .gyro_search import Alignment, search
from .pairs import Pair
from .picture_alone import focal_of_picture, off_centre, sideways
from .rate_log import RateLog
from .result import ScaleCheck, ScaleStatus, corrected
from .rotation_fit import Turns, fit_turns

__all__ = ["GyroQuestion", "check_against_gyro"]

F64 = NDArray[np.float64]

# Fewer pairs cannot be told from chance.
_LEAST_PAIRS = 16
# Pixels a frame below which a clip counts as still.
_LEAST_TURN_PX = 0.2
# Correlation of the camera's and the gyro's rates below which they do not belong together.
_LEAST_MATCH = 0.8
# What is left of the turns, as a share of their power, that only noise may leave, and how many times its own.
_MOST_LEFT, _NOISES = 0.05, 5.0
# Blocks of the clip for what the pictures say alone.
_BLOCKS = 10
# Degrees in a radian, within which factor a log in degrees a second is found out.
_DEGREES, _FACTOR = 180 / np.pi, 1.4
# Deviations above which a figure counts as unknown: relative, radians, frames, frames, share of the prior.
_FOCAL_KNOWN, _MOUNT_KNOWN, _DELAY_KNOWN, _READOUT_KNOWN, _BIAS_KNOWN = 0.15, 0.1, 0.7, 0.3, 0.7
# Errors that all points share, of a frame's displacement, in pixels: of sampling, and of the pixel's shape.
_COMMON_PX = 0.01
# Power along an axis over the noise's from which its direction counts as seen.
_SEEN = 50.0
# Movement, as a share of the turn, that is told; that no figure survives.
_MOVED, _MOVED_FAR = 0.02, 0.2
# How far off the axis the lens must seem to be to be told, in distances and as pixels between two frames; and how many
# times as much hides in the focal length.
_OFF_CENTRE, _OFF_PX, _HIDDEN = 0.005, 0.05, 4.0
# Side in pixels from which a picture is fine enough to tell that.
_FINE_PX = 100
# Error of the mounting that coarser ones leave.
_COARSE_RAD = 0.005
# Deviation of the focal length from a lens that is off the axis by so little that nothing shows it.
_CARE = 0.004
# Relative difference of two focal lengths that is told.
_APART = 0.01


@dataclass(frozen=True)
class GyroQuestion:
    """What was stated: `nominal` (3, 3) makes of the log's rates the camera's."""

    nominal: F64
    readout_s: float
    bias_std_rad_s: float
    max_delay_s: float


def check_against_gyro(
    pairs: Sequence[Pair], camera: Camera, log: RateLog, question: GyroQuestion, frames: int
) -> ScaleCheck:
    """Check focal length, axes, mounting, delay and readout time, from followed points and a gyro's rates."""
    empty = ScaleCheck(ScaleStatus.CHECKED, "gyro", frames=frames, n_pairs=len(pairs))
    if len(pairs) < _LEAST_PAIRS:
        return replace(empty, status=ScaleStatus.TOO_FEW_FRAMES)
    turns, fitted = fit_turns(pairs, camera)
    pairs = [pair for pair, good in zip(pairs, fitted, strict=True) if good]
    empty = replace(empty, n_pairs=len(pairs))
    still = float(np.median([_moved_px(pair) for pair in pairs])) if pairs else np.nan
    if len(pairs) < max(_LEAST_PAIRS, 0.3 * len(fitted)):
        status = ScaleStatus.NOT_TURNING if len(fitted) >= 2 * _LEAST_PAIRS else ScaleStatus.TOO_FEW_FRAMES
        return replace(empty, status=status)
    if max(still, float(np.sqrt((turns.turn_rad**2).sum(axis=1).mean())) * camera.fx) < _LEAST_TURN_PX:
        return replace(empty, status=ScaleStatus.NO_MOTION)
    found = search(turns, log, question.nominal, max_delay_s=question.max_delay_s, bias_std=question.bias_std_rad_s)
    if found is None:
        return replace(empty, status=ScaleStatus.NO_OVERLAP)
    if found.match < _LEAST_MATCH:
        return _apart(empty, turns, camera, question)
    units: list[str] = []
    if _FACTOR > found.scale * _DEGREES > 1 / _FACTOR:
        log, units = log.scaled(1 / _DEGREES), ["the gyro's rates are in degrees a second, not in radians a second"]
        found = replace(found, scale=found.scale * _DEGREES)
    start = GyroState(float(np.log(np.clip(found.scale, 0.25, 4.0))), found.rotation, found.delay_s, np.zeros(3), 0.0)
    fit = fit_gyro(pairs, camera, log, start, turns, bias_std=question.bias_std_rad_s)
    left = float((fit.residual_rad**2).sum()) / float((fit.turns.turn_rad**2).sum())
    samples = max(float(np.median(fit.turns.dt_s)) / log.step_s, 1.0)
    if left > 1 - _LEAST_MATCH**2 or (left > _MOST_LEFT and fit.gyro_std_rad_s > _NOISES * log.noise / samples**0.5):
        return _apart(empty, turns, camera, question)
    return _Judged(fit, found, camera, log, question).result(empty, units)


def _apart(empty: ScaleCheck, turns: Turns, camera: Camera, question: GyroQuestion) -> ScaleCheck:
    """Say that gyro and picture do not go together, and why where the picture tells."""
    moved, kind = _moved(turns, camera, 0.0)
    if moved > _MOVED_FAR:
        return replace(empty, status=ScaleStatus.NOT_TURNING, findings=(kind,))
    told = f"no delay up to {question.max_delay_s:g} s brings the gyro and the picture together"
    return replace(empty, status=ScaleStatus.NO_MATCH, findings=(told,))


def _moved_px(pair: Pair) -> float:
    return float(np.median(np.linalg.norm(pair.after - pair.before, axis=1)))


def _moved(turns: Turns, camera: Camera, own_std: float) -> tuple[float, str]:
    """How far the camera moved, as a share of its turn, or how far the picture's perspective is off; in words."""
    alone = focal_of_picture(turns, _BLOCKS)
    away, std = (0.0, 0.0) if alone is None else alone
    way, noise = sideways(turns, away)
    # What the points of a pair share is as good as one point.
    noise = noise * np.hypot(1.0, turns.shared_px / turns.std_px * turns.n_points**0.5)[:, None]
    turned = float(np.sqrt((turns.turn_rad**2).sum(axis=1).mean()))
    chance = float(((way / noise) ** 2).mean())
    size = float(np.sqrt(max(float(((way**2 - noise**2).sum(axis=1)).mean()), 0.0)))
    sure = chance > 1 + 4 * np.sqrt(2 / way.size) and size * camera.fx > 5 * _COMMON_PX
    share = size / max(turned, 1e-12)
    if sure and share > _MOVED:
        return max(share, abs(away)), (
            f"the camera does not turn in place: beside turning the picture shifts as if the camera were moved by "
            f"{100 * share:.0f} % of its distance from the scene a radian, or the lens distortion is another"
        )
    arm, arm_std = off_centre(turns, sideways(turns)[0])
    fine = min(camera.width, camera.height) >= _FINE_PX
    shifted_px = arm * turned * camera.fx
    if fine and arm > max(4 * arm_std, _OFF_CENTRE) and shifted_px > _OFF_PX + 4 * float(np.median(turns.shared_px)):
        return _HIDDEN * arm, (
            "the camera does not turn about its own centre (the picture shifts as if the lens were off the axis by "
            f"{100 * arm:.1f} % of its distance from the scene or more), the gyro's scale is off, or the lens "
            "distortion is another"
        )
    if abs(away) > max(3 * float(np.hypot(std, own_std)), _APART):
        return abs(away), (
            f"the picture's own perspective says a focal length {100 * abs(away):.1f} % "
            f"{'longer' if away > 0 else 'shorter'} than the gyro does: the gyro's scale is off, the camera does "
            "not turn about its own centre, or the lens distortion is another"
        )
    return 0.0, ""


@dataclass(frozen=True, eq=False)
class _Judged:
    """A fit, and what of it can be told."""

    fit: GyroFit
    found: Alignment
    camera: Camera
    log: RateLog
    question: GyroQuestion

    def result(self, empty: ScaleCheck, findings: list[str]) -> ScaleCheck:
        """Put figures and words together."""
        fit, state = self.fit, self.fit.state
        std = np.sqrt(np.diag(fit.covariance))
        moved, kind = _moved(fit.turns, self.camera, float(std[LOG_FOCAL]))
        if moved > _MOVED_FAR:
            return replace(empty, status=ScaleStatus.NOT_TURNING, findings=(kind,), n_pairs=len(fit.turns))
        findings = [*findings, *([kind] if kind else [])]
        dt = float(np.median(fit.turns.dt_s))
        std[MOUNT] = np.maximum(std[MOUNT], self._least_mount_std())
        std = np.hypot(std, self._shared())
        if moved > _MOVED:
            # What the camera moved looks like a turn that the gyro does not show.
            std[MOUNT] = np.hypot(std[MOUNT], moved)
        order, rest = ordered(self.question.nominal.T @ state.rotation)
        rest = self.question.nominal @ rest
        axes = self._axes(order)

        delay, why = self._delay(std[DELAY], dt)
        readout = estimated(
            state.readout_s,
            float(std[ROWS]) if fit.change >= LEAST_CHANGE else np.inf,
            blocks=fit.blocks,
            unit="s",
            most_std=_READOUT_KNOWN * dt,
        )
        ratio = self._focal(std[LOG_FOCAL], moved, readout)
        mounting = [
            estimated(float(angle), float(s), blocks=fit.blocks, unit="rad", most_std=_MOUNT_KNOWN)
            for angle, s in zip(rest, std[MOUNT], strict=True)
        ]
        own = np.sqrt(np.diag(state.rotation.T @ fit.covariance[BIAS, BIAS] @ state.rotation))
        own = np.hypot(own, self._shared()[BIAS]) if moved <= _MOVED else np.full(3, np.inf)
        most = _BIAS_KNOWN * self.question.bias_std_rad_s
        bias = [
            estimated(float(b), float(s), blocks=fit.blocks, unit="rad/s", most_std=most)
            for b, s in zip(state.rotation.T @ state.bias_rad_s, own, strict=True)
        ]
        focal = in_unit(ratio, self.camera.fx, "px")
        findings += words.axes_words(axes)
        findings += words.focal_words(ratio, focal, self.camera.fx)
        findings += words.mounting_words(mounting, "gyro")
        findings += words.delay_words(delay, "gyro")
        findings += words.readout_words(readout, self.question.readout_s)
        findings += words.bias_words(bias)
        untold = self._untold(ratio, axes, mounting, readout) + why
        proper = "?" not in axes and np.linalg.det(order) > 0 and all(angle.known for angle in mounting)
        return replace(
            empty,
            focal_px=focal,
            focal_ratio=ratio,
            axes=axes,
            mounting_rad=(mounting[0], mounting[1], mounting[2]),
            delay_s=delay,
            readout_s=readout,
            bias_rad_s=(bias[0], bias[1], bias[2]),
            findings=tuple(findings),
            untold=tuple(untold),
            n_pairs=len(fit.turns),
            camera=corrected(self.camera, ratio),
            R_body_from_camera=state.rotation.T if proper else np.full((3, 3), np.nan),
        )

    def _shared(self) -> F64:
        """Deviations of the unknowns from errors that all points share, as if these were one."""
        turns = self.fit.turns
        # A turn about the optical axis moves points by their distance from it.
        reach = 0.3 * float(np.hypot(self.camera.width / self.camera.fx, self.camera.height / self.camera.fy))
        rise = np.diff(turns.rate_rad_s, axis=0) * (1.0, 1.0, reach)
        # Pixels that a second of delay moves the picture by between two frames; of readout, as its rows see it.
        moves = float(np.sqrt((rise**2).sum(axis=1).mean())) * self.camera.fx + 1e-9
        shared = np.zeros(len(self.fit.prior_std))
        error_px = float(np.median(turns.shared_px))
        turned = float(np.sqrt((turns.turn_rad**2).sum(axis=1).mean())) * self.camera.fx
        shared[MOUNT] = 0.5 * error_px / max(turned, 1e-9)
        if min(self.camera.width, self.camera.height) < _FINE_PX:
            shared[MOUNT] = np.hypot(shared[MOUNT], _COARSE_RAD)
        shared[DELAY] = error_px / moves
        shared[ROWS] = np.hypot(error_px / (0.29 * moves), 0.003 * self.fit.state.readout_s)
        shared[BIAS] = error_px / (self.camera.fx * float(np.median(turns.dt_s)))
        return shared

    def _focal(self, std: float, moved: float, readout: Estimate) -> Estimate:
        """Ratio of the focal lengths; what the camera moved sideways is as much of an error.

        Where the readout time is unknown, up to the time between frames, points that go from row to row are that much
        longer or shorter on their way.
        """
        turn = self.fit.turns.turn_rad
        across = float(np.sqrt((turn[:, :2] ** 2).sum(axis=1).mean())) * self.camera.fx
        ratio = float(np.exp(self.fit.state.log_focal))
        if not readout.known:
            rows = float(np.sqrt((turn[:, 0] ** 2).mean())) * self.camera.fy / (self.camera.height - 1)
            std = float(np.hypot(std, 0.5 * rows))
        common = max(_COMMON_PX, float(np.median(self.fit.turns.shared_px)))
        std = float(np.sqrt(std**2 + (common / max(across, 1e-9)) ** 2 + moved**2 + _CARE**2))
        return estimated(ratio, ratio * std, blocks=self.fit.blocks, most_std=_FOCAL_KNOWN)

    def _delay(self, std: float, dt: float) -> tuple[Estimate, list[str]]:
        """Give the delay, or why it cannot be told."""
        change = self.fit.change
        if self.found.rivals:
            other = " or ".join(f"{1e3 * rival:.0f}" for rival, _ in self.found.rivals[:3])
            return UNKNOWN, [
                f"the delay: the motion is too even or repeats, and {1e3 * self.found.delay_s:.0f} ms explains it no "
                f"better than {other} ms: turn to and fro, irregularly"
            ]
        delay = UNKNOWN
        if change >= LEAST_CHANGE:
            delay = estimated(
                self.fit.state.delay_s, std / change**0.5, blocks=self.fit.blocks, unit="s", most_std=_DELAY_KNOWN * dt
            )
        if delay.known:
            return delay, []
        return delay, ["the delay: the rate hardly changes: turn to and fro, irregularly"]

    def _power(self, rate: F64) -> tuple[F64, float]:
        """Sum up products (3, 3) of rates beyond what noise and an unknown bias make of them; the noise's variance."""
        left = self.fit.residual_rad / self.fit.turns.dt_s[:, None]
        noise = float(np.median(left**2)) / 0.455 + 1e-10
        mean = rate.mean(axis=0)
        steady = max(0.0, 1 - (3 * self.question.bias_std_rad_s) ** 2 / max(float((mean**2).max()), 1e-12))
        power = (rate - mean).T @ (rate - mean) + len(rate) * steady * np.outer(mean, mean)
        values, vectors = np.linalg.eigh(power)
        values = np.maximum(values - noise * (len(rate) + 4 * (2 * len(rate)) ** 0.5), 0)
        return (vectors * values) @ vectors.T, noise

    def _least_mount_std(self) -> F64:
        """Deviations of the mounting that the turns allow: none about an axis that all of them were about."""
        power, noise = self._power(self.fit.turns.rate_rad_s)
        # Before the clip, within a radian.
        known = np.trace(power) * np.eye(3) - power + noise * np.eye(3)
        std = np.sqrt(np.diag(np.linalg.inv(known)) * noise)
        for _, rotation in self.found.rivals:
            if np.trace(rotation @ self.found.rotation.T) < 3 - _MOUNT_KNOWN**2:
                return np.full(3, np.inf)
        return np.asarray(std)

    def _axes(self, order: F64) -> tuple[str, str, str]:
        """For each axis of the body, the axis of the log that is it; one that did not turn by itself is not seen."""
        turns, state = self.fit.turns, self.fit.state
        rate = self.log.turn(turns.start_s + state.delay_s, turns.stop_s + state.delay_s)[0] / turns.dt_s[:, None]
        power, noise = self._power(rate)
        seen = 1 / np.diag(np.linalg.inv(power + 1e-9 * np.eye(3))) > _SEEN * noise
        others = [ordered(self.question.nominal.T @ rotation)[0] for _, rotation in self.found.rivals]
        names = []
        for k, row in enumerate(order):
            at = int(np.argmax(np.abs(row)))
            agreed = all(other[k, at] == row[at] for other in others)
            names.append(f"{'+' if row[at] > 0 else '-'}{'xyz'[at]}" if seen[at] and agreed else "?")
        return names[0], names[1], names[2]

    def _untold(
        self, ratio: Estimate, axes: Sequence[str], mounting: Sequence[Estimate], readout: Estimate
    ) -> list[str]:
        untold = []
        if not ratio.known:
            untold.append("the focal length: hardly any turn about the camera's x or y axis: pan and tilt")
        unseen = [name for name, of in zip("xyz", axes, strict=True) if of == "?"]
        if unseen:
            untold.append(f"which axis of the log is {' and '.join(unseen)}: no turn about it apart from the others")
        turned = [name for name, angle in zip("xyz", mounting, strict=True) if not angle.known]
        if turned:
            untold.append(f"the mounting about {' and '.join(turned)}: turn about another axis as well")
        if not readout.known:
            untold.append("the readout time: the rate hardly changes within a frame: turn to and fro, faster")
        return untold
