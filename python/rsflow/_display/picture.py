"""Pictures to look at: any frame as blue, green, red; and a small one inside of a notebook's page."""

from __future__ import annotations

import base64
import html as _html
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks

# The largest picture inside of a page, in pixels: what stands beside text, at most some 150 kilobytes.
_WIDEST, _HIGHEST = 480, 360


def displayed(picture: NDArray[Any], name: str = "picture") -> NDArray[np.uint8]:
    """Make a new blue, green, red uint8 picture to draw on, of any frame.

    uint8 stays as it is; uint16 and floating point are stretched from their 0.5th to their 99.5th percentile.
    """
    array = _checks.picture(name, picture)
    if array.dtype != np.uint8:
        array = _stretched(array)
    if array.ndim == 2:
        return np.repeat(array[..., None], 3, axis=2)
    return np.array(array, order="C")


def display_range(array: NDArray[Any]) -> tuple[float, float]:
    """Return the values shown as black and as white."""
    values = array[np.isfinite(array)]
    low, high = np.percentile(values, (0.5, 99.5)) if values.size else (0.0, 1.0)
    return float(low), float(high)


def _stretched(array: NDArray[Any]) -> NDArray[np.uint8]:
    with np.errstate(over="ignore"):
        values = array.astype(np.float32)
    low, high = display_range(values)
    # Clipped first: what is infinite is black or white.
    scaled = (np.nan_to_num(values, nan=low).clip(low, high) - low) * (255.0 / max(high - low, 1e-6))
    return scaled.clip(0, 255).astype(np.uint8)


def html(text: str, picture: NDArray[np.uint8] | None) -> str:
    """Give what a notebook shows of a result: its text, and a picture below it, made to fit 480 x 360 pixels.

    Examples
    --------
    >>> page = html("FlowField(64 x 48)", np.zeros((48, 64, 3), np.uint8))
    >>> page.split(" src=")[0]
    '<pre>FlowField(64 x 48)</pre><img alt="FlowField(64 x 48)"'
    >>> html("Tracks(0 points)", None)
    '<pre>Tracks(0 points)</pre>'
    """
    told = _html.escape(text)
    if picture is None or picture.size == 0:
        return f"<pre>{told}</pre>"
    import cv2

    height, width = picture.shape[:2]
    scale = min(_WIDEST / width, _HIGHEST / height)
    if scale < 1:
        size = (max(round(width * scale), 1), max(round(height * scale), 1))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    _, data = cv2.imencode(".png", picture)
    code = base64.b64encode(data.tobytes()).decode("ascii")
    return f'<pre>{told}</pre><img alt="{told}" src="data:image/png;base64,{code}">'
