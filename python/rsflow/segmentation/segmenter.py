"""What moves and what stands still, for a static and for a moving camera.

`_core.Segmenter` tells it from a background of samples, the frame and its dense flow; here are frames of every type,
the flow where none is given, masks of the sensor, and the things that move, followed over time.

docs/explanation/algorithms.md, section "What moves: MotionSegmenter".
"""

from __future__ import annotations

import numbers
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from .. import _checks, _core
from .._checks.knobs import Illumination, Preset
from .._display import options
from .._shared import Shared, alone, anew
from ..capture.masks import FixedMask
from ..errors import DTypeError, FormatError, OptionError, RsflowError, ShapeError
from ..flow import DenseFlow
from . import reduction
from .levels import Levels
from .objects import ObjectTracker
from .result import MotionSegmentation, SegmentationStatus

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..io.flow_files import FlowLike
    from .object_table import TrackedObject

    F32 = NDArray[np.float32]
    Mask = NDArray[np.bool_]

__all__ = ["MotionSegmentation", "MotionSegmenter"]

# The smallest region, as a share of the frame, and in pixels.
_LEAST_SHARE = 1e-4
_LEAST_AREA = 12
# Shorter motion of a thing is told by its way alone.
_LEAST_MOTION_PX = 0.4
# What is seen in one frame alone is noise.
_LEAST_AGE = 2


class MotionSegmenter(Shared):
    """Tell what moves from what stands still, frame after frame.

    Threads that share one wait for each other. A copy, or a pickle read anywhere, goes on with the same bits.

    Parameters
    ----------
    camera_motion : {"moving", "static"}
        Whether the camera moves. A static one need not be registered, and what differs from the background moved.
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
    Each place of the scene has samples of what was seen there when nothing moved; frames are laid over it by the
    camera's motion, which is a plane's (a translation, similarity, affine map or homography) and refined on the
    background. What differs from all samples, in light that may change, moves; where nothing was seen yet, what the
    dense flow says does. Where things move against the plane along lines through one point, by more than chance and as
    far as the camera travelled, the scene has depth: then the flow alone tells, and motion along these lines the way
    that depth goes is parallax: what moves so by itself cannot be told. Frames of more than
    300,000 pixels are judged at half their resolution, or less, and what moves is brought back to the frame's own
    pixels by its grey levels.

    Samples: O. Barnich and M. Van Droogenbroeck, IEEE Trans. Image Processing 20(6), 2011. Parallax: M. Irani and
    P. Anandan, PAMI 20(6), 1998. False discoveries: Y. Benjamini and Y. Hochberg, J. R. Stat. Soc. B 57, 1995.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> frames = np.random.default_rng(1).integers(0, 256, (3, 60, 80), np.uint8)
    >>> segmenter = rsflow.MotionSegmenter(camera_motion="static")
    >>> first = segmenter.update(frames[0])
    >>> print(first.status, bool(first.moving.any()))
    first_frame False
    """

    _state_version = 4
    _state_types: ClassVar = {
        **dict.fromkeys(("static_camera", "_flow_is_ours"), (bool, np.bool_)),
        "min_area": (numbers.Integral, type(None)),
        "_knobs": (tuple,),
        "_flow": (DenseFlow,),
        "_fixed": (FixedMask, type(None)),
        "_shape": (tuple, type(None)),
        "_levels": (Levels, type(None)),
        "_engine": (_core.Segmenter, type(None)),
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
        self._knobs = (preset, illumination, max_displacement)
        self._flow = DenseFlow(preset=preset, illumination=illumination, max_displacement=max_displacement)
        self.reset()

    def __repr__(self) -> str:
        knobs = {"camera_motion": "static" if self.static_camera else "moving", "min_area": self.min_area}
        told = options(**knobs, mask=self._fixed is not None)
        before = "no frame yet" if self._shape is None else f"frames of {self._shape[1]} x {self._shape[0]}"
        return f"MotionSegmenter({told}): {before}"

    @property
    def to_first(self) -> NDArray[np.float64]:
        """Homography (3, 3) from the last frame to the first, in which ways over the ground are told; NaN if lost."""
        return np.eye(3) if self._tracker is None else self._tracker.to_first

    @anew
    def reset(self) -> None:
        """Forget everything: the next frame is a first one, as after a cut."""
        self._shape: tuple[int, int] | None = None
        self._levels: Levels | None = None
        self._engine: _core.Segmenter | None = None
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
            # Coarse levels of the flow, and windows, reach over pixels that do not count.
            counted = self._fixed.filled(image)
        shape = (image.shape[0], image.shape[1])
        if self._shape is not None and shape != self._shape:
            raise ShapeError(
                f"image: got {shape}, expected the shape of the frames before, {self._shape}; "
                "reset() starts another sequence"
            )
        first = self._shape is None
        if flow is None:
            if not self._flow_is_ours:
                raise OptionError("flow: got None, expected that of every frame after the first, or of none")
        elif first:
            raise OptionError("flow: got one for the first frame, which has none, expected None, or reset() before")
        else:
            flow = _given_flow(flow, shape)
            self._flow_is_ours = False
        if self._levels is None or self._engine is None or first or not self._levels.hold(counted):
            # Also where a picture was first of one level, or faded in: what is known is of another light altogether.
            levels, first = Levels.of(counted), True
            area = _least_area(self.min_area, shape)
            engine = _new_engine(self.static_camera, area, levels, shape)
            if self._tracker is None:
                self._tracker = ObjectTracker(min_area=area, min_age=_LEAST_AGE, only_travelling=True)
                self._flow = self._new_flow(shape, engine.reduced_shape())
            self._levels, self._engine = levels, engine
        if self._flow_is_ours:
            flow = self._flow.update(reduction.reduced(counted, self._engine.reduced_shape()))
        result = self._segment(image, counted, None if first else flow, t_s)
        self._shape = shape
        return result

    def _new_flow(self, shape: tuple[int, int], small: tuple[int, int]) -> DenseFlow:
        """Make the flow of frames of this shape, which is measured on smaller ones."""
        preset, illumination, most = self._knobs
        pixels = None if self._fixed is None else reduction.all_of(self._fixed.pixels, small)
        return DenseFlow(
            preset=preset,
            illumination=illumination,
            max_displacement=None if most is None else most / reduction.factor(shape, small),
            mask=pixels,
            next_mask=pixels,
        )

    def _segment(
        self, image: NDArray[Any], counted: NDArray[Any], flow: FlowLike | None, t_s: float | None
    ) -> MotionSegmentation:
        assert self._engine is not None
        assert self._levels is not None
        assert self._tracker is not None
        uv, valid = (None, None) if flow is None else (np.asarray(flow.uv, np.float32), np.asarray(flow.valid, bool))
        counts = None if self._fixed is None else self._fixed.pixels
        moving, camera, parallax, _ = self._engine.update(self._levels.taken(counted), uv, valid, counts)
        homography, model = np.array(camera[0]), "static" if self.static_camera else camera[1]
        length: F32 | None = None
        objects: tuple[TrackedObject, ...] = ()
        if flow is None:
            status = SegmentationStatus.FIRST_FRAME
            if self._tracker.labels.size:
                objects = self._tracker.update(moving, t_s=t_s)
        elif model == "none":
            status = SegmentationStatus.NO_CAMERA_MOTION
            objects = self._tracker.update(moving, t_s=t_s)
        else:
            status = SegmentationStatus.OK
            # Flow within a thing is often that of the ground around it, and then it says that the thing stands.
            length, motion = self._engine.motion(_LEAST_MOTION_PX)
            objects = self._tracker.update(moving, motion, homography, image=self._levels.of_255(counted), t_s=t_s)
            if counts is not None:
                length[~counts] = np.nan
        if length is None:
            length = np.full(moving.shape, np.nan, np.float32)
        labels = self._tracker.labels
        return MotionSegmentation(
            image=image,
            moving=moving,
            residual=length,
            camera_motion=homography,
            camera_model=model,
            parallax=parallax,
            objects=objects,
            hidden=self._tracker.hidden,
            labels=labels if labels.size else np.zeros(moving.shape, np.int32),
            background=self._levels.given(self._engine.scene()),
            status=status,
            mask=counts,
        )

    def _packed(self, state: dict[str, Any]) -> dict[str, Any]:
        return {**state, "_engine": None if self._engine is None else self._engine.state()}

    def _unpacked(self, state: dict[str, Any]) -> dict[str, Any]:
        kept, parts = state.get("_engine"), ("static_camera", "min_area", "_levels", "_shape")
        # What is of another type is told by name later.
        fits = all(isinstance(state.get(name, ...), self._state_types[name]) for name in parts)
        if not (fits and isinstance(kept, dict) and state["_shape"] is not None and state["_levels"] is not None):
            return state
        shape = (int(state["_shape"][0]), int(state["_shape"][1]))
        area = _least_area(state["min_area"], shape)
        engine = _new_engine(bool(state["static_camera"]), area, state["_levels"], shape)
        try:
            engine.restore(kept)
        except RsflowError as error:
            raise FormatError(f"the state of a {type(self).__name__} is damaged: '_engine': {error}") from error
        return {**state, "_engine": engine, "_shape": shape}


def _least_area(min_area: int | None, shape: tuple[int, int]) -> int:
    share = max(_LEAST_AREA, round(_LEAST_SHARE * shape[0] * shape[1]))
    return share if min_area is None else int(min_area)


def _new_engine(static_camera: bool, area: int, levels: Levels, shape: tuple[int, int]) -> _core.Segmenter:
    return _core.Segmenter(not static_camera, area, levels.scale, levels.rounding, shape)


def _given_flow(flow: FlowLike, shape: tuple[int, ...]) -> FlowLike:
    """Check what a caller gives as flow: an object with the motion and where it is known."""
    for part in ("uv", "valid"):
        if not hasattr(flow, part):
            raise _checks.refused("flow", flow, "a FlowField", DTypeError)
    _checks.array("flow.uv", flow.uv, (*shape, 2), f"numbers, {(*shape, 2)}, as the frame has")
    _checks.bools("flow.valid", flow.valid, tuple(shape), "the frame")
    return flow
