"""Cameras: the model, its calibration, its files, and frames from a camera, a video or pictures."""
