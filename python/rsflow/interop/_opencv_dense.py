"""Dense flow behind the interface of ``cv2.DenseOpticalFlow``."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from rsflow import _checks
from rsflow._checks.knobs import Illumination, Preset
from rsflow.flow import DenseFlow as _Estimator
from rsflow.flow import dense_flow

from ._outputs import in_place

__all__ = [
    "DISOPTICAL_FLOW_PRESET_FAST",
    "DISOPTICAL_FLOW_PRESET_MEDIUM",
    "DISOPTICAL_FLOW_PRESET_ULTRAFAST",
    "DISOpticalFlow_create",
    "DenseFlow",
]

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

    def collectGarbage(self) -> None:  # noqa: N802
        """Do nothing: memory is given back by itself."""


def DISOpticalFlow_create(preset: int = DISOPTICAL_FLOW_PRESET_FAST) -> DenseFlow:  # noqa: N802
    """Give a `DenseFlow` where a program asks OpenCV for a ``cv2.DISOpticalFlow``.

    Parameters
    ----------
    preset : int
        ``DISOPTICAL_FLOW_PRESET_ULTRAFAST``: rsflow's ``ultrafast``; ``_FAST``: ``fast``; ``_MEDIUM``: ``balanced``.

    Returns
    -------
    DenseFlow
        Its `calc` has the arguments, shapes and types of DIS and finds rsflow's flow. Settings of DIS alone, such as
        ``setFinestScale``, are not there.

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
    known = _checks.whole(preset)
    if known not in _PRESETS:
        raise _checks.refused("preset", preset, "0 (ultrafast), 1 (fast) or 2 (medium)")
    return DenseFlow(preset=_PRESETS[known])
