"""A clip of a camera that travels at a known height against its known velocity or speed: joint least squares."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .gyro_search import peers
from .rate_log import RateLog
from .travel import Travel

__all__ = ["SpeedFit", "fit_speed"]

F64 = NDArray[np.float64]

# Unknowns: log of the measured over the known speed, yaw, delay, readout time.
LOG_RATIO, YAW, DELAY, ROWS = range(4)
_PRIOR_RATIO, _PRIOR_YAW, _PRIOR_FRAMES = 2.0, 3.0, 20.0
_STEPS, _SEARCHED = 20, 4
_MOST_BLOCKS, _LEAST_IN_BLOCK = 20, 3
_HUBER = 3.0
_PULL = 1e-3


@dataclass(frozen=True, eq=False)
class SpeedFit:
    """The fit: `value` and `covariance` of (log ratio, yaw, delay, readout).

    `order` (2, 2) makes of the known velocity, turned by the yaw, the measured one; `rivals` are delays that explain
    the clip as well. `residual` (K, m) and `known` (K, m) are what is left, and the known velocity at the fit.
    """

    value: F64
    covariance: F64
    order: F64
    blocks: int
    rivals: tuple[float, ...]
    delay_searched: bool
    residual: F64
    known: F64


@dataclass(frozen=True, eq=False)
class _Problem:
    """`measured` (K, m) against the known velocity of `log`, its first m columns, or against a constant speed."""

    travel: Travel
    measured: F64
    noise: F64
    log: RateLog | None
    speed: float
    order: F64
    prior: F64
    center: F64
    spread: float = 0.0

    def known(self, delay: float) -> tuple[F64, NDArray[np.bool_]]:
        """Mean of what is known over each pair (K, m), and which pairs it covers."""
        travel = self.travel
        if self.log is None:
            return np.full((len(travel), 1), self.speed), np.ones(len(travel), np.bool_)
        start, stop = travel.start_s + delay, travel.stop_s + delay
        way = self.log.turn(start, stop)[0][:, : self.measured.shape[1]]
        return way / travel.dt_s[:, None], self.log.covers(start, stop)

    def terms(self, value: F64) -> tuple[F64, F64, F64, F64, F64]:
        """Give normal matrices (K, 4, 4), gradients, residuals, what is known, and the residuals in deviations."""
        known, covered = self.known(value[DELAY])
        size = self.measured.shape[1]
        turn = _turn(value[YAW]) @ self.order if size == 2 else np.eye(1)
        longer = (1 + value[ROWS] * self.travel.rows_1_s)[:, None]
        predicted = np.exp(value[LOG_RATIO]) * known @ turn.T * longer
        left = self.measured - predicted
        columns = np.zeros((len(known), size, 4))
        columns[..., LOG_RATIO] = -predicted
        if size == 2:
            columns[..., YAW] = -predicted @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        if self.log is not None:
            half = 0.25 * float(np.median(self.travel.dt_s))
            late, early = self.known(value[DELAY] + half)[0], self.known(value[DELAY] - half)[0]
            columns[..., DELAY] = -np.exp(value[LOG_RATIO]) * ((late - early) / (2 * half)) @ turn.T * longer
        columns[..., ROWS] = -predicted / longer * self.travel.rows_1_s[:, None]
        weight = np.linalg.inv(self.noise + self.spread**2 * np.eye(size))
        off = np.sqrt(np.maximum(np.einsum("ki,kij,kj->k", left, weight, left) / size, 0))
        weight = weight * (np.minimum(1.0, _HUBER / np.maximum(off, 1e-12)) * covered)[:, None, None]
        normal = np.einsum("kia,kij,kjb->kab", columns, weight, columns)
        return normal, np.einsum("kia,kij,kj->ka", columns, weight, left), left, known, np.where(covered, off, np.nan)

    def descend(self, value: F64, keep: NDArray[np.bool_] | None = None, steps: int = _STEPS) -> F64:
        """Go down to the minimum over the pairs that are kept."""
        for _ in range(steps):
            normal, gradient, *_ = self.terms(value)
            if keep is not None:
                normal, gradient = normal[keep], gradient[keep]
            slope = gradient.sum(axis=0) + (value - self.center) / self.prior**2
            step = -np.linalg.solve(normal.sum(axis=0) + np.diag(self.prior**-2), slope)
            step *= min(1.0, 0.3 / max(float(np.abs(step / self.prior).max()), 1e-12))
            value = value + step
            if float(np.abs(step / self.prior).max()) < 1e-8:
                break
        return value


def _turn(angle: float) -> F64:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def fit_speed(
    travel: Travel,
    *,
    log: RateLog | None,
    speed_m_s: float = np.nan,
    vector: bool = False,
    readout: tuple[float, float],
    max_delay_s: float,
) -> SpeedFit | None:
    """Fit the ratio of measured to known speed, the yaw, the delay and the readout time.

    Parameters
    ----------
    travel : Travel
    log : RateLog, optional
        Of the known velocity, or of the speed in its first column; without it the speed is constant.
    speed_m_s : float
        Without a log.
    vector : bool
        Whether the log's first two columns are a velocity.
    readout : (float, float)
        What is known of the readout time before, in seconds, and its deviation.
    max_delay_s : float
        How late or early the log may be.

    Returns
    -------
    SpeedFit or None
        None where the log covers too little.
    """
    dt = float(np.median(travel.dt_s))
    measured = travel.velocity_m_s if vector else travel.along()[:, None]
    noise = travel.covariance if vector else np.trace(travel.covariance, axis1=1, axis2=2)[:, None, None] / 2
    prior = np.array([_PRIOR_RATIO, _PRIOR_YAW, _PRIOR_FRAMES * dt, max(readout[1], 1e-9)])
    problem = _Problem(travel, measured, noise, log, speed_m_s, np.eye(2), prior, np.array([0.0, 0.0, 0.0, readout[0]]))
    value, wanted = problem.center.copy(), False
    rivals: tuple[float, ...] = ()
    if log is not None:
        found = _searched(problem, max_delay_s, dt)
        if found is None:
            return None
        value[DELAY], problem, rivals = found
        wanted = True
    known, covered = problem.known(float(value[DELAY]))
    power = float((known[covered] ** 2).sum())
    value[LOG_RATIO] = 0.5 * np.log(max(float((measured[covered] ** 2).sum()), 1e-12) / max(power, 1e-12))
    problem = replace(problem, center=np.array([0.0, 0.0, value[DELAY], readout[0]]))
    for _ in range(3):
        value = problem.descend(value)
        left, off = problem.terms(value)[2], problem.terms(value)[4]
        spread = float(np.sqrt(np.median(left[np.isfinite(off)] ** 2) / 0.455))
        problem = replace(problem, spread=max(spread, 1e-9))
    return _with_deviations(problem, value, rivals, wanted)


def _searched(problem: _Problem, max_delay_s: float, dt: float) -> tuple[float, _Problem, tuple[float, ...]] | None:
    """Seek the delay, and the order of the axes."""
    count = int(np.ceil(max_delay_s / dt * _SEARCHED))
    delays, crosses, powers = [], [], []
    for k in range(-count, count + 1):
        known, covered = problem.known(k * dt / _SEARCHED)
        if covered.sum() < max(6, 0.5 * len(covered)):
            continue
        a, b = problem.measured[covered], known[covered]
        delays.append(k * dt / _SEARCHED)
        crosses.append(a.T @ b / len(a))
        powers.append(np.sqrt((a**2).sum() * (b**2).sum()) / len(a))
    if not delays:
        return None
    cross = np.stack(crosses)
    match = np.linalg.svd(cross, compute_uv=False).sum(axis=1) / np.maximum(np.array(powers), 1e-300)
    alike = peers(np.array(delays), match, np.zeros(len(delays)), len(problem.travel), dt)
    # Of those that are as good, the least delay.
    best = min(alike, key=lambda k: abs(delays[k]))
    rivals = tuple(delays[k] for k in alike if k != best)
    order = np.eye(2)
    if problem.measured.shape[1] == 2:
        u, s, vt = np.linalg.svd(cross[best])
        u, _, vt = np.linalg.svd(cross[best] + _PULL * s[0] * np.eye(2))
        order = u @ vt
    return float(delays[best]), replace(problem, order=order), rivals


def _with_deviations(problem: _Problem, value: F64, rivals: tuple[float, ...], wanted: bool) -> SpeedFit:
    normal, _, left, known, _ = problem.terms(value)
    own = np.linalg.inv(normal.sum(axis=0) + np.diag(problem.prior**-2))
    count = len(problem.travel)
    blocks = int(np.clip(count // _LEAST_IN_BLOCK, 2, _MOST_BLOCKS))
    edges = np.linspace(0, count, blocks + 1).astype(int)
    steps = []
    for first, last in itertools.pairwise(edges):
        keep = np.ones(count, np.bool_)
        keep[first:last] = False
        steps.append(problem.descend(value, keep, 4) - value)
    away = np.array(steps) - np.mean(steps, axis=0)
    spread = (blocks - 1) / blocks * (away**2).sum(axis=0)
    factor = np.sqrt(np.maximum(spread / np.diag(own), 1.0))
    order = _turn(value[YAW]) @ problem.order if problem.measured.shape[1] == 2 else problem.order
    return SpeedFit(value, own * np.outer(factor, factor), order, blocks, rivals, wanted, left, known)
