"""Points of a pair of frames: where to start them, and where each went.

docs/explanation/algorithms.md, section "Points: track_points".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import _checks, _core
from .._checks import knobs
from .._checks.knobs import Deformation, Illumination
from .result import Tracks

__all__ = ["detect_corners", "track_points"]


def track_points(
    prev: NDArray[Any],
    next: NDArray[Any],
    points: ArrayLike,
    *,
    window_size: int | tuple[int, int] = 21,
    levels: int | None = None,
    max_displacement: float | None = None,
    max_iterations: int = 30,
    epsilon: float = 0.01,
    illumination: Illumination = "gain_offset",
    initial: ArrayLike | None = None,
    max_forward_backward: float | None = 0.5,
    deformation: Deformation = "auto",
    mask: NDArray[np.bool_] | None = None,
    next_mask: NDArray[np.bool_] | None = None,
) -> Tracks:
    """Where each point of `prev` is in `next`: pyramidal Lucas-Kanade with the lighting in the least squares.

    Where many points are lost or move unlike their neighbours, as under rotation and zoom, the motion of a window may
    be affine [4]_; that takes some 0.1 ms a point.

    Parameters
    ----------
    prev, next : ndarray, shape (height, width)
        Grey frames of the same size and type: uint8, uint16 or float32. Crops are read in place.
    points : array_like, shape (N, 2)
        Positions (x, y) in `prev` in pixels, pixel centres at integers.
    window_size : int or (width, height), optional
        Side of the window around a point, 3 to 63 pixels. At full resolution one more pixel on each side takes part.
    levels : int, optional
        Levels of the pyramid, the frame itself included. By default they follow from the frame's size and from
        `max_displacement`.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels: longer ones are not sought, and none is valid. By
        default any. Where texture repeats and fills the picture, one below half of its period says which of several
        displacements it was.
    max_iterations : int, optional
        Steps on one level after which a point counts as not converged.
    epsilon : float, optional
        Length of a step, in pixels, below which a point has converged.
    illumination : {"none", "offset", "gain_offset"}, optional
        What may change in the light of a window.
    initial : array_like, shape (N, 2), optional
        A first guess of each position in `next`, such as a gyroscope gives.
    max_forward_backward : float or None, optional
        How far from its start, in pixels, a point may come back when it is tracked back from `next` to `prev`.
        None does not track back.
    deformation : {"auto", "none", "affine"}, optional
        Whether windows may turn, grow and shear: where many points are lost, fit badly or move unlike their neighbours;
        nowhere; or everywhere.
    mask, next_mask : ndarray of bool, shape (height, width), optional
        True where a pixel of `prev`, and of `next`, counts. Windows use the pixels that count and whose targets do; an
        overlay that is fixed to the sensor is given as both.

    Returns
    -------
    Tracks
        One row for each point, in order. A point that cannot be tracked has a status that says why, NaN for its
        position and infinite variance.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If the arguments do not fit together; the message says which and how.

    References
    ----------
    .. [1] B. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
       IJCAI 1981.
    .. [2] J.-Y. Bouguet, "Pyramidal implementation of the affine Lucas Kanade feature tracker", Intel, 2001.
    .. [3] G. Hager and P. Belhumeur, "Efficient region tracking with parametric models of geometry and
       illumination", PAMI 1998, https://doi.org/10.1109/34.722606.
    .. [4] S. Baker and I. Matthews, "Lucas-Kanade 20 years on: a unifying framework", IJCV 2004,
       https://doi.org/10.1023/B:VISI.0000011205.11775.fd.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> y, x = np.mgrid[0:120, 0:160]
    >>> picture = lambda x, y: 120 + 50 * np.sin(x / 3) * np.cos(y / 4) + 30 * np.sin((x + 2 * y) / 7)
    >>> prev, next = (picture(x - u, y).astype(np.float32) for u in (0, 1.5))
    >>> tracks = rsflow.track_points(prev, 0.8 * next + 5, [[60, 50], [90, 70]])
    >>> np.round(tracks.displacement, 1) + 0
    array([[1.5, 0. ],
           [1.5, 0. ]], dtype=float32)
    >>> tracks.valid
    array([ True,  True])
    """
    origins = _checks.points("points", points)
    options = knobs.tracking(
        window_size=window_size,
        levels=levels,
        max_displacement=max_displacement,
        max_iterations=max_iterations,
        epsilon=epsilon,
        illumination=illumination,
        max_forward_backward=max_forward_backward,
        deformation=deformation,
    )
    start = None if initial is None else _checks.points("initial", initial)
    before, after = _checks.pair(prev, next)
    where = _checks.mask_or_none("mask", mask, before.shape)
    where_next = _checks.mask_or_none("next_mask", next_mask, before.shape)
    found = _core.track_points(before, after, origins, start, where, where_next, options)
    count = len(origins)
    return Tracks(**found, origins=origins, ids=np.arange(count, dtype=np.int64), ages=np.ones(count, dtype=np.uint32))


def detect_corners(
    frame: NDArray[Any],
    *,
    max_corners: int = 400,
    quality: float = 0.01,
    min_distance: float = 8,
    mask: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """Find the corners of a frame, which a window can be tracked from, the best first.

    Parameters
    ----------
    frame : ndarray, shape (height, width)
        Grey levels: uint8, uint16 or float32.
    max_corners : int, optional
        The most corners to return; 0 means all.
    quality : float, optional
        The least response of a corner, as a share of the best one's, above 0 and up to 1. The response is the smaller
        eigenvalue of the structure tensor over 3 x 3 pixels [1]_.
    min_distance : float, optional
        The least distance between two corners, in pixels.
    mask : ndarray of bool, shape (height, width), optional
        True where a pixel counts: a corner is one, and is made of gradients of such pixels alone.

    Returns
    -------
    ndarray of float32, shape (N, 2)
        Positions (x, y) in pixels.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If an argument does not fit; the message says which and how.

    References
    ----------
    .. [1] J. Shi and C. Tomasi, "Good features to track", CVPR 1994, https://doi.org/10.1109/CVPR.1994.323794.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> frame = np.zeros((60, 80), np.uint8)
    >>> frame[20:40, 30:50] = 200
    >>> rsflow.detect_corners(frame).shape
    (4, 2)
    """
    options = knobs.corners(max_corners, quality, min_distance)
    frame = _checks.frame("frame", frame)
    return _core.detect_corners(frame, _checks.mask_or_none("mask", mask, frame.shape), *options, 3, None, False)[0]
