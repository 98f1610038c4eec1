"""What happens to frames between the camera and the file: lost, given twice, encoded as JPEG."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _checks
from ..errors import DTypeError
from .flights import Flight

__all__ = ["dropped", "encoded", "repeated"]


def dropped(flight: Flight, frames: Iterable[int]) -> Flight:
    """Lose frames; the times of the others stay as they are, and velocity and rate are means over longer intervals.

    Parameters
    ----------
    flight : Flight
    frames : iterable of int
        Which are lost, from 0.

    Returns
    -------
    Flight

    Examples
    --------
    >>> from rsflow import synthetic
    >>> whole = synthetic.flight(frames=5, rate_hz=10.0, velocity_m_s=(0.03, 0.0, 0.0), seed=1)
    >>> found = dropped(whole, [2, 3])
    >>> found.t_s.round(3).tolist(), found.velocity_m_s[2].round(3).tolist()
    ([0.0, 0.1, 0.4], [0.03, 0.0, 0.0])
    """
    chosen = _chosen(flight, frames, least=0)
    keep = np.setdiff1d(np.arange(len(flight)), chosen)
    if not len(keep):
        raise _checks.refused("frames", chosen, f"some of the {len(flight)} frames, not all")
    velocity, rate = flight.path.means(flight.t_s[keep[:-1]], flight.t_s[keep[1:]])
    unknown = np.full((1, 3), np.nan)
    arrays: dict[str, Any] = {
        name: getattr(flight, name)[keep]
        for name in ("images", "t_s", "shown_s", "height_m", "down", "position_m", "masks")
    }
    arrays |= {"velocity_m_s": np.vstack([unknown, velocity]), "rate_rad_s": np.vstack([unknown, rate])}
    return dataclasses.replace(flight, **arrays)


def repeated(flight: Flight, frames: Iterable[int], *, jpeg_quality: int | None = None) -> Flight:
    """Show the picture before once more in place of some frames, as a camera does that falls behind.

    Their times go on, and so does what the flight says of the camera; `Flight.shown_s` says when the picture was
    taken, and `Flight.flow` what the pictures show.

    Parameters
    ----------
    flight : Flight
    frames : iterable of int
        Which show the picture before, from 1; some in a row show one picture.
    jpeg_quality : int, optional
        Encode each repeated picture as JPEG of this quality, so that it differs from the one before.

    Returns
    -------
    Flight

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow import synthetic
    >>> found = repeated(synthetic.flight(frames=4, rate_hz=10.0, seed=1), [2])
    >>> found.shown_s.round(3).tolist(), bool(np.array_equal(found.images[1], found.images[2]))
    ([0.0, 0.1, 0.1, 0.3], True)
    """
    chosen = _chosen(flight, frames, least=1)
    images, shown, masks = flight.images.copy(), flight.shown_s.copy(), flight.masks.copy()
    original = flight.images
    source = np.arange(len(flight))
    for k in np.unique(chosen):
        source[k] = source[k - 1]
        images[k] = original[source[k]]
        shown[k], masks[k] = shown[source[k]], masks[source[k]]
        if jpeg_quality is not None:
            images[k] = _jpeg(images[k], jpeg_quality)
    return dataclasses.replace(flight, images=images, shown_s=shown, masks=masks)


def encoded(flight: Flight, jpeg_quality: int = 80) -> Flight:
    """Encode every picture as JPEG and decode it again.

    Parameters
    ----------
    flight : Flight
        Of uint8.
    jpeg_quality : int
        1 to 100.

    Returns
    -------
    Flight

    Examples
    --------
    >>> import numpy as np
    >>> from rsflow import synthetic
    >>> flight = synthetic.flight(frames=2, seed=1)
    >>> loss = encoded(flight, 60).images.astype(float) - flight.images
    >>> bool(1 < np.abs(loss).mean() < 10)
    True
    """
    _checks.instance("flight", flight, Flight, "a Flight")
    return dataclasses.replace(flight, images=np.stack([_jpeg(image, jpeg_quality) for image in flight.images]))


def _chosen(flight: Flight, frames: Iterable[int], *, least: int) -> NDArray[np.intp]:
    _checks.instance("flight", flight, Flight, "a Flight")
    most = len(flight) - 1
    given = _checks.iterable("frames", frames, f"integers from {least} to {most}")
    return np.array([_checks.integer("frames", k, least=least, most=most) for k in given], dtype=np.intp)


def _jpeg(image: NDArray[Any], quality: int) -> NDArray[Any]:
    import cv2

    quality = _checks.integer("jpeg_quality", quality, least=1, most=100)
    if image.dtype != np.uint8:
        raise DTypeError(f"flight: got images of {image.dtype}, expected uint8, which JPEG holds")
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
