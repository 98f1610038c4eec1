"""Packets of made videos, encoded here or, where the encoder may crash, in a process of its own."""

from __future__ import annotations

import functools
import pickle
import subprocess
import sys
from fractions import Fraction

import cv2
import numpy as np
import pytest

SIZE = (64, 48)
_NO_ENCODER = 3


def scene(number: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    texture = np.random.default_rng(7).integers(0, 255, (size[1] // 4, size[0] // 4), np.uint8)
    return np.roll(cv2.resize(texture, size), number, 1)


@functools.cache
def encode(codec: str, count: int, size: tuple[int, int] = SIZE, *, b_frames: int = 0) -> tuple[bytes, ...]:
    """Packets of `count` pictures, in the order of decoding."""
    pytest.importorskip("av")
    if codec != "libx265":
        return _encode(codec, count, size, b_frames)
    # This encoder was seen to crash while its threads end; a crash of it says nothing about rsflow.
    command = [sys.executable, __file__, codec, str(count), *map(str, size), str(b_frames)]
    for _ in range(3):
        done = subprocess.run(command, capture_output=True, check=False)
        if done.returncode == 0:
            return pickle.loads(done.stdout)
        if done.returncode == _NO_ENCODER:
            raise ValueError(done.stderr.decode(errors="replace").splitlines()[-1])
        assert done.returncode < 0, done.stderr.decode(errors="replace")
    pytest.skip(f"the encoder {codec} crashes: signal {-done.returncode}")


def _encode(codec: str, count: int, size: tuple[int, int], b_frames: int) -> tuple[bytes, ...]:
    import av

    context = av.CodecContext.create(codec, "w")
    context.width, context.height = size
    context.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    context.time_base, context.framerate = Fraction(1, 30), Fraction(30, 1)
    context.max_b_frames = b_frames
    if codec == "libx265":
        threads = "pools=none:frame-threads=1:wpp=0"
        context.options = {"x265-params": f"bframes={b_frames}:log-level=none:{threads}"}
    packets = []
    for number in range(count):
        frame = av.VideoFrame.from_ndarray(scene(number, size), format="gray").reformat(format=context.pix_fmt)
        frame.pts, frame.time_base = number, Fraction(1, 30)
        packets += [bytes(packet) for packet in context.encode(frame)]
    return (*packets, *(bytes(packet) for packet in context.encode()))


def _main() -> int:
    import av

    codec, count, width, height, b_frames = sys.argv[1:]
    try:
        packets = _encode(codec, int(count), (int(width), int(height)), int(b_frames))
    except (av.FFmpegError, ValueError) as error:
        print(error, file=sys.stderr)
        return _NO_ENCODER
    sys.stdout.buffer.write(pickle.dumps(packets))
    return 0


if __name__ == "__main__":
    sys.exit(_main())
