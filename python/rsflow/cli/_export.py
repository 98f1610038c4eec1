"""Velocities sent on from a command: to an autopilot over MAVLink, into a ROS 2 bag."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rsflow.errors import OptionError

if TYPE_CHECKING:
    from argparse import _ActionsContainer as Arguments

    from rsflow.velocity import Velocity

__all__ = ["Exports", "add_exports", "exports"]


def add_exports(parser: Arguments) -> None:
    """Add --mavlink, --ros2-bag and --forward."""
    parser.add_argument(
        "--mavlink",
        metavar="TARGET",
        help="send the flow to an autopilot: px4: or ardupilot: and FILE.tlog, udpout:HOST:PORT or DEVICE,BAUD",
    )
    parser.add_argument("--ros2-bag", metavar="FOLDER", help="write a ROS 2 bag: twists with covariance, optical flow")
    parser.add_argument(
        "--forward",
        choices=("top", "right", "bottom", "left"),
        help="side of the picture that points forward on the vehicle, for --mavlink and --ros2-bag (default: top)",
    )


class Exports:
    """Where velocities are sent to; nowhere, where no option asks for it."""

    def __init__(self, writers: dict[str, Any]) -> None:
        self._writers = writers
        self._sent = self._blind = 0

    def write(self, velocity: Velocity, **told: Any) -> None:
        """Send the velocity of a frame, with what the estimator was told for it, as of `flow_reading`."""
        readings = [writer.write(velocity, **told) for writer in self._writers.values()]
        self._sent += any(reading is not None for reading in readings)
        self._blind += any(reading is not None and reading.quality == 0 for reading in readings)

    def close(self) -> None:
        """End it early: what was sent is kept, where that is anything."""
        for writer in self._writers.values():
            if writer.count:
                writer.close()

    def told(self) -> dict[str, Any]:
        """Say what was sent, for a summary; empty where nothing was asked for."""
        if not self._writers:
            return {}
        sent = {name: str(getattr(writer, "target", "") or writer.folder) for name, writer in self._writers.items()}
        return sent | {
            "exported": self._sent,
            "exported_blind": self._blind,
        }


@contextlib.contextmanager
def exports(args: argparse.Namespace, *, inputs: tuple[Any, ...] = (), overwrite: bool = False) -> Iterator[Exports]:
    """Open what the options ask for before the work; what fails in it leaves neither a log nor a bag.

    `inputs` are the files that the command reads, which are not written over.
    """
    mount = getattr(args, "mount", None)
    if args.forward is not None and args.mavlink is None and args.ros2_bag is None:
        raise OptionError("--forward: got it alone, expected --mavlink or --ros2-bag with it")
    if args.camera is None and (args.mavlink is not None or args.ros2_bag is not None):
        raise OptionError("--mavlink, --ros2-bag: got one without --camera, expected a camera and a height with it")
    if args.forward is not None and mount is not None:
        raise OptionError(
            "--forward: got it beside --mount, which already says what points forward, expected one of them"
        )
    options: dict[str, Any] = {
        "forward": "x" if mount is not None else args.forward or "top",
        # A height that was typed is no measurement of a range.
        "distance": args.height is None,
    }
    with contextlib.ExitStack() as stack:
        writers: dict[str, Any] = {}
        if args.mavlink is not None:
            from rsflow.interop.mavlink import MavlinkWriter

            _expect_new(args.mavlink, inputs, overwrite=overwrite)
            writers["mavlink"] = stack.enter_context(MavlinkWriter(args.mavlink, **options))
        if args.ros2_bag is not None:
            from rsflow.interop.ros import RosBagWriter

            bag = RosBagWriter(args.ros2_bag, overwrite=overwrite, **options)
            writers["ros2_bag"] = stack.enter_context(bag)
        yield Exports(writers)


def _expect_new(target: str, inputs: tuple[Any, ...], *, overwrite: bool) -> None:
    """Raise OptionError where a log would be written over something."""
    from rsflow._results.inputs import Inputs

    path = target.partition(":")[2]
    if not path.endswith(".tlog"):
        return
    Inputs(inputs[0] if inputs else None, files=inputs).refuse([path])
    if Path(path).exists() and not overwrite:
        raise OptionError(f"--mavlink: got {target}, expected a new file, or --overwrite, which replaces it")
