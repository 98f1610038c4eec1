"""OpenCV's flow functions by their own names, parameters, shapes, defaults and errors.

A program written for OpenCV runs with its import changed::

    from rsflow.interop import opencv as cv2

``calcOpticalFlowPyrLK``, ``buildOpticalFlowPyramid``, ``goodFeaturesToTrack``, ``calcOpticalFlowFarneback`` and
``DISOpticalFlow`` are then rsflow's; every other name of ``cv2`` (``cvtColor``, ``circle``, ``TERM_CRITERIA_EPS``, ...)
is OpenCV's own, which is imported when the first of them is used.

The point functions answer as OpenCV's do, their blind spots included: a status of 1 only says that a point ended inside
of the frame. `rsflow.track_points` is what tells whether it went the right way, in any light. Dense flow behind
OpenCV's interface is rsflow's own; `rsflow.dense_flow` also tells where it was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsflow import _checks, _core
from rsflow.errors import DTypeError, ShapeError

from ._opencv_dense import (
    DISOPTICAL_FLOW_PRESET_FAST,
    DISOPTICAL_FLOW_PRESET_MEDIUM,
    DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    OPTFLOW_FARNEBACK_GAUSSIAN,
    OPTFLOW_USE_INITIAL_FLOW,
    DenseFlow,
    DISOpticalFlow,
    DISOpticalFlow_create,
    calcOpticalFlowFarneback,
)
from ._outputs import in_place

__all__ = [
    "DISOPTICAL_FLOW_PRESET_FAST",
    "DISOPTICAL_FLOW_PRESET_MEDIUM",
    "DISOPTICAL_FLOW_PRESET_ULTRAFAST",
    "OPTFLOW_FARNEBACK_GAUSSIAN",
    "OPTFLOW_LK_GET_MIN_EIGENVALS",
    "OPTFLOW_USE_INITIAL_FLOW",
    "DISOpticalFlow",
    "DISOpticalFlow_create",
    "DenseFlow",
    "buildOpticalFlowPyramid",
    "calcOpticalFlowFarneback",
    "calcOpticalFlowPyrLK",
    "goodFeaturesToTrack",
]

OPTFLOW_LK_GET_MIN_EIGENVALS = 8

# More levels than a picture that fits into memory has, and the widest window of lk-core's structure tensor.
_MOST_LEVELS = 64
_MOST_BLOCK = 63

# cv2.TERM_CRITERIA_COUNT and cv2.TERM_CRITERIA_EPS, and what OpenCV takes where one of them is missing.
_COUNT, _EPS = 1, 2
_DEFAULT_COUNT, _DEFAULT_EPS = 30, 0.01

Criteria = tuple[int, int, float]

# A float32 picture within these levels is one of 0 (black) to 1 (white), with room for what filters overshoot by. One
# of 0 to 255 within them would be black all over.
_UNIT_LEVELS = (-1.0, 2.0)
_WHITE = 255.0


def __getattr__(name: str) -> Any:
    """Give OpenCV's own where rsflow does not stand in for it."""
    # What begins with an underscore is asked for by import, doctest and the like, which must not load OpenCV.
    if not name.startswith("_") or name == "__version__":
        import cv2

        try:
            return getattr(cv2, name)
        except AttributeError:
            pass
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}, and neither has cv2")


def __dir__() -> list[str]:
    """List what is here and what is OpenCV's."""
    import cv2

    return sorted({*__all__, "__version__", *(name for name in dir(cv2) if not name.startswith("_"))})


def calcOpticalFlowPyrLK(
    prevImg: Any,
    nextImg: Any,
    prevPts: Any,
    nextPts: Any,
    status: Any = None,
    err: Any = None,
    winSize: tuple[int, int] = (21, 21),
    maxLevel: int = 3,
    criteria: Criteria = (_COUNT | _EPS, _DEFAULT_COUNT, _DEFAULT_EPS),
    flags: int = 0,
    minEigThreshold: float = 1e-4,
) -> tuple[NDArray[np.float32] | None, NDArray[np.uint8] | None, NDArray[np.float32] | None]:
    """Track points as ``cv2.calcOpticalFlowPyrLK`` does.

    Parameters
    ----------
    prevImg, nextImg : ndarray of uint8, shape (height, width), or pyramids of `buildOpticalFlowPyramid`
        Grey frames; uint16 and float32 are taken too. Colour is not. float32 pictures of 0 (black) to 1 (white),
        which are those that both have all their levels between -1 and 2, are measured as 255 times of what they hold,
        so that `minEigThreshold` and `err` mean what they mean for uint8.
    prevPts : ndarray of float32, shape (N, 1, 2), (1, N, 2) or (N, 2)
        Positions in `prevImg` in pixels.
    nextPts : ndarray of float32 or None
        First guesses, and the output, if `flags` has `OPTFLOW_USE_INITIAL_FLOW`; written to where the size fits.
    status, err : ndarray or None
        Outputs, written to where the size fits.
    winSize : (int, int)
        Width and height of the window, 3 to 63 pixels.
    maxLevel : int
        Index of the coarsest level.
    criteria : (type, count, epsilon)
        When to stop, with ``cv2.TERM_CRITERIA_COUNT`` and ``cv2.TERM_CRITERIA_EPS``.
    flags : int
        `OPTFLOW_USE_INITIAL_FLOW` | `OPTFLOW_LK_GET_MIN_EIGENVALS`.
    minEigThreshold : float
        The least eigenvalue of a window.

    Returns
    -------
    nextPts : ndarray of float32, of the shape of `prevPts`
        Positions in `nextImg`.
    status : ndarray of uint8, shape (N, 1)
        1 where the point was found.
    err : ndarray of float32, shape (N, 1)
        Mean absolute difference of the windows in grey levels, or the eigenvalue.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        Where OpenCV raises ``cv2.error``: all of them derive from `rsflow.RsflowError`.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.interop.opencv import calcOpticalFlowPyrLK
    >>> y, x = np.mgrid[0:80, 0:100]
    >>> prev, next = ((120 + 60 * np.sin((x - u) / 4) * np.cos(y / 5)).astype(np.uint8) for u in (0, 1))
    >>> moved, status, err = calcOpticalFlowPyrLK(prev, next, np.float32([[[50, 40]]]), None)
    >>> np.round(moved, 1), status
    (array([[[51., 40.]]], dtype=float32), array([[1]], dtype=uint8))
    """
    points = _points("prevPts", prevPts)
    flags = _checks.integer("flags", flags, least=0)
    if points.size == 0:
        return None, None, None
    initial = None
    if flags & OPTFLOW_USE_INITIAL_FLOW:
        if nextPts is None:
            raise ShapeError("nextPts: got None, expected first guesses, as flags say with OPTFLOW_USE_INITIAL_FLOW")
        initial = _points("nextPts", nextPts)
    width, height = _checks.integers("winSize", winSize, 2, "(width, height), more than 2 pixels a side", least=3)
    maxLevel = _checks.integer("maxLevel", maxLevel, least=0)
    kind, count, epsilon = _criteria(criteria)
    least = _checks.number("minEigThreshold", minEigThreshold, most=_checks.FLOAT32_MAX)
    # The bounds are OpenCV's.
    count = min(max(count, 0), 100) if kind & _COUNT else _DEFAULT_COUNT
    epsilon = min(max(epsilon, 0.0), 10.0) if kind & _EPS else _DEFAULT_EPS
    before, after = _checks.pair(_image(prevImg), _image(nextImg), ("prevImg", "nextImg"))
    if _is_unit(before) and _is_unit(after):
        before, after = before * np.float32(_WHITE), after * np.float32(_WHITE)
    moved, found, error = _core.track_pyr_lk(
        before,
        after,
        points,
        initial,
        (width, height),
        min(maxLevel, _MOST_LEVELS),
        count,
        epsilon,
        least,
        bool(flags & OPTFLOW_LK_GET_MIN_EIGENVALS),
    )
    shape = np.shape(prevPts)
    return (
        in_place(nextPts, moved.reshape(shape)),
        in_place(status, found[:, None]),
        in_place(err, error[:, None]),
    )


def buildOpticalFlowPyramid(
    img: NDArray[Any],
    winSize: tuple[int, int],
    maxLevel: int,
    pyramid: Any = None,
    withDerivatives: bool = True,
    pyrBorder: int = 4,
    derivBorder: int = 0,
    tryReuseInputImage: bool = True,
) -> tuple[int, list[NDArray[Any]]]:
    """Build a pyramid that `calcOpticalFlowPyrLK` takes in place of an image.

    Parameters
    ----------
    img : ndarray of uint8, shape (height, width)
        Grey frame.
    winSize : (int, int)
        Window of the tracker: no level is smaller.
    maxLevel : int
        Index of the coarsest level.
    pyramid, pyrBorder, derivBorder, tryReuseInputImage
        Taken and not needed: borders are made when a window reaches over one.
    withDerivatives : bool
        Whether Scharr's derivatives follow each level.

    Returns
    -------
    maxLevel : int
        Index of the coarsest level that was built.
    pyramid : list of ndarray
        Levels, uint8, each followed by its derivatives, int16 (height, width, 2), if `withDerivatives`.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If an argument does not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.interop.opencv import buildOpticalFlowPyramid
    >>> level, pyramid = buildOpticalFlowPyramid(np.zeros((80, 100), np.uint8), (21, 21), 3, withDerivatives=False)
    >>> level, [picture.shape for picture in pyramid]
    (1, [(80, 100), (40, 50)])
    """
    if _checks.frame("img", img).dtype != np.uint8:
        raise DTypeError(f"img: got dtype {img.dtype}, expected uint8")
    if img.size == 0:
        raise ShapeError(f"img: got shape {img.shape}, expected at least one pixel")
    maxLevel = _checks.integer("maxLevel", maxLevel, least=0)
    width, height = _checks.integers("winSize", winSize, 2, "(width, height), integers")
    withDerivatives = _checks.flag("withDerivatives", withDerivatives)
    levels: list[NDArray[Any]] = []
    count = 0
    picture = img
    while True:
        levels.append(picture)
        if withDerivatives:
            levels.append(_scharr(picture))
        size = tuple((side + 1) // 2 for side in picture.shape)
        if count == maxLevel or size[1] <= width or size[0] <= height:
            return count, levels
        # OpenCV rounds each level to whole grey levels before it builds the next one.
        picture = np.floor(_core.gaussian_pyramid(picture, 2)[1] + 0.5).astype(np.uint8)
        count += 1


def goodFeaturesToTrack(
    image: NDArray[Any],
    maxCorners: int,
    qualityLevel: float,
    minDistance: float,
    corners: Any = None,
    mask: NDArray[np.uint8] | None = None,
    blockSize: int = 3,
    useHarrisDetector: bool = False,
    k: float = 0.04,
) -> NDArray[np.float32] | None:
    """Find corners as ``cv2.goodFeaturesToTrack`` does, with a gradient over 3 x 3 pixels.

    Parameters
    ----------
    image : ndarray of uint8 or float32, shape (height, width)
        Grey frame; uint16 is taken too.
    maxCorners : int
        The most corners to return; 0 or less means all.
    qualityLevel : float
        The least response, as a share of the best one's.
    minDistance : float
        The least distance between corners, in pixels.
    corners : None
        Taken and not needed.
    mask : ndarray of uint8, shape (height, width), optional
        Not 0 where to look.
    blockSize : int
        Side of the window of the structure tensor.
    useHarrisDetector : bool
        Harris and Stephens' response in place of the smaller eigenvalue.
    k : float
        Its parameter.

    Returns
    -------
    ndarray of float32, shape (N, 1, 2), or None
        Positions, the best first; None if there are none.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        Where OpenCV raises ``cv2.error``.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.interop.opencv import goodFeaturesToTrack
    >>> frame = np.zeros((60, 80), np.uint8)
    >>> frame[20:40, 30:50] = 200
    >>> goodFeaturesToTrack(frame, 10, 0.1, 5).shape
    (4, 1, 2)
    """
    image = _checks.frame("image", image)
    where = None
    if mask is not None:
        given = _checks.array("mask", mask, ..., "uint8, (height, width), not 0 where to look", kinds="biu")
        if given.size:
            if given.dtype not in (np.uint8, np.bool_, np.int8):
                raise DTypeError(f"mask: got dtype {given.dtype}, expected uint8")
            where = _checks.mask("mask", given != 0, image.shape, "image")
    most = _checks.FLOAT32_MAX
    quality = _checks.number("qualityLevel", qualityLevel, least=1e-30, most=1)
    distance = _checks.number("minDistance", minDistance, least=0, most=most, of="pixels")
    size = _checks.integer("blockSize", blockSize, least=1, most=_MOST_BLOCK, of="pixels")
    k = _checks.number("k", k, least=-most, most=most)
    harris = k if _checks.flag("useHarrisDetector", useHarrisDetector) else None
    count = max(_checks.integer("maxCorners", maxCorners), 0)
    found, _ = _core.detect_corners(image, where, count, quality, distance, size, harris, True)
    return found[:, None] if len(found) else None


def _points(name: str, value: Any) -> NDArray[np.float32]:
    """`value` as (N, 2), whatever of OpenCV's shapes it has."""
    if not isinstance(value, np.ndarray):
        raise DTypeError(f"{name}: got {type(value).__name__}, expected a numpy array of float32")
    if value.dtype != np.float32:
        raise DTypeError(f"{name}: got dtype {value.dtype}, expected float32")
    fits = value.size == 0 or (value.ndim in (2, 3) and value.shape[-1] == 2)
    if fits and value.ndim == 3 and value.size:
        fits = 1 in value.shape[:2]
    if not fits:
        raise ShapeError(f"{name}: got shape {value.shape}, expected (N, 1, 2), (1, N, 2) or (N, 2)")
    return np.ascontiguousarray(value.reshape(-1, 2))


def _criteria(criteria: Criteria) -> tuple[int, int, float]:
    """Take OpenCV's (type, count, epsilon)."""
    expected = "(type, count, epsilon): two integers and a number"
    if not isinstance(criteria, Sequence) or isinstance(criteria, (str, bytes)) or len(criteria) != 3:
        raise _checks.refused("criteria", criteria, expected)
    kind, count = _checks.whole(criteria[0]), _checks.whole(criteria[1])
    if kind is None or count is None:
        raise _checks.refused("criteria", criteria, expected)
    return kind, count, _checks.number("criteria[2]", criteria[2])


def _image(value: Any) -> Any:
    """Take the finest level of a pyramid, or the image itself."""
    return value[0] if isinstance(value, (list, tuple)) and len(value) else value


def _is_unit(picture: NDArray[Any]) -> bool:
    """Whether it is float32 of 0 to 1; pixels that are NaN do not say."""
    if picture.dtype != np.float32 or picture.size == 0:
        return False
    darkest, brightest = _UNIT_LEVELS
    lowest, highest = np.fmin.reduce(picture, axis=None), np.fmax.reduce(picture, axis=None)
    return bool(darkest <= lowest and highest <= brightest)


def _scharr(picture: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Scharr's derivatives, int16 (height, width, 2), the border mirrored."""
    padded = np.pad(picture.astype(np.int16), 1, mode="reflect" if min(picture.shape) > 1 else "edge")
    top, middle, bottom = padded[:-2], padded[1:-1], padded[2:]
    smooth = 3 * (top + bottom) + 10 * middle
    slope = bottom - top
    across = smooth[:, 2:] - smooth[:, :-2]
    down = 3 * (slope[:, 2:] + slope[:, :-2]) + 10 * slope[:, 1:-1]
    return np.stack([across, down], axis=2)
