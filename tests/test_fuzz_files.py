"""Damaged files of every format: a result or an error of ours, within 1 GiB and 2 s.

Eight hundred by default; ``RSFLOW_FUZZ_CASES=5000`` runs that many, ``RSFLOW_FUZZ_SEED`` others.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

CASES = int(os.environ.get("RSFLOW_FUZZ_CASES", "800"))
SEED = int(os.environ.get("RSFLOW_FUZZ_SEED", "11"))


@pytest.mark.timeout(60 + CASES)
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc and RLIMIT_AS")
def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    script = Path(__file__).with_name("fuzz_files.py")
    outcomes: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    faults: list[str] = []
    first = 0
    print(f"seed {SEED}, {CASES} cases")
    while first < CASES:
        words = [sys.executable, str(script), str(tmp_path), str(SEED), str(first), str(CASES - first)]
        started: dict[str, object] = {}
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                said = json.loads(line)
                if "outcome" not in said:
                    started = said
                    continue
                first = said["case"] + 1
                outcomes[said["outcome"].split(":")[0]] += 1
                kinds[Path(str(started["name"])).suffix] += 1
                if said["outcome"].startswith("wrong"):
                    faults.append(f"case {said['case']} of {started['name']}: {said['outcome']}")
                started = {}
        if process.returncode:
            assert started, f"the program ended with {process.returncode} before case {first}"
            faults.append(f"case {started['case']} of {started['name']}: the process ended with {process.returncode}")
            first = int(str(started["case"])) + 1
    print(dict(outcomes), dict(kinds))
    assert not faults, "\n".join(faults)
    assert outcomes["refused"] > CASES / 4, "the files are hardly damaged"
    assert outcomes["read"] > CASES / 50, "nothing is read any more"
