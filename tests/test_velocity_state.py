"""What a velocity estimator carries from frame to frame, and that a copy of it carries the same."""

from __future__ import annotations

import copy
import math
import os
import pickle
import signal
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rsflow
from rsflow import Velocity, VelocityEstimator, VelocityStatus, synthetic
from rsflow.extraction import checkpoint
from rsflow.synthetic import Flight, Gyro, RangeFinder
from rsflow.velocity.sensors import Sensors
from velocity_helpers import WIDE

DOUBLES = (lambda e: copy.copy(e), lambda e: copy.deepcopy(e), lambda e: pickle.loads(pickle.dumps(e)))


@cache
def swaying() -> tuple[Flight, np.ndarray]:
    """A flight that turns, with the rates of a gyro that lags and has a bias."""
    f = synthetic.flight(
        WIDE, frames=24, rate_hz=30.0, height_m=0.5, velocity_m_s=(0.3, -0.1, 0.02), seed=12,
        rate_rad_s=lambda t: (0.6 * math.sin(9 * t), 0.5 * math.cos(7 * t), 0.2),
    )  # fmt: skip
    return f, Gyro(delay_s=0.01, bias_rad_s=(0.03, -0.02, 0.01), seed=1).log(f).between(f.t_s)


def step(estimator: VelocityEstimator, k: int, *, told: bool) -> Velocity:
    f, rates = swaying()
    known: dict[str, object] = {"height_m": f.height_m[k]} if k % 5 else {}
    if told and k:
        known |= {"rate_rad_s": rates[k], "down": f.down[k]}
    return estimator.update(f.images[k], f.t_s[k], **known)  # type: ignore[arg-type]


def bits(v: Velocity) -> tuple[object, ...]:
    """Everything that a velocity says, to the bit."""
    arrays = (v.covariance, v.origin_velocity_m_s, v.rate_rad_s, v.rate_covariance, *v.parts.values())
    numbers = (
        v.t_s,
        v.dt_s,
        v.vx_m_s,
        v.vy_m_s,
        v.vz_m_s,
        v.dx_px,
        v.dy_px,
        v.yaw_rate_rad_s,
        v.height_m,
        v.height_std_m,
    )
    said = (v.status, v.n_points, v.terms, tuple(v.parts), v.unstated, v.doubts)
    return (*said, np.array(numbers).tobytes(), *(array.tobytes() for array in arrays))


def learned(estimator: VelocityEstimator) -> bytes:
    g = estimator.gyro
    return b"".join(
        (g.bias_rad_s.tobytes(), g.bias_std_rad_s.tobytes(), np.array([g.delay_s, g.delay_std_s]).tobytes())
    )


@pytest.mark.parametrize("told", [True, False])
def test_a_copy_or_a_pickle_goes_on_with_the_same_bits(told: bool) -> None:
    """Split at the first frame, before anything was learned, and after: what comes is the same for each."""
    f, _ = swaying()
    whole = VelocityEstimator(f.camera, height_m=0.5)
    doubles: list[VelocityEstimator] = []
    for k in range(len(f)):
        expected = bits(step(whole, k, told=told))
        for double in doubles:
            assert bits(step(double, k, told=told)) == expected, k
            assert learned(double) == learned(whole)
        if k in (0, 2, 16):
            doubles += [make(whole) for make in DOUBLES]
    assert not told or np.abs(whole.gyro.bias_rad_s).max() > 0.005


def test_a_copy_goes_its_own_way() -> None:
    f, _ = swaying()
    estimator = VelocityEstimator(f.camera, height_m=0.5)
    for k in range(5):
        step(estimator, k, told=True)
    before = learned(estimator)
    double = copy.copy(estimator)
    for k in range(5, 8):
        step(double, k, told=True)
    assert learned(estimator) == before != learned(double)
    double.reset()
    assert step(estimator, 5, told=True).valid


def test_a_frame_taken_back_is_in_the_pickle_too() -> None:
    """After a repeated picture the next one is compared with that before both, in a copy as well."""
    f, _ = swaying()
    estimator = VelocityEstimator(f.camera, height_m=0.5)
    for k in range(4):
        step(estimator, k, told=True)
    again = np.clip(f.images[3].astype(int) + np.random.default_rng(1).integers(-1, 2, f.images[3].shape), 0, 255)
    assert estimator.update(again.astype(np.uint8), f.t_s[4]).status is VelocityStatus.REPEATED_FRAME
    double = pickle.loads(pickle.dumps(estimator))
    one, other = (e.update(f.images[5], f.t_s[5], height_m=f.height_m[5]) for e in (estimator, double))
    assert bits(one) == bits(other)
    assert one.valid
    assert one.dt_s == pytest.approx(f.t_s[5] - f.t_s[3])
    both = f.path.means(f.t_s[[3]], f.t_s[[5]])[0][0]
    assert np.abs([one.vx_m_s - both[0], one.vy_m_s - both[1]]).max() < 5 * np.sqrt(np.diag(one.covariance)[:2]).max()


def test_reset_forgets_everything() -> None:
    f, _ = swaying()
    estimator = VelocityEstimator(f.camera, height_m=0.5)
    first = [bits(step(estimator, k, told=True)) for k in range(10)]
    blank = learned(VelocityEstimator(f.camera))
    assert learned(estimator) != blank
    estimator.reset()
    assert learned(estimator) == blank
    assert [bits(step(estimator, k, told=True)) for k in range(10)] == first


def test_threads_with_estimators_of_their_own_do_not_disturb_each_other() -> None:
    f, _ = swaying()
    found: dict[int, list[tuple[object, ...]]] = {}

    def run(which: int) -> None:
        estimator = VelocityEstimator(f.camera, height_m=0.5)
        found[which] = [bits(step(estimator, k, told=True)) for k in range(10)]

    _together([lambda which=which: run(which) for which in range(3)])  # type: ignore[misc]
    assert found[0] == found[1] == found[2]


def test_threads_that_share_one_wait_for_each_other() -> None:
    """Each frame is taken whole: in some order, and never between two halves of another."""
    f, _ = swaying()
    estimator = VelocityEstimator(f.camera, height_m=0.5)
    found: list[Velocity] = []

    def run() -> None:
        found.extend(estimator.update(f.images[k], f.t_s[k]) for k in range(8))

    _together([run, run, estimator.__getstate__])
    assert len(found) == 16
    assert [v.status for v in found].count(VelocityStatus.FIRST_FRAME) == 1
    assert all(np.isfinite(v.covariance).all() == v.valid for v in found)


def _together(runs: list[Callable[[], object]]) -> None:
    failed: list[BaseException] = []

    def guarded(run: Callable[[], object]) -> None:
        try:
            run()
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=guarded, args=(run,)) for run in runs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert not failed, failed[:1]


def test_an_extraction_that_was_stopped_goes_on_to_the_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With heights and rates of their own: what was learned of the gyro is among what was kept."""
    f, _ = swaying()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(checkpoint, "_EVERY_S", 0.0)
    monkeypatch.setattr(checkpoint, "_SHARE", 1e9)
    Gyro(delay_s=0.01, bias_rad_s=(0.03, -0.02, 0.01), seed=1).log(f).save("rates.csv")
    RangeFinder(rate_hz=20.0, along="down").log(f).save("heights.csv")
    pictures = list(zip(f.images, f.t_s.tolist(), strict=True))
    options = {"camera": f.camera, "height_m": "heights.csv", "sensors": Sensors(rates="rates.csv"), "videos": False}

    def press(measured: object) -> None:
        if measured.frame.index == 15:  # type: ignore[attr-defined]
            os.kill(os.getpid(), signal.SIGINT)

    rsflow.extract(pictures, "whole", **options)  # type: ignore[arg-type]
    with pytest.raises(rsflow.ExtractionInterrupted):
        rsflow.extract(pictures, "out", **options, on_frame=press)  # type: ignore[arg-type]
    rsflow.extract(pictures, "out", **options, resume=True)  # type: ignore[arg-type]
    for name in ("velocity.csv", "trajectory.csv"):
        assert Path("out", name).read_bytes() == Path("whole", name).read_bytes(), name
    assert "ok" in Path("out/velocity.csv").read_text()
