"""``rsflow track``: points through a sequence, as trails over the picture and as a table."""

from __future__ import annotations

import argparse
import collections
import json
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.cli._options import (
    add_illumination,
    add_mask,
    add_max_displacement,
    add_overwrite,
    add_range,
    add_rate,
    identity_of,
    mask_of,
    source_of,
    tell_notes,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rsflow.tracking import Tracks

DESCRIPTION = """\
Track points through a sequence: corners are found, followed with persistent ids, and replaced when they are lost.

Writes into the folder OUT:

  tracks.mp4   the picture with the trail of each point, coloured by its direction; a dot marks where it is, a circle
               a new one
  tracks.csv   a row for each point and frame: frame,t_s,id,age,x_px,y_px,dx_px,dy_px,vx_px_s,vy_px_s,
               std_x_px,std_y_px,residual,status (tracks.parquet with --parquet; needs rsflow-motion[parquet])

A point that is lost has a last row whose status says why, and nan for what was not measured.

examples:
  rsflow track clip.mp4 -o out
  rsflow track 'pictures/*.png' --rate 30 --points 1000 --window 15
  rsflow track 0 --stop 300 --no-video --parquet
  rsflow track clip.mp4 --mask scene.png -o out      black in scene.png: letters over the picture, the own vehicle
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rsflow track``."""
    parser.add_argument("source", metavar="SOURCE", help="video, folder or glob of pictures, camera number, URL")
    parser.add_argument("-o", "--output", default=".", metavar="OUT", help="folder for the files (default: this one)")
    parser.add_argument("--points", type=int, default=400, metavar="N", help="points to keep (default: 400)")
    parser.add_argument("--quality", type=float, default=0.01, help="least response of a corner, of the best one's")
    parser.add_argument("--distance", type=float, default=8.0, metavar="PX", help="least distance between new points")
    parser.add_argument("--window", type=int, default=21, metavar="PX", help="side of the window (default: 21)")
    add_illumination(parser)
    add_max_displacement(parser)
    parser.add_argument(
        "--deformation",
        choices=("auto", "none", "affine"),
        default="auto",
        help="whether windows may turn, grow and shear: where points ask for it, nowhere, everywhere (default: auto)",
    )
    add_mask(parser)
    parser.add_argument("--trail", type=int, default=30, metavar="N", help="frames that a trail lasts (default: 30)")
    add_rate(parser)
    add_range(parser)
    parser.add_argument("--no-video", action="store_true", help="write the table alone")
    parser.add_argument("--parquet", action="store_true", help="write tracks.parquet in place of tracks.csv")
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print a summary as JSON")


def run(args: argparse.Namespace) -> int:
    """Track, write the video and the table, print a summary."""
    import rsflow
    from rsflow._results.folder import ResultFolder
    from rsflow._results.inputs import Inputs
    from rsflow.capture.masks import expect_size
    from rsflow.capture.too_few import expect_range, too_few
    from rsflow.errors import OptionError

    if args.trail < 1:
        raise OptionError(f"--trail: got {args.trail}, expected 1 or more frames")
    folder, given = Path(args.output), source_of(args.source)
    table = folder / ("tracks.parquet" if args.parquet else "tracks.csv")
    video = folder / "tracks.mp4"
    files = [table] if args.no_video else [video, table]
    mask = mask_of(args.mask)
    tracker = rsflow.PointTracker(
        max_corners=args.points,
        quality=args.quality,
        min_distance=args.distance,
        window_size=args.window,
        illumination=args.illumination,
        max_displacement=args.max_displacement,
        deformation=args.deformation,
        mask=mask,
        record=True,
    )
    options = {"start": args.start, "stop": args.stop, "stride": args.stride, "frame_rate": args.rate}
    trails = _Trails(args.trail)
    count, cuts, interrupted = 0, 0, False
    with ExitStack() as stack:
        source = stack.enter_context(rsflow.frames(given, **options))
        stack.callback(tell_notes, "track", source)
        expect_range(source)
        Inputs(given, files=(args.mask,)).refuse(files)
        names = ("tracks.mp4", "tracks.csv", "tracks.parquet")
        # What is wrong with the folder is found out before the work, not after it.
        result = stack.enter_context(
            ResultFolder(folder, "track", names, identity_of(given, args, files=("mask",)), overwrite=args.overwrite)
        )
        writer = None
        try:
            for frame in source:
                if mask is not None and count == 0:
                    expect_size(f"--mask {args.mask}", mask, frame.image.shape[::-1])
                tracks = tracker.update(frame.image, t_s=frame.t_s)
                cuts += tracker.scene_cut
                count += 1
                if not args.no_video:
                    if writer is None:
                        rate = (source.frame_rate or 30.0) / args.stride
                        writer = stack.enter_context(rsflow.VideoWriter(video, frame_rate=rate))
                    writer.write(trails.draw(frame.image, tracks, tracker.scene_cut))
        except KeyboardInterrupt:
            interrupted = True
        if count < 2 and not interrupted:
            raise too_few(source, count)
        result.record()
        rows = tracker.to_table()
        rows.save(table)
        result.finish(files)
    summary = _summary(rows.columns, count, cuts)
    if args.json:
        print(json.dumps(summary))
    else:
        print(
            f"{count} frames, {summary['points']} points, {summary['tracked']} steps tracked of {summary['steps']}, "
            f"median speed {summary['median_step_px']:.2f} px a frame, {cuts} scene cuts"
        )
        for written in [table] if args.no_video or count == 0 else [video, table]:
            print(written)
    if interrupted:
        print("rsflow track: interrupted; what was tracked until then is written", file=sys.stderr)
        return 130
    return 0


def _summary(columns: dict[str, NDArray[Any]], frames: int, cuts: int) -> dict[str, Any]:
    """Count what the table holds."""
    import numpy as np

    tracked = columns["status"] == "tracked"
    steps = int((columns["status"] != "new").sum()) if frames else 0
    step = np.hypot(columns["dx_px"], columns["dy_px"])[tracked] if tracked.any() else np.array([np.nan])
    return {
        "frames": frames,
        "points": int(np.unique(columns["id"]).size),
        "steps": steps,
        "tracked": int(tracked.sum()),
        "median_step_px": float(np.median(step)),
        "scene_cuts": cuts,
    }


class _Trails:
    """The last positions of each point, drawn over the picture."""

    def __init__(self, length: int) -> None:
        self._length = length
        self._trails: dict[int, collections.deque[tuple[float, float]]] = {}

    def draw(self, image: NDArray[Any], tracks: Tracks, cut: bool) -> NDArray[np.uint8]:
        """Take in one frame's tracks, and give the picture with all trails."""
        import cv2
        import numpy as np

        from rsflow.tracking import PointStatus

        if cut:
            self._trails.clear()
        alive: dict[int, collections.deque[tuple[float, float]]] = {}
        new = tracks.status == PointStatus.NEW
        standing = tracks.valid | new
        for ident, point in zip(tracks.ids[standing].tolist(), tracks.points[standing].tolist(), strict=True):
            trail = self._trails.get(ident) or collections.deque(maxlen=self._length + 1)
            trail.append((point[0], point[1]))
            alive[ident] = trail
        self._trails = alive
        picture = cv2.cvtColor(_to_u8(image), cv2.COLOR_GRAY2BGR)
        # Half the brightness, so that trails stand out on any ground; 4 bits of fraction in OpenCV's coordinates.
        picture = cv2.convertScaleAbs(picture, alpha=0.6)
        for trail in alive.values():
            if len(trail) < 2:
                continue
            end = (round(trail[-1][0] * 16), round(trail[-1][1] * 16))
            cv2.circle(picture, end, 16, _colour(trail), -1, cv2.LINE_AA, shift=4)
            line = np.round(np.array(trail) * 16).astype(np.int32)
            cv2.polylines(picture, [line[:, None]], False, _colour(trail), 1, cv2.LINE_AA, shift=4)
        for x, y in tracks.points[new].tolist():
            cv2.circle(picture, (round(x * 16), round(y * 16)), 3 * 16, (200, 200, 200), 1, cv2.LINE_AA, shift=4)
        return np.asarray(picture, dtype=np.uint8)


def _colour(trail: collections.deque[tuple[float, float]]) -> tuple[float, float, float]:
    """Colour a trail by its direction; one that stands still is white."""
    import colorsys
    import math

    dx, dy = trail[-1][0] - trail[0][0], trail[-1][1] - trail[0][1]
    # Half a pixel over the whole trail is within what a window can tell.
    saturation = min(1.0, math.hypot(dx, dy) / 2.0)
    red, green, blue = colorsys.hsv_to_rgb(math.atan2(dy, dx) / math.tau % 1.0, saturation, 1.0)
    return 255 * blue, 255 * green, 255 * red


def _to_u8(image: NDArray[Any]) -> NDArray[np.uint8]:
    """Give a picture to look at: 16-bit and float grey levels are spread over 0 to 255."""
    import numpy as np

    if image.dtype == np.uint8:
        return image
    finite = image[np.isfinite(image)] if image.dtype.kind == "f" else image
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
    scaled = (np.nan_to_num(image.astype(np.float64), nan=low) - low) * (255.0 / max(high - low, 1e-12))
    return np.clip(np.round(scaled), 0, 255).astype(np.uint8)
