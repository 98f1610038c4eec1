"""The result of `rsflow.segmentation` for one frame, and its pictures."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks, _display
from .._results.status import WordStatus
from ..plotting import arrows, drawing, labels
from . import patches, regions
from .object_table import OBJECT_COLUMNS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .object_table import TrackedObject

    F32 = NDArray[np.float32]
    F64 = NDArray[np.float64]
    Mask = NDArray[np.bool_]


# What stands still is shown at this share of its light, and the edge of what moves without steps of so many pixels.
_DARKENED = 0.35
_SOFT_PX = 2
# An arrow of a thing shows its way in so many frames, if it is longer than this.
_ARROW_FRAMES, _LEAST_ARROW_PX = 10.0, 3.0


class SegmentationStatus(WordStatus):
    """Whether a frame could be compared with the one before, and if not, why; equal to its word, ``"ok"`` say.

    Examples
    --------
    >>> import rsflow
    >>> status = rsflow.SegmentationStatus("first_frame")
    >>> print(status, status.valid, "--", status.explanation)
    first_frame False -- there is no frame before to compare with: nothing is moving
    >>> status == "first_frame", rsflow.SegmentationStatus.OK.valid
    (True, True)
    """

    OK = "ok", "The frame was compared with the one before."
    FIRST_FRAME = "first_frame", "There is no frame before to compare with: nothing is moving."
    NO_CAMERA_MOTION = "no_camera_motion", "The flow does not tell the camera's motion: nothing is moving."


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
    parallax : bool
        Whether the scene was seen to have depth: then what moves along the lines of the camera's travel, the way that
        depth goes, counts as still, and `residual` is the motion across them.
    objects : tuple of TrackedObject
        The things that move, with numbers that last over the frames; what moves and goes nowhere, such as leaves in
        the wind, is none.
    labels : (H, W) int32
        The number of the object at each pixel, 0 for none.
    background : (H, W) float32
        The still scene as this frame would show it, in its light: a median of samples; NaN where nothing is known yet.
        Of frames of more than 300,000 pixels it has half the resolution, of more than 1,200,000 a quarter, and so on.
    status : SegmentationStatus
        ``"ok"``; ``"first_frame"``, with nothing to compare to; ``"no_camera_motion"`` where the flow does not tell the
        camera's motion. In the last two nothing is moving.
    mask : (H, W) bool, or None
        True where a pixel counts, as the segmenter was told; elsewhere nothing is moving, `residual` is NaN and
        `background` what other frames saw there, if they did. None: all count.
    hidden : tuple of TrackedObject
        Things that were seen before and are hidden in this frame, where they are predicted.

    Examples
    --------
    >>> import rsflow
    >>> segmenter = rsflow.MotionSegmenter(camera_motion="moving")
    >>> for frame in rsflow.synthetic.flight_with_object(frames=6):
    ...     seen = segmenter.update(frame.image)
    >>> seen.valid, seen.camera_model, len(seen.objects), bool(seen.moving[seen.labels > 0].all())
    (True, 'translation', 1, True)
    >>> seen.moving_view().shape == (*seen.moving.shape, 3)
    True
    """

    image: NDArray[Any]
    moving: Mask
    residual: F32
    camera_motion: F64
    camera_model: str
    parallax: bool
    objects: tuple[TrackedObject, ...]
    labels: NDArray[np.int32]
    background: F32
    status: SegmentationStatus
    mask: Mask | None = None
    hidden: tuple[TrackedObject, ...] = ()

    def __repr__(self) -> str:
        height, width = self.moving.shape
        parallax = " with parallax" if self.parallax else ""
        seen = f"camera {self.camera_model}{parallax}, {float(self.moving.mean()):.2%} moving" if self.valid else ""
        things = f"{len(self.objects)} object{'' if len(self.objects) == 1 else 's'}"
        return f"MotionSegmentation({width} x {height}, {self.status}: {seen or self.status.explanation}; {things})"

    def _repr_html_(self) -> str:
        return _display.html(repr(self), self.moving_view())

    @property
    def valid(self) -> bool:
        """Whether the frame could be compared with the one before."""
        return self.status is SegmentationStatus.OK

    def to_dict(self) -> dict[str, Any]:
        """Give the frame's figures as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to str, float or int
            Status and model by their words, the share of the pixels that move (of those that count), and how many
            objects there are.

        Examples
        --------
        >>> import numpy as np, rsflow
        >>> first = rsflow.MotionSegmenter().update(np.zeros((60, 80), np.uint8))
        >>> first.to_dict()
        {'status': 'first_frame', 'camera_model': 'none', 'parallax': False, 'moving_share': nan, 'objects': 0}
        """
        counted = self.moving if self.mask is None else self.moving[self.mask]
        return {
            "status": self.status.word,
            "camera_model": self.camera_model,
            "parallax": self.parallax,
            "moving_share": float(counted.mean()) if self.valid and counted.size else math.nan,
            "objects": len(self.objects),
        }

    def to_table(self) -> dict[str, NDArray[Any]]:
        """Give the objects as columns of equal length, for ``pandas.DataFrame``: a row for each.

        Returns
        -------
        dict of str to ndarray
            The columns of ``objects.csv`` without frame and time; see `rsflow.objects.TrackedObject.to_dict`.

        Examples
        --------
        >>> import rsflow
        >>> segmenter = rsflow.MotionSegmenter(camera_motion="moving")
        >>> for frame in rsflow.synthetic.flight_with_object(frames=6):
        ...     seen = segmenter.update(frame.image)
        >>> table = seen.to_table()
        >>> table["id"].tolist(), list(table)[:4]
        ([1], ['id', 'age_frames', 'x_px', 'y_px'])
        """
        return _display.columns([thing.to_dict() for thing in self.objects], OBJECT_COLUMNS[2:])

    def moving_view(self, picture: NDArray[Any] | None = None, *, boxes: bool = True) -> NDArray[np.uint8]:
        """Draw what moves, in its own light and with smooth edges, before the darkened rest.

        Parameters
        ----------
        picture : ndarray, optional
            The frame in colour, to draw on instead of `image`.
        boxes : bool
            Whether each object has its box, its number where there is room, and an arrow of ten times its motion, at
            most thrice its box.

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

        boxes = _checks.flag("boxes", boxes)
        shown = patches.canvas(self.moving.shape, self.image, picture)
        out: NDArray[np.uint8] = np.asarray(cv2.convertScaleAbs(shown, alpha=_DARKENED), np.uint8)
        for part in patches.parts_around(patches.boxes_of(self.moving), shown.shape, _SOFT_PX + 1):
            at = patches.cut(part)
            out[at] = patches.laid_over(out[at], shown[at], patches.softened(self.moving[at], _SOFT_PX))
        if boxes:
            self._draw_boxes(out)
        return out

    def static_view(self, picture: NDArray[Any] | None = None) -> NDArray[np.uint8]:
        """Draw the frame without what moves: the background stands in its place, or hatching where none is known.

        Parameters
        ----------
        picture : ndarray, optional
            The frame in colour, to draw on instead of `image`; what is filled in is grey. A
            `rsflow.segmentation.scene.StaticScene` fills in colours, and what is seen later.

        Returns
        -------
        ndarray of uint8, (height, width, 3)
            Blue, green, red.

        Raises
        ------
        ShapeError
            If the picture is not of the frame's size.
        """
        out = patches.canvas(self.moving.shape, self.image, picture)
        # Only what is replaced is looked at: most of a picture stands still.
        near = regions.dilated(self.moving, 5)
        rows, columns = regions.pixels(near if self.mask is None else near & self.mask)
        behind = self.background[rows, columns]
        low, high = (0.0, 255.0) if self.image.dtype == np.uint8 else _display.display_range(self.image)
        filled = np.clip((np.nan_to_num(behind) - low) * (255.0 / max(high - low, 1e-6)), 0, 255)
        out[rows, columns] = np.where(np.isfinite(behind), filled, patches.hatching(rows, columns)).astype(np.uint8)[
            :, None
        ]
        return out

    def _draw_boxes(self, out: NDArray[np.uint8]) -> None:
        import cv2

        colors = [drawing.distinct_color(thing.id) for thing in self.objects]
        line = round(drawing.size_for(out.shape))
        around, arrowed = [], []
        for thing, color in zip(self.objects, colors, strict=True):
            x, y, width, height = thing.box
            around.append((x - 2, y - 2, x + width + 1, y + height + 1))
            cv2.rectangle(out, around[-1][:2], around[-1][2:], color, line)
            vx, vy = thing.vx_px_per_frame, thing.vy_px_per_frame
            speed = math.hypot(vx, vy)
            if _ARROW_FRAMES * speed > _LEAST_ARROW_PX:
                # Not longer than thrice the thing: a speed that is wrong must not draw through the picture.
                scale = min(_ARROW_FRAMES, 3 * math.hypot(width, height) / speed)
                arrowed.append((color, (thing.x, thing.y), (vx * scale, vy * scale)))
        if arrowed:
            inks, starts, ways = zip(*arrowed, strict=True)
            drawing.rimmed(out, drawing.Strokes(arrows.lines(np.array(starts), np.array(ways)), list(inks), line))
        labels.draw_labels(out, around, [str(thing.id) for thing in self.objects], colors)
