"""Camera files: rsflow's JSON, OpenCV FileStorage, ROS camera_info, kalibr camchain.

Each reader gives a plain dictionary of the document; one place then makes the camera of it, so that the same checks
and messages hold for every format.
"""

from __future__ import annotations

import json
import os
from typing import Any, get_args

from .. import _checks
from ..errors import FormatError, OptionError
from ..io.atomic import writing
from ..io.limits import read_text
from . import filestorage, yaml_files
from .document import Document
from .intrinsics import CameraFormat, Intrinsics

__all__ = ["CAMERA_SUFFIXES", "format_of", "read", "write"]

# A camera file has a few kilobytes, a FileStorage with every corner of a long calibration a few megabytes.
_MAX_BYTES = 16 * 1024 * 1024

# Nesting beyond this is no camera's.
_DEPTH = 20

# Suffixes of camera files, and the format that each is written in.
CAMERA_SUFFIXES: dict[str, CameraFormat] = {".json": "json", ".yaml": "ros", ".yml": "opencv", ".xml": "opencv"}

# Words of ROS and kalibr for the lens models, and how many coefficients each may have.
_ROS_MODELS: dict[str, tuple[str, tuple[int, ...]]] = {
    "plumb_bob": ("pinhole", (0, 4, 5)),
    "rational_polynomial": ("pinhole", (8, 12)),
    "equidistant": ("fisheye", (4,)),
    "fisheye": ("fisheye", (4,)),
    "none": ("pinhole", (0,)),
    "": ("pinhole", (0,)),
}
_KALIBR_MODELS: dict[str, tuple[str, tuple[int, ...]]] = {
    "radtan": ("pinhole", (4,)),
    "equidistant": ("fisheye", (4,)),
    "none": ("pinhole", (0,)),
}
_JSON_MARK = "rsflow camera"


def read(path: str | os.PathLike[str], *, camera: str | None = None, size: tuple[int, int] | None = None) -> Intrinsics:
    """Read a camera from a file of any known format; see `rsflow.Camera.load`."""
    file = _checks.path("path", path)
    if camera is not None:
        camera = _checks.text("camera", camera)
    if size is not None:
        size = _checks.size("size", size)
    text = read_text(file, most=_MAX_BYTES)
    if not text.strip():
        raise FormatError(f"{file}: the file is empty")
    document = Document(str(file), _parse(str(file), text))
    try:
        return _camera(document, camera, size)
    except OptionError as error:
        raise FormatError(f"{file}: {error}") from None


def _parse(path: str, text: str) -> Any:
    head = text.lstrip()
    if filestorage.recognizes(text):
        return filestorage.parse(path, text)
    if head.startswith("{"):
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise FormatError(f"{path}: not valid JSON: {error}") from None
        if _is_deeper(value, _DEPTH):
            raise FormatError(f"{path}: got JSON nested deeper than {_DEPTH} levels")
        return value
    return yaml_files.parse(path, text)


def _is_deeper(value: Any, depth: int) -> bool:
    items = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return depth < 0 or any(_is_deeper(item, depth - 1) for item in items if isinstance(item, (dict, list)))


def _camera(document: Document, camera: str | None, size: tuple[int, int] | None) -> Intrinsics:
    """Make the camera, by the keys that tell one format from another."""
    if document.value("format") == _JSON_MARK:
        return _from_json(document)
    chain = document.names_of_maps_with("intrinsics")
    if chain:
        if camera is None and len(chain) > 1:
            raise FormatError(f"{document.path}: got the cameras {', '.join(chain)}: say which one with camera=")
        name = chain[0] if camera is None else camera
        if name not in chain:
            raise FormatError(f"{document.path}: got no camera {name!r}, expected one of {', '.join(chain)}")
        return _from_kalibr(document.at(name))
    if document.first("image_width", "width") and document.first("camera_matrix", "K", "k"):
        if document.first("distortion_model", "D", "d") and not document.value("fisheye_model"):
            return _from_ros(document)
        return _from_opencv(document, size)
    if document.first("camera_matrix", "cameraMatrix", "camera_Matrix", "Camera_Matrix", "K", "M1"):
        return _from_opencv(document, size)
    raise FormatError(
        f"{document.path}: got the keys {document.keys_text()}: not a camera file "
        "(rsflow JSON, OpenCV FileStorage, ROS camera_info or kalibr camchain)"
    )


def _from_json(document: Document) -> Intrinsics:
    version = document.integer("version")
    if version != 1:
        raise FormatError(f"{document.path}: version: got {version}, expected 1: written by a newer rsflow")
    std = document.at("std") if document.value("std") is not None else None
    return Intrinsics(
        *(document.number(name) for name in ("fx", "fy", "cx", "cy")),
        width=document.integer("width"),
        height=document.integer("height"),
        distortion=document.numbers("distortion"),
        model=document.word("model", ("pinhole", "fisheye")),
        std={} if std is None else {name: std.number(name) for name in std.names()},
    )


def _from_kalibr(document: Document) -> Intrinsics:
    document.word("camera_model", ("pinhole",))
    lens = document.word("distortion_model", tuple(_KALIBR_MODELS)) if document.first("distortion_model") else "none"
    model, lengths = _KALIBR_MODELS[lens]
    fx, fy, cx, cy = document.numbers("intrinsics", (4,))
    width, height = document.numbers("resolution", (2,))
    coefficients = () if lens == "none" else document.numbers("distortion_coeffs", lengths)
    return Intrinsics(
        fx,
        fy,
        cx,
        cy,
        width=document.whole("resolution", width),
        height=document.whole("resolution", height),
        distortion=coefficients,
        model=model,  # type: ignore[arg-type]
    )


def _from_ros(document: Document) -> Intrinsics:
    name = document.first("distortion_model")
    lens = "plumb_bob" if name is None else document.word(name, tuple(_ROS_MODELS))
    model, lengths = _ROS_MODELS[lens]
    key = document.first("distortion_coefficients", "D", "d")
    coefficients = () if key is None else document.numbers(key)
    if len(coefficients) not in lengths and (any(coefficients) or len(coefficients) not in (0, 4, 5)):
        raise FormatError(
            f"{document.path}: {key}: got {len(coefficients)} coefficients, expected "
            f"{' or '.join(map(str, lengths))} for the distortion model {lens!r}"
        )
    for name in ("binning_x", "binning_y"):
        if document.value(name) is not None and document.integer(name) > 1:
            raise FormatError(
                f"{document.path}: {name}: got {document.integer(name)}, expected no binning: use Camera.scaled"
            )
    std = document.at("standard_deviations") if document.value("standard_deviations") is not None else None
    return Intrinsics.from_matrix(
        document.matrix(document.first("camera_matrix", "K", "k") or "camera_matrix"),
        coefficients if len(coefficients) in lengths else (),
        width=document.integer(document.first("image_width", "width") or "image_width"),
        height=document.integer(document.first("image_height", "height") or "image_height"),
        model=model,  # type: ignore[arg-type]
        std={} if std is None else {name: std.number(name) for name in std.names()},
    )


def _from_opencv(document: Document, size: tuple[int, int] | None) -> Intrinsics:
    key = document.first("camera_matrix", "cameraMatrix", "camera_Matrix", "Camera_Matrix", "K", "M1") or ""
    lens = document.first(
        "distortion_coefficients", "distCoeffs", "dist_coeffs", "Distortion_Coefficients", "dist_coeff", "D", "D1"
    )
    pair = document.first("image_size", "imageSize", "Image_Size", "cameraResolution", "calibImageSize")
    wide = document.first("image_width", "image_Width", "imageWidth", "width")
    high = document.first("image_height", "image_Height", "imageHeight", "height")
    if pair is not None:
        width, height = (document.whole(pair, value) for value in document.numbers(pair, (2,)))
    elif wide is not None and high is not None:
        width, height = document.integer(wide), document.integer(high)
    elif size is not None:
        width, height = size
    else:
        raise FormatError(
            f"{document.path}: image_width, image_height: the file does not say the size of the pictures: "
            "give it, size=(width, height)"
        )
    coefficients = () if lens is None else document.numbers(lens)
    # OpenCV fills up with zeros what was not estimated.
    while len(coefficients) > 5 and len(coefficients) not in (8, 12) and coefficients[-1] == 0:
        coefficients = coefficients[:-1]
    fisheye = bool(document.value("fisheye_model")) or document.value("distortion_model") == "equidistant"
    camera = Intrinsics.from_matrix(
        document.matrix(key),
        coefficients,
        width=width,
        height=height,
        model="fisheye" if fisheye else "pinhole",
    )
    return _with_std(camera, document)


def _with_std(camera: Intrinsics, document: Document) -> Intrinsics:
    """Add the deviations under the names that OpenCV's calibration program writes."""
    if document.value("cameraMatrix_std_dev") is None:
        return camera
    std = dict(zip(("fx", "fy", "cx", "cy"), document.numbers("cameraMatrix_std_dev", (4,)), strict=True))
    if document.value("dist_coeffs_std_dev") is not None:
        std.update(zip(camera.distortion_names, document.numbers("dist_coeffs_std_dev"), strict=False))
    return Intrinsics(
        camera.fx,
        camera.fy,
        camera.cx,
        camera.cy,
        width=camera.width,
        height=camera.height,
        distortion=camera.distortion,
        model=camera.model,
        std=std,
    )


def format_of(path: str | os.PathLike[str], format: CameraFormat | None = None) -> CameraFormat:
    """Give the format in which a camera is written to `path`.

    Parameters
    ----------
    path : path
        The file to be written.
    format : {"json", "opencv", "ros", "kalibr"}, optional
        Overrules what the suffix says.

    Returns
    -------
    str

    Raises
    ------
    OptionError
        If `format` is not known, or is None and the suffix says none.

    Examples
    --------
    >>> from rsflow.camera.formats import format_of
    >>> format_of("camera.yml"), format_of("camera.yaml", "kalibr")
    ('opencv', 'kalibr')
    """
    file = _checks.path("path", path)
    if format is not None:
        return _checks.choice("format", format, get_args(CameraFormat), or_none=True)
    kind = CAMERA_SUFFIXES.get(file.suffix.lower())
    if kind is None:
        raise _checks.refused("path", file, f"a name that ends in {', '.join(CAMERA_SUFFIXES)}, or format=")
    return kind


def write(camera: Intrinsics, path: str | os.PathLike[str], *, format: CameraFormat | None = None) -> None:
    """Write a camera; see `rsflow.Camera.save`."""
    file = _checks.path("path", path)
    kind = format_of(file, format)
    if kind == "json":
        text = _json_text(camera)
    elif kind == "opencv":
        suffix = file.suffix.lower()
        text = filestorage.text(camera, {".xml": "xml", ".json": "json"}.get(suffix, "yaml"))
    elif kind == "ros":
        text = yaml_files.ros_text(camera, file.stem)
    else:
        text = yaml_files.kalibr_text(camera)
    with writing(file) as partial:
        partial.write_text(text, encoding="utf-8")


def _json_text(camera: Intrinsics) -> str:
    fields: dict[str, Any] = {"format": _JSON_MARK, "version": 1, "model": camera.model}
    fields |= {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    fields["distortion"] = list(camera.distortion)
    if camera.std:
        fields["std"] = dict(camera.std)
    return json.dumps(fields, indent=2) + "\n"
