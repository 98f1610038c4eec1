"""Install and run what `make dist` made, as a stranger would: the wheel without Rust, the source distribution with it.

    python .ci/check_dist.py dist

Each goes into a new environment of its own. The wheel must be small, promise old systems, import fast, measure a known
motion with every level of CPU (`check_wheel.py`) and do the main job (`rsflow demo`) with nothing but its two
dependencies; no Rust tool is on the path then.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

HERE = Path(__file__).resolve().parent
LARGEST_MB = 5.0
LONGEST_IMPORT_MS = 100.0


def alone(folder: Path, python: Path) -> dict[str, str]:
    """Give an environment whose path leads to no Rust tool and whose Python finds no other packages."""
    tools = {"cargo", "rustc", "maturin"}
    places = [p for p in os.environ["PATH"].split(os.pathsep) if not any((Path(p) / tool).exists() for tool in tools)]
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "CARGO", "RUST"))}
    return kept | {"PATH": os.pathsep.join([str(python.parent), *places]), "HOME": str(folder)}


def environment(folder: Path) -> Path:
    """Make a virtual environment; its Python."""
    venv.create(folder, with_pip=True)
    return folder / "bin" / "python"


def import_ms(python: Path, env: dict[str, str]) -> float:
    """Time the import of rsflow beyond that of numpy, the median of some runs."""
    code = "import numpy, time; begin = time.perf_counter(); import rsflow; print(1e3 * (time.perf_counter() - begin))"
    times = [
        float(subprocess.run([python, "-c", code], env=env, check=True, stdout=subprocess.PIPE, text=True).stdout)
        for _ in range(9)
    ]
    return statistics.median(times[2:])


def check_wheel(wheel: Path, folder: Path) -> None:
    """Install the wheel without Rust and use it."""
    size = wheel.stat().st_size / 1e6
    print(f"{wheel.name}: {size:.2f} MB")
    if size > LARGEST_MB:
        raise SystemExit(f"{wheel.name}: got {size:.2f} MB, expected at most {LARGEST_MB:g} MB")
    if sys.platform == "linux" and not any(tag in wheel.name for tag in ("manylinux", "musllinux")):
        raise SystemExit(f"{wheel.name}: got a wheel for this machine alone, expected one for manylinux or musllinux")
    python = environment(folder / "wheel")
    env = alone(folder, python)
    run = {"env": env, "check": True, "cwd": folder}
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--only-binary", ":all:", str(wheel)], **run)
    subprocess.run([python, HERE / "check_wheel.py"], **run)
    took = import_ms(python, env)
    print(f"import rsflow: {took:.0f} ms beyond numpy")
    if took > LONGEST_IMPORT_MS:
        raise SystemExit(f"import rsflow: got {took:.0f} ms beyond numpy, expected at most {LONGEST_IMPORT_MS:g} ms")
    subprocess.run([python, "-m", "rsflow", "demo", "-o", "demo"], stdout=subprocess.DEVNULL, **run)
    print("rsflow demo:", ", ".join(sorted(file.name for file in (folder / "demo").iterdir())))


def check_sdist(sdist: Path, folder: Path) -> None:
    """Build and install the source distribution, and use it."""
    if shutil.which("cargo") is None:
        raise SystemExit("cargo: not found; the source distribution takes a Rust toolchain")
    python = environment(folder / "sdist")
    subprocess.run([python, "-m", "pip", "install", "--quiet", str(sdist)], check=True, cwd=folder)
    subprocess.run([python, HERE / "check_wheel.py"], check=True, cwd=folder)


def main() -> int:
    """Check all that is in the folder."""
    if len(sys.argv) != 2:
        raise SystemExit("usage: python .ci/check_dist.py FOLDER")
    made = Path(sys.argv[1]).resolve()
    wheels, sdists = sorted(made.glob("*.whl")), sorted(made.glob("*.tar.gz"))
    if len(wheels) != 1 or len(sdists) != 1:
        found = f"{len(wheels)} wheels and {len(sdists)} source distributions"
        raise SystemExit(f"{made}: got {found}, expected one of each")
    for file, check in ((wheels[0], check_wheel), (sdists[0], check_sdist)):
        with tempfile.TemporaryDirectory() as folder:
            check(file, Path(folder))
        print(f"{file.name}: installed and run")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
