"""Dense flow behind the interface of ``cv2.DenseOpticalFlow``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rsflow.errors import DTypeError, ShapeError
from rsflow.flow import Illumination, Preset, dense_flow

__all__ = ["DenseFlow"]


class DenseFlow:
    """Takes the place of a ``cv2.DenseOpticalFlow``, such as ``cv2.DISOpticalFlow``: ``calc(I0, I1, flow)``.

    Parameters
    ----------
    preset, illumination, max_displacement
        As in `rsflow.dense_flow`, which also tells where the flow was measured and how well it fits.

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

    def calc(self, I0: NDArray[Any], I1: NDArray[Any], flow: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Return the flow from `I0` to `I1`, (height, width, 2) float32, x then y.

        Parameters
        ----------
        I0, I1 : ndarray (height, width) of uint8, uint16 or float32
            The frames, grey.
        flow : ndarray (height, width, 2) of float32, optional
            Where it is given, the result is written into it and it is returned, as OpenCV does.

        Raises
        ------
        ShapeError, DTypeError
            If a frame or `flow` does not fit.
        """
        uv = dense_flow(I0, I1, **self._knobs).uv
        if flow is None:
            return uv
        if not isinstance(flow, np.ndarray) or flow.dtype != np.float32:
            raise DTypeError(f"flow: got {getattr(flow, 'dtype', type(flow).__name__)}, expected a float32 array")
        if flow.shape != uv.shape:
            raise ShapeError(f"flow: got shape {flow.shape}, expected {uv.shape}")
        flow[...] = uv
        return flow

    def collectGarbage(self) -> None:  # noqa: N802
        """Do nothing: memory is given back by itself."""
