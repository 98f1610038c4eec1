"""What is measured in each frame: every estimator once, the dense flow shared by all that need it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from .._display import fields
from ..capture.masks import FixedMask, mask_of_frames
from ..errors import OptionError
from . import rows
from .ground import Ground
from .probe import CameraDecision, arrow_style, camera_motion
from .settings import ExtractSettings

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

    from numpy.typing import NDArray

    from ..capture.stream import Frame, Frames
    from ..flow.field import FlowField
    from ..plotting import QuiverStyle
    from ..segmentation.result import MotionSegmentation
    from ..segmentation.segmenter import MotionSegmenter
    from ..shift import Shift
    from ..velocity import Velocity
    from .checkpoint import Saved

    Scales = Callable[[NDArray[np.float64]], NDArray[np.float64]]

__all__ = ["Measured", "Pipeline"]

Result = TypeVar("Result")


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
    """The estimators of one extraction, fed frame by frame in two steps with the probe's decision between.

    Parameters
    ----------
    settings : ExtractSettings
    stream : Frames
    whole : bool
        It begins with the first frame of the run.
    covariance : bool
        Let the dense flow say how far it may be off, as the arrows of the videos need it: most of its time.
    beside : Executor, optional
        Threads for what does not wait for each other within a step: a frame's figures are known sooner.
    """

    def __init__(
        self,
        settings: ExtractSettings,
        stream: Frames,
        *,
        whole: bool = True,
        covariance: bool = True,
        beside: Executor | None = None,
    ) -> None:
        from ..flow import DenseFlow

        self.settings, self.stream, self._beside = settings, stream, beside
        # Read before the first frame: a wrong file must fail before anything is written.
        self.mask = mask_of_frames(settings.mask, stream, settings.roi)
        self._fixed = None if self.mask is None else FixedMask(self.mask)
        self._dense = DenseFlow(
            preset=settings.preset,
            illumination=settings.illumination,
            max_displacement=settings.max_displacement,
            mask=self.mask,
            next_mask=self.mask,
            # For the arrows: what is within the flow's own uncertainty is none.
            covariance=covariance,
        )
        self._prev: NDArray[Any] | None = None
        self._prev_t_s = math.nan
        self._segmenter: MotionSegmenter | None = None
        self.ground: Ground | None = None
        # "auto" is decided by `settle`.
        self.decision = (
            CameraDecision("static", "given as at rest")
            if settings.camera_motion == "static"
            else CameraDecision("moving", "given as moving")
        )
        if settings.height_m is not None:
            assert settings.camera is not None, "the settings say so"
            # Read before the first frame: a wrong file must fail before anything is written.
            self.ground = Ground(settings.camera, settings.height_m, settings.height_std_m, settings.sensors)
            if whole:
                self.ground.expect_some(stream)

    def measure(self, frame: Frame, *, after_gap: bool = False) -> tuple[Shift | None, FlowField | None]:
        """First step: displacement and dense flow since the frame before, None for the first and `after_gap`."""
        from ..shift import estimate_shift

        if after_gap:
            self._prev = None
            self._dense.reset()
        if self._prev is None and self.ground is not None and not self.ground.is_open:
            self.ground.open(self.stream, self.settings.roi, self.mask)
        shift = None
        if self._prev is not None:
            shift = self._begun(
                estimate_shift,
                self._prev,
                frame.image,
                illumination=self.settings.illumination,
                max_displacement=self.settings.max_displacement,
                mask=self.mask,
                next_mask=self.mask,
            )
        self._prev = frame.image
        flow = self._dense.update(self._counted(frame.image))
        return None if shift is None else shift(), flow

    def _begun(self, function: Callable[..., Result], *args: Any, **options: Any) -> Callable[[], Result]:
        """Call a function beside what is done here, or at once; what this gives has its result."""
        if self._beside is not None:
            return self._beside.submit(function, *args, **options).result
        result = function(*args, **options)
        return lambda: result

    def _counted(self, image: NDArray[Any]) -> NDArray[Any]:
        """Fill what does not count: coarse levels of the flow reach over it."""
        if self._fixed is None:
            return image
        self._fixed.expect_shape(image.shape)
        return self._fixed.filled(image)

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
            "ground": None if self.ground is None else self.ground.state(),
        }

    def go_on(self, saved: Saved, frame: Frame) -> None:
        """Be as after `frame`, which is measured already, from what was saved then."""
        state = saved.value("pipeline", make={"MotionSegmenter": self._new_segmenter})
        self.decision = CameraDecision(*state["decision"])
        self._segmenter = state["segmenter"]
        # The others know the frame before and no more.
        self._prev, self._prev_t_s = frame.image, frame.t_s
        self._dense.update(self._counted(frame.image))
        if self.ground is not None:
            self.ground.open(self.stream, self.settings.roi, self.mask)
            self.ground.go_on(state["ground"])

    def begin(self, decision: CameraDecision) -> None:
        """Separate by what was decided elsewhere, from the first frames of the source."""
        self.decision = decision
        self._segmenter = self._new_segmenter()

    def learn(self, frame: Frame, flow: FlowField | None) -> MotionSegmentation:
        """Second step of a frame before the first that counts: what moves and what stands still alone."""
        assert self._segmenter is not None, "begin comes first"
        self._prev_t_s = frame.t_s
        return self._segmenter.update(frame.image, flow=flow, t_s=frame.t_s)

    def to_first(self) -> list[list[float]]:
        """Give what takes a place of the last frame to the picture in which things are followed over the ground."""
        assert self._segmenter is not None, "settle, begin or go_on comes first"
        return self._segmenter.to_first.tolist()  # type: ignore[no-any-return]

    def finish(self, frame: Frame, shift: Shift | None, flow: FlowField | None, *, after_gap: bool = False) -> Measured:
        """Second step: moving and static, velocity, and the rows of the tables.

        `after_gap` the frame before is of too long ago to be compared with. What is known of the scene stays with a
        camera at rest alone; things are sought where they would be by now.
        """
        assert self._segmenter is not None, "settle or go_on comes first"
        velocity, table_row, measured = None, None, None
        if self.ground is not None:
            if after_gap:
                self.ground.after_gap()
            measured = self._begun(self.ground.update, frame)
        known = _no_flow(frame.image.shape) if after_gap else flow
        segmentation = self._segmenter.update(frame.image, flow=known, t_s=frame.t_s)
        dt_s = frame.t_s - self._prev_t_s
        self._prev_t_s = frame.t_s
        if measured is not None:
            velocity, table_row = measured()
        return Measured(
            frame=frame,
            flow=flow,
            segmentation=segmentation,
            velocity=velocity,
            motion=rows.motion_row(frame, dt_s, shift, flow, segmentation),
            objects=rows.object_rows(frame, segmentation, self._scales()),
            velocity_row=table_row,
        )

    def _scales(self) -> Scales | None:
        """Give what knows the metres of a pixel at places, if anything does."""
        scale = self.settings.scale_m_per_px
        if scale is not None:
            return lambda places: np.full(len(places), scale)
        return None if self.ground is None else self.ground.scales

    @property
    def notes(self) -> list[str]:
        """What to know of the camera and of the logs, in sentences."""
        if self.ground is None:
            return []
        return [*self.ground.notes, *(f"{text}." for text in (*self.ground.gaps(), *self.ground.doubts()))]

    @property
    def attitude(self) -> dict[str, Any]:
        """How the body stood in the last interval, for the path."""
        return {} if self.ground is None else self.ground.attitude

    @property
    def unstated(self) -> tuple[str, ...]:
        """What the velocities' deviations leave out."""
        return () if self.ground is None else self.ground.unstated

    def without_log(self) -> OptionError | None:
        """Give the error that a log had nothing for any frame, or None."""
        return None if self.ground is None else self.ground.missed()


def _no_flow(shape: tuple[int, ...]) -> FlowField:
    """Give a flow of which nothing is known."""
    from ..flow.field import FlowField

    unknown, light = np.zeros((*shape, 2), np.float32), np.zeros((1, 1), np.float32)
    return FlowField(unknown, np.zeros(shape, bool), unknown[..., 0], (light + 1, light, 0))
