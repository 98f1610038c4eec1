"""What is measured in each frame: every estimator once, the dense flow shared by all that need it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._display import fields
from ..capture.masks import FixedMask, mask_of_frames
from ..errors import OptionError
from . import rows
from .metric import HeightOf, fitting_camera
from .probe import CameraDecision, arrow_style, camera_motion
from .settings import ExtractSettings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..capture.stream import Frame, Frames
    from ..flow.field import FlowField
    from ..plotting import QuiverStyle
    from ..segmentation.result import MotionSegmentation
    from ..segmentation.segmenter import MotionSegmenter
    from ..shift import Shift
    from ..velocity import Velocity, VelocityEstimator
    from .checkpoint import Saved

__all__ = ["Measured", "Pipeline"]


@dataclass(frozen=True)
class Measured:
    """Everything known about one frame.

    Attributes
    ----------
    frame : Frame
        With its picture in grey and in colour.
    flow : FlowField or None
        Dense flow since the frame before; None for the first.
    segmentation : MotionSegmentation
        What moves and what stands still.
    velocity : Velocity or None
        With camera and height only.
    motion, objects, velocity_row
        The rows of ``motion.csv``, ``objects.csv`` and ``velocity.csv``.

    Examples
    --------
    >>> import tempfile, rsflow
    >>> flight = rsflow.synthetic.flight(frames=3, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> seen = []
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = rsflow.extract(flight.images, folder, frame_rate=30, videos=False, on_frame=seen.append)
    >>> [(measured.frame.index, measured.motion["frame"], measured.flow is None) for measured in seen]
    [(0, 0, True), (1, 1, False), (2, 2, False)]
    """

    frame: Frame
    flow: FlowField | None
    segmentation: MotionSegmentation
    velocity: Velocity | None
    motion: dict[str, Any]
    objects: list[dict[str, Any]]
    velocity_row: dict[str, Any] | None

    __repr__ = fields


class Pipeline:
    """The estimators of one extraction, fed frame by frame in two steps with the probe's decision between."""

    def __init__(self, settings: ExtractSettings, stream: Frames, *, whole: bool = True) -> None:
        from ..flow import DenseFlow

        self.settings, self.stream = settings, stream
        # Read before the first frame: a wrong file must fail before anything is written.
        self.mask = mask_of_frames(settings.mask, stream, settings.roi)
        self._fixed = None if self.mask is None else FixedMask(self.mask)
        self._dense = DenseFlow(
            preset=settings.preset,
            illumination=settings.illumination,
            max_displacement=settings.max_displacement,
            mask=self.mask,
            next_mask=self.mask,
        )
        self._prev: NDArray[Any] | None = None
        self._prev_t_s = math.nan
        self._segmenter: MotionSegmenter | None = None
        self._last_segmentation: MotionSegmentation | None = None
        self._velocity: VelocityEstimator | None = None
        self._height: HeightOf | None = None
        # "auto" is decided by `settle`.
        self.decision = (
            CameraDecision("static", "given as at rest")
            if settings.camera_motion == "static"
            else CameraDecision("moving", "given as moving")
        )
        self.notes: list[str] = []
        # What the velocities' deviations leave out.
        self.unstated: tuple[str, ...] = ()
        if settings.height_m is not None:
            # Read before the first frame: a wrong file must fail before anything is written.
            self._height = HeightOf(settings.height_m)
            self.notes.extend(self._height.notes)
            if whole:
                self._height.expect_some(stream)

    def measure(self, frame: Frame) -> tuple[Shift | None, FlowField | None]:
        """First step: displacement and dense flow since the frame before, None for the first."""
        from ..shift import estimate_shift

        if self._prev is None and self.settings.height_m is not None:
            self._open_velocity()
        shift = None
        if self._prev is not None:
            shift = estimate_shift(
                self._prev,
                frame.image,
                illumination=self.settings.illumination,
                max_displacement=self.settings.max_displacement,
                mask=self.mask,
                next_mask=self.mask,
            )
        self._prev = frame.image
        return shift, self._dense.update(self._counted(frame.image))

    def _counted(self, image: NDArray[Any]) -> NDArray[Any]:
        """Fill what does not count: coarse levels of the flow reach over it."""
        if self._fixed is None:
            return image
        self._fixed.expect_shape(image.shape)
        return self._fixed.filled(image)

    def _open_velocity(self) -> VelocityEstimator:
        from ..velocity import VelocityEstimator

        camera, note = fitting_camera(self.settings.camera, self.stream, self.settings.roi)
        if note:
            self.notes.append(note)
        self._velocity = VelocityEstimator(camera, height_std_m=self.settings.height_std_m, mask=self.mask)
        return self._velocity

    def settle(self, pairs: Sequence[tuple[Any, FlowField | None]], width: int) -> QuiverStyle:
        """Decide from the first pairs; give the style of the arrows."""
        told = [pair for pair in pairs if pair[1] is not None]
        if self.settings.camera_motion == "auto":
            self.decision = camera_motion(told)
        self._segmenter = self._new_segmenter()
        return arrow_style([flow for _, flow in told], width)

    def _new_segmenter(self) -> MotionSegmenter:
        from ..segmentation import MotionSegmenter

        return MotionSegmenter(camera_motion=self.decision.motion, mask=self.mask)

    def state(self) -> dict[str, Any]:
        """Give what the second step knows beside the last frame, for `go_on`."""
        return {
            "decision": (self.decision.motion, self.decision.reason),
            "segmenter": self._segmenter,
            "heights": None if self._height is None else self._height.counts(),
            "unstated": self.unstated,
        }

    def go_on(self, saved: Saved, frame: Frame) -> None:
        """Be as after `frame`, which is measured already, from what was saved then."""
        state = saved.value("pipeline", make={"MotionSegmenter": self._new_segmenter})
        self.decision = CameraDecision(*state["decision"])
        from ..segmentation.result import SegmentationStatus

        self._segmenter = segmenter = state["segmenter"]
        self.unstated = state["unstated"]
        # For the background, if no frame is left.
        self._last_segmentation = segmenter._result(
            frame.image, segmenter._previous, None, np.eye(3), self.decision.motion, (), SegmentationStatus.OK
        )
        # The others know the frame before and no more.
        self._prev, self._prev_t_s = frame.image, frame.t_s
        self._dense.update(self._counted(frame.image))
        if self._height is not None:
            self._height.go_on(state["heights"])
            self._open_velocity().update(frame.image, frame.t_s)

    def finish(self, frame: Frame, shift: Shift | None, flow: FlowField | None) -> Measured:
        """Second step: moving and static, velocity, and the rows of the tables."""
        assert self._segmenter is not None, "settle or go_on comes first"
        segmentation = self._segmenter.update(frame.image, flow=flow)
        self._last_segmentation = segmentation
        dt_s = frame.t_s - self._prev_t_s
        self._prev_t_s = frame.t_s
        velocity, table_row = None, None
        if self._velocity is not None and self._height is not None:
            from ..velocity import velocity_row

            height_m = self._height.at(frame.index, frame.t_s)
            velocity = self._velocity.update(frame.image, frame.t_s, height_m=height_m)
            self.unstated = velocity.unstated or self.unstated
            table_row = velocity_row(velocity, frame=frame.index, height_m=height_m)
        return Measured(
            frame=frame,
            flow=flow,
            segmentation=segmentation,
            velocity=velocity,
            motion=rows.motion_row(frame, dt_s, shift, flow, segmentation),
            objects=rows.object_rows(frame, segmentation),
            velocity_row=table_row,
        )

    def without_height(self) -> OptionError | None:
        """Give the error that no frame had a height, or None."""
        return None if self._height is None else self._height.missed()

    def background(self) -> NDArray[np.uint8] | None:
        """Give the static scene at the end, None where there is none."""
        if self._last_segmentation is None:
            return None
        from .._display import displayed

        scene = self._last_segmentation.background
        image = self._last_segmentation.image
        # Where nothing is known yet a middle grey stands; other depths are shown as the last frame would be.
        known = np.isfinite(scene)
        picture = np.where(known, scene, scene[known].mean(dtype=np.float64) if known.any() else 0.0)
        return displayed(picture.round().clip(0, 255).astype(np.uint8) if image.dtype == np.uint8 else picture)
