"""Focal length, axes, delay, bias and readout time at which a clip's turns are those of a gyro: joint least squares."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._rotation import rotation_matrix
from ..camera import Camera
from .pairs import Pair
from .picture_alone import focal_of_picture
from .rate_log import RateLog
from .rotation_fit import FOCAL, READOUT, TURN, Sweep, Turns, fit_turns

__all__ = [
    "BIAS",
    "DELAY",
    "LEAST_CHANGE",
    "LOG_FOCAL",
    "MOUNT",
    "ROWS",
    "GyroFit",
    "GyroState",
    "fit_gyro",
]

F64 = NDArray[np.float64]

# Unknowns: log of the focal length's ratio, small rotation of the gyro's axes, delay, bias (in the camera's axes), and
# readout time.
LOG_FOCAL, MOUNT, DELAY, BIAS, ROWS = 0, slice(1, 4), 4, slice(5, 8), 8
_COUNT = 9
# What is known of them before: a focal length within a factor, a rotation, a delay of so many frames, readout likewise.
_PRIOR_FOCAL, _PRIOR_MOUNT, _PRIOR_FRAMES = 2.0, 1.0, 20.0
_ROUNDS, _STEPS = 5, 12
# Blocks of the clip of which each is left out once.
_MOST_BLOCKS, _LEAST_IN_BLOCK = 20, 4
# Part of the time between frames, on either side of one, over which the gyro's rate there is taken, at least.
_AROUND = 1 / 6
# Rows of a frame at which its turn is read from the log.
_NODES = 9
# Neighbours on either side that stand for a pair of a steady clip.
_BESIDE = 3
# How far the perspective is trusted: as far as lens distortion is usually known.
_TRUST = 0.01
# Part of the rate's change that must be more than noise for a delay and a readout time to be fitted.
LEAST_CHANGE = 0.3
# Deviations of a pair beyond which it counts less.
_HUBER = 3.0


@dataclass(frozen=True)
class GyroState:
    """Where the fit stands: `rotation` (3, 3) makes of the gyro's rates the camera's."""

    log_focal: float
    rotation: F64
    delay_s: float
    bias_rad_s: F64
    readout_s: float

    def moved(self, step: F64) -> GyroState:
        """Add a step of the unknowns."""
        return GyroState(
            self.log_focal + float(step[LOG_FOCAL]),
            rotation_matrix(step[MOUNT]) @ self.rotation,
            self.delay_s + float(step[DELAY]),
            self.bias_rad_s + step[BIAS],
            self.readout_s + float(step[ROWS]),
        )

    def since(self, other: GyroState) -> F64:
        """Give the step from `other` to this."""
        turn = self.rotation @ other.rotation.T
        small = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        return np.concatenate(
            [
                [self.log_focal - other.log_focal],
                small,
                [self.delay_s - other.delay_s],
                self.bias_rad_s - other.bias_rad_s,
                [self.readout_s - other.readout_s],
            ]
        )


@dataclass(frozen=True, eq=False)
class GyroFit:
    """The fit, the covariance (9, 9) of its unknowns, and what is left.

    Attributes
    ----------
    state : GyroState
    covariance : (9, 9) float64
        Of (log focal, rotation, delay, bias, readout): the larger, for each, of what the noise says and of what leaving
        out blocks of the clip says.
    blocks : int
    turns : Turns
        At the fitted focal length and readout time, of the pairs that the log covers.
    residual_rad : (K, 3) float64
        The camera's turn less the gyro's.
    gyro_std_rad_s : float
        Noise of the gyro's mean rate over an interval that the residuals show.
    prior_std : (9,) float64
        What was known before.
    change : float
        Which part of the change of the gyro's rate from frame to frame is surely no noise.
    """

    state: GyroState
    covariance: F64
    blocks: int
    turns: Turns
    residual_rad: F64
    gyro_std_rad_s: float
    prior_std: F64
    change: float


def scaled_camera(camera: Camera, ratio: float) -> Camera:
    """Give the camera with its focal length multiplied."""
    return replace(camera, fx=camera.fx * ratio, fy=camera.fy * ratio, std={})


def fit_gyro(
    pairs: Sequence[Pair], camera: Camera, log: RateLog, start: GyroState, turns: Turns, *, bias_std: float
) -> GyroFit:
    """Fit all unknowns together, from a start.

    The points of each pair are reduced to a turn and its derivatives, first with the focal length and readout time of
    the start; that is repeated with those that come out.
    """
    dt = float(np.median(turns.dt_s))
    prior = np.full(_COUNT, bias_std)
    prior[LOG_FOCAL], prior[MOUNT], prior[DELAY], prior[ROWS] = _PRIOR_FOCAL, _PRIOR_MOUNT, _PRIOR_FRAMES * dt, dt
    state = start
    chosen = list(pairs)
    gyro_std = 0.0
    steady = _Problem(turns, log, start, prior, 0.0).change(start) < LEAST_CHANGE
    if steady:
        # Noise would be taken for what a delay and a readout time do.
        prior[[DELAY, ROWS]] = 1e-3 * dt
    for _ in range(_ROUNDS):
        before = state
        turns, fitted = fit_turns(
            chosen,
            scaled_camera(camera, float(np.exp(state.log_focal))),
            sweep=_sweep(log, state, turns, _AROUND * dt),
            start=turns,
        )
        chosen = [pair for pair, good in zip(chosen, fitted, strict=True) if good]
        problem = _Problem(turns, log, before, prior, gyro_std, start.delay_s, perspective(turns, before), steady)
        state, gyro_std = problem.solve()
        if float(np.abs(state.since(before) / np.maximum(prior, 1e-9)).max()) < 1e-5:
            break
    problem = replace(problem, gyro_std=gyro_std)
    return _with_deviations(problem, state)


def _sweep(log: RateLog, state: GyroState, turns: Turns, around_s: float) -> Sweep:
    """How the camera turns while the rows of each frame are read, as the log says; nothing outside of it."""
    share = np.linspace(-0.5, 0.5, _NODES)
    frames = np.stack([turns.start_s, turns.stop_s], axis=1).ravel() + state.delay_s
    at = np.repeat(frames, _NODES)
    row = at + np.tile(share, len(frames)) * state.readout_s
    half = max(around_s, 0.5 * abs(state.readout_s))
    covered = np.repeat(log.covers(frames - half, frames + half), _NODES)[:, None]
    bias = log_bias(state)
    angle = (log.turn(at, row)[0] - bias * (row - at)[:, None]) @ state.rotation.T
    # Each row's rate, taken around it for the gyro's noise.
    rate = log.turn(row - around_s, row + around_s)[0] / (2 * around_s) - bias
    grows = (rate * np.tile(share, len(frames))[:, None]) @ state.rotation.T
    shape = (len(turns), 2, _NODES, 3)
    return Sweep(share, np.where(covered, angle, 0.0).reshape(shape), np.where(covered, grows, 0.0).reshape(shape))


def log_bias(state: GyroState) -> F64:
    """Give the bias in the log's own axes."""
    return np.asarray(state.rotation.T @ state.bias_rad_s)


def perspective(turns: Turns, state: GyroState) -> tuple[float, float]:
    """Say what the perspective says of the log of the focal length, and how far that is trusted."""
    alone = focal_of_picture(turns, min(10, len(turns)))
    if alone is None:
        return 0.0, _PRIOR_FOCAL
    return state.log_focal + alone[0], float(np.hypot(alone[1], _TRUST))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Least squares over pairs whose points were reduced at `base`."""

    turns: Turns
    log: RateLog
    base: GyroState
    prior: F64
    gyro_std: float
    begun_s: float = 0.0
    focal: tuple[float, float] = (0.0, _PRIOR_FOCAL)
    steady: bool = False

    def residuals(self, state: GyroState) -> tuple[F64, F64, NDArray[np.bool_]]:
        """Give the camera's turn less the gyro's (K, 3), its derivatives (K, 3, 9), and which pairs the log covers."""
        turns = self.turns
        start, stop = turns.start_s + state.delay_s, turns.stop_s + state.delay_s
        covered = self.log.covers(start, stop)
        angle, twist = self.log.turn(start, stop)
        hand = float(np.sign(np.linalg.det(state.rotation)))
        gyro = (angle + hand * twist) @ state.rotation.T - state.bias_rad_s * turns.dt_s[:, None]
        known = [FOCAL, READOUT]
        # The points' own turn follows the focal length and the readout time by these.
        follows = -np.linalg.solve(turns.normal[:, TURN, TURN], turns.normal[:, TURN, known])
        if self.steady and len(turns) > 2 * _BESIDE:
            follows = _of_neighbours(np.asarray(follows))
        away = np.array([state.log_focal - self.base.log_focal, state.readout_s - self.base.readout_s])
        left = turns.turn_rad + follows @ away - gyro
        columns = np.zeros((len(turns), 3, _COUNT))
        columns[:, :, [LOG_FOCAL, ROWS]] = follows
        # A turn `a` of the axes adds a x gyro.
        x, y, z = (gyro + state.bias_rad_s * turns.dt_s[:, None]).T
        zero = np.zeros_like(x)
        columns[:, :, MOUNT] = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3) * -1.0
        columns[:, :, DELAY] = -self.rise(start, stop) @ state.rotation.T
        columns[:, :, BIAS] = np.eye(3) * turns.dt_s[:, None, None]
        return left, columns, covered

    def rise(self, start: F64, stop: F64) -> F64:
        """How much the gyro's rate rises from frame to frame, (K, 3), each taken around the frame."""
        around = _AROUND * float(np.median(self.turns.dt_s))
        after, before = (self.log.turn(t - around, t + around)[0] for t in (stop, start))
        return (after - before) / (2 * around)

    def change(self, state: GyroState) -> float:
        """Which part of that rise is more than what the gyro's noise makes of it: 0 where all of it is noise."""
        turns = self.turns
        start, stop = turns.start_s + state.delay_s, turns.stop_s + state.delay_s
        rise = self.rise(start, stop)[self.log.covers(start, stop)]
        samples = max(2 * _AROUND * float(np.median(turns.dt_s)) / self.log.step_s, 1.0)
        noise = 6 * self.log.noise**2 / samples
        return max(0.0, 1 - 1.2 * noise / max(float((rise**2).sum(axis=1).mean()), 1e-12)) if len(rise) else 0.0

    def terms(self, state: GyroState) -> tuple[F64, F64, F64, F64]:
        """Give normal matrices (K, 9, 9) and gradients (K, 9) of the pairs, their residuals and these in deviations."""
        left, columns, covered = self.residuals(state)
        noise = np.linalg.inv(self.turns.normal[:, TURN, TURN])
        noise = noise + np.eye(3) * ((self.gyro_std * self.turns.dt_s) ** 2)[:, None, None]
        weight = np.linalg.inv(noise)
        size = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", left, weight, left) / 3, 0))
        trust = np.minimum(1.0, _HUBER / np.maximum(size, 1e-12)) * covered
        weight = weight * trust[:, None, None]
        normal = np.einsum("kia,kij,kjb->kab", columns, weight, columns)
        gradient = np.einsum("kia,kij,kj->ka", columns, weight, left)
        inner, slope = self._within(state)
        # Rows see the gyro's noise as if the camera shook.
        sure = self.change(state) * covered
        normal[:, ROWS, ROWS] += inner * sure
        gradient[:, ROWS] += slope * sure
        return normal, gradient, left, np.where(covered, size, np.nan)

    def _within(self, state: GyroState) -> tuple[F64, F64]:
        """Say what the rows of each pair say of the readout time, its turn apart: information and slope, each (K,)."""
        normal, gradient = self.turns.normal, self.turns.gradient
        mixed = np.linalg.solve(normal[:, TURN, TURN], normal[:, TURN, READOUT, None])[..., 0]
        inner = normal[:, READOUT, READOUT] - np.einsum("ki,ki->k", normal[:, READOUT, TURN], mixed)
        slope = gradient[:, READOUT] - np.einsum("ki,ki->k", gradient[:, TURN], mixed)
        return inner, slope + inner * (state.readout_s - self.base.readout_s)

    def prior_terms(self, state: GyroState) -> tuple[F64, F64]:
        """Give normal matrix and gradient of what was known before; the axes have none but a weak hold."""
        away, prior = np.zeros(_COUNT), self.prior.copy()
        away[BIAS], away[ROWS] = state.bias_rad_s, state.readout_s
        away[DELAY] = state.delay_s - self.begun_s
        away[LOG_FOCAL], prior[LOG_FOCAL] = state.log_focal - self.focal[0], self.focal[1]
        return np.diag(prior**-2), away * prior**-2

    def descend(self, state: GyroState, keep: NDArray[np.bool_] | None = None, steps: int = _STEPS) -> GyroState:
        """Go down to the minimum over the pairs that are kept."""
        for _ in range(steps):
            normal, gradient, _, _ = self.terms(state)
            if keep is not None:
                normal, gradient = normal[keep], gradient[keep]
            held, pull = self.prior_terms(state)
            step = -np.linalg.solve(normal.sum(axis=0) + held, gradient.sum(axis=0) + pull)
            step *= min(1.0, 0.3 / max(float(np.abs(step / self.prior).max()), 1e-12))
            state = state.moved(step)
            if float(np.abs(step / self.prior).max()) < 1e-7:
                break
        return state

    def solve(self) -> tuple[GyroState, float]:
        """Fit, with the noise of the gyro that the residuals show."""
        problem, state = self, self.base
        std = self.gyro_std
        for _ in range(3):
            state = problem.descend(state)
            std = problem.noise(state)
            problem = replace(problem, gyro_std=std)
        return state, std

    def noise(self, state: GyroState) -> float:
        """Deviation of the gyro's mean rates beyond what the points' own noise leaves, in rad/s."""
        left, _, covered = self.residuals(state)
        if covered.sum() < 3:
            return self.gyro_std
        own = np.diagonal(np.linalg.inv(self.turns.normal[:, TURN, TURN]), axis1=1, axis2=2)
        dt = self.turns.dt_s[:, None]
        square = np.median(((left**2 - own) / dt**2)[covered], axis=0)
        # Where noise is normal the median square is 0.455 of the mean one.
        return float(np.sqrt(max(float(square.mean()) / 0.455, 1e-10)))


def _of_neighbours(values: F64) -> F64:
    """Give each pair the mean of its neighbours, itself apart.

    The derivatives of a pair go with its own turn, and so with the noise in that: where turns differ by little else,
    the fit would see its own noise as a wrong focal length.
    """
    padded = np.concatenate([values[1 : _BESIDE + 1][::-1], values, values[-_BESIDE - 1 : -1][::-1]])
    total = np.zeros_like(values)
    for offset in range(-_BESIDE, _BESIDE + 1):
        if offset:
            total += padded[_BESIDE + offset : _BESIDE + offset + len(values)]
    return total / (2 * _BESIDE)


def _with_deviations(problem: _Problem, state: GyroState) -> GyroFit:
    """Add deviations: of the noise, and of leaving out each block of the clip (the jackknife)."""
    normal, _, left, size = problem.terms(state)
    covered = np.isfinite(size)
    held, _ = problem.prior_terms(state)
    own = np.linalg.inv(normal.sum(axis=0) + held)
    count = len(problem.turns)
    blocks = int(np.clip(count // _LEAST_IN_BLOCK, 2, _MOST_BLOCKS))
    edges = np.linspace(0, count, blocks + 1).astype(int)
    steps = []
    for first, last in itertools.pairwise(edges):
        keep = np.ones(count, np.bool_)
        keep[first:last] = False
        steps.append(problem.descend(state, keep, 3).since(state))
    away = np.array(steps) - np.mean(steps, axis=0)
    spread = (blocks - 1) / blocks * away.T @ away
    factor = np.sqrt(np.maximum(np.diag(spread) / np.diag(own), 1.0))
    covariance = own * np.outer(factor, factor)
    return GyroFit(
        state,
        covariance,
        blocks,
        problem.turns.only(covered),
        left[covered],
        problem.gyro_std,
        problem.prior,
        problem.change(state),
    )
