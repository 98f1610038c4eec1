"""Bringing one picture to the light of another: a gain and an offset for the frame, and smooth ones over it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    Mask = NDArray[np.bool_]

# Pixels this far apart are enough to fit the light of a whole frame.
_STEP = 6
# What a camera's exposure and a lamp do from frame to frame; beyond is not light.
_GAINS = (0.3, 3.0)
# The smooth light is fitted on a picture reduced this many times, over windows of this many reduced pixels: things up
# to half of 60 px wide do not pass for light.
_REDUCTION = 4
_WINDOW = 15


def fit_light(reference: F32, image: F32, use: Mask) -> tuple[float, float]:
    """Gain and offset that bring a reference to the light of an image, robustly, over the pixels to use.

    Three rounds of least squares without what lies beyond three standard deviations (from the median).
    """
    a, b = reference[::_STEP, ::_STEP], image[::_STEP, ::_STEP]
    keep = use[::_STEP, ::_STEP] & np.isfinite(a) & np.isfinite(b)
    a, b = a[keep], b[keep]
    if a.size < 16:
        return 1.0, 0.0
    gain, offset = 1.0, float(np.median(b - a))
    for _ in range(3):
        residual = np.abs(b - np.float32(gain) * a - np.float32(offset))
        near = residual <= max(3 * 1.4826 * float(np.median(residual)), 1e-6)
        x, y = a[near].astype(np.float64), b[near].astype(np.float64)
        mean_x, mean_y = x.mean(), y.mean()
        x -= mean_x
        # Plain sums: a BLAS that starts threads for a dot product takes longer.
        spread = float((x * x).sum())
        # Without contrast a gain cannot be told from an offset.
        gain = float(np.clip(float((x * (y - mean_y)).sum()) / spread, *_GAINS)) if spread > 1e-9 * x.size else 1.0
        offset = float(mean_y - gain * mean_x)
    return gain, offset


def relit(reference: F32, image: F32, use: Mask, noise: float) -> F32:
    """Bring a reference to the light of an image: one gain and offset, then ones that vary slowly over the frame.

    Parameters
    ----------
    reference, image : (H, W) float32
        Finite.
    use : (H, W) bool
        Where both show the same still thing, as far as is known.
    noise : float
        Standard deviation of their difference. What differs by more than this, or 6 % of the picture's range, after
        the first step is things and not light.
    """
    import cv2

    gain, offset = fit_light(reference, image, use)
    lit: F32 = reference * np.float32(gain) + np.float32(offset)
    height, width = image.shape
    small = (max(width // _REDUCTION, 1), max(height // _REDUCTION, 1))
    a, b = (cv2.resize(x, small, interpolation=cv2.INTER_AREA) for x in (lit, image))
    weight = cv2.resize(use.astype(np.float32), small, interpolation=cv2.INTER_AREA)
    difference = b - a
    # Averaged over sixteen pixels the noise is a fourth: what is left is light, up to this limit.
    limit = np.float32(max(noise, 0.06 * float(a.max() - a.min()), 1e-6))
    smooth = np.zeros_like(a)
    slope = np.zeros_like(a)
    for _ in range(2):
        residual = difference - (smooth + slope * a)
        w = weight * np.clip(1 - (residual / limit) ** 2, 0, None) + np.float32(1e-3)
        mean_w, mean_a, mean_d, mean_aa, mean_ad = (
            cv2.blur(x, (_WINDOW, _WINDOW), borderType=cv2.BORDER_REPLICATE)
            for x in (w, w * a, w * difference, w * a * a, w * a * difference)
        )
        mean_a, mean_d = mean_a / mean_w, mean_d / mean_w
        variance = mean_aa / mean_w - mean_a * mean_a
        # A ridge: where the window has little contrast the difference is an offset.
        slope = (mean_ad / mean_w - mean_a * mean_d) / (np.maximum(variance, 0) + limit * limit)
        slope = cv2.blur(slope, (5, 5), borderType=cv2.BORDER_REPLICATE)
        smooth = mean_d - slope * mean_a
    smooth, slope = (cv2.resize(x, (width, height), interpolation=cv2.INTER_LINEAR) for x in (smooth, slope))
    cv2.multiply(slope, lit, dst=slope)
    out: F32 = lit + slope
    out += smooth
    return out
