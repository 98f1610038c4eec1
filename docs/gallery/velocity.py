"""Velocity of a camera over the ground, with the band of two deviations, beside what the flight was made with.

The camera rocks and its gain goes up and down by a third; the height is known to one percent.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def rocking(t_s: float) -> tuple[float, float, float]:
    """Give the rate of a camera that rocks by some degrees, rad/s."""
    return 0.25 * np.cos(6.0 * t_s), 0.15 * np.cos(4.5 * t_s), 0.0


def speeding(t_s: float) -> tuple[float, float, float]:
    """Give a velocity that changes, m/s."""
    return 0.25 + 0.15 * np.sin(3.0 * t_s), 0.1 * np.cos(2.0 * t_s), 0.0


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    flight = synthetic.flight(
        frames=8 if small else 90,
        height_m=0.5,
        velocity_m_s=speeding,
        rate_rad_s=rocking,
        exposure_drift=synthetic.auto_exposure(0.33),
        seed=1,
    )
    gyro = synthetic.Gyro(rate_hz=200.0, noise_rad_s=0.004, seed=1).log(flight).between(flight.t_s)
    estimator = rsflow.VelocityEstimator(flight.camera, height_std_m=0.005, rate_std_rad_s=0.004)
    t_s, found, deviation, true = [], [], [], []
    for k, frame in enumerate(flight):
        v = estimator.update(
            frame.image, frame.t_s, height_m=flight.height_m[k], rate_rad_s=gyro[k] if k else None, down=flight.down[k]
        )
        if v.valid:
            t_s.append(frame.t_s)
            found.append((v.vx_m_s, v.vy_m_s))
            deviation.append(np.sqrt(np.diag(v.covariance)[:2]))
            true.append(flight.velocity_m_s[k, :2])
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    ax = figure.subplots()
    for axis, (name, color) in enumerate((("to the right", "#4363d8"), ("down the picture", "#e6194b"))):
        middle, wide = np.array(found)[:, axis], 2 * np.array(deviation)[:, axis]
        ax.fill_between(t_s, middle - wide, middle + wide, color=color, alpha=0.25, linewidth=0)
        ax.plot(t_s, middle, color=color, label=f"{name}, with two deviations")
        ax.plot(t_s, np.array(true)[:, axis], "k--", linewidth=1, label="truth" if axis else None)
    ax.set(xlabel="time, s", ylabel="velocity, m/s")
    ax.grid(alpha=0.3)
    ax.legend(loc="lower left")
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "velocity.png")
