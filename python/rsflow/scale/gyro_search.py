"""Which axes of a gyro are which of the camera, and how late it is: sought over all delays, from rates alone."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .rate_log import RateLog
from .rotation_fit import Turns

__all__ = ["Alignment", "peers", "search"]

F64 = NDArray[np.float64]

# Steps of the search for each interval between frames.
_STEPS = 4
# Pulls axes that nothing is known of to those that were stated: a share of the strongest one.
_PULL = 1e-3
# Samples of the clip, in blocks: a delay that wins in more than one of 20 is a rival.
_RESAMPLED, _BLOCKS = 200, 16
# Correlation of the rates' changes from which these tell the axes.
_ALIKE = 0.9
# Fewer pairs than this at a delay are not compared with it.
_LEAST_PAIRS = 8


@dataclass(frozen=True)
class Alignment:
    """Where the search came to.

    `rotation` (3, 3) makes of the gyro's rates the camera's; its determinant is -1 where axes are mirrored. `scale` is
    the ratio of the camera's rates to the gyro's, `match` the correlation of both. `rivals` are other delays that
    explain the clip as well, with the rotations that go with them.
    """

    rotation: F64
    scale: float
    delay_s: float
    match: float
    rivals: tuple[tuple[float, F64], ...]


def search(turns: Turns, log: RateLog, nominal: F64, *, max_delay_s: float, bias_std: float) -> Alignment | None:
    """Seek the delay at which the rates of camera and gyro agree best, whatever the axes.

    Parameters
    ----------
    turns : Turns
        Of the camera.
    log : RateLog
        Of the gyro.
    nominal : (3, 3)
        Rotation of the gyro's axes to the camera's as stated.
    max_delay_s : float
        How late or early the gyro may be.
    bias_std : float
        Standard deviation of the gyro's bias in rad/s.

    Returns
    -------
    Alignment or None
        None where the log does not cover enough of the clip.
    """
    dt = float(np.median(turns.dt_s))
    count = int(np.ceil(max_delay_s / dt * _STEPS))
    delays = np.arange(-count, count + 1) * (dt / _STEPS)
    delays = delays[np.abs(delays) <= max_delay_s * (1 + 1e-9)]
    moments = [_moments(turns, log, float(delay)) for delay in delays]
    known = np.array([m is not None for m in moments])
    if not known.any():
        return None
    delays = delays[known]
    sums = np.stack([m for m in moments if m is not None])
    total = sums.sum(axis=1)
    match, rotation, _ = _match(total, nominal, bias_std)
    # Delays that win when the clip is drawn again from its blocks.
    rng = np.random.default_rng(11)
    counts = rng.multinomial(_BLOCKS, np.full(_BLOCKS, 1 / _BLOCKS), size=_RESAMPLED).astype(np.float64)
    again = np.stack([_match(np.einsum("b,dbij->dij", c, sums), nominal, bias_std)[0] for c in counts])
    wins = np.bincount(np.argmax(again, axis=1), minlength=len(delays)) / _RESAMPLED
    alike = peers(delays, match, wins, len(turns), dt)
    # Of those that are as good, the one that needs least: axes as stated, then a small delay.
    needs = [float(np.trace(rotation[k] @ nominal.T)) - 0.1 * abs(float(delays[k])) / max_delay_s for k in alike]
    best = alike[int(np.argmax(needs))]
    rivals = tuple((float(delays[k]), rotation[k]) for k in alike if k != best)
    steady, whole, scale = _match(total[best : best + 1], nominal, 0.0)
    # Where the rate does not change, what it is tells the axes, whatever its bias.
    axes = rotation[best] if match[best] > _ALIKE or steady[0] < match[best] else whole[0]
    matched = max(float(match[best]), float(steady[0]))
    return Alignment(axes, float(scale[0]), float(delays[best]), matched, rivals)


def peers(delays: F64, match: F64, wins: F64, count: int, dt: float) -> list[int]:
    """Places of the best delay and of those, apart from each other, that explain the clip as well."""
    found = [int(np.argmax(match))]
    left = 1 - match**2
    far = np.where(np.abs(delays - delays[found[0]]) > 2 * dt, wins, 0.0)
    for k in np.argsort(-(match + far)):
        around = np.abs(delays - delays[k]) <= 2 * dt
        top = match[k] >= match[np.abs(delays - delays[k]) <= 0.6 * dt].max()
        alike = left[k] < left[found[0]] * (1 + 20 / count) + 1e-5
        if np.abs(delays[k] - delays[found]).min() > 2 * dt and ((top and alike) or far[around].sum() > 0.05):
            found.append(int(k))
    return found


def _moments(turns: Turns, log: RateLog, delay: float) -> F64 | None:
    """Sum up products (blocks, 7, 7) of (1, camera rate, gyro rate) over pairs; None where too few are covered."""
    start, stop = turns.start_s + delay, turns.stop_s + delay
    covered = log.covers(start, stop)
    if covered.sum() < max(_LEAST_PAIRS, 0.5 * len(turns)):
        return None
    rate = log.turn(start, stop)[0] / turns.dt_s[:, None]
    both = np.hstack([np.ones((len(turns), 1)), turns.rate_rad_s, rate]) * covered[:, None]
    products = np.einsum("ki,kj->kij", both, both)
    edges = np.linspace(0, len(turns), _BLOCKS + 1).astype(int)
    return np.stack([products[a:b].sum(axis=0) for a, b in itertools.pairwise(edges)])


def _match(sums: F64, nominal: F64, bias_std: float) -> tuple[F64, F64, F64]:
    """Correlation, rotation and scale of sums (D, 7, 7), by Procrustes' method, with the bias between the means."""
    n = np.maximum(sums[:, 0, 0], 1.0)[:, None, None]
    mean = sums[:, 1:, :1] / n
    centred = sums[:, 1:, 1:] / n - mean @ mean.transpose(0, 2, 1)
    # What the means say, beside the bias that they may differ by: as much as one sample with the bias as its noise.
    spread = 0.05 * np.trace(centred, axis1=1, axis2=2)[:, None, None] + 1e-8
    share = spread / (spread + n * bias_std**2)
    second = centred + share * (mean @ mean.transpose(0, 2, 1))
    camera, gyro, cross = second[:, :3, :3], second[:, 3:, 3:], second[:, :3, 3:]
    strength = np.linalg.svd(cross, compute_uv=False)
    u, _, vt = np.linalg.svd(cross + _PULL * strength[:, :1, None] * nominal)
    power = np.trace(camera, axis1=1, axis2=2) * np.trace(gyro, axis1=1, axis2=2)
    correlation = strength.sum(axis=1) / np.sqrt(np.maximum(power, 1e-300))
    size = np.trace(camera, axis1=1, axis2=2) / np.maximum(np.trace(gyro, axis1=1, axis2=2), 1e-300)
    return correlation, u @ vt, np.sqrt(size)
