"""What a calibration says about itself: coverage, advice, text and pictures."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._display import measured
from .._results.inputs import Inputs
from ..io.atomic import writing
from .figures import Figures
from .views import View

# Focal lengths from a chessboard repeat to 0.09 % at best; a deviation of half a percent is half a percent of speed.
_FOCAL_GOOD = 0.001
_FOCAL_POOR = 0.005

# A view this many times worse than the median view does not fit the others.
_POOR_VIEW = 2.0

# Tilt from which a view tells focal length from distance, in radians (15 degrees), and how many such views it takes.
_TILT_RAD = math.radians(15.0)
_TILTED_VIEWS = 4
_GOOD_VIEWS = 10

# Enlargement of the residual arrows in the pictures.
_ARROWS = 50

# Views that are not used are listed one by one up to this number, then counted.
_LISTED = 20

_PLACES = (
    ("top left", "top", "top right"),
    ("left", "centre", "right"),
    ("bottom left", "bottom", "bottom right"),
)


def empty_places(counts: NDArray[np.int64]) -> list[str]:
    """Name the parts of the picture, of 3 x 3, of whose cells fewer than half hold a corner."""
    places = []
    for y, row in enumerate(np.array_split(counts > 0, 3, axis=0)):
        for x, part in enumerate(np.array_split(row, 3, axis=1)):
            if part.mean() < 0.5:
                places.append(_PLACES[y][x])
    return places


def poor_views(calibration: Figures) -> list[View]:
    """Give the views that do not fit the others, worst first."""
    limit = _POOR_VIEW * float(np.median(calibration.per_view_errors))
    return sorted((view for view in calibration.used if view.rms > limit), key=lambda view: -view.rms)


def advice(calibration: Figures) -> tuple[str, ...]:
    """Say what would make a calibration better, most important first."""
    said = []
    used = calibration.used
    repaired = [view for view in used if view.repaired]
    worst = poor_views(calibration)
    camera, deviation = calibration.camera, calibration.focal_deviation
    repair = max(calibration.std_repair["fx"] / camera.fx, calibration.std_repair["fy"] / camera.fy)
    if repair > 0.5 * deviation and repaired:
        said.append(
            f"drop or retake {_listed(repaired)}: {sum(view.repaired for view in repaired)} corners there lie beside "
            f"something else (a cut square, the edge of the paper, a reflection) and were set right; without that f "
            f"would differ by {repair:.2%}, which its deviation includes"
        )
    if worst:
        median = float(np.median(calibration.per_view_errors))
        said.append(f"drop {_listed(worst)}: {worst[0].rms:.2f} px error against {median:.2f} px of the median view")
    said += calibration.doubts
    if len(used) < _GOOD_VIEWS:
        said.append(f"add views: {len(used)} were used, {_GOOD_VIEWS} to 20 make deviations reliable")
    tilted = sum(view.tilt_rad > _TILT_RAD for view in used)
    if tilted < _TILTED_VIEWS:
        said.append(
            f"add views with the board tilted by 20 to 45 degrees, to each side: {tilted} of {len(used)} are tilted by "
            "more than 15 degrees, and without tilt the focal length cannot be told from the distance"
        )
    places = empty_places(calibration.coverage())
    if places:
        said.append(
            f"add views with the board in the {_joined(places)} of the picture, whose distortion is a guess so far"
        )
    if not said and deviation > _FOCAL_POOR:
        said.append(f"add views, and hold the board flat: f is known to {deviation:.2%} only")
    return tuple(said)


def _joined(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _listed(views: list[View]) -> str:
    names = [view.name for view in views]
    return _joined(names) if len(names) <= 6 else f"{', '.join(names[:6])} and {len(names) - 6} more"


def line(calibration: Figures) -> str:
    """Give what matters in two lines or three."""
    camera, std = calibration.camera, calibration.std
    told = [f"{name}={measured(getattr(camera, name), std.get(name, 0.0))}" for name in ("fx", "fy", "cx", "cy")]
    views = f"{len(calibration.used)} of {len(calibration.views)} views, rms {calibration.rms:.3f} px"
    first = f"Calibration({camera.width} x {camera.height} {camera.model}, {views}:\n            {', '.join(told)} px"
    doubts = f",\n            in doubt: {' '.join(calibration.doubts[0].split())}" if calibration.doubts else ""
    return f"{first}{doubts})"


def summary(calibration: Figures) -> str:
    """Give the result, its views and the advice as text."""
    camera = calibration.camera
    used = calibration.used
    deviation = calibration.focal_deviation
    model = "" if camera.model == "pinhole" else f"{camera.model}, "
    grade = "good" if deviation <= _FOCAL_GOOD else "usable" if deviation <= _FOCAL_POOR else "poor"
    lines = [
        f"camera {camera.width} x {camera.height}, {model}{len(used)} of {len(calibration.views)} views used, "
        f"rms {calibration.rms:.3f} px, corners in {calibration.covered:.0%} of the picture",
        "",
        "parameter        value    deviation",
    ]
    values = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy}
    values |= dict(zip(camera.distortion_names, camera.distortion, strict=True))
    for name, value in values.items():
        unit = " px" if name in ("fx", "fy", "cx", "cy") else ""
        share = f"  ({calibration.std[name] / value:.2%})" if name in ("fx", "fy") else ""
        digits = 2 if unit else 5
        lines.append(f"{name:<9} {value:12.{digits}f} {calibration.std[name]:12.{digits}f}{unit}{share}")
    lines += ["", "view                          corners    rms px   tilt deg   moves f by"]
    rejected = calibration.rejected
    for view in calibration.views:
        if not view.used:
            if len(rejected) <= _LISTED:
                lines.append(f"{view.name:<28} {'-':>8}   {view.reason}")
            continue
        repaired = f"   {view.repaired} corners set right" if view.repaired else ""
        lines.append(
            f"{view.name:<28} {len(view.corners):8d} {view.rms:9.3f} {math.degrees(view.tilt_rad):10.1f} "
            f"{view.influence:11.3%}{repaired}"
        )
    if len(rejected) > _LISTED:
        counts = Counter(rejected.values())
        lines += [f"{count} others: {reason}" for reason, count in counts.most_common(_LISTED)]
    lines += [
        "",
        f"{grade}: f is known to {deviation:.2%} (one standard deviation); a speed over ground computed with it is "
        f"uncertain by the same {deviation:.2%} before height and flow add theirs",
        f"the board's normals lie within {math.degrees(calibration.tilt_span_rad):.1f} degrees of each other; the "
        f"board is bent by {1000 * calibration.board_bend_m:.2f} mm",
    ]
    lines += [f"- {line}" for line in advice(calibration)]
    return "\n".join(lines)


def to_dict(calibration: Figures) -> dict[str, Any]:
    """Give everything but the corners as plain values; what is not known is None."""
    camera = calibration.camera
    return {
        "camera": {
            "model": camera.model,
            "width": camera.width,
            "height": camera.height,
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "distortion": list(camera.distortion),
        },
        "std": calibration.std,
        "std_views": calibration.std_views,
        "std_repair": calibration.std_repair,
        "std_model": calibration.std_model,
        "rms_px": calibration.rms,
        "focal_deviation": calibration.focal_deviation,
        "covariance": calibration.covariance.tolist(),
        "tilt_span_rad": calibration.tilt_span_rad,
        "board_bend_m": calibration.board_bend_m,
        "covered": calibration.covered,
        "board": list(calibration.board.size),
        "square_size_m": calibration.board.square_size_m,
        "pattern": calibration.board.pattern,
        "views": [{name: _number(value) for name, value in view.to_dict().items()} for view in calibration.views],
        "doubts": list(calibration.doubts),
        "advice": list(advice(calibration)),
    }


def _number(value: str | float) -> str | float | None:
    return value if isinstance(value, str) or math.isfinite(value) else None


def draw(calibration: Figures, folder: Path) -> list[Path]:
    """Write a picture of each view, and one of the coverage; none over a picture that was calibrated with."""
    written = []
    used: set[str] = set()
    names = [f"{Path(view.name).stem.replace(' ', '-')}.corners.png" for view in calibration.views]
    Inputs(files=[view.name for view in calibration.views]).refuse(folder / name for name in (*names, "coverage.png"))
    for number, view in enumerate(calibration.views):
        if not view.jpeg:
            continue
        stem = Path(view.name).stem.replace(" ", "-")
        name = stem if stem not in used else f"{stem}-{number}"
        used.add(name)
        written.append(_write(folder / f"{name}.corners.png", _view_picture(view)))
    written.append(_write(folder / "coverage.png", coverage_picture(calibration)))
    return written


def _write(path: Path, image: NDArray[np.uint8]) -> Path:
    import cv2

    done, data = cv2.imencode(".png", image)
    assert done
    with writing(path) as partial:
        partial.write_bytes(data.tobytes())
    return path


def _view_picture(view: View) -> NDArray[np.uint8]:
    import cv2

    image: NDArray[np.uint8] = np.asarray(cv2.imdecode(np.frombuffer(view.jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)
    # Drawing at subpixel positions: OpenCV takes fixed-point coordinates with so many fractional bits.
    bits = 4
    radius = max(3, image.shape[1] // 160)
    for i, (point, residual) in enumerate(zip(view.corners, view.residuals, strict=False)):
        share = i / max(1, len(view.corners) - 1)
        color = (int(255 * (1 - share)), 160, int(255 * share))
        centre = tuple(round(float(value) * 2**bits) for value in point)
        tip = tuple(round(float(value) * 2**bits) for value in point + _ARROWS * residual)
        cv2.circle(image, centre, radius * 2**bits, color, 1, cv2.LINE_AA, bits)
        cv2.line(image, centre, tip, (0, 0, 255), 2, cv2.LINE_AA, bits)
    if view.used:
        text = f"{view.name}: {len(view.corners)} corners, rms {view.rms:.2f} px, errors x {_ARROWS}"
    else:
        text = f"{view.name}: not used: {view.reason}"
    return _labelled(image, text)


def coverage_picture(calibration: Figures) -> NDArray[np.uint8]:
    """Draw where in the picture the corners of all views were, and where none was."""
    import cv2

    camera = calibration.camera
    image = np.full((camera.height, camera.width, 3), 255, np.uint8)
    counts = calibration.coverage()
    rows, columns = counts.shape
    for y, x in zip(*np.nonzero(counts == 0), strict=True):
        top, left = round(y * camera.height / rows), round(x * camera.width / columns)
        bottom, right = round((y + 1) * camera.height / rows), round((x + 1) * camera.width / columns)
        image[top:bottom, left:right] = (200, 200, 255)
    radius = max(2, camera.width // 320)
    for view in calibration.used:
        for x, y in view.corners:
            cv2.circle(image, (round(float(x)), round(float(y))), radius, (160, 90, 0), -1, cv2.LINE_AA)
    return _labelled(image, f"corners of {len(calibration.used)} views; red: none ({calibration.covered:.0%} covered)")


def _labelled(image: NDArray[np.uint8], text: str) -> NDArray[np.uint8]:
    """Put a line of text on a band above the picture, made to fit its width."""
    import cv2

    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.5 * max(1.0, image.shape[1] / 640)
    (width, height), _ = cv2.getTextSize(text, font, scale, 1)
    if width > image.shape[1] - 8:
        scale *= (image.shape[1] - 8) / width
        (_, height), _ = cv2.getTextSize(text, font, scale, 1)
    band = np.full((height + 10, image.shape[1], 3), 255, np.uint8)
    cv2.putText(band, text, (4, height + 4), font, scale, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([band, image])
