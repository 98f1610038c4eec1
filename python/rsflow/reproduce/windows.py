"""Tables 4-1 and 4-2: displacement between two windows of one picture, in steady and in changed light."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from .._checks.knobs import Illumination
from .._display import fields
from ..errors import OptionError
from ..shift import estimate_shift
from ..synthetic import Lighting, Sensor, gain, offset, ramp, texture
from ..synthetic.textures import CONTRAST_LEVELS, MEAN_LEVEL
from .printed import WINDOW, report

__all__ = ["CONDITIONS", "Condition", "SyntheticMotion", "photographs", "synthetic_motion", "textures"]

# The report's second window is brighter; it does not say by how much. A tenth of the full scale.
RISE = 25.0


def photographs() -> dict[str, NDArray[np.uint8]]:
    """Photographs that scikit-image ships, by name.

    Returns
    -------
    dict of str to (512, 512) uint8
        brick, grass, gravel and camera.

    Raises
    ------
    MissingExtraError
        If scikit-image is not installed.

    Examples
    --------
    >>> from rsflow.reproduce import photographs
    >>> sorted(photographs())
    ['brick', 'camera', 'grass', 'gravel']
    """
    from .._extras import require

    data = require("skimage.data", extra="reproduce", purpose="reproducing tables 4-1 and 4-2 on photographs")
    return {name: getattr(data, name)() for name in ("brick", "grass", "gravel", "camera")}


def textures() -> dict[str, NDArray[np.uint8]]:
    """Textures of rsflow's own, for where there are no photographs.

    Returns
    -------
    dict of str to (256, 256) uint8

    Examples
    --------
    >>> {name: picture.shape for name, picture in textures().items()}
    {'fine texture': (256, 256), 'smooth texture': (256, 256), 'ground texture': (256, 256)}
    """
    found = {}
    for name, kind in (("fine texture", "fine"), ("smooth texture", "smooth"), ("ground texture", "ground")):
        levels = MEAN_LEVEL + CONTRAST_LEVELS * texture((256, 256), kind, seed=7)
        found[name] = np.clip(np.rint(levels), 0, 255).astype(np.uint8)
    return found


@dataclass(frozen=True)
class Condition:
    """What happens to the second window: light, noise in both windows, and whether the light is compensated.

    Examples
    --------
    >>> from rsflow.reproduce import CONDITIONS
    >>> CONDITIONS[1].name, CONDITIONS[1].illumination
    ('brighter, not compensated', 'none')
    """

    name: str
    light: Lighting | None = None
    noise: float = 0.0
    illumination: Illumination = "gain_offset"


# The first two are the report's tables 4-1 and 4-2.
CONDITIONS: tuple[Condition, ...] = (
    Condition("brighter, compensated", offset(RISE)),
    Condition("brighter, not compensated", offset(RISE), illumination="none"),
    Condition("steady light", None),
    Condition("gain 0.8", gain(0.8)),
    Condition("ramp 0.7 to 1.0", ramp(0.7, 1.0)),
    Condition("brighter, noise 2 levels", offset(RISE), noise=2.0),
)


@dataclass(frozen=True)
class SyntheticMotion:
    """Tables 4-1 and 4-2 again, in one condition.

    Attributes
    ----------
    condition : str
    pictures : tuple of str
    actual_px : (39, 2) float64
        The displacements of table 4-1, in its order.
    report_px : (39, 2) float64 or None
        What the report calculated, where it has this condition; NaN where it left a row out.
    measured_px : (pictures, 39, 2) float64
        What rsflow measured; NaN where it says that it cannot.

    Examples
    --------
    >>> from rsflow.reproduce import CONDITIONS, synthetic_motion, textures
    >>> table = synthetic_motion(textures(), CONDITIONS[0])
    >>> table.errors_px.shape, bool(table.errors_px.max() < 0.05)
    ((3, 39), True)
    """

    condition: str
    pictures: tuple[str, ...]
    actual_px: NDArray[np.float64]
    report_px: NDArray[np.float64] | None
    measured_px: NDArray[np.float64]

    __repr__ = fields

    @property
    def errors_px(self) -> NDArray[np.float64]:
        """Length of the error of each measurement, (pictures, 39)."""
        return np.asarray(np.linalg.norm(self.measured_px - self.actual_px, axis=2), dtype=np.float64)

    @property
    def report_errors_px(self) -> NDArray[np.float64]:
        """Length of the report's errors, (39,); NaN where it has none."""
        if self.report_px is None:
            return np.full(len(self.actual_px), np.nan)
        return np.asarray(np.linalg.norm(self.report_px - self.actual_px, axis=1), dtype=np.float64)


def synthetic_motion(pictures: Mapping[str, NDArray[Any]], condition: Condition, *, seed: int = 0) -> SyntheticMotion:
    """Measure the report's 39 displacements between windows cropped from pictures.

    Parameters
    ----------
    pictures : mapping of name to (height, width) uint8
        At least 81 pixels in each direction, so that the largest displacement fits.
    condition : Condition
        One of `CONDITIONS`.
    seed : int
        Of the noise.

    Returns
    -------
    SyntheticMotion

    Raises
    ------
    OptionError
        If a picture is too small or not grey uint8.

    Notes
    -----
    Both windows are cropped, as in the report: what left the first one is not seen in the second.

    Examples
    --------
    >>> from rsflow.reproduce import CONDITIONS, synthetic_motion, textures
    >>> table = synthetic_motion(textures(), CONDITIONS[0])
    >>> table.condition, len(table.pictures), table.measured_px.shape
    ('brighter, compensated', 3, (3, 39, 2))
    """
    _checks.instance("pictures", pictures, Mapping, "pictures by their names")
    _checks.instance("condition", condition, Condition, "a Condition")
    seed = _checks.integer("seed", seed, least=0)
    with_light = report()["table_4_1_with_illumination_correction"]
    actual = np.array([row["actual_px"] for row in with_light], dtype=np.float64)
    least = WINDOW + 2 * int(np.abs(actual).max()) + 1
    found = np.full((len(pictures), len(actual), 2), np.nan)
    sensor = Sensor(noise=condition.noise)
    rng = np.random.default_rng(seed)
    for i, (name, picture) in enumerate(pictures.items()):
        grey = _checks.frame(f"pictures[{name!r}]", picture)
        if grey.dtype != np.uint8 or min(grey.shape) < least:
            raise OptionError(
                f"pictures[{name!r}]: got {_checks.described(picture)}, "
                f"expected grey uint8 of at least {least} x {least} pixels"
            )
        y, x = ((side - WINDOW) // 2 for side in picture.shape)
        for j, (dx, dy) in enumerate(actual.astype(int)):
            # What is at (x, y) of the first window is at (x + dx, y + dy) of the second: that starts further up.
            first, second = (
                np.ascontiguousarray(picture[b : b + WINDOW, a : a + WINDOW])
                for a, b in ((x, y), (x - int(dx), y - int(dy)))
            )
            lit = second.astype(np.float64) if condition.light is None else condition.light(second.astype(np.float64))
            if condition.noise:
                first = sensor.expose(first.astype(np.float64), rng)
            second = sensor.expose(lit, rng)
            shift = estimate_shift(first, second, illumination=condition.illumination)
            found[i, j] = (shift.dx, shift.dy) if shift.valid else np.nan
    table = {
        "brighter, compensated": "table_4_1_with_illumination_correction",
        "brighter, not compensated": "table_4_2_without_illumination_correction",
    }.get(condition.name)
    printed = None
    if table is not None:
        rows = {tuple(row["actual_px"]): row["estimated_px"] for row in report()[table]}
        printed = np.array([rows.get((int(dx), int(dy)), (np.nan, np.nan)) for dx, dy in actual])
    return SyntheticMotion(condition.name, tuple(pictures), actual, printed, found)
