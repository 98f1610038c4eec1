"""Camera files by themselves: read, written, converted."""

from __future__ import annotations

import os

from .. import _checks
from .._results.inputs import Inputs
from .files import CAMERA_SUFFIXES, format_of
from .intrinsics import CameraFormat
from .model import Camera

__all__ = ["CAMERA_SUFFIXES", "format_of", "load_camera", "save_camera"]


def load_camera(
    path: str | os.PathLike[str], *, camera: str | None = None, size: tuple[int, int] | None = None
) -> Camera:
    """Read a camera from a file of any known format; see `Camera.load`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from rsflow import Camera
    >>> from rsflow.camera.formats import load_camera, save_camera
    >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_camera(camera, pathlib.Path(folder, "camera.json"))
    ...     load_camera(pathlib.Path(folder, "camera.json")) == camera
    True
    """
    return Camera.load(path, camera=camera, size=size)


def convert_camera(
    source: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    format: CameraFormat | None = None,
    camera: str | None = None,
    size: tuple[int, int] | None = None,
) -> Camera:
    """Read a camera file and write it in another format; give the camera.

    Parameters and errors are those of `Camera.load` and `Camera.save`.
    """
    format_of(target, format)
    Inputs(files=[source]).refuse([target])
    loaded = load_camera(source, camera=camera, size=size)
    save_camera(loaded, target, format=format)
    return loaded


def save_camera(camera: Camera, path: str | os.PathLike[str], *, format: CameraFormat | None = None) -> None:
    """Write a camera; see `Camera.save`.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from rsflow import Camera
    >>> from rsflow.camera.formats import load_camera, save_camera
    >>> camera = Camera(300.0, 300.0, 159.5, 119.5, width=320, height=240)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_camera(camera, pathlib.Path(folder, "camera.json"))
    ...     load_camera(pathlib.Path(folder, "camera.json")) == camera
    True
    """
    _checks.instance("camera", camera, Camera, "an rsflow.Camera").save(path, format=format)
