"""What is believed of things, as what users get."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..object_table import TrackedObject
from .followed import SEEN, STATES, Followed

if TYPE_CHECKING:
    from numpy.typing import NDArray


def told(things: Followed, which: NDArray[np.bool_], interval_s: float) -> tuple[TrackedObject, ...]:
    """Give those among `which`, by number; velocities per second over intervals of `interval_s`, NaN for unknown."""
    at = np.flatnonzero(which)
    if not len(at):
        return ()
    at = at[np.argsort(things.id[at], kind="stable")]
    velocity = np.where(things.informed[at, None], things.velocity[at], np.nan)
    deviation = np.where(things.informed[at, None], np.sqrt(np.maximum(things.variance[at, :, 2], 0)), np.inf)
    place_std = np.sqrt(np.maximum(things.variance[at, :, 0], 0))
    alone = (things.state[at] == SEEN)[:, None]
    place = np.where(alone, things.centre[at], things.place[at])
    box = things.box[at]
    hidden = things.state[at] == STATES.index("hidden")
    if hidden.any():
        half = things.size[at] / 2
        predicted = np.concatenate(
            [np.round(things.place[at] - half + 0.5), np.round(things.place[at] + half + 0.5)], 1
        )
        box = np.where(hidden[:, None], predicted, box)
    corner = box.astype(np.int64)
    columns = zip(
        things.id[at].tolist(),
        place.tolist(),
        corner.tolist(),
        things.pixels[at].astype(np.int64).tolist(),
        velocity.tolist(),
        things.age[at].tolist(),
        things.state[at].tolist(),
        place_std.tolist(),
        deviation.tolist(),
        things.ground[at].tolist(),
        things.travelled[at].tolist(),
        things.missed[at].tolist(),
        strict=True,
    )
    return tuple(
        TrackedObject(
            number,
            x,
            y,
            (left, top, right - left, bottom - top),
            area,
            vx,
            vy,
            age,
            state=STATES[state],
            missed_frames=missed,
            x_std_px=x_std,
            y_std_px=y_std,
            vx_std_px_per_frame=vx_std,
            vy_std_px_per_frame=vy_std,
            interval_s=interval_s,
            x_ground_px=x_ground,
            y_ground_px=y_ground,
            travelled_px=travelled,
        )
        for (
            number, (x, y), (left, top, right, bottom), area, (vx, vy), age, state, (x_std, y_std), (vx_std, vy_std),
            (x_ground, y_ground), travelled, missed,
        ) in columns
    )  # fmt: skip
