"""What moves and what stands still, for a static and for a moving camera.

For each frame: the camera's own motion in the picture is fitted to the dense flow; what is left of each pixel's flow
is tested against its covariance; pictures tell which pixels near a motion edge belong to what moves; regions are
cleaned and followed. With a static camera what differs from the background, in light that may change, is the outline.

docs/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

import math
import numbers
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from .. import _checks
from .._checks.knobs import Illumination, Preset
from .._display import options
from .._shared import Shared, alone, anew
from ..capture.masks import FixedMask
from ..errors import DTypeError, OptionError, ShapeError
from ..flow import DenseFlow
from . import evidence, regions
from . import homography as _homography
from . import parallax as _parallax
from .background import Background, warped
from .foreground import Outline, shows_background
from .objects import ObjectTracker
from .photometric import fit_light
from .reduction import Reduction
from .result import MotionSegmentation, SegmentationStatus

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..io.flow_files import FlowLike
    from .object_table import TrackedObject

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["MotionSegmentation", "MotionSegmenter"]

# Vectors for the camera's motion stand this far apart, in pixels: about the reach of the flow's own smoothness.
_VECTOR_STEP = 12
# Parallax is looked for among about so many vectors.
_PARALLAX_VECTORS = 3000
# Motion below this many pixels per frame is not told from rest.
_LEAST_MOTION_PX = 0.4
# The smallest region, as a share of the frame, and in pixels.
_LEAST_SHARE = 1e-4
_LEAST_AREA = 12
# What is seen in one frame alone is noise.
_LEAST_AGE = 2
# A background of fewer frames may still hold what moves.
_TRUSTED_BACKGROUND = 5
# The noise of a camera rises at most by this factor from frame to frame.
_SPREAD_RISE = 1.1
# Quantisation: the standard deviation of rounding to whole levels.
_ROUNDING = 0.29


class MotionSegmenter(Shared):
    """Tell what moves from what stands still, frame after frame.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Parameters
    ----------
    camera_motion : {"moving", "static"}
        Whether the camera moves. Of a static camera more can be told: the outline of what moves, also for a while
        when it pauses.
    preset : {"ultrafast", "fast", "balanced", "accurate"}
        Of the dense flow.
    illumination : {"gain_offset", "offset", "none"}
        How light may change, for the dense flow.
    max_displacement : float, optional
        The longest displacement to look for, a length in pixels from frame to frame: longer ones are not sought, and
        none is valid. By default half the frame along each axis.
    min_area : int, optional
        Things of fewer pixels are left out; by default a ten-thousandth of the frame, and at least 12.
    mask : ndarray of bool, (height, width), optional
        True where a pixel counts, in every frame: False where the picture shows what is fixed to the sensor, such as
        letters over the picture or a part of the own vehicle. There nothing is ever moving or part of a thing, and
        nothing depends on what the picture shows there.

    Raises
    ------
    OptionError
        If `camera_motion` or `min_area` is out of range.
    DTypeError
        If the mask is not of bool.

    Notes
    -----
    The camera's motion is a plane's: a translation, similarity, affine map or homography. Where things move against
    that plane along lines through one point, by more than chance and as far as the camera travelled, the scene has
    depth, and motion along these lines the way that depth goes is parallax: what moves so by itself cannot be told.

    Parallax: M. Irani and P. Anandan, PAMI 20(6), 1998. False discoveries: Y. Benjamini and Y. Hochberg,
    J. R. Stat. Soc. B 57, 1995.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> frames = np.random.default_rng(1).integers(0, 256, (3, 60, 80), np.uint8)
    >>> segmenter = rsflow.MotionSegmenter(camera_motion="static")
    >>> first = segmenter.update(frames[0])
    >>> print(first.status, bool(first.moving.any()))
    first_frame False
    """

    _state_types: ClassVar = {
        **dict.fromkeys(("static_camera", "_flow_is_ours"), (bool, np.bool_)),
        "_parallax": (_parallax.Parallax, type(None)),
        "min_area": (numbers.Integral, type(None)),
        "_flow": (DenseFlow,),
        "_fixed": (FixedMask, type(None)),
        **dict.fromkeys(("_previous", "_moving", "_camera_before"), (np.ndarray, type(None))),
        "_outline": (Outline, type(None)),
        "_background": (Background,),
        "_spread": (numbers.Real,),
        "_tracker": (ObjectTracker, type(None)),
    }

    def __init__(
        self,
        *,
        camera_motion: Literal["moving", "static"] = "moving",
        preset: Preset = "fast",
        illumination: Illumination = "gain_offset",
        max_displacement: float | None = None,
        min_area: int | None = None,
        mask: NDArray[np.bool_] | None = None,
    ) -> None:
        _checks.choice("camera_motion", camera_motion, ("moving", "static"))
        min_area = _checks.integer_or_none("min_area", min_area, least=1, of="pixels")
        self.static_camera = camera_motion == "static"
        self.min_area = min_area
        mask = _checks.mask_or_none("mask", mask)
        self._fixed = None if mask is None else FixedMask(mask)
        pixels = None if self._fixed is None else self._fixed.pixels
        self._flow = DenseFlow(
            preset=preset,
            illumination=illumination,
            max_displacement=max_displacement,
            mask=pixels,
            next_mask=pixels,
        )
        self.reset()

    def __repr__(self) -> str:
        knobs = {"camera_motion": "static" if self.static_camera else "moving", "min_area": self.min_area}
        told = options(**knobs, mask=self._fixed is not None)
        shape = None if self._previous is None else self._previous.shape
        before = "no frame yet" if shape is None else f"frames of {shape[1]} x {shape[0]}"
        return f"MotionSegmenter({told}): {before}"

    @anew
    def reset(self) -> None:
        """Forget everything: the next frame is a first one, as after a cut."""
        self._previous: F32 | None = None
        self._moving: Mask | None = None
        self._outline: Outline | None = None
        self._parallax: _parallax.Parallax | None = None
        self._camera_before: F64 | None = None
        self._background = Background()
        self._spread = np.inf
        self._tracker: ObjectTracker | None = None
        self._flow.reset()
        self._flow_is_ours = True

    @alone
    def update(
        self, image: NDArray[Any], *, flow: FlowLike | None = None, t_s: float | None = None
    ) -> MotionSegmentation:
        """Take the next frame.

        Parameters
        ----------
        image : ndarray of uint8, uint16 or float32, (height, width)
            The frame; all of one size.
        flow : FlowField, optional
            Flow from the previous frame to this one where it is known already; by default it is computed here. Give
            it for every frame after the first or for none.
        t_s : float, optional
            Its time in seconds, for velocities of things per second.

        Returns
        -------
        MotionSegmentation

        Raises
        ------
        ShapeError, DTypeError
            If it is not such a frame, or not of the size of the one before or of the mask.
        OptionError
            If a flow is given for some frames only.
        """
        image, t_s = _checks.frame("image", image), _checks.number_or_none("t_s", t_s, of="seconds", or_nan=True)
        if image.size == 0:
            raise ShapeError(f"image: got shape {image.shape}, expected at least one pixel")
        counted = image
        if self._fixed is not None:
            self._fixed.expect_shape(image.shape)
            # Coarse levels of the flow, and filters here, reach over pixels that do not count.
            counted = self._fixed.filled(image)
        current = counted.astype(np.float32)
        if image.dtype == np.float32:
            current = np.nan_to_num(current)
        self._rounding = _ROUNDING if image.dtype != np.float32 else max(1e-3 * float(np.ptp(current)), 1e-9)
        if self._previous is not None and current.shape != self._previous.shape:
            raise ShapeError(
                f"image: got {current.shape}, expected the shape of the frames before, {self._previous.shape}; "
                "reset() starts another sequence"
            )
        if flow is None:
            if not self._flow_is_ours:
                raise OptionError("flow: got None, expected that of every frame after the first, or of none")
            flow = self._flow.update(counted)
        elif self._previous is None:
            raise OptionError("flow: got one for the first frame, which has none, expected None, or reset() before")
        else:
            flow = _given_flow(flow, current.shape)
            self._flow_is_ours = False
        if self._previous is None or flow is None:
            return self._start(image, current)
        result = self._segment(image, current, flow, t_s)
        self._previous = current
        return result

    def _start(self, image: NDArray[Any], current: F32) -> MotionSegmentation:
        self._previous = current
        self._moving = np.zeros(current.shape, bool)
        area = max(_LEAST_AREA, round(_LEAST_SHARE * current.size)) if self.min_area is None else self.min_area
        self._tracker = ObjectTracker(min_area=area, min_age=_LEAST_AGE, only_travelling=True)
        self._background.add(current, self._uncounted(self._moving))
        model = "static" if self.static_camera else "none"
        return self._result(image, current, None, np.eye(3), model, (), SegmentationStatus.FIRST_FRAME)

    def _segment(self, image: NDArray[Any], current: F32, flow: FlowLike, t_s: float | None) -> MotionSegmentation:
        assert self._previous is not None
        assert self._moving is not None
        assert self._tracker is not None
        uv = np.asarray(flow.uv, np.float32)
        given: Mask = np.isfinite(uv[..., 0] + uv[..., 1])
        if self._fixed is not None:
            given &= self._fixed.pixels
        trusted = given & np.asarray(flow.valid, bool)
        covariance = getattr(flow, "covariance", None)
        camera = self._camera(uv, trusted, covariance)
        homography = camera.homography
        self._camera_before = None if camera.model == "none" else homography
        self._background.follow(homography)
        if camera.model == "none":
            self._background.reset()
            self._moving = np.zeros_like(self._moving)
            self._background.add(current, self._uncounted(self._moving))
            objects = self._tracker.update(self._moving, t_s=t_s)
            return self._result(image, current, None, homography, "none", objects, SegmentationStatus.NO_CAMERA_MOTION)
        small = Reduction.of(current.shape)
        if self.static_camera and self._outline is None:
            self._outline = Outline((small.size[1], small.size[0]))
        # Flow that its own estimator does not trust takes part as well: the pictures decide whether it explains them.
        b, known = evidence.backward(small.motion(uv, given), small.all(given))
        residual = evidence.residual_motion(b, small.homography(homography))
        believed = self._believe(uv, trusted, covariance, camera)
        if believed is not None:
            residual = believed.unexplained(residual, small)
        # Where this frame shows what the one before did not, and windows reach over there, nothing is compared.
        known &= evidence.seen_before(known.shape, small.homography(homography))
        counts = None
        if self._fixed is not None:
            counts = small.all(self._fixed.pixels)
            known &= counts
            # Nor was there anything to see where the frame before did not count.
            there = warped(counts.view(np.uint8), small.homography(homography), missing=1, nearest=True)
            counts = counts & there.view(bool)
        kept = small.any(warped(self._moving.view(np.uint8), homography, missing=0, nearest=True).view(bool))
        work = small.image(current)
        least = max(_LEAST_MOTION_PX, 3 * camera.sigma_px) / small.factor
        found = evidence.by_flow(
            small.image(self._previous),
            work,
            b,
            residual,
            known,
            kept,
            homography=small.homography(homography),
            model_sigma=max(camera.sigma_px, 0.05) / small.factor,
            least_motion=least,
            rounding=self._rounding / small.factor,
            most_spread=_SPREAD_RISE * self._spread,
            variance=None if self._outline is None else self._outline.variance,
            counts=counts,
        )
        self._spread, background = found.spread, small.image(self._background.picture(small.full))
        if self._outline is not None:
            mask = self._outline.update(work, background, found, kept, self._rounding)
        elif self._background.kept >= _TRUSTED_BACKGROUND:
            mask = found.moving & ~shows_background(work, background, found)
        else:
            mask = found.moving
        size = max(3, round(min(mask.shape) / 80)) | 1
        mask = small.enlarged(regions.cleaned(mask, size, max(1, self._tracker.min_area // small.factor**2)))
        if self._fixed is not None:
            mask &= self._fixed.pixels
        residual[~known] = np.nan
        motion = small.enlarged_motion(residual, mask & trusted)
        objects = self._tracker.update(mask, motion, homography, image=image, t_s=t_s)
        self._moving = self._tracker.lasting
        away = regions.dilated(self._moving, size)
        if self._background.kept == 1:
            self._background.amend_first(evidence.carried_back(away, uv, given))
        self._background.add(current, self._uncounted(away))
        length = small.enlarged_image(np.hypot(residual[..., 0], residual[..., 1]) * np.float32(small.factor))
        if self._fixed is not None:
            length[~self._fixed.pixels] = np.nan
        ok, depth = SegmentationStatus.OK, believed is not None
        return self._result(image, current, length, homography, camera.model, objects, ok, parallax=depth)

    def _uncounted(self, away: Mask) -> Mask:
        """Add the pixels that do not count to those that a background cannot be taken from."""
        return away if self._fixed is None else away | ~self._fixed.pixels

    def _camera(self, uv: F32, valid: Mask, covariance: F32 | None) -> _homography.CameraMotion:
        step = _VECTOR_STEP if min(valid.shape) >= 8 * _VECTOR_STEP else max(1, min(valid.shape) // 8)
        start = step // 2
        rows, columns = np.nonzero(valid[start::step, start::step])
        rows, columns = rows * step + start, columns * step + start
        points = np.column_stack([columns, rows]).astype(np.float64)
        even = _homography.spread_evenly(rows, columns, valid.shape)
        points, rows, columns = points[even], rows[even], columns[even]
        vectors = uv[rows, columns].astype(np.float64)
        if self.static_camera:
            sigma = 0.0 if not len(vectors) else float(np.median(np.hypot(*vectors.T))) / 1.1774
            return _homography.CameraMotion(np.eye(3), "static", min(max(sigma, 0.02), 0.3), 1.0)
        return _homography.fit(points, vectors, _homography.picked(covariance, rows, columns), self._camera_before)

    def _believe(
        self, uv: F32, valid: Mask, covariance: F32 | None, camera: _homography.CameraMotion
    ) -> _parallax.Parallax | None:
        """Follow what is believed of the scene's depth; None where this frame has none, or with a static camera."""
        if self.static_camera:
            return None
        step = max(2, round(math.sqrt(valid.size / _PARALLAX_VECTORS)))
        rows, columns = np.nonzero(valid[::step, ::step])
        rows, columns = rows * step, columns * step
        points = np.column_stack([columns, rows]).astype(np.float64)
        vectors = uv[rows, columns].astype(np.float64)
        given = _homography.picked(covariance, rows, columns)
        self._parallax = _parallax.find(points, vectors, given, camera, self._parallax)
        return self._parallax if self._parallax is not None and self._parallax.believed else None

    def _result(
        self,
        image: NDArray[Any],
        current: F32,
        residual: F32 | None,
        homography: F64,
        model: str,
        objects: tuple[TrackedObject, ...],
        status: SegmentationStatus,
        *,
        parallax: bool = False,
    ) -> MotionSegmentation:
        assert self._tracker is not None
        assert self._moving is not None
        moving = self._moving
        background = self._background.picture(current.shape)
        gain, offset = fit_light(background, current, ~self._uncounted(moving))
        background = background * np.float32(gain) + np.float32(offset)
        return MotionSegmentation(
            image=image,
            moving=moving,
            residual=np.full(moving.shape, np.nan, np.float32) if residual is None else residual,
            camera_motion=homography.copy(),
            camera_model=model,
            parallax=parallax,
            objects=objects,
            hidden=self._tracker.hidden,
            labels=self._tracker.labels if self._tracker.labels.size else np.zeros(moving.shape, np.int32),
            background=background,
            status=status,
            mask=None if self._fixed is None else self._fixed.pixels,
        )


def _given_flow(flow: FlowLike, shape: tuple[int, ...]) -> FlowLike:
    """Check what a caller gives as flow: an object with the motion and where it is known."""
    for part in ("uv", "valid"):
        if not hasattr(flow, part):
            raise _checks.refused("flow", flow, "a FlowField", DTypeError)
    _checks.array("flow.uv", flow.uv, (*shape, 2), f"numbers, {(*shape, 2)}, as the frame has")
    _checks.bools("flow.valid", flow.valid, tuple(shape), "the frame")
    return flow
