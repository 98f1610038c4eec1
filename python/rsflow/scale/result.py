"""What a check of scale found: figures with their intervals, and what is wrong in words."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .._results.status import WordStatus
from ..camera import Camera
from .estimate import UNKNOWN, Estimate, in_unit

__all__ = ["ScaleCheck", "ScaleStatus", "corrected"]

F64 = NDArray[np.float64]


class ScaleStatus(WordStatus):
    """What became of a check.

    Examples
    --------
    >>> import rsflow
    >>> print(rsflow.ScaleStatus.NO_MATCH, rsflow.ScaleStatus.CHECKED.valid)
    no_match True
    """

    CHECKED = "checked", "The figures hold, those that are known; `findings` says what is wrong."
    TOO_FEW_FRAMES = "too_few_frames", "Too few frames could be compared with the one before."
    NO_MOTION = "no_motion", "The picture hardly moves: nothing can be told."
    NOT_TURNING = (
        "not_turning",
        "The picture does not move as that of a camera that turns in place: it is also moved, or the lens is another.",
    )
    NO_MATCH = "no_match", "At no delay does what was given follow what the picture does."
    NO_OVERLAP = "no_overlap", "What was given covers less than half of the clip."


@dataclass(frozen=True, eq=False)
class ScaleCheck:
    """What `check_scale` found.

    Attributes
    ----------
    status : ScaleStatus
    against : {"gyro", "velocity", "speed", "distance"}
        What the clip was held against.
    focal_px : Estimate
        Effective focal length along x, in pixels.
    focal_ratio : Estimate
        Effective focal length over the one that was stated.
    axes : (str, str, str)
        For each axis x, y, z of the body, the axis of the log that measures it: "+x" where it is right, "-x" where the
        sign is wrong, "+y" where axes are swapped, "?" where the clip cannot tell.
    mounting_rad : (Estimate, Estimate, Estimate)
        What is left of a turn between the log's axes, put in order, and the camera's: a rotation vector in the
        camera's axes, which turns rates of the log into rates of the camera.
    delay_s : Estimate
        How much later than the picture the log is: what it says of time t stands in it at t + delay.
    readout_s : Estimate
        Time from the first row of a picture to its last one.
    bias_rad_s : (Estimate, Estimate, Estimate)
        Of a gyro, in its own axes.
    findings : tuple of str
        What is wrong, a sentence each.
    untold : tuple of str
        What this clip cannot tell, and what would.
    frames : int
        Of the clip.
    n_pairs : int
        Pairs of frames that were used.
    camera : Camera or None
        The camera with the effective focal length and its deviation; None where that is unknown.
    R_body_from_camera : (3, 3) float64
        Of a gyro, for a `VelocityEstimator` that is given the log's rates as they are, less the bias; NaN where
        unknown, or where the log's axes are mirrored.

    Examples
    --------
    >>> import numpy as np, rsflow
    >>> flight = rsflow.synthetic.flight(frames=8, velocity_m_s=(0.0, 0.0, 0.0), seed=1)
    >>> check = rsflow.check_scale(flight, flight.camera, t_s=np.arange(9) / 30, rate_rad_s=np.zeros((9, 3)))
    >>> check.ok, check.status.word, check.delay_s
    (False, 'too_few_frames', Estimate(unknown))
    """

    status: ScaleStatus
    against: str
    focal_px: Estimate = UNKNOWN
    focal_ratio: Estimate = UNKNOWN
    axes: tuple[str, str, str] = ("?", "?", "?")
    mounting_rad: tuple[Estimate, Estimate, Estimate] = (UNKNOWN, UNKNOWN, UNKNOWN)
    delay_s: Estimate = UNKNOWN
    readout_s: Estimate = UNKNOWN
    bias_rad_s: tuple[Estimate, Estimate, Estimate] = (UNKNOWN, UNKNOWN, UNKNOWN)
    findings: tuple[str, ...] = ()
    untold: tuple[str, ...] = ()
    frames: int = 0
    n_pairs: int = 0
    camera: Camera | None = None
    R_body_from_camera: F64 = field(default_factory=lambda: np.full((3, 3), np.nan))

    @property
    def yaw_rad(self) -> Estimate:
        """The mounting's turn about the optical axis."""
        return self.mounting_rad[2]

    @property
    def ok(self) -> bool:
        """Whether the check could be made and found nothing wrong; what it could not tell is in `untold`."""
        return self.status.valid and not self.findings

    def __repr__(self) -> str:
        if not self.status.valid:
            return f"ScaleCheck({self.status.name}: {self.status.explanation})"
        told = f"focal {self.focal_px}, delay {self.delay_s}, readout {self.readout_s}, axes {' '.join(self.axes)}"
        wrong = f"{len(self.findings)} findings" if self.findings else "nothing wrong found"
        return f"ScaleCheck({told},\n           {wrong}, {len(self.untold)} not told, {self.n_pairs} pairs)"

    def to_dict(self) -> dict[str, float | int | str | bool]:
        """Give the figures as a row, for ``pandas.DataFrame`` a list of such.

        Returns
        -------
        dict of str to float, int, str or bool
            Each figure with ``_std``, ``_low`` and ``_high``; findings and what is not told joined to one text each.
        """
        row: dict[str, float | int | str | bool] = {"status": self.status.word, "against": self.against, "ok": self.ok}
        figures = {"focal_px": self.focal_px, "focal_ratio": self.focal_ratio, "delay_s": self.delay_s}
        figures |= {"readout_s": self.readout_s}
        for name, three in (("mounting_{}_rad", self.mounting_rad), ("bias_{}_rad_s", self.bias_rad_s)):
            figures |= {name.format(axis): value for axis, value in zip("xyz", three, strict=True)}
        for name, value in figures.items():
            row |= {name: value.value, f"{name}_std": value.std, f"{name}_low": value.low, f"{name}_high": value.high}
        row |= {f"axis_{axis}": of for axis, of in zip("xyz", self.axes, strict=True)}
        row |= {"findings": "; ".join(self.findings), "untold": "; ".join(self.untold)}
        return row | {"frames": self.frames, "n_pairs": self.n_pairs}

    def report(self) -> str:
        """Say all of it in lines, for a terminal."""
        lines = [f"{self.frames} frames, {self.n_pairs} pairs held against the {self.against}"]
        if not self.status.valid:
            lines.append(f"not checked: {self.status.explanation}")
        else:
            degrees = [in_unit(angle, 180 / np.pi, "deg") for angle in self.mounting_rad]
            figures = {"focal length": self.focal_px, "of what was stated": self.focal_ratio}
            figures |= {f"mounting about {axis}": angle for axis, angle in zip("xyz", degrees, strict=True)}
            figures |= {"delay": in_unit(self.delay_s, 1e3, "ms"), "readout": in_unit(self.readout_s, 1e3, "ms")}
            if self.against == "gyro":
                figures |= {f"bias of {axis}": bias for axis, bias in zip("xyz", self.bias_rad_s, strict=True)}
            lines.append(f"{'axes x, y, z':<20}{', '.join(self.axes)}")
            lines += [f"{name:<20}{_with_interval(figure)}" for name, figure in figures.items()]
        lines += [f"wrong: {text}" for text in self.findings]
        lines += [f"not told: {text}" for text in self.untold]
        if self.ok:
            lines.append("nothing wrong found")
        return "\n".join(lines)


def _with_interval(figure: Estimate) -> str:
    if not figure.known:
        return "unknown"
    unit = f" {figure.unit}" if figure.unit else ""
    return f"{figure.value:.5g}{unit}, 95 % from {figure.low:.5g} to {figure.high:.5g}{unit}"


def corrected(camera: Camera, ratio: Estimate) -> Camera | None:
    """Give the camera with its focal length multiplied by a ratio, and its deviation; None where that is unknown."""
    if not ratio.known:
        return None
    std = {**camera.std, "fx": camera.fx * ratio.std, "fy": camera.fy * ratio.std}
    return replace(camera, fx=camera.fx * ratio.value, fy=camera.fy * ratio.value, std=std)
