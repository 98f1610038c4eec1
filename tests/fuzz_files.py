"""Damaged files of every format that rsflow reads, one after the other in a process whose memory is bounded.

Run as a program by `test_fuzz_files.py`: ``python fuzz_files.py FOLDER SEED FIRST COUNT``. Each case follows from the
seed and its number alone. A line is printed before each case and after it, so that a crash tells which one it was.
"""

from __future__ import annotations

import json
import os
import resource
import struct
import sys
import time
import warnings
import zlib
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import rsflow
from rsflow.io import read_flow_times
from rsflow.velocity import Attitudes, Heights, Rates

SIZE = (40, 30)
GROWTH_BYTES = 2**30
CPU_S = 2.0

# What a call may raise besides RsflowError: the path is a file that was there, so none of these should come at all.
DOCUMENTED = (FileNotFoundError, PermissionError)


def texture(channels: int = 1, depth: type = np.uint8, number: int = 0) -> np.ndarray:
    top = np.iinfo(depth).max if np.issubdtype(depth, np.integer) else 1.0
    values = np.random.default_rng(3).random((SIZE[1], SIZE[0], channels)) * top
    picture = np.roll(cv2.GaussianBlur(values, (0, 0), 2.0), number, 1).astype(depth)
    return picture.reshape(SIZE[1], SIZE[0]) if channels == 1 else picture.reshape(SIZE[1], SIZE[0], channels)


def flow_files(folder: Path) -> None:
    uv = np.random.default_rng(4).normal(0, 3, (SIZE[1], SIZE[0], 2)).astype(np.float32)
    uv[2, 3] = np.nan
    for suffix in (".flo", ".png", ".npy", ".npz", ".pfm"):
        rsflow.write_flow(folder / f"flow{suffix}", uv)
    rsflow.write_flow(folder / "timed.npz", uv, t0_s=0.5, t1_s=0.54)
    np.savez(folder / "plain.npz", flow=uv)
    np.save(folder / "order.npy", np.asfortranarray(uv.astype(np.float64)))


def picture_files(folder: Path) -> None:
    makers: dict[str, tuple[np.ndarray, list[int]]] = {
        "grey.png": (texture(), []),
        "deep.png": (texture(3, np.uint16), []),
        "alpha.png": (texture(4), []),
        "bits.png": ((texture() > 100).astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1]),
        "base.jpg": (texture(3), []),
        "progressive.jpg": (texture(3), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1]),
        "restart.jpg": (texture(), [cv2.IMWRITE_JPEG_RST_INTERVAL, 2]),
        "a.bmp": (texture(3), []),
        "a.webp": (texture(3), []),
        "lossless.webp": (texture(4), [cv2.IMWRITE_WEBP_QUALITY, 101]),
        "a.pgm": (texture(), []),
        "text.ppm": (texture(3), [cv2.IMWRITE_PXM_BINARY, 0]),
        "a.pam": (texture(3), []),
        "a.hdr": (texture(3, np.float32), []),
        "a.pfm": (texture(1, np.float32), []),
        "a.jp2": (texture(3), []),
        "a.sr": (texture(3), []),
        "still.gif": (texture(3), []),
        "a.avif": (texture(3), []),
        **{f"packed{k}.tif": (texture(3), [cv2.IMWRITE_TIFF_COMPRESSION, k]) for k in (1, 5, 8, 32773)},
        "deep.tif": (texture(1, np.uint16), []),
        "float.tif": (texture(1, np.float32), []),
    }
    for name, (picture, flags) in makers.items():
        try:
            done, data = cv2.imencode(Path(name).suffix, picture, flags)
        except cv2.error:
            continue
        if done:
            (folder / f"picture_{name}").write_bytes(data.tobytes())
    cv2.imwritemulti(str(folder / "picture_pages.tif"), [texture(number=k) for k in range(4)])
    if hasattr(cv2, "imwriteanimation"):
        animation = cv2.Animation()
        animation.frames, animation.durations = [texture(3, number=k) for k in range(4)], [40, 50, 60, 70]
        for name in ("picture_moving.webp", "picture_moving.png", "video_moving.gif"):
            cv2.imwriteanimation(str(folder / name), animation)


def video_files(folder: Path) -> None:
    for name, code in (("a.avi", "MJPG"), ("b.avi", "mp4v"), ("c.mp4", "mp4v"), ("d.mkv", "mp4v"), ("e.mkv", "MJPG")):
        writer = cv2.VideoWriter(str(folder / f"video_{name}"), cv2.VideoWriter_fourcc(*code), 25.0, SIZE)
        for number in range(12):
            writer.write(texture(3, number=number))
        writer.release()
    try:
        import av
    except ImportError:
        return
    for name, codec in (("f.mp4", "libx264"), ("g.ts", "libx264"), ("h.webm", "libvpx"), ("i.mjpeg", "mjpeg")):
        try:
            with av.open(str(folder / f"video_{name}"), "w") as container:
                stream = container.add_stream(codec, rate=25)
                stream.width, stream.height = SIZE
                stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
                for number in range(12):
                    picture = av.VideoFrame.from_ndarray(texture(3, number=number), format="bgr24")
                    container.mux(stream.encode(picture.reformat(format=stream.pix_fmt)))
                container.mux(stream.encode())
        except (av.FFmpegError, ValueError):
            (folder / f"video_{name}").unlink(missing_ok=True)


def text_files(folder: Path) -> None:
    from rsflow.camera.formats import save_camera

    std = {"fx": 0.5, "fy": 0.5, "cx": 0.2, "cy": 0.2}
    camera = rsflow.Camera(60.0, 61.0, 19.5, 14.5, width=40, height=30, distortion=(-0.2, 0.1, 0, 1e-5, 0), std=std)
    for name, kind in (("a.json", "json"), ("b.yaml", "ros"), ("c.yml", "opencv"), ("d.xml", "opencv")):
        save_camera(camera, folder / f"camera_{name}", format=kind)  # type: ignore[arg-type]
    save_camera(camera, folder / "camera_e.json", format="opencv")
    plain = rsflow.Camera(60.0, 61.0, 19.5, 14.5, width=40, height=30)
    save_camera(plain, folder / "camera_f.yaml", format="kalibr")
    rows = [(k, k / 25, 0.2 + 0.01 * k) for k in range(12)]
    (folder / "times_a.csv").write_text("frame,t_s\n" + "".join(f"{k},{t}\n" for k, t, _ in rows))
    (folder / "times_b.csv").write_text("# made\r\nt_ms\r\n" + "".join(f"{1000 * t:g}\r\n" for _, t, _ in rows))
    (folder / "heights_a.csv").write_text("t_s;height_m\n" + "".join(f"{t};{h:.3f}\n" for _, t, h in rows))
    (folder / "rates_a.csv").write_text(
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt\n"
        + "".join(f"{1e6 * t:g},{h},0,0.1,4000\n" for _, t, h in rows)
    )
    (folder / "rates_b.csv").write_text(
        "timestamp,TimeUS,I,GyrX,GyrY,GyrZ\n" + "".join(f"1,{1e6 * t:g},{k % 2},{h},0,0.1\n" for k, t, h in rows)
    )
    (folder / "attitudes_a.csv").write_text("t_s,qw,qx,qy,qz\n" + "".join(f"{t},1,0,0,0\n" for _, t, _ in rows))
    (folder / "attitudes_b.csv").write_text("TimeUS,Roll,Pitch\n" + "".join(f"{1e6 * t:g},{h},0\n" for _, t, h in rows))
    (folder / "heights_c.csv").write_text(
        "timestamp,current_distance,variance,orientation\n" + "".join(f"{1e6 * t:g},{h},0.01,25\n" for _, t, h in rows)
    )
    (folder / "heights_b.csv").write_text("frame,height_m\n" + "".join(f"{k},{h:.3f}\n" for k, _, h in rows))


def read_frames(path: Path) -> None:
    with rsflow.frames(path) as source:
        for _ in islice(source, 64):
            pass


def read_flow(path: Path) -> None:
    rsflow.read_flow(path)
    read_flow_times(path)


def read_times(path: Path) -> None:
    list(rsflow.frames([np.zeros((4, 6), np.uint8)] * 12, times=path))


def read_rates(path: Path) -> None:
    Rates.read(path).mean(0.0, 0.2)


def read_attitudes(path: Path) -> None:
    Attitudes.read(path).down(0.1)


def reader_of(name: str) -> Callable[[Path], Any]:
    kinds: dict[str, Callable[[Path], Any]] = {
        "camera": rsflow.Camera.load,
        "times": read_times,
        "heights": Heights.read,
        "rates": read_rates,
        "attitudes": read_attitudes,
        "picture": read_frames,
        "video": read_frames,
    }
    return kinds.get(name.split("_")[0], read_flow)


WORDS = (
    b"nan",
    b"-1",
    b"1e999",
    b"9" * 400,
    b"0,5",
    b"\0",
    b"*a",
    b"&a [",
    b"{" * 3000,
    b"[" * 3000,
    b"\xff",
    b"#",
    b"\n",
)
NUMBERS = (0, 1, 0x7F, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x00FFFFFF)


def damaged(data: bytes, others: list[bytes], rng: np.random.Generator) -> bytes:
    """Damage a file in one to four ways."""
    for _ in range(int(rng.integers(1, 5))):
        size = len(data)
        if size < 2:
            break
        # Headers stand at the beginning: half of what is done is done there.
        reach = min(size, 256) if rng.random() < 0.5 else size
        at = int(rng.integers(reach))
        length = int(rng.integers(1, max(2, min(size - at, 64) + 1)))
        work = bytearray(data)
        way = int(rng.integers(9))
        if way == 0:
            for place in rng.integers(reach, size=int(rng.integers(1, 12))):
                work[place] ^= 1 << int(rng.integers(8))
        elif way == 1:
            work = work[: int(rng.integers(size))]
        elif way == 2:
            # A length, a size or a count that lies, in either order of bytes.
            order, value = "<>"[int(rng.integers(2))], NUMBERS[int(rng.integers(len(NUMBERS)))]
            field = struct.pack(f"{order}I", value)
            field = field if rng.random() < 0.7 else (field[2:] if order == ">" else field[:2])
            work[at : at + len(field)] = field
        elif way == 3:
            del work[at : at + length]
        elif way == 4:
            work[at:at] = work[at : at + length] * int(rng.integers(1, 40))
        elif way == 5:
            other = others[int(rng.integers(len(others)))]
            work = work[:at] + bytearray(other[int(rng.integers(len(other))) :])
        elif way == 6:
            work[at : at + length] = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
        elif way == 7:
            work[at : at + min(length, 4)] = WORDS[int(rng.integers(len(WORDS)))]
        else:
            work[at : at + length] = bytes(length)
        data = bytes(work)
    return data


def rechecked(data: bytes) -> bytes:
    """Give a PNG the checksums of its chunks as they are now: without them, hardly any damage gets to the decoder."""
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        return data
    work, place = bytearray(data), 8
    while place + 12 <= len(work):
        end = place + 8 + int.from_bytes(work[place : place + 4], "big")
        if end + 4 > len(work):
            break
        work[end : end + 4] = struct.pack(">I", zlib.crc32(work[place + 4 : end]))
        place = end + 4
    return bytes(work)


def run(folder: Path, seed: int, first: int, count: int) -> None:
    whole = folder / "whole"
    if not whole.exists():
        whole.mkdir()
        for make in (flow_files, picture_files, video_files, text_files):
            make(whole)
    names = sorted(path.name for path in whole.iterdir())
    contents = {name: (whole / name).read_bytes() for name in names}
    for name in names:
        # What is damaged must be read where it is not; this also loads all modules before memory is bounded.
        reader_of(name)(whole / name)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + GROWTH_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    for case in range(first, first + count):
        rng = np.random.default_rng([seed, case])
        name = names[case % len(names)]
        alike = [content for other, content in contents.items() if Path(other).suffix == Path(name).suffix]
        data = damaged(contents[name], alike if rng.random() < 0.7 else list(contents.values()), rng)
        data = rechecked(data) if rng.random() < 0.5 else data
        path = folder / f"case{case}_{name}"
        path.write_bytes(data)
        print(json.dumps({"case": case, "name": name}), flush=True)
        started = time.process_time()
        outcome = "read"
        try:
            reader_of(name)(path)
        except rsflow.RsflowError:
            outcome = "refused"
        except DOCUMENTED as error:
            outcome = type(error).__name__
        except BaseException as error:
            outcome = f"wrong: {type(error).__name__}: {error}"[:300]
        took_s = time.process_time() - started
        if took_s > CPU_S:
            outcome = f"wrong: took {took_s:.1f} s, {outcome}"
        if not outcome.startswith("wrong"):
            path.unlink()
        print(json.dumps({"case": case, "outcome": outcome, "s": round(took_s, 3)}), flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    run(Path(sys.argv[1]), *(int(word) for word in sys.argv[2:5]))
