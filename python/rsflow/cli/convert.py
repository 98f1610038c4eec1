"""``rsflow convert FROM TO``: flow files and camera files from one format to another."""

from __future__ import annotations

import argparse
from pathlib import Path

DESCRIPTION = """\
Convert a flow file or a camera file; the suffixes say which formats.

  flow:    .flo (Middlebury), .png (KITTI, 16 bits), .npy, .npz (with times), .pfm; to a picture: .jpg, .svg
  camera:  .json (rsflow), .yaml (ROS camera_info), .yml and .xml (OpenCV); kalibr with --camera-format

examples:
  rsflow convert flow10.flo flow10.npz
  rsflow convert kitti.png flow.flo
  rsflow convert flow10.flo colors.jpg              Middlebury's colours, with their wheel
  rsflow convert camchain.yaml camera.yml --camera cam0"""

_CAMERA_SUFFIXES = (".json", ".yaml", ".yml", ".xml")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.add_argument("source", metavar="FROM", help="the file to read")
    parser.add_argument("target", metavar="TO", help="the file to write")
    parser.add_argument("--camera", metavar="NAME", help="which camera of a kalibr chain, cam0 for instance")
    parser.add_argument(
        "--camera-format", choices=("json", "opencv", "ros", "kalibr"), help="of a camera file, whatever its suffix"
    )
    parser.add_argument("--max-flow", type=float, metavar="PX", help="motion of full colour in a .jpg (the largest)")


def run(args: argparse.Namespace) -> int:
    """Run the command: 0 done."""
    from rsflow._results.inputs import Inputs
    from rsflow.errors import FormatError, OptionError
    from rsflow.io.flow_files import FLOW_SUFFIXES, read_flow, read_flow_times, write_flow

    source, target = Path(args.source), Path(args.target)
    Inputs(files=[source]).refuse([target])
    if source.suffix.lower() not in (*_CAMERA_SUFFIXES, *FLOW_SUFFIXES):
        kind = "a folder" if source.is_dir() else f"a name that ends in {source.suffix!r}"
        cameras, flows = (", ".join(suffixes) for suffixes in (_CAMERA_SUFFIXES, FLOW_SUFFIXES))
        raise FormatError(f"{source}: got {kind}, expected a flow file ({flows}) or a camera file ({cameras})")
    if source.suffix.lower() in _CAMERA_SUFFIXES:
        from rsflow.camera import Camera

        if target.suffix.lower() not in _CAMERA_SUFFIXES and args.camera_format is None:
            known = ", ".join(_CAMERA_SUFFIXES)
            raise OptionError(f"{target}: got another format, expected {known}, since {source} is a camera file")
        Camera.load(source, camera=args.camera).save(target, format=args.camera_format)
        return 0
    uv = read_flow(source)
    suffix = target.suffix.lower()
    if suffix in (".jpg", ".jpeg"):
        from rsflow.plotting import flow_to_color

        flow_to_color(uv, max_flow=args.max_flow, legend=True, path=target)
    elif suffix == ".svg":
        from rsflow.plotting import quiver

        quiver(uv, path=target)
    elif suffix in FLOW_SUFFIXES:
        t0_s, t1_s = read_flow_times(source) or (None, None)
        write_flow(target, uv, t0_s=t0_s, t1_s=t1_s)
    else:
        known = ", ".join(FLOW_SUFFIXES)
        raise OptionError(
            f"{target}: got another format, expected {known}, .jpg or .svg, since {source} is a flow file"
        )
    return 0
