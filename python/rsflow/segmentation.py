"""What moves and what stands still, for a static and for a moving camera.

For each frame: the camera's own motion in the picture is fitted to the dense flow; what is left of each pixel's flow
is tested against its own covariance; pictures tell which of the pixels near a motion edge belong to the thing that
moves; regions are cleaned and followed over time. With a static camera what differs from the background, in light
that may change, gives the outline.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _camera_motion, _drawing
from . import _motion_evidence as evidence
from . import _regions as regions
from ._background import Background, warped
from ._light import fit_light, relit
from ._reduction import Reduction
from .errors import DTypeError, OptionError, ShapeError
from .flow import DenseFlow, Illumination, Preset
from .objects import ObjectTracker, TrackedObject

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .io import FlowLike

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["MotionSegmentation", "MotionSegmenter"]

# Vectors for the camera's motion stand this far apart, in pixels: about the reach of the flow's own smoothness.
_VECTOR_STEP = 12
# The frame is divided into so many tiles along each side, and each gives at most so many vectors.
_TILES = 8
_VECTORS_A_TILE = 8
# Motion below this many pixels per frame is not told from rest.
_LEAST_MOTION_PX = 0.4
# A difference from the background of this many mean squares (see `mismatch`) is one; a weaker one only beside it.
_STRONG_OUTLINE = 20.0
_WEAK_OUTLINE = 8.0
# With a static camera, for how many frames after it moved a thing that differs from the background is still moving.
_MEMORY_FRAMES = 20
# The smallest region, as a share of the frame, and in pixels.
_LEAST_SHARE = 1e-4
_LEAST_AREA = 12
# The noise of a camera rises at most by this factor from frame to frame.
_SPREAD_RISE = 1.1
# Share of a frame in the usual variance of a pixel's difference: it remembers twenty frames.
_LEARNING_RATE = 0.05
# Quantisation: the standard deviation of rounding to whole levels.
_ROUNDING = 0.29


@dataclasses.dataclass(frozen=True, eq=False)
class MotionSegmentation:
    """What moves in one frame.

    Attributes
    ----------
    image : (H, W) array
        The frame.
    moving : (H, W) bool
        True where something moves against the still surroundings.
    residual : (H, W) float32
        Length of the motion that the camera's does not explain, in pixels per frame; NaN where it is unknown.
    camera_motion : (3, 3) float64
        Homography from the pixels of the previous frame to this one's: the camera's motion as the picture shows it.
    camera_model : str
        ``"translation"``, ``"similarity"``, ``"affine"`` or ``"homography"``, the simplest that explains it;
        ``"static"`` for a static camera, ``"none"`` where it could not be fitted.
    objects : tuple of TrackedObject
        The regions of `moving` with their numbers, which last over the frames.
    labels : (H, W) int32
        The number of the object at each pixel, 0 for none.
    background : (H, W) float32
        The frame without what moves, in its own light: a temporal median; NaN where nothing is known yet.
    status : str
        ``"ok"``; ``"first_frame"``, with nothing to compare to; ``"no_camera_motion"`` where the flow does not tell the
        camera's motion. In the last two nothing is moving.
    """

    image: NDArray[Any]
    moving: Mask
    residual: F32
    camera_motion: F64
    camera_model: str
    objects: tuple[TrackedObject, ...]
    labels: NDArray[np.int32]
    background: F32
    status: str

    @property
    def valid(self) -> bool:
        """Whether the frame could be compared with the one before."""
        return self.status == "ok"

    def moving_view(self, picture: NDArray[Any] | None = None, *, boxes: bool = True) -> NDArray[np.uint8]:
        """Draw what moves, in its own light, before the darkened rest.

        Parameters
        ----------
        picture : ndarray, optional
            The frame in colour, to draw on instead of `image`.
        boxes : bool
            Whether each object has its box, number, and an arrow of ten times its motion.

        Returns
        -------
        ndarray of uint8, (height, width, 3)
            Blue, green, red.

        Raises
        ------
        ShapeError
            If the picture is not of the frame's size.
        """
        import cv2

        shown = self._canvas(picture)
        grey = cv2.convertScaleAbs(cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY), alpha=0.35)
        out: NDArray[np.uint8] = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
        cv2.copyTo(shown, self.moving.view(np.uint8), out)
        if boxes:
            self._draw_boxes(out)
        return out

    def static_view(self, picture: NDArray[Any] | None = None) -> NDArray[np.uint8]:
        """Draw the frame without what moves: the background stands in its place, or hatching where none is known.

        Parameters
        ----------
        picture : ndarray, optional
            The frame in colour, to draw on instead of `image`; what is filled in is grey.

        Returns
        -------
        ndarray of uint8, (height, width, 3)
            Blue, green, red.

        Raises
        ------
        ShapeError
            If the picture is not of the frame's size.
        """
        out = self._canvas(picture)
        # Only what is replaced is looked at: most of a picture stands still.
        rows, columns = regions.pixels(regions.dilated(self.moving, 5))
        behind = self.background[rows, columns]
        low, high = (0.0, 255.0) if self.image.dtype == np.uint8 else _drawing.display_range(self.image)
        filled = np.clip((np.nan_to_num(behind) - low) * (255.0 / max(high - low, 1e-6)), 0, 255)
        hatching = np.where((rows + columns) % 8 < 2, 110, 70)
        out[rows, columns] = np.where(np.isfinite(behind), filled, hatching).astype(np.uint8)[:, None]
        return out

    def _canvas(self, picture: NDArray[Any] | None) -> NDArray[np.uint8]:
        out = _drawing.displayed(self.image if picture is None else picture)
        if out.shape[:2] != self.moving.shape:
            raise ShapeError(f"the picture is {out.shape[:2]} and the frame is {self.moving.shape} (height, width)")
        return out

    def _draw_boxes(self, out: NDArray[np.uint8]) -> None:
        import cv2

        for thing in self.objects:
            color = _drawing.distinct_color(thing.id)
            x, y, width, height = thing.box
            cv2.rectangle(out, (x - 2, y - 2), (x + width + 1, y + height + 1), color, 1)
            if np.isfinite(thing.vx):
                tip = np.array([[thing.x, thing.y], [thing.x + 10 * thing.vx, thing.y + 10 * thing.vy]])
                _drawing.polylines(out, [tip], color, 1)
            _drawing.put_text(out, str(thing.id), (x - 2, max(y - 5, 12)), color=color)


class MotionSegmenter:
    """Tell what moves from what stands still, frame after frame.

    Parameters
    ----------
    camera_motion : {"moving", "static"}
        Whether the camera moves. Of a static camera more can be told: the outline of what moves, also for a while
        when it pauses.
    preset : {"fast", "balanced", "accurate"}
        Of the dense flow.
    illumination : {"gain_offset", "offset", "none"}
        How light may change, for the dense flow.
    max_displacement : float, optional
        The largest motion to expect, in pixels per frame.
    min_area : int, optional
        Things of fewer pixels are left out; by default a ten-thousandth of the frame, and at least 12.

    Raises
    ------
    OptionError
        If `camera_motion` or `min_area` is out of range.

    Notes
    -----
    The camera's motion is a plane's: a translation, similarity, affine map or homography. A rigid scene with depth
    seen by a camera that travels has parallax, which looks like motion where it is larger than the errors.

    False discoveries: Y. Benjamini and Y. Hochberg, J. R. Stat. Soc. B 57, 1995.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> frames = np.random.default_rng(1).integers(0, 256, (3, 60, 80), np.uint8)
    >>> segmenter = rsflow.MotionSegmenter(camera_motion="static")
    >>> first = segmenter.update(frames[0])
    >>> first.status, bool(first.moving.any())
    ('first_frame', False)
    """

    def __init__(
        self,
        *,
        camera_motion: Literal["moving", "static"] = "moving",
        preset: Preset = "fast",
        illumination: Illumination = "gain_offset",
        max_displacement: float | None = None,
        min_area: int | None = None,
    ) -> None:
        if camera_motion not in ("moving", "static"):
            raise OptionError(f"camera_motion must be 'moving' or 'static', got {camera_motion!r}")
        if min_area is not None and min_area < 1:
            raise OptionError(f"min_area must be at least 1 pixel, got {min_area!r}")
        self.static_camera = camera_motion == "static"
        self.min_area = min_area
        self._flow = DenseFlow(preset=preset, illumination=illumination, max_displacement=max_displacement)
        self.reset()

    def reset(self) -> None:
        """Forget everything: the next frame is a first one, as after a cut."""
        self._previous: F32 | None = None
        self._moving: Mask | None = None
        self._heat: NDArray[np.uint8] | None = None
        self._background = Background()
        self._spread = np.inf
        self._variance: F32 | None = None
        self._tracker: ObjectTracker | None = None
        self._flow.reset()
        self._flow_is_ours = True

    def update(self, image: NDArray[Any], *, flow: FlowLike | None = None) -> MotionSegmentation:
        """Take the next frame.

        Parameters
        ----------
        image : ndarray of uint8, uint16 or float32, (height, width)
            The frame; all of one size.
        flow : FlowField, optional
            Flow from the previous frame to this one where it is known already; by default it is computed here. Give
            it for every frame after the first or for none.

        Returns
        -------
        MotionSegmentation

        Raises
        ------
        ShapeError, DTypeError
            If it is not such a frame, or not of the size of the one before.
        OptionError
            If a flow is given for some frames only.
        """
        image = np.asarray(image)
        if image.ndim != 2 or image.size == 0:
            raise ShapeError(f"a frame must be grey, (height, width), got {image.shape}")
        if image.dtype not in (np.uint8, np.uint16, np.float32):
            raise DTypeError(f"a frame must be uint8, uint16 or float32, got {image.dtype}")
        current = image.astype(np.float32)
        if image.dtype == np.float32:
            current = np.nan_to_num(current)
        self._rounding = _ROUNDING if image.dtype != np.float32 else max(1e-3 * float(np.ptp(current)), 1e-9)
        if self._previous is not None and current.shape != self._previous.shape:
            raise ShapeError(f"the frame is {current.shape}, the one before was {self._previous.shape}")
        if flow is None:
            if not self._flow_is_ours:
                raise OptionError("give the flow of every frame after the first, or of none")
            flow = self._flow.update(image)
        elif self._previous is None:
            raise OptionError("the first frame has no flow: give flow=None, or reset() before")
        else:
            self._flow_is_ours = False
        if self._previous is None or flow is None:
            return self._start(image, current)
        result = self._segment(image, current, flow)
        self._previous = current
        return result

    def _start(self, image: NDArray[Any], current: F32) -> MotionSegmentation:
        self._previous = current
        self._moving = np.zeros(current.shape, bool)
        area = max(_LEAST_AREA, round(_LEAST_SHARE * current.size)) if self.min_area is None else self.min_area
        self._tracker = ObjectTracker(min_area=area)
        self._background.add(current, self._moving)
        model = "static" if self.static_camera else "none"
        return self._result(image, current, None, np.eye(3), model, (), "first_frame")

    def _segment(self, image: NDArray[Any], current: F32, flow: FlowLike) -> MotionSegmentation:
        assert self._previous is not None
        assert self._moving is not None
        assert self._tracker is not None
        uv = np.asarray(flow.uv, np.float32)
        if uv.shape != (*current.shape, 2):
            raise ShapeError(f"the flow is {uv.shape} and the frame is {current.shape}")
        given: Mask = np.isfinite(uv[..., 0] + uv[..., 1])
        trusted = given & np.asarray(flow.valid, bool)
        camera = self._camera(uv, trusted)
        homography = camera.homography
        self._background.follow(homography)
        if camera.model == "none":
            self._background.reset()
            self._background.add(current, np.zeros_like(self._moving))
            self._moving = np.zeros_like(self._moving)
            objects = self._tracker.update(self._moving)
            return self._result(image, current, None, homography, "none", objects, "no_camera_motion")
        small = Reduction.of(current.shape)
        # Flow that its own estimator does not trust takes part as well: the pictures decide whether it explains them.
        b, known = evidence.backward(small.motion(uv, given), small.all(given))
        residual = evidence.residual_motion(b, small.homography(homography))
        # Where this frame shows what the one before did not, and windows reach over there, nothing is compared.
        known &= evidence.seen_before(known.shape, small.homography(homography))
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
            variance=self._variance,
        )
        self._spread = found.spread
        mask = self._outlined(work, found, kept, small) if self.static_camera else found.moving
        size = max(3, round(min(mask.shape) / 80)) | 1
        mask = small.enlarged(regions.cleaned(mask, size, max(1, self._tracker.min_area // small.factor**2)))
        residual[~known] = np.nan
        objects = self._tracker.update(mask, small.enlarged_motion(residual, mask & trusted), homography)
        self._moving = self._tracker.labels > 0
        away = regions.dilated(self._moving, size)
        if self._background.kept == 1:
            self._background.amend_first(evidence.carried_back(away, uv, given))
        self._background.add(current, away)
        length = small.enlarged_image(np.hypot(residual[..., 0], residual[..., 1]) * np.float32(small.factor))
        return self._result(image, current, length, homography, camera.model, objects, "ok")

    def _camera(self, uv: F32, valid: Mask) -> _camera_motion.CameraMotion:
        step = _VECTOR_STEP if min(valid.shape) >= 8 * _VECTOR_STEP else max(1, min(valid.shape) // 8)
        start = step // 2
        rows, columns = np.nonzero(valid[start::step, start::step])
        rows, columns = rows * step + start, columns * step + start
        points = np.column_stack([columns, rows]).astype(np.float64)
        tile = (rows * _TILES // valid.shape[0]) * _TILES + columns * _TILES // valid.shape[1]
        even = _evenly(tile)
        points, rows, columns = points[even], rows[even], columns[even]
        vectors = uv[rows, columns].astype(np.float64)
        if self.static_camera:
            sigma = 0.0 if not len(vectors) else float(np.median(np.hypot(*vectors.T))) / 1.1774
            return _camera_motion.CameraMotion(np.eye(3), "static", min(max(sigma, 0.02), 0.3), 1.0)
        return _camera_motion.fit(points, vectors)

    def _outlined(self, current: F32, found: evidence.FlowEvidence, kept: Mask, small: Reduction) -> Mask:
        """With a static camera: regions that differ from the background and move, or moved lately."""
        if self._heat is None:
            self._heat = np.zeros(current.shape, np.uint8)
        background = small.image(self._background.picture(small.full))
        known = np.isfinite(background)
        if not known.any():
            return found.moving
        spread = found.spread
        still = known & ~kept & ~regions.dilated(found.moving, 5)
        filled = relit(np.where(known, background, current), current, still, spread)
        usual = spread**2 if self._variance is None else np.maximum(self._variance, np.float32(self._rounding**2))
        apart = evidence.mismatch(current - filled, found.slope, usual)
        differs = known & (apart > _WEAK_OUTLINE) & ~evidence.explained_by_light(filled, current, spread)
        differs &= evidence.outstanding(current - filled)
        surely = differs & (apart > _STRONG_OUTLINE)
        self._heat = np.where(self._heat > 0, self._heat - 1, 0).astype(np.uint8)
        warm = regions.dilated(self._heat > 0, 3)
        # What changed from frame to frame moved, also where it was too fast for its flow.
        moves = found.moving | found.changed
        mask = regions.grown(differs, surely & (moves | warm)) | (found.moving & ~known)
        moved = regions.grown(mask, mask & moves)
        self._heat[moved] = _MEMORY_FRAMES
        self._learn(found, mask)
        return mask

    def _learn(self, found: evidence.FlowEvidence, mask: Mask) -> None:
        """Keep the usual variance of each pixel's difference from frame to frame."""
        square = np.minimum(found.square, np.float32(4 * found.spread**2))
        if self._variance is None:
            self._variance = np.maximum(square, np.float32(found.spread**2))
        else:
            step = np.where(regions.dilated(mask, 5), np.float32(0), np.float32(_LEARNING_RATE))
            self._variance += step * (square - self._variance)

    def _result(
        self,
        image: NDArray[Any],
        current: F32,
        residual: F32 | None,
        homography: F64,
        model: str,
        objects: tuple[TrackedObject, ...],
        status: str,
    ) -> MotionSegmentation:
        assert self._tracker is not None
        assert self._moving is not None
        moving = self._moving
        background = self._background.picture(current.shape)
        gain, offset = fit_light(background, current, ~moving)
        background = background * np.float32(gain) + np.float32(offset)
        return MotionSegmentation(
            image=image,
            moving=moving,
            residual=np.full(moving.shape, np.nan, np.float32) if residual is None else residual,
            camera_motion=homography.copy(),
            camera_model=model,
            objects=objects,
            labels=self._tracker.labels if status != "first_frame" else np.zeros(moving.shape, np.int32),
            background=background,
            status=status,
        )


def _evenly(tile: NDArray[np.intp]) -> NDArray[np.intp]:
    """Choose a few vectors of each tile, so that the camera's motion is not that of what has texture."""
    chosen = []
    for number in np.unique(tile):
        inside = np.nonzero(tile == number)[0]
        chosen.append(inside[:: -(-len(inside) // _VECTORS_A_TILE)])
    return np.concatenate(chosen) if chosen else np.zeros(0, np.intp)
