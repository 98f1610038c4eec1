"""The rotation of a camera from each frame to the next, and what else its points say: one normal equation a pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._rotation import rotation_matrix
from ..camera import Camera
from .pairs import LEAST_POINTS, Pair

__all__ = ["FOCAL", "READOUT", "SHIFT", "TURN", "Sweep", "Turns", "fit_turns"]

F64 = NDArray[np.float64]

# Unknowns of a pair: the turn (rad), log of the focal length, readout time (s), the camera's way (in distances).
TURN, FOCAL, READOUT, SHIFT = slice(0, 3), 3, 4, slice(5, 8)
_UNKNOWNS = 8
_STEPS = 6
# Error in pixels that all points share, and the share of an unstated error that is shared.
_SHARED_PX, _TOGETHER = 0.006, 0.3
# Step of a numerical derivative, of the log of the focal length.
_STEP = 1e-4
# Samples of three points that a pair's rotation is sought from, and the deviations within which a point agrees.
_SAMPLES, _AGREES = 40, 4.0


@dataclass(frozen=True, eq=False)
class Turns:
    """How a camera turned between successive frames, for one focal length and one readout time.

    Attributes
    ----------
    start_s, stop_s : (K,) float64
        Times of the frames of each pair.
    turn_rad : (K, 3) float64
        Rotation of the camera as a vector, right-handed, in the camera's axes.
    normal : (K, 8, 8), gradient : (K, 8) float64
        Of half the sum of squared residuals in deviations, for (turn, log focal, readout, way): the step that
        lowers it is ``-solve(normal, gradient)``.
    n_points : (K,) int
    residual : (K,) float64
        Root mean square residual in the deviations that the points state.
    std_px : (K,) float64
        Typical deviation of a point, with the residual's share in it.
    """

    start_s: F64
    stop_s: F64
    turn_rad: F64
    normal: F64
    gradient: F64
    n_points: NDArray[np.int64]
    residual: F64
    std_px: F64

    def __len__(self) -> int:
        return len(self.start_s)

    @property
    def dt_s(self) -> F64:
        """Time between the frames of each pair."""
        return self.stop_s - self.start_s

    @property
    def rate_rad_s(self) -> F64:
        """Mean angular rate of each pair, (K, 3)."""
        return self.turn_rad / self.dt_s[:, None]

    @property
    def shared_px(self) -> F64:
        """Error of each pair that its points share, in pixels: of windows and sampling, and of lossy compression.

        Points that are worse than they state are so together, where blocks of the picture are; that the focal length
        is another, or that the camera moved, is no error of theirs.
        """
        own = [0, 1, 2, FOCAL, *range(SHIFT.start, SHIFT.stop)]
        normal, gradient = self.normal[:, own][:, :, own], self.gradient[:, own]
        explained = np.einsum("ka,ka->k", gradient, np.linalg.solve(normal, gradient[..., None])[..., 0])
        left = np.maximum(self.residual, 1.0) * np.sqrt(np.clip(1 - explained / (2 * self.n_points), 0.0, 1.0))
        excess = np.sqrt(np.maximum(left**2 - 1, 0)) / np.maximum(self.residual, 1.0)
        return np.asarray(np.hypot(_SHARED_PX, _TOGETHER * self.std_px * excess))

    def only(self, which: NDArray[np.bool_]) -> Turns:
        """Keep the pairs where `which` is True."""
        return replace(self, **{name: getattr(self, name)[which] for name in self.__dataclass_fields__})


@dataclass(frozen=True, eq=False)
class Sweep:
    """How a camera turns while the rows of a frame are read.

    Attributes
    ----------
    share : (J,) float64
        Of the readout time, from -1/2 at the first row to 1/2 at the last.
    angle : (K, 2, J, 3) float64
        Turn from the middle row to there, of the first and the second frame of each pair.
    rate : (K, 2, J, 3) float64
        How that grows with each second of the readout time.
    """

    share: F64
    angle: F64
    rate: F64

    def between(self, k: int, pair: Pair, height: int) -> tuple[F64, F64]:
        """Say what pair `k` turns more between the rows of a point than between the middle rows, and how that grows."""
        found = np.zeros((2, len(pair.before), 3))
        for frame, (points, sign) in enumerate(((pair.before, -1.0), (pair.after, 1.0))):
            share = points[:, 1] / (height - 1) - 0.5
            for number, table in enumerate((self.angle, self.rate)):
                for axis in range(3):
                    found[number, :, axis] += sign * np.interp(share, self.share, table[k, frame, :, axis])
        return found[0], found[1]


def fit_turns(
    pairs: Sequence[Pair],
    camera: Camera,
    *,
    sweep: Sweep | None = None,
    start: Turns | None = None,
) -> tuple[Turns, NDArray[np.bool_]]:
    """Fit the rotation of each pair.

    Parameters
    ----------
    pairs : sequence of Pair
    camera : Camera
        With the focal length that is being tried.
    sweep : Sweep, optional
        How the camera turns while the rows of each frame are read; not at all where it is not given.
    start : Turns, optional
        An earlier fit of the same pairs, to begin from.

    Returns
    -------
    Turns
        Of the pairs that could be fitted.
    (K,) bool
        Which these are.
    """
    rows: list[tuple[Any, ...]] = []
    fitted = np.zeros(len(pairs), np.bool_)
    rng = np.random.default_rng(7)
    sizes = [len(pair.before) for pair in pairs]
    ends = np.cumsum(sizes)[:-1]
    points = [np.vstack([getattr(pair, name) for pair in pairs]) for name in ("before", "after")]
    x1, x2 = (np.split(camera.undistort_points(p, normalized=True).astype(np.float64), ends) for p in points)
    # Lens distortion stays that of the picture: a ray does not simply shrink with the focal length.
    longer = replace(camera, fx=camera.fx * (1 + _STEP), fy=camera.fy * (1 + _STEP), std={})
    rays = (longer.undistort_points(p, normalized=True).astype(np.float64) for p in points)
    d1, d2 = (
        [(other - ray) / _STEP for ray, other in zip(before, np.split(after, ends), strict=True)]
        for before, after in zip((x1, x2), rays, strict=True)
    )
    for k, pair in enumerate(pairs):
        none = np.zeros((len(pair.before), 3))
        extra, grows = (none, none) if sweep is None else sweep.between(k, pair, camera.height)
        seen = np.isfinite(x1[k]).all(axis=1) & np.isfinite(x2[k]).all(axis=1)
        view = _View(
            x1[k][seen],
            x2[k][seen],
            np.stack([d1[k][seen], d2[k][seen]]),
            (camera.fx, camera.fy) / pair.std_px[seen, None],
            extra[seen],
            grows[seen],
        )
        row = view.fit(None if start is None else start.turn_rad[k], rng) if seen.sum() >= LEAST_POINTS else None
        if row is not None:
            fitted[k] = True
            std_px = float(np.median(pair.std_px)) * max(row[4], 1.0)
            rows.append((pair.start_s, pair.stop_s, *row, std_px))
    return _gathered(rows), fitted


def _gathered(rows: list[tuple[Any, ...]]) -> Turns:
    """Make arrays of the rows of pairs."""
    columns: list[Any] = list(zip(*rows, strict=True)) if rows else [[]] * 8
    start, stop, turn, normal, gradient, count, residual, std = (np.asarray(c, dtype=np.float64) for c in columns)
    shape = (-1, _UNKNOWNS, _UNKNOWNS)
    return Turns(
        start_s=start,
        stop_s=stop,
        turn_rad=turn.reshape(-1, 3),
        normal=normal.reshape(shape),
        gradient=gradient.reshape(shape[:2]),
        n_points=count.astype(np.int64),
        residual=residual,
        std_px=std,
    )


@dataclass(frozen=True)
class _View:
    """Rays of one pair of frames.

    `grows` (2, N, 2) is how the rays of both frames change with the log of the focal length; `scale` makes of a
    difference of rays deviations; `extra` is what the readout adds, for each point, to the turn between its two rows,
    and `sweep` how that grows with the readout time.
    """

    x1: F64
    x2: F64
    grows: F64
    scale: F64
    extra: F64
    sweep: F64

    def residuals(self, turn: F64) -> tuple[F64, F64]:
        """Residuals (N, 2) in deviations, and the points (N, 3) turned into the second frame."""
        rays = np.hstack([self.x1, np.ones((len(self.x1), 1))])
        turned = rays @ rotation_matrix(-turn).T
        # The turn between two rows differs from the pair's by little: its square is enough.
        once = np.cross(turned, self.extra)
        turned = turned + once + 0.5 * np.cross(once, self.extra)
        return (self.x2 - turned[:, :2] / turned[:, 2:]) * self.scale, turned

    def columns(self, turned: F64, turn: F64) -> F64:
        """Give derivatives (N, 2, 8) of the residuals."""
        x, y, z = turned.T
        zero = np.zeros_like(x)
        project = np.stack([1 / z, zero, -x / z**2, zero, 1 / z, -y / z**2], axis=1).reshape(-1, 2, 3)
        cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
        rotation = -project @ cross
        columns = np.empty((len(x), 2, _UNKNOWNS))
        columns[..., TURN] = rotation
        # For where the point should be, not where it was measured: noise times itself is no slope.
        off = self.x2 - turned[:, :2] / turned[:, 2:]
        moved = self.grows[0] @ rotation_matrix(-turn)[:, :2].T
        columns[..., FOCAL] = self.grows[1] + off - np.einsum("nij,nj->ni", project, moved)
        columns[..., READOUT] = np.einsum("nij,nj->ni", rotation, self.sweep)
        columns[..., SHIFT] = project
        return columns * self.scale[..., None]

    def fit(self, start: F64 | None, rng: np.random.Generator) -> tuple[F64, F64, F64, int, float] | None:
        """Turn, normal matrix, gradient, points that agree and their residual; None where too few agree."""
        turn = self._sampled(rng) if start is None else start.copy()
        weight = np.ones(len(self.x1))
        for _ in range(_STEPS):
            residual, turned = self.residuals(turn)
            size = np.linalg.norm(residual, axis=1)
            # The median length of a residual of two Gaussian parts is 1.177 deviations.
            unit = max(float(np.median(size)) / 1.177, 1.0)
            weight = np.clip(1 - (size / (_AGREES * unit)) ** 2, 0, None) ** 2
            columns = self.columns(turned, turn)[..., TURN]
            normal = np.einsum("n,nki,nkj->ij", weight, columns, columns)
            step = np.linalg.lstsq(normal, np.einsum("n,nki,nk->i", weight, columns, residual), rcond=1e-12)[0]
            turn = turn - step
            if float(np.abs(step).max()) < 1e-9:
                break
        residual, turned = self.residuals(turn)
        agree = weight > 0
        count = int(agree.sum())
        if count < max(LEAST_POINTS, 0.5 * len(self.x1)):
            return None
        columns = self.columns(turned, turn)
        rms = float(np.sqrt((weight[:, None] * residual**2).sum() / (2 * weight.sum())))
        # Where the points are worse than they say, so are the figures.
        weight = weight / max(rms, 1.0) ** 2
        normal = np.einsum("n,nki,nkj->ij", weight, columns, columns)
        gradient = np.einsum("n,nki,nk->i", weight, columns, residual)
        return turn, normal, gradient, count, rms

    def _sampled(self, rng: np.random.Generator) -> F64:
        """Give the turn, of many from three points each, that most points agree with."""
        residual, turned = self.residuals(np.zeros(3))
        columns = self.columns(turned, np.zeros(3))[..., TURN]
        best, least = np.zeros(3), np.inf
        picks = rng.integers(0, len(self.x1), (_SAMPLES, 3))
        # A little on the diagonal: three points on one spot say nothing.
        normal = np.einsum("snki,snkj->sij", columns[picks], columns[picks])
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-30 * np.eye(3)
        right = np.einsum("snki,snk->si", columns[picks], residual[picks])
        turns = -np.linalg.solve(normal, right[..., None])[..., 0]
        for turn in turns:
            if np.linalg.norm(turn) > 1.0:
                continue
            size = float(np.median(np.abs(self.residuals(turn)[0])))
            if size < least:
                best, least = turn, size
        return best
