"""Object storage, through fsspec: sources are fetched, results written beside and then moved."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .._extras import require
from ..errors import CaptureError, MissingExtraError, OptionError

__all__ = ["fetched", "is_remote", "listed", "moved", "read", "received", "removed", "sent", "stamp", "storage"]

# What OpenCV opens by itself, or rsflow does.
_OTHERS = ("http", "https", "rtsp", "rtsps", "rtmp", "rtmps", "rtp", "udp", "tcp", "srt", "mms", "ftp")


def is_remote(place: Any) -> bool:
    """Whether this is a URL of fsspec's: ``s3://bucket/clip.mp4``, ``gs://...``, ``memory://...``, ``file://...``."""
    if not isinstance(place, str) or "://" not in place:
        return False
    return place.split("://")[0].split("::")[-1].lower() not in _OTHERS


def storage(url: str) -> tuple[Any, str]:
    """Give the file system of a URL and the path in it.

    Raises
    ------
    MissingExtraError
        If fsspec, or what it needs for this kind of storage, is not installed.
    OptionError
        If fsspec knows no such kind of storage.
    """
    kind = url.split("://")[0]
    fsspec = require("fsspec", extra="fsspec", purpose=f"reading and writing {kind}://")
    try:
        file_system, path = fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise MissingExtraError(f"{url}: reading and writing {kind}:// needs more: {error}") from None
    except ValueError as error:
        raise OptionError(f"storage: got {url}, expected what fsspec knows, as s3://...: {error}") from None
    return file_system, str(path)


def listed(url: str, suffixes: tuple[str, ...]) -> list[str]:
    """Give the files that a URL stands for: itself, those that a pattern matches, the videos in a folder."""
    file_system, path = storage(url)
    if any(mark in path for mark in "*?["):
        found = sorted(str(name) for name in file_system.glob(path) if file_system.isfile(name))
    elif file_system.isdir(path):
        found = sorted(str(name) for name in file_system.find(path) if str(name).lower().endswith(suffixes))
    else:
        return [url]
    return [str(file_system.unstrip_protocol(name)) for name in found]


def stamp(url: str) -> str:
    """Give a check sum of what storage tells of a file: it is another one when the file has changed.

    Raises
    ------
    CaptureError
        If there is no such file.
    """
    file_system, path = storage(url)
    try:
        info = file_system.info(path)
    except FileNotFoundError:
        raise CaptureError(f"{url}: no such file in storage") from None
    told = [url, *(f"{name}={info[name]}" for name in _TOLD if info.get(name) is not None)]
    return hashlib.blake2b("\n".join(told).encode(), digest_size=16).hexdigest()


_TOLD = ("size", "ETag", "etag", "md5", "md5Hash", "generation", "mtime", "LastModified", "last_modified", "created")


class _Kept:
    """The file that this process fetched last: parts of one video follow each other."""

    def __init__(self) -> None:
        self.stamp = ""
        self.folder: tempfile.TemporaryDirectory[str] | None = None
        self.path = Path()
        self.process = 0
        self.lock = threading.Lock()


_kept = _Kept()


@contextlib.contextmanager
def fetched(source: Any) -> Iterator[Any]:
    """Give a source as a file of this machine, fetched if it is in storage."""
    if not is_remote(source):
        yield source
        return
    with _kept.lock:
        told = stamp(source)
        if _kept.process != os.getpid() or _kept.stamp != told:
            folder = tempfile.TemporaryDirectory(prefix="rsflow-source-", ignore_cleanup_errors=True)
            file_system, path = storage(source)
            target = Path(folder.name) / (path.rstrip("/").split("/")[-1] or "source")
            file_system.get_file(path, str(target))
            _kept.stamp, _kept.folder, _kept.path, _kept.process = told, folder, target, os.getpid()
        # Held for as long as it is read: another thread may fetch another one meanwhile.
        held, path_here = _kept.folder, _kept.path
    yield str(path_here)
    del held


def sent(folder: Path, url: str, *, last: str | None = None) -> None:
    """Write the files of a folder to storage, each beside its name and then moved to it; `last` tells that all are."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    files.sort(key=lambda path: path.name == last)
    for path in files:
        _sent_one(path, f"{url}/{path.relative_to(folder).as_posix()}")


def _sent_one(path: Path, url: str) -> None:
    file_system, target = storage(url)
    parent, _, name = target.rpartition("/")
    file_system.makedirs(parent, exist_ok=True)
    beside = f"{parent}/.{name}.working-{os.urandom(6).hex()}"
    try:
        file_system.put_file(str(path), beside)
        file_system.mv(beside, target)
    except BaseException:
        with contextlib.suppress(Exception):
            file_system.rm_file(beside)
        raise


def received(url: str, folder: Path) -> Path:
    """Fetch all files below a URL into a folder."""
    file_system, path = storage(url)
    for name in file_system.find(path):
        target = folder / str(name)[len(path.rstrip("/")) :].lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        file_system.get_file(name, str(target))
    return folder


def removed(url: str) -> None:
    """Remove what is below a URL, if anything is."""
    file_system, path = storage(url)
    with contextlib.suppress(FileNotFoundError):
        file_system.rm(path, recursive=True)


def read(url: str) -> bytes | None:
    """Give a small file; None where there is none."""
    file_system, path = storage(url)
    try:
        return bytes(file_system.cat_file(path))
    except FileNotFoundError:
        return None


def moved(folder: Path, url_or_path: str, *, last: str) -> None:
    """Bring a folder to its place, here or in storage, so that `last` is there only with all the rest."""
    if is_remote(url_or_path):
        sent(folder, url_or_path, last=last)
        return
    target = Path(url_or_path)
    try:
        folder.rename(target)
    except OSError:
        if not (target / last).exists():
            raise
        # Another worker was as quick.
        shutil.rmtree(folder, ignore_errors=True)
