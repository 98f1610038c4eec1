"""Bringing one picture to the light of another: a gain and an offset for the frame, and smooth ones over it."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    Mask = NDArray[np.bool_]

# About so many pixels, on a grid, are enough to fit the light of a whole frame.
_SAMPLES = 2000
# Fewer tell too little.
_FEWEST = 64
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
    step = max(1, math.isqrt(image.size // _SAMPLES))
    a, b = reference[::step, ::step], image[::step, ::step]
    keep = use[::step, ::step] & np.isfinite(a) & np.isfinite(b)
    a, b = a[keep], b[keep]
    if a.size < _FEWEST:
        return 1.0, 0.0
    gain, offset = 1.0, _median(b - a)
    for _ in range(3):
        residual = np.abs(b - np.float32(gain) * a - np.float32(offset))
        near = residual <= max(3 * 1.4826 * _median(residual), 1e-6)
        x, y = a[near].astype(np.float64), b[near].astype(np.float64)
        mean_x, mean_y = x.mean(), y.mean()
        x -= mean_x
        # Plain sums: a BLAS that starts threads for a dot product takes longer.
        spread = float((x * x).sum())
        # Without contrast a gain cannot be told from an offset.
        gain = float(np.clip(float((x * (y - mean_y)).sum()) / spread, *_GAINS)) if spread > 1e-9 * x.size else 1.0
        offset = float(mean_y - gain * mean_x)
    return gain, offset


def _median(values: F32) -> float:
    """Upper median by one partition: a third of the time of `numpy.median`."""
    middle = values.size // 2
    return float(np.partition(values, middle)[middle])


@dataclasses.dataclass(frozen=True)
class Light:
    """How the light of a picture differs from a reference's: gain and offset, and what varies slowly over the frame.

    Attributes
    ----------
    gain, offset : float
        Of the whole frame.
    slope, smooth : (H, W) float32
        What the frame's gain and offset leave, at each pixel: another gain less one, and another offset.
    """

    gain: float
    offset: float
    slope: F32
    smooth: F32

    def on(self, reference: F32) -> F32:
        """Show a reference in this light."""
        lit: F32 = reference * np.float32(self.gain) + np.float32(self.offset)
        change = lit * self.slope
        change += self.smooth
        lit += change
        return lit


def relit(reference: F32, image: F32, use: Mask, noise: float) -> F32:
    """Bring a reference to the light of an image: see `light_between`."""
    return light_between(reference, image, use, noise).on(reference)


def light_between(
    reference: F32, image: F32, use: Mask, noise: float, start: tuple[float, float] | None = None
) -> Light:
    """Fit one gain and offset, then ones that vary slowly over the frame.

    Parameters
    ----------
    reference, image : (H, W) float32
        Finite.
    use : (H, W) bool
        Where both show the same still thing, as far as is known.
    noise : float
        Standard deviation of their difference. What differs by more than this, or 6 % of the picture's range, after
        the first step is things and not light.
    start : (gain, offset), optional
        Of the whole frame, where `fit_light` has given them already.
    """
    import cv2

    gain, offset = start or fit_light(reference, image, use)
    height, width = image.shape
    size = (max(width // _REDUCTION, 1), max(height // _REDUCTION, 1))
    a, b = (cv2.resize(x, size, interpolation=cv2.INTER_AREA) for x in (reference, image))
    a = a * np.float32(gain) + np.float32(offset)
    weight = cv2.resize(use.view(np.uint8) * np.uint8(255), size, interpolation=cv2.INTER_AREA) * np.float32(1 / 255)
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
    slope, smooth = (cv2.resize(x, (width, height), interpolation=cv2.INTER_LINEAR) for x in (slope, smooth))
    return Light(gain, offset, slope, smooth)
