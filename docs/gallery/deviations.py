"""How sure: the deviation that is stated for each pixel, beside the error that it turned out to have.

One picture whose texture fades from left to right; the flow is the same everywhere.
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

import rsflow
from rsflow import synthetic


def draw(*, small: bool = False) -> Figure:
    """Give the picture; `small` for a trial."""
    size = (160, 96) if small else (480, 280)
    pair = synthetic.shifted_pair(3.3, -1.6, size=size, sensor=synthetic.Sensor(noise=0.0), seed=4)
    share = np.linspace(1.0, 0.03, size[0])
    noise = np.random.default_rng(1)
    prev, after = (
        np.clip((image - 128.0) * share + 128.0 + noise.normal(0, 2.0, image.shape), 0, 255).round().astype(np.uint8)
        for image in (pair.prev, pair.next)
    )
    field = rsflow.dense_flow(prev, after, covariance=True)
    error = np.hypot(field.uv[..., 0] - pair.dx, field.uv[..., 1] - pair.dy)
    stated = np.sqrt(np.trace(field.covariance, axis1=-2, axis2=-1))
    figure = Figure(figsize=(12.0, 5.4), layout="constrained")
    (a, b), (c, d) = figure.subplots(2, 2)
    a.imshow(prev, cmap="gray", vmin=0, vmax=255, aspect="auto")
    a.set_title("texture that fades, noise of 2 grey levels")
    for ax, values, title in ((b, stated, "stated deviation"), (c, error, "error")):
        shown = ax.imshow(values, cmap="magma", vmin=0, vmax=0.2, aspect="auto")
        ax.set_title(title)
        figure.colorbar(shown, ax=ax, label="pixels")
    for ax in (a, b, c):
        ax.set(xticks=[], yticks=[])
    shown_rows = slice(10, -10)
    d.semilogy(np.sqrt(np.nanmean(error[shown_rows] ** 2, axis=0)), color="#e6194b", label="rms error of a column")
    # Where a pixel has no answer its deviation is infinite.
    told = np.ma.masked_invalid(stated[shown_rows])
    d.semilogy(np.sqrt((told**2).mean(axis=0)), color="#4363d8", label="stated")
    d.set(xlabel="column", ylabel="pixels")
    d.grid(alpha=0.3)
    d.legend()
    return figure


if __name__ == "__main__":
    draw().savefig(sys.argv[1] if len(sys.argv) > 1 else "deviations.png")
