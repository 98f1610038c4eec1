"""What speaks for motion at each pixel of the current frame: residual flow and picture differences.

Plain functions over arrays, so that each can be tested alone; `rsflow.segmentation` puts them together.

docs/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np

from . import regions
from .background import warped
from .photometric import fit_light, light_between

if TYPE_CHECKING:
    from numpy.typing import NDArray

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

# Windows in pixels: of the structure tensor, and of a picture difference.
_TENSOR_WINDOW = 7
_DIFFERENCE_WINDOW = 5
# The same of half the size, in which the structure under a shadow is compared.
_SHADOW_WINDOW = 5
# A soft shadow differs from its ground by less than this share of what its thing does, this many pixels around.
_SHADOW_SHARE = 0.25
_SHADOW_REACH = 31
# A difference from the frame before of this many mean squares (see `mismatch`) is one; a weaker one only beside it.
_STRONG_MISMATCH = 6.0
_WEAK_MISMATCH = 2.5
_CHANGED = 25.0
# Share of the gradient that a picture difference may have from interpolation and registration, in pixels.
_REGISTRATION_PX = 0.15
# False discoveries allowed among the pixels called moving.
_FALSE_DISCOVERY = 1e-3
# chi-squared of two degrees of freedom: below this nothing is called moving whatever the rate (p = 0.001).
_LEAST_CHI2 = 13.8


@functools.lru_cache(maxsize=2)
def grid(height: int, width: int) -> tuple[F32, F32]:
    """Columns and rows of every pixel, for reading only."""
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    x.flags.writeable = y.flags.writeable = False
    return x, y


def backward(uv: F32, valid: Mask) -> tuple[F32, Mask]:
    """Where each pixel of the next frame was: x + b is its place in the previous one; and where that is known.

    Solves b(y) = -u(y + b(y)) by two fixed-point steps.
    """
    import cv2

    x, y = grid(*valid.shape)
    flow = np.where(valid[..., None], uv, np.float32(0))
    u = flow
    for _ in range(2):
        u = cv2.remap(flow, x - u[..., 0], y - u[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    source = cv2.remap(
        valid.view(np.uint8), x - u[..., 0], y - u[..., 1], cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT
    )
    return -u, source.view(bool)


def carried_back(mask: Mask, uv: F32, valid: Mask) -> Mask:
    """Where the pixels of a mask of the next frame were in the previous one."""
    import cv2

    x, y = grid(*mask.shape)
    flow = np.where(valid[..., None], uv, np.float32(0))
    out: Mask = cv2.remap(mask.view(np.uint8), x + flow[..., 0], y + flow[..., 1], cv2.INTER_NEAREST).view(bool)
    return out


def seen_before(shape: tuple[int, ...], homography: F64) -> Mask:
    """Pixels of this frame whose window the frame before shows, as the camera's motion says."""
    import cv2

    if np.array_equal(homography, np.eye(3)):
        return np.ones(shape, bool)
    there = warped(np.ones(shape, np.float32), homography, missing=0.0) > 0.999
    kernel = np.ones((_TENSOR_WINDOW, _TENSOR_WINDOW), np.uint8)
    # Beyond the frame counts as seen here, or the frame's own border would be lost as well.
    out: Mask = cv2.erode(there.view(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=1).view(bool)
    return out


def residual_motion(b: F32, homography: F64) -> F32:
    """Motion that the camera's does not explain, at the pixels of the next frame: y - H(y + b(y))."""
    if np.array_equal(homography, np.eye(3)):
        return -b
    x, y = grid(*b.shape[:2])
    h = homography.astype(np.float32)
    at_x, at_y = x + b[..., 0], y + b[..., 1]
    w = h[2, 0] * at_x + h[2, 1] * at_y + h[2, 2]
    return np.dstack(
        [
            x - (h[0, 0] * at_x + h[0, 1] * at_y + h[0, 2]) / w,
            y - (h[1, 0] * at_x + h[1, 1] * at_y + h[1, 2]) / w,
        ]
    )


def gradient(image: F32) -> tuple[F32, F32]:
    """Central differences along x and y, the frame's border repeated."""
    import cv2

    kernel = np.array([-0.5, 0, 0.5], np.float32)
    one = np.ones(1, np.float32)
    return (
        cv2.sepFilter2D(image, cv2.CV_32F, kernel, one, borderType=cv2.BORDER_REPLICATE),
        cv2.sepFilter2D(image, cv2.CV_32F, one, kernel, borderType=cv2.BORDER_REPLICATE),
    )


def box(image: F32, window: int) -> F32:
    """Mean over a square window."""
    import cv2

    out: F32 = cv2.blur(image, (window, window), borderType=cv2.BORDER_REPLICATE)
    return out


def structure_tensor(gx: F32, gy: F32) -> tuple[F32, F32, F32]:
    """Mean of the products of the gradients over a window: xx, xy, yy."""
    return box(gx * gx, _TENSOR_WINDOW), box(gx * gy, _TENSOR_WINDOW), box(gy * gy, _TENSOR_WINDOW)


def chi_squared(residual: F32, tensor: tuple[F32, F32, F32], noise: float, model_sigma: float, at: Any) -> F32:
    """Squared length of the residual motion in standard deviations of its own covariance, at an index of pixels.

    The covariance is that of a least-squares displacement, 2 noise^2 G^-1 with the structure tensor G of a window,
    plus the model's own: where the picture has no texture it is large, and no motion is significant.
    """
    count = _TENSOR_WINDOW**2
    xx, xy, yy = (part[at] * count for part in tensor)
    # Noise in the gradients looks like texture: half differences have half the variance of a pixel.
    bias = np.float32(count * noise**2 / 2)
    information = 1 / np.float32(2 * noise**2)
    xx, xy, yy = np.maximum(xx - bias, 0) * information, xy * information, np.maximum(yy - bias, 0) * information
    # (s I + A^-1)^-1 with information A is A (I + s A)^-1, which needs no inverse of a singular A.
    s = np.float32(model_sigma**2)
    p, q, r = 1 + s * xx, s * xy, 1 + s * yy
    determinant = np.maximum(p * r - q * q, np.float32(1e-12))
    a = (xx * r - xy * q) / determinant
    b = (xy * p - xx * q) / determinant
    c = (yy * p - xy * q) / determinant
    u, v = residual[at][..., 0], residual[at][..., 1]
    out: F32 = np.maximum(a * u * u + 2 * b * u * v + c * v * v, 0)
    return out


def significant(chi2: F32, sample: F32, share: float) -> float:
    """Value of chi-squared above which pixels are called moving, by Benjamini and Hochberg's false discovery rate.

    Parameters
    ----------
    chi2 : (n,) float32
        Of the pixels that may move.
    sample : (m,) float32
        Of pixels all over the frame: the null is scaled to their median, so that errors larger than their covariance
        do not count as motion.
    share : float
        How many times more pixels the frame has than `sample`.
    """
    # The median of chi-squared with two degrees of freedom is 2 ln 2.
    scale = max(1.0, float(np.median(sample)) / (2 * np.log(2))) if sample.size else 1.0
    edges = np.arange(_LEAST_CHI2, 120.0, 0.5)
    above = chi2.size - np.searchsorted(np.sort(chi2) / scale, edges)
    expected = sample.size * share * np.exp(-edges / 2)
    enough = np.nonzero(expected <= _FALSE_DISCOVERY * np.maximum(above, 1))[0]
    return float(edges[enough[0] if len(enough) else -1]) * scale


def outstanding(difference: F32) -> Mask:
    """Where a difference is not far weaker than the strongest nearby: a soft shadow is beside what casts it."""
    import cv2

    length = np.asarray(np.abs(box(difference, 3)), np.float32)
    # The strongest of a small area, not of a pixel, in the reach of a shadow.
    strongest = cv2.dilate(box(length, _DIFFERENCE_WINDOW), np.ones((_SHADOW_REACH, _SHADOW_REACH), np.uint8))
    out: Mask = length > _SHADOW_SHARE * strongest
    return out


def noise_of(difference: F32, known: Mask) -> float:
    """Robust standard deviation of a difference of two frames."""
    values = np.abs(difference[::4, ::4][known[::4, ::4]])
    if values.size == 0:
        return 0.0
    middle, most = np.percentile(values, (50, 90))
    # Of a normal distribution both are the same; compression leaves most pixels too quiet and a tail.
    return float(max(1.4826 * middle, most / 1.645))


def mismatch(difference: F32, slope: F32, variance: float | F32) -> F32:
    """Mean squared difference of a window in units of what noise and a small misregistration explain: about 1."""
    scale = np.asarray(variance, np.float32) + np.float32(_REGISTRATION_PX**2) * slope
    return box(np.asarray(difference * difference / scale, np.float32), _DIFFERENCE_WINDOW)


@dataclasses.dataclass(frozen=True)
class FlowEvidence:
    """What flow and the two pictures say.

    Attributes
    ----------
    moving : (H, W) bool
        Regions that move.
    changed : (H, W) bool
        Pixels that differ from the frame before by more than noise and light, whatever their flow.
    spread : float
        Standard deviation of the difference of two pictures of the same.
    slope : (H, W) float32
        Squared gradient of the current picture.
    square : (H, W) float32
        Squared difference from the frame before, mean over a window.
    """

    moving: Mask
    changed: Mask
    spread: float
    slope: F32
    square: F32


def by_flow(
    previous: F32,
    current: F32,
    b: F32,
    residual: F32,
    known: Mask,
    kept: Mask,
    *,
    homography: F64,
    model_sigma: float,
    least_motion: float,
    rounding: float,
    most_spread: float,
    variance: F32 | None = None,
    counts: Mask | None = None,
) -> FlowEvidence:
    """Find the regions whose residual motion is significant and explains the picture better than rest does.

    `kept` is where something moved in the frame before, carried along by the camera's motion: there less is enough.
    Noise does not jump: a spread above `most_spread` comes from a thing that fills much of the frame.
    `variance` is the usual one of the difference at each pixel, where it is known: leaves in the wind have more.
    Where `counts` is False pictures are not compared, and windows around take the difference for none.
    """
    import cv2

    x, y = grid(*current.shape)
    moved = cv2.remap(previous, x + b[..., 0], y + b[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    stood = warped(previous, homography, missing=0.0)
    still = known & ~kept
    gain, offset = fit_light(stood, current, still)
    spread = noise_of(current - (stood * np.float32(gain) + np.float32(offset)), still)
    light = light_between(stood, current, still, spread, (gain, offset))
    by_rest = current - light.on(stood)
    if counts is not None:
        by_rest[~counts] = 0
    # Two frames differ by the noise of both, and rounding is part of it.
    spread = max(min(noise_of(by_rest, still), most_spread), np.sqrt(2) * rounding)
    square = box(by_rest * by_rest, _DIFFERENCE_WINDOW)
    usual = spread**2 if variance is None else np.maximum(variance, np.float32(2 * rounding**2))
    by_motion = current - light.on(moved)
    if counts is not None:
        by_motion[~counts] = 0
    gx, gy = gradient(current)
    slope = gx * gx + gy * gy
    rest, motion = mismatch(by_rest, slope, usual), mismatch(by_motion, slope, usual)
    length2 = residual[..., 0] ** 2 + residual[..., 1] ** 2
    may = known & (length2 > least_motion**2) & (rest > _WEAK_MISMATCH)
    # Where there is no texture, both explain it: that alone is no evidence, but it fills a thing.
    smooth = known & (length2 > least_motion**2) & (motion < _WEAK_MISMATCH)
    # Near the edge of a thing its flow reaches over the surroundings: there rest explains the picture as well.
    may &= rest > np.where(kept, 0.9 * motion, 1.3 * motion + 0.7)
    noise = spread / np.sqrt(2)
    tensor = structure_tensor(gx, gy)
    sample = chi_squared(residual, tensor, noise, model_sigma, np.s_[::4, ::4])[known[::4, ::4]]
    chi2 = chi_squared(residual, tensor, noise, model_sigma, may)
    threshold = significant(chi2, sample, 16)
    seeds, weak = np.zeros_like(may), np.zeros_like(may)
    weak[may] = chi2 > threshold / 3
    seeds[may] = (chi2 > threshold) & (rest[may] > _STRONG_MISMATCH)
    changed = known & (rest > _CHANGED) & ~explained_by_light(stood, current, spread)
    # A thing goes on where its flow does not explain the picture, as on legs, but rest does not either.
    moving = regions.filled_hulls((weak | changed) & outstanding(by_rest), smooth, seeds)
    return FlowEvidence(moving, changed, float(spread), slope, square)


def explained_by_light(reference: F32, image: F32, noise: float) -> Mask:
    """Where a small window shows the same structure under another light, as in a shadow: a gain fits it."""
    import cv2

    height, width = image.shape
    half = (max(width // 2, 1), max(height // 2, 1))
    a, b = (cv2.resize(x, half, interpolation=cv2.INTER_AREA) for x in (reference, image))
    mean_a, mean_b = box(a, _SHADOW_WINDOW), box(b, _SHADOW_WINDOW)
    var_a = np.maximum(box(a * a, _SHADOW_WINDOW) - mean_a * mean_a, 0)
    var_b = np.maximum(box(b * b, _SHADOW_WINDOW) - mean_b * mean_b, 0)
    covariance = box(a * b, _SHADOW_WINDOW) - mean_a * mean_b
    # Four pixels are averaged, so their noise is half.
    textured = (var_a > np.float32(noise**2)) & (var_b > np.float32(noise**2))
    same = covariance > np.float32(0.85) * np.sqrt(var_a * var_b)
    # A shadow or a lamp is a gain in this range; a dark coat on a bright path is not.
    lit = textured & same & (mean_b > 0.4 * mean_a) & (mean_b < 2.5 * mean_a)
    out: Mask = cv2.resize(lit.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).view(bool)
    return out
