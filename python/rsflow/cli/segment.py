"""``rsflow segment SOURCE -o OUT``: what moves and what stands still."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import (
    add_lines,
    add_mask,
    add_max_displacement,
    add_overwrite,
    add_preset,
    add_range,
    add_rate,
    identity_of,
    mask_of,
    tell_notes,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rsflow.capture import Frame
    from rsflow.segmentation import MotionSegmentation, MotionSegmenter
    from rsflow.segmentation.tracks.statistics import ObjectStatistics
    from rsflow.video import VideoWriter

DESCRIPTION = """\
Tell what moves from what stands still in a SOURCE (a video, a folder or glob of pictures, a camera's index, a URL).

In OUT: moving.mp4 (what moves, with numbers), static.mp4 (the same without it), objects.csv (a row for each thing in
each frame, units in the names of the columns), objects.json (counts, speeds, where things came and went, counts across
lines), paths.svg (their paths), and with --masks a black and white picture of each frame.

examples:
  rsflow segment street.mp4 -o out --camera-motion static     a camera on a pole: sharper outlines
  rsflow segment drone.mp4 -o out                             a camera that moves
  rsflow segment clip.mp4 -o out --stop 100 --masks
  rsflow segment street.mp4 -o out --line 320,470,320,10 --scale 0.02     who crosses it, and speeds in m/s
  rsflow segment clip.mp4 -o out --mask scene.png             black in scene.png: a clock over the picture, say"""


# What a folder may hold; the last one with --masks.
_NAMES = (
    "moving.mp4",
    "static.mp4",
    "objects.csv",
    "objects.json",
    "paths.svg",
    "masks/[0-9][0-9][0-9][0-9][0-9][0-9]*.png",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("source", metavar="SOURCE", help="what to read frames from")
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="the folder to write to")
    parser.add_argument(
        "--camera-motion", choices=("moving", "static"), default="moving", help="whether the camera moves (moving)"
    )
    add_preset(parser, default="fast")
    add_max_displacement(parser, default="half the frame, along each axis")
    parser.add_argument("--min-area", type=int, metavar="PX", help="leave out things of fewer pixels (1/10000)")
    add_mask(parser)
    add_lines(parser)
    parser.add_argument("--masks", action="store_true", help="also write masks/000001.png and so on")
    add_range(parser)
    add_rate(parser)
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print a line of JSON for each frame")


def run(args: argparse.Namespace) -> int:
    """Run the command: 0 done."""
    import numpy as np

    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs
    from rsflow.capture import frames
    from rsflow.capture.masks import expect_size
    from rsflow.capture.too_few import expect_range, too_few
    from rsflow.extraction.things import Seen
    from rsflow.plotting.drawing import save_picture, svg_of
    from rsflow.segmentation.object_table import ObjectTable
    from rsflow.segmentation.tracks.lines import CountingLine
    from rsflow.segmentation.tracks.statistics import ObjectStatistics
    from rsflow.video import VideoWriter

    out = Path(args.output)
    mask = mask_of(args.mask)
    segmenter = _segmenter(args, mask)
    count, seen = 0, Seen(args.scale)
    statistics = ObjectStatistics(lines=[CountingLine(*line) for line in args.line], scale_m_per_px=args.scale)
    with contextlib.ExitStack() as stack:
        source = stack.enter_context(
            frames(args.source, color=True, start=args.start, stop=args.stop, stride=args.stride, frame_rate=args.rate)
        )
        stack.callback(tell_notes, "segment", source)
        expect_range(source)
        files = [out / name for name in _NAMES[:-1]]
        masks = [out / "masks" / "000000.png", *out.glob("masks/*.png")] if args.masks else []
        Inputs(args.source, files=(args.mask,)).refuse([*files, *masks])
        folder = stack.enter_context(
            ResultFolder(
                out, "segment", _NAMES, identity_of(args.source, args, files=("mask",)), overwrite=args.overwrite
            )
        )
        rate = (source.frame_rate or 25.0) / args.stride
        table = stack.enter_context(ObjectTable(out / "objects.csv", scale_m_per_px=args.scale))
        videos = [
            stack.enter_context(VideoWriter(out / f"{name}.mp4", frame_rate=rate)) for name in ("moving", "static")
        ]
        static = _StaticVideo(videos[1], rate)
        try:
            for frame in source:
                if mask is not None and count == 0:
                    expect_size(f"--mask {args.mask}", mask, frame.image.shape[::-1])
                result = segmenter.update(frame.image, t_s=frame.t_s)
                t_s = frame.t_s if math.isfinite(frame.t_s) else None
                videos[0].write(result.moving_view(frame.color), t_s)
                static.write(result, frame, t_s)
                table.write(frame.index, frame.t_s, (*result.objects, *result.hidden))
                statistics.update(frame.index, result.objects, result.hidden, size=frame.image.shape[::-1])
                if args.masks:
                    folder.record()
                    files.append(out / "masks" / f"{frame.index:06d}.png")
                    save_picture(files[-1], result.moving.astype(np.uint8) * 255)
                count += 1
                seen.add(frame, result)
                if args.json:
                    print(json.dumps(_line(frame, result)))
            static.finish()
        except KeyboardInterrupt:
            # What is finished is kept.
            folder.record()
            static.finish()
            for video in videos:
                video.finish()
            raise
        if count < 2:
            raise too_few(source, count)
        folder.record()
        folder.finish(files)
    (out / "objects.json").write_text(json.dumps(statistics.to_dict(), indent=2) + "\n", encoding="utf-8")
    scene = result.static_view(frame.color) if segmenter.static_camera else None
    # No PNG: beside the pictures of a source it would be read as one of them.
    (out / "paths.svg").write_text(svg_of(statistics.picture(scene)), encoding="utf-8")
    if not args.json:
        print(seen.text())
        _tell_lines(statistics)
        print(f"{count} frames: {out / 'moving.mp4'}, {out / 'static.mp4'}, {out / 'objects.csv'}")
    return 0


def _segmenter(args: argparse.Namespace, mask: NDArray[np.bool_] | None) -> MotionSegmenter:
    from rsflow.segmentation import MotionSegmenter

    return MotionSegmenter(
        camera_motion=args.camera_motion,
        preset=args.preset,
        max_displacement=args.max_displacement,
        min_area=args.min_area,
        mask=mask,
    )


def _tell_lines(statistics: ObjectStatistics) -> None:
    for line in statistics.lines:
        print(line.text())


class _StaticVideo:
    """What stands still: each picture waits for what is seen behind its things later."""

    def __init__(self, video: VideoWriter, rate: float) -> None:
        from rsflow.segmentation.scene import StaticScene, frames_ahead

        self._video, self._scene = video, StaticScene(look_ahead=frames_ahead(rate))
        self._times: deque[float | None] = deque()

    def write(self, result: MotionSegmentation, frame: Frame, t_s: float | None) -> None:
        """Take a frame; write the pictures that are complete."""
        self._times.append(t_s)
        self._put(self._scene.add(result, frame.color))

    def finish(self) -> None:
        """Write the pictures that wait."""
        self._put(self._scene.finish())

    def _put(self, pictures: list[NDArray[np.uint8]]) -> None:
        for picture in pictures:
            self._video.write(picture, self._times.popleft())


def _line(frame: Frame, result: MotionSegmentation) -> dict[str, Any]:
    """Give what is told of a frame with ``--json``."""
    from rsflow.capture.masks import share

    return {
        "frame": frame.index,
        "t_s": frame.t_s if math.isfinite(frame.t_s) else None,
        "status": result.status,
        "camera_model": result.camera_model,
        "moving_share": share(result.moving, result.mask),
        "objects": [thing.id for thing in result.objects],
    }
