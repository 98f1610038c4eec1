"""Seek cases for the fuzz targets by what of the code they reach, and keep the few that reach most: fuzz/seeds.

    python .ci/fuzz_seeds.py [--seconds 60] [--only TARGET] [--keep 12]

Each target is built with libFuzzer and counters of its branches, by switches that a stable compiler has, and seeks for
so many seconds, from the seeds that are kept. Of all that it found those are kept that together reach most: the one
that adds most first. `cargo test --release` in fuzz/ runs what is kept before anything else.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import subprocess
import tempfile
from pathlib import Path

FUZZ = Path(__file__).resolve().parent.parent / "fuzz"
SEEDS = FUZZ / "seeds"
# Long enough for every field of a case, short enough to be looked at.
LONGEST_BYTES = 96
COUNTERS = (
    *("-Cpasses=sancov-module", "-Cllvm-args=-sanitizer-coverage-level=3", "--cfg=fuzzing"),
    *("-Cllvm-args=-sanitizer-coverage-inline-8bit-counters", "-Cllvm-args=-sanitizer-coverage-pc-table"),
)


def targets() -> list[str]:
    """Names of all fuzz targets."""
    return sorted(path.stem for path in (FUZZ / "fuzz_targets").glob("*.rs"))


def built(names: list[str]) -> dict[str, Path]:
    """Build targets with counters; give their programs."""
    version = subprocess.run(["rustc", "-vV"], check=True, capture_output=True, text=True).stdout
    host = re.search(r"^host: (.+)$", version, re.MULTILINE)
    assert host is not None
    place = Path(os.environ.get("CARGO_TARGET_DIR", FUZZ / "target")) / "counted"
    flags = " ".join((os.environ.get("RUSTFLAGS", ""), *COUNTERS)).strip()
    bins = [word for name in names for word in ("--bin", name)]
    subprocess.run(
        ["cargo", "build", "--release", "--locked", "--target", host[1], "--target-dir", str(place), *bins],
        cwd=FUZZ,
        env=os.environ | {"RUSTFLAGS": flags},
        check=True,
    )
    return {name: place / host[1] / "release" / name for name in names}


def found(program: Path, name: str, seconds: int, place: Path) -> dict[bytes, frozenset[int]]:
    """Seek; give each case that reaches something new with the branches that it reaches."""
    for folder in ("corpus", "merged"):
        (place / folder).mkdir()
    kept = SEEDS / name
    for path in kept.glob("*") if kept.is_dir() else ():
        (place / "corpus" / path.name).write_bytes(path.read_bytes())
    corpus = str(place / "corpus")
    seek = ["-seed=1", f"-max_len={LONGEST_BYTES}", f"-max_total_time={seconds}", f"-artifact_prefix={place}/"]
    log = place / "log"
    with log.open("wb") as file:
        ended = subprocess.run([program, corpus, *seek], stderr=file, stdout=file, check=False).returncode
    if ended != 0:
        told = log.read_text(encoding="utf-8", errors="replace")[-3000:]
        cases = [f"{path.name}: {path.read_bytes().hex()}" for path in sorted(place.glob("crash-*"))]
        raise SystemExit("\n".join([told, f"{name}: a fault; the case:", *cases]))
    control = place / "control"
    merge = ["-set_cover_merge=1", f"-merge_control_file={control}", f"-max_len={LONGEST_BYTES}"]
    subprocess.run([program, str(place / "merged"), corpus, *merge], check=True, stderr=subprocess.DEVNULL)
    return reached(control.read_text(encoding="utf-8"))


def reached(control: str) -> dict[bytes, frozenset[int]]:
    r"""Read a control file of libFuzzer: how many files, how many of the first folder, their names; what each reaches.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> _ = (folder / "a").write_bytes(b"x"), (folder / "b").write_bytes(b"y")
    >>> reached(f"2\n0\n{folder}/a\n{folder}/b\nSTARTED 0 1\nFT 0 8 17\nSTARTED 1 1\nFT 1 16 24\n")
    {b'x': frozenset({1, 2}), b'y': frozenset({2, 3})}
    """
    lines = control.splitlines()
    count = int(lines[0])
    files = [Path(line) for line in lines[2 : 2 + count]]
    # Eight features stand for one branch: how often it was taken.
    pieces = [line.split() for line in lines[2 + count :] if line.startswith("FT ")]
    return {files[int(piece[1])].read_bytes(): frozenset(int(word) // 8 for word in piece[2:]) for piece in pieces}


def chosen(cases: dict[bytes, frozenset[int]], count: int) -> list[bytes]:
    """Choose the cases that together reach most; of those that add as much the shortest.

    Examples
    --------
    >>> chosen({b"a": frozenset({1}), b"bb": frozenset({1, 2, 3}), b"c": frozenset({4}), b"dd": frozenset({4})}, 2)
    [b'bb', b'c']
    """
    left, known, taken = dict(cases), set[int](), list[bytes]()
    while left and len(taken) < count:
        best = min(left, key=lambda case: (-len(left[case] - known), len(case), case))
        if not left[best] - known:
            break
        known |= left.pop(best)
        taken.append(best)
    return taken


def main() -> int:
    """Seek, choose, and write what is kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=int, default=60, help="for each target (default 60)")
    parser.add_argument("--only", choices=targets(), action="append")
    parser.add_argument("--keep", type=int, default=12, help="cases of each target, at most (default 12)")
    args = parser.parse_args()
    names = args.only or targets()
    for name, program in built(names).items():
        with tempfile.TemporaryDirectory(prefix="rsflow-fuzz-") as folder:
            cases = found(program, name, args.seconds, Path(folder))
        kept = chosen(cases, args.keep)
        (SEEDS / name).mkdir(parents=True, exist_ok=True)
        for path in (SEEDS / name).iterdir():
            path.unlink()
        for case in kept:
            (SEEDS / name / hashlib.sha256(case).hexdigest()[:12]).write_bytes(case)
        whole = frozenset().union(*cases.values())
        part = frozenset().union(*(cases[case] for case in kept))
        print(
            f"{name}: {len(kept)} of {len(cases)} cases kept, {sum(map(len, kept))} bytes, which reach {len(part)} of "
            f"{len(whole)} branches",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
