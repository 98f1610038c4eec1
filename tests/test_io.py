"""Flow files: round trips in every format, exact bytes, and headers that lie."""

from __future__ import annotations

import struct
import zipfile
import zlib
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import rsflow
from rsflow.io import FLOW_SUFFIXES, read_flow_times

SIZES = st.tuples(st.integers(1, 7), st.integers(1, 9)).map(lambda size: (*size, 2))
ANY_FLOAT = st.floats(-1e9, 1e9, width=32) | st.just(float("nan"))
SLOW_FOLDER = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def as_read(uv: np.ndarray) -> np.ndarray:
    """What a reader gives back: NaN in both components where either is unknown."""
    expected = uv.copy()
    expected[np.isnan(uv).any(axis=2)] = np.nan
    return expected


@pytest.mark.parametrize("suffix", [".flo", ".npy", ".npz", ".pfm"])
@SLOW_FOLDER
@given(uv=hnp.arrays(np.float32, SIZES, elements=ANY_FLOAT))
def test_float_formats_return_the_same_bits(tmp_path: Path, suffix: str, uv: np.ndarray) -> None:
    path = tmp_path / f"flow{suffix}"
    rsflow.write_flow(path, uv)
    back = rsflow.read_flow(path)
    assert back.dtype == np.float32
    assert back.flags.c_contiguous
    assert back.flags.writeable
    np.testing.assert_array_equal(back, as_read(uv))


@SLOW_FOLDER
@given(uv=hnp.arrays(np.float32, SIZES, elements=st.floats(-512, 511.984375, width=32) | st.just(float("nan"))))
def test_kitti_returns_within_half_a_step(tmp_path: Path, uv: np.ndarray) -> None:
    path = tmp_path / "flow.png"
    rsflow.write_flow(path, uv)
    back = rsflow.read_flow(path)
    expected = as_read(uv)
    np.testing.assert_array_equal(np.isnan(back), np.isnan(expected))
    known = ~np.isnan(expected)
    assert np.all(np.abs(back[known] - expected[known]) <= 1 / 128)


def test_flo_has_the_exact_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.flo"
    rsflow.write_flow(path, [[[1.5, -2.0], [np.nan, 0.0], [3.0, np.inf]]])
    expected = b"PIEH" + struct.pack("<ii6f", 3, 1, 1.5, -2.0, 1e10, 1e10, 1e10, 1e10)
    assert path.read_bytes() == expected
    assert struct.unpack("<f", b"PIEH")[0] == 202021.25


def test_kitti_has_the_channels_in_order(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    rsflow.write_flow(path, [[[1.0, -2.0], [np.nan, 0.0]]])
    blue, green, red = cv2.split(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
    assert blue.tolist() == [[1, 0]]
    assert green.tolist() == [[32768 - 128, 0]]
    assert red.tolist() == [[32768 + 64, 0]]


def test_pfm_is_bottom_up_and_of_either_byte_order(tmp_path: Path) -> None:
    uv = np.arange(12, dtype=np.float32).reshape(3, 2, 2)
    path = tmp_path / "a.pfm"
    rsflow.write_flow(path, uv)
    assert path.read_bytes().startswith(b"PF\n2 3\n-1.0\n" + struct.pack("<3f", *uv[2, 0], 0.0))
    big = b"PF\n2 3\n1.0\n" + np.dstack([uv, np.zeros((3, 2))])[::-1].astype(">f4").tobytes()
    path.write_bytes(big)
    np.testing.assert_array_equal(rsflow.read_flow(path), uv)


def test_a_field_loses_what_is_not_valid_and_npz_keeps_times(tmp_path: Path) -> None:
    uv = np.ones((2, 3, 2), np.float32)
    valid = np.array([[True, False, True], [True, True, True]])
    path = tmp_path / "a.npz"
    rsflow.write_flow(path, SimpleNamespace(uv=uv, valid=valid), t0_s=0.5, t1_s=0.54)
    np.testing.assert_array_equal(~np.isnan(rsflow.read_flow(path)).any(axis=2), valid)
    assert read_flow_times(path) == (0.5, 0.54)
    assert np.array_equal(uv, np.ones_like(uv)), "the caller's array must not change"
    rsflow.write_flow(path, uv)
    assert read_flow_times(path) is None
    assert read_flow_times(tmp_path / "a.flo") is None


def test_an_array_is_taken_in_any_layout(tmp_path: Path) -> None:
    uv = np.random.default_rng(3).normal(size=(5, 8, 2))
    path = tmp_path / "a.npy"
    rsflow.write_flow(path, uv[::-1, ::2])
    np.testing.assert_array_equal(rsflow.read_flow(path), uv[::-1, ::2].astype(np.float32))
    np.save(path, np.asfortranarray(uv))
    np.testing.assert_array_equal(rsflow.read_flow(path), uv.astype(np.float32))
    np.save(path, np.ones((2, 2, 2), ">i2"))
    np.testing.assert_array_equal(rsflow.read_flow(path), np.ones((2, 2, 2), np.float32))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a .flo file"),
        (b"PIEH\x01\0", "cut off after 6 bytes"),
        (b"HEIP" + struct.pack("<iiff", 1, 1, 0, 0), "starts with b'HEIP'"),
        (b"PIEH" + struct.pack("<ii", -1, 4), "-1 x 4 pixels"),
        (b"PIEH" + struct.pack("<ii", 0, 4), "0 x 4 pixels"),
        (b"PIEH" + struct.pack("<ii", 2**31 - 1, 2**31 - 1), "but the file has 12"),
        (b"PIEH" + struct.pack("<iiff", 1, 1, 0, 0) + b"x", "takes 20 bytes, but the file has 21"),
        (b"PIEH" + struct.pack("<iif", 1, 1, 0), "takes 20 bytes, but the file has 16"),
    ],
)
def test_a_flo_header_is_not_believed(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.flo"
    path.write_bytes(content)
    with pytest.raises(rsflow.FormatError, match=message):
        rsflow.read_flow(path)


def png(width: int, height: int, depth: int, kind: int, data: bytes, *, end: bool = True) -> bytes:
    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, kind, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", data) + (chunk(b"IEND", b"") if end else b"")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a PNG"),
        (b"\x89PNG\r\n\x1a\n", "not a PNG"),
        (png(1, 1, 8, 2, b""), "got 8 bits"),
        (png(1, 1, 16, 0, b""), "colour type 0"),
        (png(2**31 - 1, 2**31 - 1, 16, 2, b""), "cannot hold"),
        (png(0, 1, 16, 2, b""), "0 x 1 pixels"),
        (png(1, 1, 16, 2, zlib.compress(bytes(7)), end=False), "cut off"),
    ],
)
def test_a_png_header_is_not_believed(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.png"
    path.write_bytes(content)
    with pytest.raises(rsflow.FormatError, match=message):
        rsflow.read_flow(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a .pfm"),
        (b"Pf\n1 1\n-1.0\n\0\0\0\0", "one channel"),
        (b"PF\n1\n-1\n", "expected that of a .pfm"),
        (b"PF\n1 1\n0\n", "scale that is not 0"),
        (b"PF\n1 1\nnan\n", "scale that is not 0"),
        (b"PF\n-1 1\n-1\n", "-1 x 1 pixels"),
        (b"PF\n99999999 99999999\n-1\n", "but the file has 24"),
    ],
)
def test_a_pfm_header_is_not_believed(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "bad.pfm"
    path.write_bytes(content)
    with pytest.raises(rsflow.FormatError, match=message):
        rsflow.read_flow(path)


def npy(header: str) -> bytes:
    body = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(body)) + body


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a numpy array"),
        (b"\x93NUMPY\x07\x00", "not a numpy array"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1073741824, 1073741824, 2), }"), "but 0 follow"),
        (
            npy("{'descr': '|O', 'fortran_order': False, 'shape': (1, 1, 2), }"),
            "got dtype object, expected real numbers",
        ),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (0, 1, 2), }"), r"\(height, width, 2\)"),
        (npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }") + bytes(8), r"\(height, width, 2\)"),
        (npy("{'descr': '<f4'}"), "not a numpy array"),
        (npy("__import__('os').getcwd()"), "not a numpy array"),
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_a_numpy_header_is_not_believed(tmp_path: Path, content: bytes, message: str, packed: bool) -> None:
    path = tmp_path / ("bad.npz" if packed else "bad.npy")
    if packed:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("flow.npy", content)
    else:
        path.write_bytes(content)
    with pytest.raises(rsflow.FormatError, match=message):
        rsflow.read_flow(path)


def test_an_npz_that_is_no_flow(tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(b"nothing")
    with pytest.raises(rsflow.FormatError, match=r"not an \.npz"):
        rsflow.read_flow(path)
    np.savez(path, other=np.zeros(3))
    with pytest.raises(rsflow.FormatError, match=r"no array 'flow', but \['other.npy'\]"):
        rsflow.read_flow(path)
    np.savez(path, flow=np.zeros((2, 2, 2)), valid=np.ones(3), t0="x", t1=1.0)
    with pytest.raises(rsflow.FormatError, match=r"valid: got .*, expected .* as flow is"):
        rsflow.read_flow(path)
    with pytest.raises(rsflow.FormatError, match="real numbers"):
        read_flow_times(path)
    np.savez(path, flow=np.zeros((2, 2, 2)), t0=np.zeros(2), t1=1.0)
    with pytest.raises(rsflow.FormatError, match="each be one number"):
        read_flow_times(path)


def test_opencv_reads_and_writes_the_same_files(tmp_path: Path) -> None:
    uv = np.random.default_rng(5).normal(0, 9, (11, 7, 2)).astype(np.float32)
    holes = uv.copy()
    holes[2, 3] = np.nan
    rsflow.write_flow(tmp_path / "a.flo", holes)
    back = cv2.readOpticalFlow(str(tmp_path / "a.flo"))
    assert (back[2, 3] == np.float32(1e10)).all()
    back[2, 3] = np.nan
    np.testing.assert_array_equal(back, holes)
    assert cv2.writeOpticalFlow(str(tmp_path / "b.flo"), uv)
    np.testing.assert_array_equal(rsflow.read_flow(tmp_path / "b.flo"), uv)
    # OpenCV's order of channels is B, G, R.
    rsflow.write_flow(tmp_path / "a.pfm", uv)
    back = cv2.imread(str(tmp_path / "a.pfm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(back, np.dstack([np.zeros((11, 7)), uv[..., 1], uv[..., 0]]))
    assert cv2.imwrite(str(tmp_path / "b.pfm"), back)
    np.testing.assert_array_equal(rsflow.read_flow(tmp_path / "b.pfm"), uv)


@pytest.mark.parametrize("suffix", FLOW_SUFFIXES)
def test_every_truncation_is_an_error(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    rsflow.write_flow(path, np.random.default_rng(7).normal(size=(3, 4, 2)))
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(rsflow.FormatError):
            rsflow.read_flow(path)


@pytest.mark.parametrize("suffix", FLOW_SUFFIXES)
@SLOW_FOLDER
@given(where=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255))
def test_a_changed_byte_never_does_worse_than_an_error(tmp_path: Path, suffix: str, where: float, value: int) -> None:
    path = tmp_path / f"a{suffix}"
    rsflow.write_flow(path, np.random.default_rng(7).normal(size=(3, 4, 2)))
    data = bytearray(path.read_bytes())
    data[int(where * len(data))] = value
    path.write_bytes(data)
    try:
        uv = rsflow.read_flow(path)
    except rsflow.FormatError:
        return
    assert uv.ndim == 3
    assert uv.shape[2] == 2


def test_misuse_says_what_is_wrong(tmp_path: Path) -> None:
    flow = np.zeros((2, 2, 2), np.float32)
    with pytest.raises(rsflow.OptionError, match=r'path: got ".*a\.txt", expected a name that ends in \.flo, \.png'):
        rsflow.write_flow(tmp_path / "a.txt", flow)
    with pytest.raises(rsflow.FormatError, match=r"'\.txt'"):
        rsflow.read_flow(tmp_path / "a.txt")
    with pytest.raises(rsflow.OptionError, match=r"t0_s, t1_s: got 1\.0 and None, expected both or none"):
        rsflow.write_flow(tmp_path / "a.npz", flow, t0_s=1.0)
    for bad in (np.zeros((2, 2)), np.zeros((2, 2, 3)), np.zeros((0, 2, 2))):
        with pytest.raises(rsflow.ShapeError, match="field: got shape"):
            rsflow.write_flow(tmp_path / "a.flo", bad)
    for bad in (np.zeros((2, 2, 2), complex), np.full((2, 2, 2), "x")):
        with pytest.raises(rsflow.DTypeError, match="real numbers"):
            rsflow.write_flow(tmp_path / "a.flo", bad)
    with pytest.raises(rsflow.DTypeError, match="got None, as DenseFlow gives for its first frame"):
        rsflow.write_flow(tmp_path / "a.flo", rsflow.DenseFlow().update(np.zeros((4, 5), np.uint8)))
    with pytest.raises(rsflow.ShapeError, match="field: got list that is no array"):
        rsflow.write_flow(tmp_path / "a.flo", [[1, 2], [3]])
    with pytest.raises(
        rsflow.ShapeError, match=r"field.valid: got shape \(3, 3\), expected that of the flow, \(2, 2\)"
    ):
        rsflow.write_flow(tmp_path / "a.flo", SimpleNamespace(uv=flow, valid=np.ones((3, 3), bool)))
    for bad in ("soon", float("nan"), float("inf"), [1.0, 2.0]):
        with pytest.raises(rsflow.OptionError, match=r"t1_s: got .*, expected a finite number of seconds"):
            rsflow.write_flow(tmp_path / "a.npz", flow, t0_s=0.0, t1_s=bad)
    flow[1, 0] = 512, 3
    with pytest.raises(
        rsflow.OptionError,
        match=r"field: got \(512, 3\) at x=0, y=1 and 1 such pixels, expected displacements from -512 to 511.98 px",
    ):
        rsflow.write_flow(tmp_path / "a.png", flow)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", FLOW_SUFFIXES)
def test_folders_and_missing_files(tmp_path: Path, suffix: str) -> None:
    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    with pytest.raises(rsflow.FormatError, match="got a folder, expected a regular file"):
        rsflow.read_flow(folder)
    with pytest.raises(FileNotFoundError):
        rsflow.read_flow(tmp_path / f"none{suffix}")
    with pytest.raises(OSError, match="cannot write"):
        rsflow.write_flow(folder, np.zeros((1, 1, 2)))
    assert list(folder.iterdir()) == []
