"""Dense flow behind the interfaces of ``cv2.DenseOpticalFlow`` and ``cv2.calcOpticalFlowFarneback``."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from rsflow import _checks
from rsflow._checks.knobs import Illumination, Preset
from rsflow._display import options
from rsflow.errors import ShapeError
from rsflow.flow import DenseFlow as _Estimator
from rsflow.flow import dense_flow

from ._outputs import in_place

__all__ = [
    "DISOPTICAL_FLOW_PRESET_FAST",
    "DISOPTICAL_FLOW_PRESET_MEDIUM",
    "DISOPTICAL_FLOW_PRESET_ULTRAFAST",
    "OPTFLOW_FARNEBACK_GAUSSIAN",
    "OPTFLOW_USE_INITIAL_FLOW",
    "DISOpticalFlow",
    "DISOpticalFlow_create",
    "DenseFlow",
    "calcOpticalFlowFarneback",
]

OPTFLOW_USE_INITIAL_FLOW = 4
OPTFLOW_FARNEBACK_GAUSSIAN = 256

DISOPTICAL_FLOW_PRESET_ULTRAFAST = 0
DISOPTICAL_FLOW_PRESET_FAST = 1
DISOPTICAL_FLOW_PRESET_MEDIUM = 2

# Those that are meant for the same time.
_PRESETS: dict[int, Preset] = {
    DISOPTICAL_FLOW_PRESET_ULTRAFAST: "ultrafast",
    DISOPTICAL_FLOW_PRESET_FAST: "fast",
    DISOPTICAL_FLOW_PRESET_MEDIUM: "balanced",
}


class DenseFlow:
    """Takes the place of a ``cv2.DenseOpticalFlow``, such as ``cv2.DISOpticalFlow``: ``calc(I0, I1, flow)``.

    Parameters
    ----------
    preset, illumination, max_displacement
        As in `rsflow.dense_flow`, which also tells where the flow was measured and how well it fits.

    Raises
    ------
    OptionError
        If an option has a value that it does not allow.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.interop.opencv import DenseFlow
    >>> frame = np.zeros((48, 64), np.uint8)
    >>> DenseFlow(preset="fast").calc(frame, frame, None).shape
    (48, 64, 2)
    """

    def __init__(
        self,
        *,
        preset: Preset = "balanced",
        illumination: Illumination = "gain_offset",
        max_displacement: float | None = None,
    ) -> None:
        self._knobs: dict[str, Any] = {
            "preset": preset,
            "illumination": illumination,
            "max_displacement": max_displacement,
        }
        # Raises now what `calc` would raise for each pair of frames.
        _Estimator(**self._knobs)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({options(**self._knobs)})"

    def calc(self, I0: NDArray[Any], I1: NDArray[Any], flow: Any = None) -> NDArray[Any]:
        """Return the flow from `I0` to `I1`.

        Parameters
        ----------
        I0, I1 : ndarray (height, width) of uint8, uint16 or float32
            The frames, grey.
        flow : ndarray (height, width, 2) of float32 or None
            Where it has this shape and type, the result is written into it and it is returned; else it is left alone,
            as OpenCV does. What it holds before is not used: far motion is found without a start.

        Returns
        -------
        ndarray of float32, (height, width, 2)
            Displacement in pixels, x then y; NaN where there was nothing to measure, as at a pixel that is not finite.

        Raises
        ------
        ShapeError, DTypeError
            If a frame does not fit, where OpenCV raises ``cv2.error``.
        """
        I0, I1 = _checks.pair(I0, I1, ("I0", "I1"))
        return in_place(flow, dense_flow(I0, I1, **self._knobs).uv)

    def collectGarbage(self) -> None:
        """Do nothing: memory is given back by itself."""


class DISOpticalFlow(DenseFlow):
    """Takes the place of ``cv2.DISOpticalFlow``, with its settings; `calc` finds rsflow's flow.

    Parameters
    ----------
    preset : int
        ``DISOPTICAL_FLOW_PRESET_ULTRAFAST``: rsflow's ``ultrafast``; ``_FAST``: ``fast``; ``_MEDIUM``: ``balanced``.

    Raises
    ------
    OptionError
        If it is another preset.

    Notes
    -----
    Every other method of ``cv2.DISOpticalFlow`` (``setFinestScale``, ``getPatchSize``, ``save``, ...) is OpenCV's own:
    it checks, keeps and returns the value as OpenCV does. One setting changes the flow:
    ``setUseMeanNormalization(False)`` takes the light as steady (``illumination="none"``). The others describe how DIS
    searches. rsflow searches otherwise, as its preset says, and they change nothing.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.interop import opencv
    >>> dis = opencv.DISOpticalFlow.create(opencv.DISOPTICAL_FLOW_PRESET_MEDIUM)
    >>> dis.setUseSpatialPropagation(False)
    >>> dis.getUseSpatialPropagation(), dis.getPatchSize()
    (False, 8)
    >>> frame = np.zeros((48, 64), np.uint8)
    >>> dis.calc(frame, frame, None).shape
    (48, 64, 2)
    """

    def __init__(self, preset: int = DISOPTICAL_FLOW_PRESET_FAST) -> None:
        known = _checks.whole(preset)
        if known not in _PRESETS:
            raise _checks.refused("preset", preset, "0 (ultrafast), 1 (fast) or 2 (medium)")
        super().__init__(preset=_PRESETS[known])
        import cv2

        self._preset = known
        self._settings: Any = cv2.DISOpticalFlow.create(known)

    @staticmethod
    def create(preset: int = DISOPTICAL_FLOW_PRESET_FAST) -> DISOpticalFlow:
        """Return one with this preset, as ``cv2.DISOpticalFlow.create`` does."""
        return DISOpticalFlow(preset)

    def calc(self, I0: NDArray[Any], I1: NDArray[Any], flow: Any = None) -> NDArray[Any]:
        """Return the flow from `I0` to `I1`, as `DenseFlow.calc` does."""
        self._knobs["illumination"] = "gain_offset" if self._settings.getUseMeanNormalization() else "none"
        return super().calc(I0, I1, flow)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self._settings, name)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in dir(self._settings) if not name.startswith("_"))})

    def __reduce__(self) -> tuple[Any, ...]:
        # OpenCV's object cannot be copied or pickled; what was set can.
        getters = (name for name in dir(self._settings) if name.startswith("get") and hasattr(self, f"set{name[3:]}"))
        return _restored, (self._preset, {name[3:]: getattr(self._settings, name)() for name in getters})


def _restored(preset: int, settings: dict[str, Any]) -> DISOpticalFlow:
    """Give a `DISOpticalFlow` with these settings."""
    flow = DISOpticalFlow(preset)
    for name, value in settings.items():
        getattr(flow, f"set{name}")(value)
    return flow


def DISOpticalFlow_create(preset: int = DISOPTICAL_FLOW_PRESET_FAST) -> DISOpticalFlow:
    """Give a `DISOpticalFlow` where a program asks OpenCV for one.

    Parameters
    ----------
    preset : int
        As in `DISOpticalFlow`.

    Returns
    -------
    DISOpticalFlow
        Its `calc` has the arguments, shapes and types of DIS and finds rsflow's flow.

    Raises
    ------
    OptionError
        If it is another preset.

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow.interop import opencv
    >>> frame = np.zeros((48, 64), np.uint8)
    >>> dis = opencv.DISOpticalFlow_create(opencv.DISOPTICAL_FLOW_PRESET_MEDIUM)
    >>> dis.calc(frame, frame, None).shape
    (48, 64, 2)
    """
    return DISOpticalFlow(preset)


def calcOpticalFlowFarneback(
    prev: Any,
    next: Any,
    flow: Any,
    pyr_scale: float,
    levels: int,
    winsize: int,
    iterations: int,
    poly_n: int,
    poly_sigma: float,
    flags: int,
) -> NDArray[Any]:
    """Find dense flow where a program calls ``cv2.calcOpticalFlowFarneback``.

    The flow is rsflow's, with the preset ``balanced``: it is no polynomial expansion. It finds far motion without
    settings and measures in changing light.

    Parameters
    ----------
    prev, next : ndarray (height, width) of uint8, uint16 or float32
        Grey frames.
    flow : ndarray of float32, shape (height, width, 2), or None
        With `OPTFLOW_USE_INITIAL_FLOW` the first guess. Where it has this shape and type, the result is written into
        it.
    pyr_scale : float
        Ratio of the sizes of two levels, above 0 and below 1. Checked and without effect: rsflow's is a half.
    levels, winsize, iterations, poly_n : int
        Number of levels, side of the averaging window, steps a level, side of the neighbourhood of a polynomial.
        Checked and without effect: the preset has its own.
    poly_sigma : float
        Deviation of the Gaussian of that neighbourhood. Checked and without effect.
    flags : int
        `OPTFLOW_USE_INITIAL_FLOW` | `OPTFLOW_FARNEBACK_GAUSSIAN`; the latter, a Gaussian window, is without effect.

    Returns
    -------
    ndarray of float32, (height, width, 2)
        Displacement in pixels, x then y; NaN where there was nothing to measure, as at a pixel that is not finite.

    Raises
    ------
    ShapeError, DTypeError, OptionError
        If an argument does not fit.

    Examples
    --------
    >>> from rsflow import synthetic
    >>> from rsflow.interop import opencv
    >>> pair = synthetic.shifted_pair(2.5, 1.0, size=(160, 120), seed=1)
    >>> flow = opencv.calcOpticalFlowFarneback(pair.prev, pair.next, None, 0.5, 3, 15, 3, 5, 1.2, 0)
    >>> flow[60, 80].round(1)
    array([2.5, 1. ], dtype=float32)
    """
    _checks.number("pyr_scale", pyr_scale, above=0, below=1)
    _checks.integer("levels", levels, least=0)
    _checks.integer("winsize", winsize, least=1, of="pixels")
    _checks.integer("iterations", iterations, least=0)
    _checks.integer("poly_n", poly_n, least=1, of="pixels")
    _checks.number("poly_sigma", poly_sigma, least=0)
    flags = _checks.integer("flags", flags, least=0)
    before, after = _checks.pair(prev, next)
    initial = None
    if flags & OPTFLOW_USE_INITIAL_FLOW:
        if flow is None:
            raise ShapeError("flow: got None, expected a first guess, as flags say with OPTFLOW_USE_INITIAL_FLOW")
        initial = _checks.array("flow", flow, (*before.shape, 2), "numbers, (height, width, 2)")
    return in_place(flow, dense_flow(before, after, initial=initial).uv)
