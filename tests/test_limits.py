"""Small files that claim much, and files that are none: refused before anything is allocated or waited for."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import threading
import time
import zipfile
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

import rsflow
from rsflow.io.limits import max_pixels_of
from rsflow.io.picture_headers import picture_header


def png(width: int, height: int, depth: int = 8, kind: int = 0, body: bytes = b"", *, lie: int | None = None) -> bytes:
    def chunk(name: bytes, data: bytes, length: int | None = None) -> bytes:
        checked = struct.pack(">I", zlib.crc32(name + data))
        return struct.pack(">I", len(data) if length is None else length) + name + data + checked

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", body, lie) + chunk(b"IEND", b"")


def jpeg(width: int, height: int) -> bytes:
    """A JPEG of 16 x 16 pixels whose frame header says another size."""
    data = bytearray(cv2.imencode(".jpg", np.zeros((16, 16), np.uint8))[1].tobytes())
    place = data.index(b"\xff\xc0")
    data[place + 5 : place + 9] = struct.pack(">HH", height, width)
    return bytes(data)


def tiff(width: int, height: int) -> bytes:
    """One strip of one byte, by hand: the directory says width and height, 8 bits, no packing."""
    tags = [(256, width), (257, height), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (278, height), (279, 1)]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    return b"II*\0" + struct.pack("<I", 12) + b"\0\0\0\0" + struct.pack("<H", len(tags)) + entries + bytes(4)


LIARS = {
    "chunk.png": png(64, 64, body=b"x" * 20, lie=0x7FFFFFFF),
    "wide.png": png(30000, 30000, 1, body=zlib.compress(bytes(30000 * 3751), 9)),
    "empty.png": png(16000, 16000, body=b"x"),
    "wide.jpg": jpeg(65500, 65500),
    "empty.jpg": jpeg(16000, 16000),
    "wide.tif": tiff(2**31, 2**31),
    "empty.tif": tiff(16000, 16000),
    "wide.bmp": b"BM" + struct.pack("<IIIIiiHHI", 100, 0, 54, 40, 30000, 30000, 1, 24, 0) + bytes(24),
    "wide.ppm": b"P6 30000 30000 255\n" + bytes(100),
    "text.pgm": b"P2 16000 16000 255\n0 0 0",
    "wide.webp": b"RIFF" + struct.pack("<I", 22) + b"WEBPVP8X" + struct.pack("<I", 10) + bytes(4) + b"\xff" * 6,
    "wide.hdr": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 30000 +X 30000\n" + bytes(100),
    "wide.jp2": b"\xff\x4f\xff\x51"
    + struct.pack(">HH8IHBBB", 41, 0, 2**30, 2**30, 0, 0, 2**30, 2**30, 0, 0, 1, 7, 1, 1),
}


@pytest.mark.parametrize("name", LIARS)
def test_a_header_is_not_believed(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(LIARS[name])
    started = time.monotonic()
    with pytest.raises(rsflow.CaptureError, match=rf"{name}: "):
        rsflow.frames(path)
    assert time.monotonic() - started < 1.0


def test_a_lying_file_takes_no_memory(tmp_path: Path) -> None:
    """In a process of its own whose addresses may grow by 256 MiB: decoders that believe headers abort there."""
    for name, data in LIARS.items():
        (tmp_path / name).write_bytes(data)
    script = """if True:
        import pathlib, resource, sys
        import cv2, rsflow, rsflow.capture.sources
        size = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + 2**28, size + 2**28))
        for path in sorted(pathlib.Path(sys.argv[1]).iterdir()):
            try:
                rsflow.frames(path)
            except rsflow.RsflowError as error:
                print(path.name)
        """
    if not Path("/proc/self/statm").exists():
        pytest.skip("needs /proc")
    done = subprocess.run([sys.executable, "-c", script, tmp_path], capture_output=True, text=True, check=True)
    assert done.stdout.split() == sorted(LIARS)


def test_whole_pictures_pass_with_their_size(tmp_path: Path) -> None:
    colour = np.random.default_rng(0).integers(0, 255, (37, 53, 3), np.uint8)
    for suffix in (".png", ".jpg", ".bmp", ".tif", ".webp", ".ppm", ".jp2", ".hdr", ".pfm", ".gif", ".avif"):
        picture = colour.astype(np.float32) / 255 if suffix in (".hdr", ".pfm") else colour
        try:
            done, data = cv2.imencode(suffix, picture)
        except cv2.error:
            continue
        if done:
            header = picture_header(data.tobytes())
            assert header is not None, suffix
            assert (header.width, header.height, header.pages) == (53, 37, (0,)), suffix
    for flag in (cv2.IMWRITE_JPEG_PROGRESSIVE, cv2.IMWRITE_JPEG_OPTIMIZE):
        flat = cv2.imencode(".jpg", np.full((2000, 3000), 77, np.uint8), [flag, 1])[1].tobytes()
        (tmp_path / "flat.jpg").write_bytes(flat)
        assert next(rsflow.frames(tmp_path / "flat.jpg")).image.shape == (2000, 3000)
    for packing in (1, 5, 8, 32773):
        done, data = cv2.imencode(".tif", np.full((2000, 3000), 77, np.uint8), [cv2.IMWRITE_TIFF_COMPRESSION, packing])
        (tmp_path / "flat.tif").write_bytes(data.tobytes())
        assert next(rsflow.frames(tmp_path / "flat.tif")).image.shape == (2000, 3000)


def test_the_limit_is_raised_by_the_argument_and_the_variable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((30, 40), np.uint8))
    message = (
        r"a\.png: the header says 40 x 30 pixels, expected at most 1199 in all: raise the limit with max_pixels= or"
    )
    with pytest.raises(rsflow.CaptureError, match=message):
        rsflow.frames(path, max_pixels=1199)
    rsflow.frames(path, max_pixels=1200)
    flow = tmp_path / "a.flo"
    rsflow.write_flow(flow, np.zeros((30, 40, 2), np.float32))
    monkeypatch.setenv("RSFLOW_MAX_PIXELS", "1199")
    for read in (rsflow.frames, rsflow.read_flow):
        with pytest.raises(rsflow.RsflowError, match="expected at most 1199 in all"):
            read(path if read is rsflow.frames else flow)
    assert next(rsflow.frames(path, max_pixels=1200)).image.shape == (30, 40)
    assert rsflow.read_flow(flow, max_pixels=1200).shape == (30, 40, 2)
    for text in ("many", "-1", "0", "1e9", "9" * 30):
        monkeypatch.setenv("RSFLOW_MAX_PIXELS", text)
        with pytest.raises(rsflow.OptionError, match=r"RSFLOW_MAX_PIXELS: got .*, expected a whole number"):
            max_pixels_of(None)
    for value in (0, -1, True, 1.5, "9"):
        with pytest.raises(rsflow.OptionError, match="max_pixels: got"):
            rsflow.frames(path, max_pixels=value)  # type: ignore[arg-type]


@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_a_packed_flow_is_held_to_the_limit(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"flow{suffix}"
    shape = (16384, 16384, 2)
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    head = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode()
    if suffix == ".npy":
        path.write_bytes(head + bytes(100))
    else:
        # 2 GiB of zeros as 2 MB: the same deflate block again and again.
        packer = zlib.compressobj(9, zlib.DEFLATED, -15)
        block = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH)
        zeros = zlib.compressobj(9, zlib.DEFLATED, -15)
        one = zeros.compress(bytes(2**24)) + zeros.flush(zlib.Z_FULL_FLUSH)
        last = zlib.compressobj(9, zlib.DEFLATED, -15)
        body = block + one * 128 + last.flush()
        with zipfile.ZipFile(path, "w") as archive:
            info = zipfile.ZipInfo("flow.npy")
            archive.writestr(info, body)
        data = bytearray(path.read_bytes())
        size = len(head) + 2**31
        for signature, method, sizes in ((b"PK\x03\x04", 8, 18), (b"PK\x01\x02", 10, 20)):
            place = data.index(signature)
            data[place + method : place + method + 2] = struct.pack("<H", 8)
            data[place + sizes : place + sizes + 8] = struct.pack("<II", len(body), size)
        path.write_bytes(data)
    started = time.monotonic()
    with pytest.raises(rsflow.FormatError, match=r"flow\.np[yz]: "):
        rsflow.read_flow(path)
    assert time.monotonic() - started < 1.0


def refused(call, *, within_s: float = 5.0) -> str:
    """Run in a thread, since what is tested may wait for ever; give the message."""
    got: list[str] = []

    def run() -> None:
        try:
            call()
        except rsflow.RsflowError as error:
            got.append(str(error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(within_s)
    assert not thread.is_alive(), "still waiting"
    assert got, "no error"
    return got[0]


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs devices")
@pytest.mark.parametrize("kind", ["device", "pipe", "folder"])
def test_only_regular_files_are_read(tmp_path: Path, kind: str) -> None:
    from rsflow.velocity import Heights

    word = {"device": "a device", "pipe": "a pipe", "folder": "a folder"}[kind]

    def place(name: str) -> Path:
        path = tmp_path / name
        if kind == "device":
            path.symlink_to("/dev/zero")
        elif kind == "pipe":
            os.mkfifo(path)
        else:
            path.mkdir()
        return path

    calls = {
        "cam.yaml": rsflow.Camera.load,
        "h.csv": Heights.read,
        "t.csv": lambda path: rsflow.frames([np.zeros((4, 4), np.uint8)] * 3, times=path),
        **{f"f{suffix}": rsflow.read_flow for suffix in (".flo", ".png", ".npy", ".npz", ".pfm")},
    }
    if kind != "folder":
        calls |= {"a.png": rsflow.frames, "a.mp4": rsflow.frames, "b.png": lambda path: rsflow.frames([path, path])}
    for name, call in calls.items():
        path = place(name)
        message = refused(lambda call=call, path=path: call(path))
        assert f"{name}: got {word}, expected a" in message


def test_text_is_read_up_to_a_size(tmp_path: Path) -> None:
    path = tmp_path / "big.csv"
    with path.open("wb") as file:
        file.truncate(65 * 1024 * 1024)
    with pytest.raises(rsflow.FormatError, match=r"big\.csv: got 68157440 bytes, expected at most 67108864"):
        rsflow.frames([np.zeros((4, 4), np.uint8)] * 3, times=path)
    camera = tmp_path / "cam.yaml"
    camera.write_text("a: [" + "1, " * 100_000 + "1]\n")
    with pytest.raises(rsflow.FormatError, match="characters of YAML, expected a camera file of at most"):
        rsflow.Camera.load(camera)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "YAML|JSON"),
        ('{"a": ' * 500 + "1" + "}" * 500, "JSON"),
        ('{"a": ' * 100_000, "JSON"),
        ('{"fx": ' + "9" * 5000 + "}", "JSON|digits"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "alias"),
        ("%YAML:1.0\n---\nM: !!opencv-matrix\n   rows" + " " * 1_000_000 + "x", "FileStorage|not a camera"),
        ("%YAML:1.0\n---\nM: !!opencv-matrix\n   rows: " + "9" * 5000 + "\n   cols: 3\n", "beyond|matrix"),
        ("%YAML:1.0\n---\nM: !!opencv-matrix\n   rows: 2000000000\n   cols: 3\n   dt: d\n   data: [ 1 ]\n", "matrix"),
    ],
)
def test_a_camera_file_that_blows_up_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "cam.yaml"
    path.write_text(text)
    started = time.monotonic()
    with pytest.raises(rsflow.FormatError, match=message):
        rsflow.Camera.load(path)
    assert time.monotonic() - started < 2.0
