"""The model of a camera, and the files that it is kept in."""

from __future__ import annotations

from .formats import CAMERA_SUFFIXES, format_of, load_camera, save_camera
from .model import Camera, CameraFormat, CameraModel

__all__ = ["CAMERA_SUFFIXES", "Camera", "CameraFormat", "CameraModel", "format_of", "load_camera", "save_camera"]
