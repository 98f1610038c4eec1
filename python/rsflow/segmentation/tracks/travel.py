"""Whether what moves gets anywhere: leaves, tape and the places that things have left do not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .followed import HIDDEN

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .followed import Followed

# A thing is listed when it has gone so far, in pixels and as a share of its size, as the motion in it says too; where
# that is not known, so much further, and in so many frames.
_LEAST_PX, _LEAST_SHARE = 1.5, 0.04
_FAR_PX, _FAR_SHARE, _FAR_AGE = 4.0, 0.3, 4
# So much of its way must be what the motion in it says, or the region grew and shrank.
_BY_MOTION = 0.35
# So much of its steps must have brought it there.
_STRAIGHT = 0.5
# After so many frames a thing that never went its own size from where it began must have gone this share of its path.
_PATIENCE = 25
_NOWHERE = 0.6


# Its path is as long as its steps of so much of its size are together, so that trembling is none.
_STEP_PX, _STEP_SHARE = 1.0, 0.1


def go_on(things: Followed) -> None:
    """Lengthen the paths of things that have gone a step."""
    step = things.way - things.corner
    far = length(step)
    extent = np.sqrt(things.size[:, 0] * things.size[:, 1])
    gone = far >= np.maximum(_STEP_PX, _STEP_SHARE * extent)
    things.path[gone] += far[gone]
    things.corner[gone] = things.way[gone]
    things.reach = np.where(things.state == HIDDEN, things.reach, np.maximum(things.reach, length(things.way)))


def length(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Length of each vector."""
    return np.asarray(np.hypot(vectors[:, 0], vectors[:, 1]))


def travelling(things: Followed) -> NDArray[np.bool_]:
    """Say of each thing whether it gets somewhere."""
    far = length(things.way)
    extent = np.sqrt(things.size[:, 0] * things.size[:, 1])
    # How much of its way the motion in it says, of that in the frames where it was known.
    known = length(things.alongside)
    along = (things.carried * things.way).sum(axis=1) / np.maximum(far, 1e-9)
    expected = (things.alongside * things.way).sum(axis=1) / np.maximum(far, 1e-9)
    told = things.flowing & (known >= 0.5 * far)
    agrees = along >= _BY_MOTION * np.maximum(expected, known)
    near = (far >= np.maximum(_LEAST_PX, _LEAST_SHARE * extent)) & told & agrees
    distant = (far >= np.maximum(_FAR_PX, _FAR_SHARE * extent)) & (things.age >= _FAR_AGE) & ~(told & ~agrees)
    starts = near | distant
    straight = far >= _STRAIGHT * things.steps
    young = things.age < _PATIENCE
    lasts = (things.reach >= extent) | np.where(young, straight, things.reach >= _NOWHERE * things.path)
    out: NDArray[np.bool_] = (things.listed | starts) & lasts
    return out
