"""The figures of scale.md: throughput measured here (--measure), and a simulated run on 1,000 workers.

python docs/explanation/scale_figures.py --measure     # minutes; writes scale_measured.json
python docs/explanation/scale_figures.py               # writes the tables of scale.md from that
"""

from __future__ import annotations

import argparse
import datetime
import heapq
import json
import platform
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
PAGE, MEASURED = HERE / "scale.md", HERE / "scale_measured.json"
SIZES = ((320, 240), (640, 480))
# Runs of each kind, which take turns; the median is kept.
ROUNDS = 3
RATE = 30.0

# --- measured -------------------------------------------------------------------------------------------------------


def measure() -> dict:
    """CPU time of a frame by what is done with it, on one thread."""
    import cv2

    import rsflow

    rsflow.set_num_threads(1)
    cv2.setNumThreads(1)
    with tempfile.TemporaryDirectory() as folder:
        sizes = [one_size(Path(folder), size) for size in SIZES]
    info = rsflow.build_info()
    return {
        "date": datetime.date.today().isoformat(),
        "cpu": cpu_name(),
        "level": str(info.get("cpu_level", info.get("cpu", ""))),
        "versions": f"rsflow {rsflow.__version__}, Python {platform.python_version()}, OpenCV {cv2.__version__}",
        "rounds": ROUNDS,
        "sizes": sizes,
        "steps_per_second": steps_per_second(),
    }


def cpu_name() -> str:
    """Name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())


def one_size(folder: Path, size: tuple[int, int]) -> dict:
    """Measure with frames of one size."""
    import rsflow
    from rsflow import synthetic

    frames = 60
    scene = synthetic.moving_things(frames=frames, size=size, seed=2)
    clip, camera = folder / f"{size[0]}.mp4", folder / f"{size[0]}.json"
    with rsflow.VideoWriter(clip, frame_rate=RATE) as video:
        for image in scene.images:
            video.write(image)
    focal = 0.8 * size[0]
    rsflow.Camera(focal, focal, size[0] / 2, size[1] / 2, width=size[0], height=size[1]).save(camera)

    def decoded() -> None:
        with rsflow.frames(clip, color=True) as source:
            for _ in source:
                pass

    def extracted(**options: object) -> None:
        with tempfile.TemporaryDirectory(dir=folder) as out:
            done = rsflow.extract(clip, out, camera_motion="moving", **options)
            sizes.update({name: path.stat().st_size / frames for name, path in done.files.items()})

    metric = {"camera": camera, "height_m": 1.0}
    sizes: dict[str, float] = {}
    jobs = {
        "decode": decoded,
        "tables": lambda: extracted(videos=False),
        "tables and velocity": lambda: extracted(videos=False, **metric),
        "all with videos": lambda: extracted(**metric),
    }
    taken: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            begin = time.process_time()
            job()
            taken[name].append(1e3 * (time.process_time() - begin) / frames)
    return {
        "width": size[0],
        "height": size[1],
        "ms": {name: round(float(np.median(times)), 2) for name, times in taken.items()},
        "table_bytes": round(sum(sizes[name] for name in ("motion", "velocity", "trajectory", "objects"))),
        "video_bytes": round(sum(sizes[name] for name in ("flow", "moving", "static"))),
        "source_bytes": round(clip.stat().st_size / frames),
    }


def steps_per_second() -> float:
    """How many steps the loop of a batch hands out and takes back in a second, of sources that are no videos."""
    from concurrent.futures import ThreadPoolExecutor

    from rsflow.batch import extract_many

    count = 2000
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as pool:
        sources = [f"{folder}/{k}.mp4" for k in range(count)]
        begin = time.process_time()
        extract_many(sources, f"{folder}/out", executor=pool, at_once=lambda: 2000)
        return round(count / (time.process_time() - begin))


# --- simulated ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fleet:
    """Workers of one core each: how many are slow and by how much, how often they fail, how long they are away."""

    workers: int = 1000
    slow_share: float = 0.05
    slowness: float = 3.0
    spread: float = 0.1
    mean_hours_to_failure: float = 24.0
    away_s: float = 300.0
    seed: int = 1


@dataclass(frozen=True)
class Outcome:
    """Of a simulated run: how long it took beside a perfect one, work that was lost, failures, steps."""

    hours: float
    ideal_hours: float
    lost_share: float
    extra_share: float
    failures: int
    steps: int


def videos_of(hours: float, seed: int = 0) -> np.ndarray:
    """Seconds of videos that are together so long: most of minutes, some of a day."""
    rng = np.random.default_rng(seed)
    found = np.minimum(rng.lognormal(np.log(1200.0), 1.3, int(hours * 3600 / 2000) + 100), 86_400.0)
    return found[: int(np.searchsorted(np.cumsum(found), hours * 3600.0)) + 1]


def simulate(videos_s: np.ndarray, ms_per_frame: float, part_s: float | None, fleet: Fleet) -> Outcome:
    """Run all videos: a worker that is free takes the next step; one that fails loses the step at hand.

    Steps are handed out as `rsflow batch` does: in the order of the videos. A step of a part costs its frames and
    those of the overlap.
    """
    overlap_s = 60 / RATE
    cost = ms_per_frame * 1e-3 * RATE
    steps: list[float] = []
    for video_s in videos_s:
        count = 1 if part_s is None else max(1, int(video_s // part_s))
        if count == 1:
            steps.append(float(video_s) * cost)
            continue
        steps += [(part_s + (overlap_s if k else 0.0)) * cost for k in range(count - 1)]
        steps.append((float(video_s) - part_s * (count - 1) + overlap_s) * cost)
    rng = np.random.default_rng(fleet.seed)
    speed = rng.lognormal(0.0, fleet.spread, fleet.workers)
    speed[: round(fleet.slow_share * fleet.workers)] /= fleet.slowness
    mean_s = fleet.mean_hours_to_failure * 3600.0
    fails_s = rng.exponential(mean_s, fleet.workers) if np.isfinite(mean_s) else np.full(fleet.workers, np.inf)
    free = [(0.0, worker) for worker in range(fleet.workers)]
    heapq.heapify(free)
    waiting = steps[::-1]
    # Steps that were lost are known when their worker fails, and are done again first.
    lost: list[tuple[float, float]] = []
    end_s = lost_s = 0.0
    failures = 0
    while waiting or lost:
        now_s, worker = heapq.heappop(free)
        if lost and lost[0][0] <= now_s:
            step = heapq.heappop(lost)[1]
        elif waiting:
            step = waiting.pop()
        else:
            # Nothing to do until something fails.
            heapq.heappush(free, (lost[0][0], worker))
            continue
        begin_s = now_s
        while fails_s[worker] < begin_s:
            fails_s[worker] += rng.exponential(mean_s)
        done_s = begin_s + step / speed[worker]
        if fails_s[worker] < done_s:
            failures += 1
            lost_s += fails_s[worker] - begin_s
            heapq.heappush(lost, (float(fails_s[worker]), step))
            heapq.heappush(free, (float(fails_s[worker]) + fleet.away_s, worker))
            continue
        end_s = max(end_s, done_s)
        heapq.heappush(free, (done_s, worker))
    needed_s = float(np.sum(videos_s)) * cost
    ideal_s = needed_s / float(speed.sum())
    return Outcome(
        end_s / 3600.0,
        ideal_s / 3600.0,
        lost_s / (end_s * fleet.workers),
        sum(steps) / needed_s - 1.0,
        failures,
        len(steps),
    )


# --- the page -------------------------------------------------------------------------------------------------------


def table(head: list[str], rows: list[list[str]]) -> str:
    """Write a table."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def measured_table(told: dict) -> str:
    """Write what was measured."""
    rows = []
    for one in told["sizes"]:
        ms = one["ms"]
        rows.append(
            [
                f"{one['width']} x {one['height']}",
                *(f"{ms[name]:.1f} ms" for name in ("decode", "tables", "tables and velocity", "all with videos")),
                f"{one['table_bytes']} B",
            ]
        )
    head = ["frame", "decoded", "tables", "and velocity", "and videos", "tables a frame"]
    return table(head, rows)


def million_table(told: dict) -> str:
    """Tell of a million hours of video: processor hours, days on 1,000 workers, what is written."""
    rows = []
    for one in told["sizes"]:
        for name in ("tables", "all with videos"):
            hours = 1e6 * RATE * one["ms"][name] * 1e-3
            written = one["table_bytes"] + (one["video_bytes"] if name.startswith("all") else 0)
            rows.append(
                [
                    f"{one['width']} x {one['height']}, {name}",
                    f"{hours / 1e6:.2f} million",
                    f"{1e3 / one['ms'][name] / RATE:.2f}",
                    f"{hours / 1000 / 24:.0f}",
                    f"{written * RATE * 3600 * 1e6 / 1e12:.0f} TB",
                ]
            )
    head = ["", "processor hours", "times real time, one processor", "days on 1,000 processors", "written"]
    return table(head, rows)


PARTS = ((None, "not cut"), (7200.0, "2 h"), (1800.0, "30 min"), (600.0, "10 min"), (120.0, "2 min"))
HOURS = 10_000.0


def simulated_table(told: dict) -> str:
    """Write what the simulated runs gave, by the length of parts."""
    ms = told["sizes"][1]["ms"]["tables"]
    videos = videos_of(HOURS)
    rows = []
    for part_s, name in PARTS:
        calm = simulate(videos, ms, part_s, Fleet(slow_share=0.0, spread=0.0, mean_hours_to_failure=np.inf))
        slow = simulate(videos, ms, part_s, Fleet(mean_hours_to_failure=np.inf))
        hard = simulate(videos, ms, part_s, Fleet())
        rows.append(
            [
                name,
                f"{hard.steps}",
                *(f"{one.hours:.1f} h ({one.hours / one.ideal_hours:.2f})" for one in (calm, slow, hard)),
                f"{hard.failures}",
                f"{100 * hard.lost_share:.1f} %",
                f"{100 * hard.extra_share:.2f} %",
            ]
        )
    head = ["parts", "steps", "equal workers", "with stragglers", "and failures", "failures", "lost", "overlap"]
    return table(head, rows)


def sections() -> dict[str, str]:
    """Give what stands between the marks of the page."""
    told = json.loads(MEASURED.read_text())
    by = f"Measured {told['date']} on one processor of {told['cpu']}, {told['versions']}; "
    by += "one run of 60 frames." if told["rounds"] == 1 else f"medians of {told['rounds']} runs of 60 frames."
    return {
        "measured": f"{by}\n\n{measured_table(told)}",
        "million": million_table(told),
        "simulated": simulated_table(told),
        "steps": f"{told['steps_per_second']:.0f} steps a second",
    }


def written(page: str) -> str:
    """Give the page with its tables written anew."""
    for name, text in sections().items():
        begin, end = f"<!-- {name}-start -->", f"<!-- {name}-end -->"
        before, rest = page.split(begin)
        after = rest.split(end)[1]
        space = " " if name == "steps" else "\n\n"
        page = before + begin + space + text + space + end + after
    return page


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--measure", action="store_true")
    if parser.parse_args().measure:
        MEASURED.write_text(json.dumps(measure(), indent=1) + "\n")
    PAGE.write_text(written(PAGE.read_text()))
