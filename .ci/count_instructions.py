"""Hold the instructions of the main kernels to the recorded ones.

    python .ci/count_instructions.py [--record]

A machine that other programs share cannot hold a time; an instruction is counted the same everywhere. Each kernel of
`crates/kernels` runs once under valgrind's callgrind, at the level `avx2` (valgrind knows no
AVX-512), and must not take more than MARGIN above what `.ci/instructions.json` says; where it takes less by that much,
a line asks for a new record (--record), so that the gain is not lost unseen. Without valgrind, or on another processor,
nothing is counted, and a line says so.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / ".ci" / "instructions.json"
# What compilers' versions and libraries change is about 1 %.
MARGIN = 0.03


def built() -> Path:
    """Build the kernels as users get them; the path of the program."""
    run = ["cargo", "build", "--release", "--locked", "--quiet", "-p", "kernels", "--message-format=json"]
    done = subprocess.run(run, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True)
    for line in done.stdout.splitlines():
        message = json.loads(line)
        if (
            message.get("reason") == "compiler-artifact"
            and message["target"]["name"] == "kernels"
            and message["executable"]
        ):
            return Path(message["executable"])
    raise SystemExit("cargo build: got no program named kernels")


def count(program: Path, kernel: str) -> int:
    """Count the instructions of one kernel."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        run = ["valgrind", "--tool=callgrind", "--toggle-collect=*measured_kernel*", f"--callgrind-out-file={out}"]
        done = subprocess.run(
            [*run, str(program), kernel],
            env=os.environ | {"RSFLOW_CPU": "avx2"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
    found = re.search(r"Collected : (\d+)", done.stdout)
    if done.returncode or found is None or int(found[1]) == 0:
        raise SystemExit(f"{kernel}: valgrind counted nothing\n{done.stdout}")
    return int(found[1])


def counted() -> dict[str, int]:
    """Count each kernel, two at a time."""
    program = built()
    listed = subprocess.run([program, "--list"], check=True, stdout=subprocess.PIPE, text=True).stdout
    kernels = listed.splitlines()
    with ThreadPoolExecutor(2) as pool:
        return dict(zip(kernels, pool.map(lambda kernel: count(program, kernel), kernels), strict=True))


def main() -> int:
    """Print a line a kernel; 1 where one takes more than it did, or the record is of other kernels."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="write what is counted as the new record")
    args = parser.parse_args()
    machine = platform.machine()
    if shutil.which("valgrind") is None or machine != "x86_64" or "avx2" not in Path("/proc/cpuinfo").read_text():
        print("instructions: not counted, that takes valgrind and an x86-64 processor with AVX2")
        return 0
    found = counted()
    if args.record:
        RECORD.write_text(json.dumps(found, indent=1) + "\n")
    recorded: dict[str, int] = json.loads(RECORD.read_text())
    if recorded.keys() != found.keys():
        changed = sorted(recorded.keys() ^ found.keys())
        print(f"{RECORD.name}: got other kernels than those of the benchmark ({', '.join(changed)}): --record")
        return 1
    worse = False
    for kernel, now in found.items():
        change = now / recorded[kernel] - 1.0
        said = ""
        if change > MARGIN:
            said, worse = f"  more than the {100 * MARGIN:g} % that are allowed", True
        elif change < -MARGIN:
            said = "  less: record it (python .ci/count_instructions.py --record)"
        print(f"{kernel:26s} {now:>12,} instructions, {100 * change:+6.2f} %{said}")
    return int(worse)


if __name__ == "__main__":
    sys.exit(main())
