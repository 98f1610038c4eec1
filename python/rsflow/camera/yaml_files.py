"""YAML of ROS and kalibr: safe reading through PyYAML, and writing without it."""

from __future__ import annotations

import re
from typing import Any

from .._extras import require
from ..errors import FormatError, OptionError
from .intrinsics import Intrinsics

# Nesting beyond this is not a camera's: it is refused before the parser recurses.
_DEPTH = 20

# A camera of ROS or kalibr has two kilobytes; PyYAML takes a second for each hundred of them.
_LENGTH = 128 * 1024

_EXPONENT = re.compile(r"[-+]?\d+[eE][-+]?\d+")


def parse(path: str, text: str) -> Any:
    """Parse the first document of a YAML text into plain values.

    Tags that make objects are refused by the safe loader; aliases too, since a few lines of them can stand for
    gigabytes.
    """
    yaml = require("yaml", extra="yaml", purpose=f"reading {path}")
    if len(text) > _LENGTH:
        raise FormatError(f"{path}: got {len(text)} characters of YAML, expected a camera file of at most {_LENGTH}")
    # The loader in C, where PyYAML was built with it, is ten times as fast.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    try:
        for event in yaml.parse(text, Loader=loader):
            if isinstance(event, yaml.AliasEvent):
                line = event.start_mark.line + 1
                raise FormatError(f"{path}: line {line}: got a YAML alias, expected a file without aliases")
            if isinstance(event, yaml.CollectionStartEvent):
                depth += 1
                if depth > _DEPTH:
                    raise FormatError(f"{path}: got YAML nested deeper than {_DEPTH} levels")
            elif isinstance(event, yaml.CollectionEndEvent):
                depth -= 1
            elif isinstance(event, yaml.DocumentEndEvent):
                break
        return _with_numbers(next(iter(yaml.load_all(text, Loader=loader)), None))
    except yaml.YAMLError as error:
        if "nesting depth" in str(error):  # the bound of the loader in C
            raise FormatError(f"{path}: got YAML nested deeper than {_DEPTH} levels") from None
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}: " if mark is not None else ""
        raise FormatError(f"{path}: {where}not valid YAML: {getattr(error, 'problem', None) or error}") from None
    except (ValueError, RecursionError, TypeError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path}: not valid YAML: {error}") from None


def _with_numbers(value: Any) -> Any:
    """Turn 1e-05 into a number: YAML 1.1 takes it for a word, since it has no point, and C++ programs write it."""
    if isinstance(value, dict):
        return {key: _with_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_numbers(item) for item in value]
    return float(value) if isinstance(value, str) and _EXPONENT.fullmatch(value) else value


def _numbers(values: Any) -> str:
    return f"[{', '.join(map(_number, values))}]"


def _number(value: float) -> str:
    # With a point before the exponent, which YAML 1.1 needs to see a number.
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def ros_text(camera: Intrinsics, name: str) -> str:
    """Write ROS camera_info, as camera_calibration does."""
    if camera.model == "fisheye":
        lens, coefficients = "equidistant", camera.distortion or (0.0,) * 4
    elif len(camera.distortion) <= 5:
        lens, coefficients = "plumb_bob", (*camera.distortion, *[0.0] * (5 - len(camera.distortion)))
    elif len(camera.distortion) == 8:
        lens, coefficients = "rational_polynomial", camera.distortion
    else:
        count = len(camera.distortion)
        raise OptionError(
            f'format: got "ros", expected "json" or "opencv": ROS camera_info cannot hold {count} distortion '
            "coefficients"
        )
    K = camera.matrix
    projection = [*K[0], 0.0, *K[1], 0.0, *K[2], 0.0]
    # A name that YAML would take for something else (a number, a colon in it) must be quoted.
    quoted = '"' + "".join(c if c.isprintable() and c not in '"\\' else "_" for c in name) + '"'
    parts = [
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"camera_name: {quoted}",
        _matrix("camera_matrix", 3, 3, K.ravel()),
        f"distortion_model: {lens}",
        _matrix("distortion_coefficients", 1, len(coefficients), coefficients),
        _matrix("rectification_matrix", 3, 3, [1, 0, 0, 0, 1, 0, 0, 0, 1]),
        _matrix("projection_matrix", 3, 4, projection),
    ]
    if camera.std:
        # A key of our own, which readers of ROS pass over.
        deviations = ", ".join(f"{key}: {_number(value)}" for key, value in camera.std.items())
        parts.append(f"standard_deviations: {{{deviations}}}")
    return "\n".join(parts) + "\n"


def _matrix(name: str, rows: int, cols: int, data: Any) -> str:
    return f"{name}:\n  rows: {rows}\n  cols: {cols}\n  data: {_numbers(data)}"


def kalibr_text(camera: Intrinsics) -> str:
    """Write a kalibr camchain with this one camera, cam0."""
    coefficients = camera.distortion or (0.0,) * 4
    if camera.model == "fisheye":
        lens = "equidistant"
    elif any(coefficients[4:]):
        names = camera.distortion_names[4:]
        raise OptionError(
            f'format: got "kalibr", expected another: kalibr\'s radtan cannot hold {names}, which are not zero'
        )
    else:
        lens = "radtan"
    lines = [
        "cam0:",
        "  camera_model: pinhole",
        f"  intrinsics: {_numbers((camera.fx, camera.fy, camera.cx, camera.cy))}",
        f"  distortion_model: {lens}",
        f"  distortion_coeffs: {_numbers(coefficients[:4])}",
        f"  resolution: [{camera.width}, {camera.height}]",
    ]
    return "\n".join(lines) + "\n"
