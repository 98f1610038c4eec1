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
_BY_MOTION = 0.5
# And that must be known for so much of its way.
_TOLD, _SOME_TOLD = 0.5, 0.2
# So much of its steps must have brought it there.
_STRAIGHT = 0.5
# And its picture must differ by so many levels of 256, within itself or from what it would be at rest.
_LEAST_CONTRAST = 6.0
# What goes further than so many times its size in the first frames is not sure to be one thing.
_SURE_SIZES = 1.5
# What went so far, in pixels and as a share of its size, or its own size, is a thing wherever it turns then, if the
# motion in it says so too: leaves swing by less.
_PROVED_PX, _PROVED_SHARE = 8.0, 0.2
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
    agrees = along >= _BY_MOTION * np.maximum(expected, known)
    told = things.flowing & (known >= _TOLD * far)
    # With pictures a thing that never moves as its own does is a change of light, or something plain.
    pictured = things.patch[:, :, 0].any(axis=1)
    some = things.flowing & (known >= _SOME_TOLD * far)
    # What has gone far in a frame or two may be another thing beside it.
    sure = (far <= _SURE_SIZES * extent) | (things.age >= _FAR_AGE)
    near = (far >= np.maximum(_LEAST_PX, _LEAST_SHARE * extent)) & sure & told & agrees
    distant = (far >= np.maximum(_FAR_PX, _FAR_SHARE * extent)) & (things.age >= _FAR_AGE)
    starts = near | (distant & np.where(pictured, some & agrees, ~(told & ~agrees)))
    # A change of light has no picture of its own.
    starts &= ~pictured | (things.contrast >= _LEAST_CONTRAST)
    straight = far >= _STRAIGHT * things.steps
    young = things.age < _PATIENCE
    lasts = (things.reach >= extent) | np.where(young, straight, things.reach >= _NOWHERE * things.path)
    things.proved |= near & (things.reach >= np.minimum(extent, _PROVED_PX + _PROVED_SHARE * extent))
    lasts &= ~(told & ~agrees & (far >= np.maximum(_FAR_PX, _FAR_SHARE * extent)))
    out: NDArray[np.bool_] = (things.listed | starts) & (lasts | things.proved)
    return out
