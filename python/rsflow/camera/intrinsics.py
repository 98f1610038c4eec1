"""Intrinsics in pixels of a stated picture size, and lens distortion: what a camera file holds."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Self, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import OptionError
from .distortion import NAMES

__all__ = ["LARGEST", "CameraFormat", "CameraModel", "Intrinsics"]

CameraModel: TypeAlias = Literal["pinhole", "fisheye"]
CameraFormat: TypeAlias = Literal["json", "opencv", "ros", "kalibr"]

# The longest side of a picture, in pixels.
LARGEST = 1_000_000

# How many distortion coefficients each model may have, in OpenCV's order.
_LENGTHS: dict[str, tuple[int, ...]] = {"pinhole": (0, 4, 5, 8, 12), "fisheye": (0, 4)}


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """The parameters of a camera, checked; `rsflow.Camera` says what each is."""

    fx: float
    fy: float
    cx: float
    cy: float
    _: dataclasses.KW_ONLY
    width: int
    height: int
    distortion: tuple[float, ...] = ()
    model: CameraModel = "pinhole"
    std: Mapping[str, float] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        put = functools.partial(object.__setattr__, self)
        for name, above in (("fx", 0.0), ("fy", 0.0), ("cx", None), ("cy", None)):
            put(name, _checks.number(name, getattr(self, name), above=above, of="pixels"))
        for name in ("width", "height"):
            put(name, _checks.integer(name, getattr(self, name), least=1, most=LARGEST, of="pixels"))
        put("model", _checks.choice("model", self.model, get_args(CameraModel)))
        values = _checks.array("distortion", self.distortion, ..., "a list of finite numbers", finite=True)
        put("distortion", tuple(np.ravel(values).astype(np.float64).tolist()))
        lengths = _LENGTHS[self.model]
        if len(self.distortion) not in lengths:
            raise OptionError(
                f"distortion: got {len(self.distortion)} coefficients, expected "
                f"{', '.join(map(str, lengths[:-1]))} or {lengths[-1]} for the model {self.model!r}"
            )
        known = ("fx", "fy", "cx", "cy", *self.distortion_names)
        deviations = _checks.instance("std", self.std, Mapping, "a mapping of names to deviations")
        if set(deviations) - set(known):
            raise _checks.refused("std", next(iter(set(deviations) - set(known))), f"deviations of {', '.join(known)}")
        put("std", {name: _checks.number(f"std[{name!r}]", value, least=0) for name, value in deviations.items()})

    @classmethod
    def from_matrix(
        cls,
        matrix: NDArray[Any] | Sequence[Sequence[float]],
        distortion: Sequence[float] | NDArray[Any] = (),
        *,
        width: int,
        height: int,
        model: CameraModel = "pinhole",
        std: Mapping[str, float] | None = None,
    ) -> Self:
        """Make a camera from a 3 x 3 matrix as OpenCV's.

        Parameters
        ----------
        matrix : array_like, (3, 3)
            Without skew.
        distortion, width, height, model, std
            As of the camera.

        Raises
        ------
        ShapeError
            If the matrix is not 3 x 3.
        OptionError
            If it has a skew, or a last row other than (0, 0, 1).

        Examples
        --------
        >>> import numpy as np
        >>> from rsflow import Camera
        >>> K = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
        >>> Camera.from_matrix(K, width=320, height=240).fx
        300.0
        """
        K = _checks.array("matrix", matrix, (3, 3), "numbers, (3, 3)").astype(np.float64)
        if abs(K[0, 1]) > 1e-9 * abs(K[0, 0]) or K[1, 0] != 0 or not np.array_equal(K[2], (0.0, 0.0, 1.0)):
            raise OptionError(f"matrix: got {K.tolist()}, expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew")
        return cls(
            K[0, 0],
            K[1, 1],
            K[0, 2],
            K[1, 2],
            width=width,
            height=height,
            distortion=distortion,  # type: ignore[arg-type]
            model=model,
            std={} if std is None else std,
        )

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The camera matrix K, (3, 3) float64."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, in pixels."""
        return self.width, self.height

    @property
    def distortion_names(self) -> tuple[str, ...]:
        """Names of the distortion coefficients, in order."""
        return NAMES[self.model][: len(self.distortion)]
