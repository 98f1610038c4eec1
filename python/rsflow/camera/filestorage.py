"""OpenCV FileStorage: reading through OpenCV, in YAML, XML or JSON, and writing."""

from __future__ import annotations

import json
import re
from typing import Any

from ..errors import FormatError
from ..io.opencv_files import quiet
from .intrinsics import Intrinsics

_DEPTH = 8
_ENTRIES = 10_000


def recognizes(text: str) -> bool:
    """Say whether a text is a FileStorage document."""
    head = text.lstrip()[:200]
    return (
        head.startswith(("%YAML:1.0", "<?xml", "<opencv_storage"))
        or "!!opencv-matrix" in text
        or (head.startswith("{") and '"opencv-matrix"' in text)
    )


def parse(path: str, text: str) -> dict[str, Any]:
    """Parse a document into plain dictionaries, lists, numbers, strings and arrays."""
    import cv2

    # OpenCV allocates what rows and cols say before it looks at the data: no matrix has more elements than characters.
    # Runs are bounded: without that, a megabyte of blanks takes the square of that many steps.
    sizes = re.findall(r"[\"<\s](?:rows|cols)[\">]{0,2}\s{0,64}[:>]?\s{0,64}(-?\d{1,20})", text)
    for rows, cols in zip(sizes[0::2], sizes[1::2], strict=False):
        if not 0 <= int(rows) * int(cols) <= len(text) or int(rows) < 0:
            raise FormatError(f"{path}: got a matrix of {rows} x {cols} in a file of {len(text)} characters")
    if any(int(size) > len(text) for size in sizes):
        raise FormatError(f"{path}: got rows or cols beyond the file's {len(text)} characters")
    with quiet():
        storage = None
        try:
            storage = cv2.FileStorage(text, cv2.FileStorage_READ | cv2.FileStorage_MEMORY)
            root = storage.root()
            content = _plain(root, 0) if not root.empty() else None
        except (cv2.error, SystemError, UnicodeDecodeError) as error:
            # What OpenCV's binding says of itself is no help; the parser's own words are the cause, if there are any.
            told = error.__cause__ if isinstance(error, SystemError) else error
            lines = str(getattr(told, "err", "") or told or "OpenCV cannot parse it").strip().splitlines()
            raise FormatError(f"{path}: not a valid OpenCV FileStorage: {lines[-1] if lines else 'damaged'}") from None
        finally:
            if storage is not None:
                storage.release()
    if not isinstance(content, dict):
        raise FormatError(f"{path}: not a valid OpenCV FileStorage: it holds no keys")
    return content


def _plain(node: Any, depth: int) -> Any:
    if depth > _DEPTH or node.size() > _ENTRIES:
        return None
    if node.isMap():
        names = node.keys()
        if {"rows", "cols", "dt"} <= set(names):
            return node.mat()
        return {name: _plain(node.getNode(name), depth + 1) for name in names}
    if node.isSeq():
        return [_plain(node.at(i), depth + 1) for i in range(node.size())]
    if node.isInt() or node.isReal():
        return node.real()
    return node.string() if node.isString() else None


def text(camera: Intrinsics, kind: str) -> str:
    """Write a camera as a FileStorage document of kind yaml, xml or json."""
    matrices: dict[str, tuple[int, int, list[float]]] = {
        "camera_matrix": (3, 3, camera.matrix.ravel().tolist()),
        "distortion_coefficients": (max(1, len(camera.distortion)), 1, list(camera.distortion) or [0.0]),
    }
    if len(camera.distortion) == 0:
        matrices["distortion_coefficients"] = (5, 1, [0.0] * 5) if camera.model == "pinhole" else (4, 1, [0.0] * 4)
    if all(name in camera.std for name in ("fx", "fy", "cx", "cy")):
        matrices["cameraMatrix_std_dev"] = (4, 1, [camera.std[name] for name in ("fx", "fy", "cx", "cy")])
        lens = [camera.std.get(name, 0.0) for name in camera.distortion_names]
        if lens:
            matrices["dist_coeffs_std_dev"] = (len(lens), 1, lens)
    scalars = {"image_width": camera.width, "image_height": camera.height}
    if camera.model == "fisheye":
        scalars["fisheye_model"] = 1
    if kind == "json":
        fields: dict[str, Any] = dict(scalars)
        for name, (rows, cols, data) in matrices.items():
            fields[name] = {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data}
        return json.dumps(fields, indent=4) + "\n"
    lines = []
    if kind == "xml":
        lines += ['<?xml version="1.0"?>', "<opencv_storage>"]
        lines += [f"<{name}>{value}</{name}>" for name, value in scalars.items()]
        for name, (rows, cols, data) in matrices.items():
            lines += [f'<{name} type_id="opencv-matrix">', f"  <rows>{rows}</rows>", f"  <cols>{cols}</cols>"]
            lines += ["  <dt>d</dt>", f"  <data>{' '.join(map(repr, data))}</data></{name}>"]
        lines.append("</opencv_storage>")
    else:
        lines += ["%YAML:1.0", "---"]
        lines += [f"{name}: {value}" for name, value in scalars.items()]
        for name, (rows, cols, data) in matrices.items():
            lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}", "   dt: d"]
            lines.append(f"   data: [ {', '.join(map(repr, data))} ]")
    return "\n".join(lines) + "\n"
