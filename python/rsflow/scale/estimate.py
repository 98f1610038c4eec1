"""A figure with its deviation and its interval, or that it cannot be told."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._display import measured

__all__ = ["UNKNOWN", "Estimate", "estimated", "in_unit"]

# Student's t, two-sided 95 %, by degrees of freedom from 1 on; beyond, nearly the normal's.
_T95: tuple[float, ...] = (12.71, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160)
_T95 += (2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060)


@dataclass(frozen=True)
class Estimate:
    """A figure, its standard deviation and its 95 % interval.

    Attributes
    ----------
    value : float
        NaN where it cannot be told.
    std : float
        Standard deviation; infinite where it cannot be told.
    low, high : float
        Ends of the 95 % interval; infinite where it cannot be told.
    unit : str
        Empty where it is a ratio.

    Examples
    --------
    >>> from rsflow.scale import Estimate
    >>> delay = Estimate(0.041, 0.0004, 0.0402, 0.0418, "s")
    >>> delay, delay.known, 0.04 in delay
    (Estimate(0.04100 +- 0.00040 s), True, False)
    >>> Estimate()
    Estimate(unknown)
    """

    value: float = math.nan
    std: float = math.inf
    low: float = -math.inf
    high: float = math.inf
    unit: str = ""

    def __repr__(self) -> str:
        return f"Estimate({self})"

    def __str__(self) -> str:
        if not self.known:
            return "unknown"
        return f"{measured(self.value, self.std)}{f' {self.unit}' if self.unit else ''}"

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    @property
    def known(self) -> bool:
        """Whether the clip tells it."""
        return math.isfinite(self.std)


UNKNOWN = Estimate()


def estimated(value: float, std: float, *, blocks: int = 0, unit: str = "", most_std: float = math.inf) -> Estimate:
    """Give value and deviation their interval, from as many blocks of the clip; unknown above `most_std`."""
    if not (math.isfinite(value) and math.isfinite(std) and std <= most_std):
        return Estimate(unit=unit)
    factor = _T95[blocks - 2] if 2 <= blocks < len(_T95) + 2 else 1.96
    return Estimate(value, std, value - factor * std, value + factor * std, unit)


def in_unit(figure: Estimate, factor: float, unit: str) -> Estimate:
    """Give a figure in another unit, in which it is `factor` times as large."""
    low, high = sorted((figure.low * factor, figure.high * factor))
    return Estimate(figure.value * factor, figure.std * abs(factor), low, high, unit)
