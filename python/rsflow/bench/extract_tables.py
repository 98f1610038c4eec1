"""What a run over the whole job found, and the Markdown tables made of it."""

from __future__ import annotations

from dataclasses import dataclass

from .._display import fields
from ._markdown import markdown

__all__ = ["EXTRACT_MARKS", "ExtractBench", "ExtractRow", "PartRow"]

# What stands between these lines of a Markdown file is rewritten by `with_tables`.
EXTRACT_MARKS = ("<!-- extract-parts-start -->", "<!-- extract-parts-end -->")


@dataclass(frozen=True)
class ExtractRow:
    """How long `rsflow.extract` takes for a frame, beside one dense flow of OpenCV's DIS of it.

    Attributes
    ----------
    size : (int, int)
        Width and height of the frames.
    outputs : str
        "tables", or "tables and videos".
    time_ms, cpu_ms : float
        Of the clock, and of all processors, a frame.
    dis_time_ms, dis_cpu_ms : float
        Of DIS with its preset "medium", a pair of frames.

    Examples
    --------
    >>> row = ExtractRow((640, 480), "tables", 12.0, 20.0, 10.0, 20.0)
    >>> row.times, row.cpu_times
    (1.2, 1.0)
    """

    size: tuple[int, int]
    outputs: str
    time_ms: float
    cpu_ms: float
    dis_time_ms: float
    dis_cpu_ms: float

    @property
    def times(self) -> float:
        """How many times that of DIS the time by the clock is."""
        return self.time_ms / self.dis_time_ms

    @property
    def cpu_times(self) -> float:
        """How many times that of DIS the time of all processors is."""
        return self.cpu_ms / self.dis_cpu_ms


@dataclass(frozen=True)
class PartRow:
    """How much time of the processor a part of the job takes, with all outputs and each call on one thread.

    Attributes
    ----------
    size : (int, int)
    part : str
    cpu_ms : float
        A frame; without what other parts take that are called for it.

    Examples
    --------
    >>> PartRow((640, 480), "dense flow", 5.1).part
    'dense flow'
    """

    size: tuple[int, int]
    part: str
    cpu_ms: float


@dataclass(frozen=True, eq=False)
class ExtractBench:
    """All rows of a run over the whole job, and what it ran on.

    Attributes
    ----------
    rows : tuple of ExtractRow
    parts : tuple of PartRow
    threads : int
    cpu_level : str
        The instructions that rsflow used.
    frames : int
        Of each clip.
    versions : dict
        Of rsflow, OpenCV, numpy and Python.

    Examples
    --------
    >>> row = ExtractRow((640, 480), "tables", 12.0, 20.0, 10.0, 20.0)
    >>> print(ExtractBench((row,), (), 2, "avx2", 90, {"rsflow": "0.1.0"}).tables().splitlines()[2])
    | 640 x 480 | tables  | 12.00 ms |       1.20 |  20.00 ms |       1.00 |
    """

    rows: tuple[ExtractRow, ...]
    parts: tuple[PartRow, ...]
    threads: int
    cpu_level: str
    frames: int
    versions: dict[str, str]

    __repr__ = fields

    def tables(self) -> str:
        """Write a Markdown table of the whole, one of the parts, and a line on what they were measured on."""
        cells = [("frames", "outputs", "a frame", "times DIS", "processor", "times DIS")]
        cells += [
            (
                f"{row.size[0]} x {row.size[1]}", row.outputs, f"{row.time_ms:.2f} ms", f"{row.times:.2f}",
                f"{row.cpu_ms:.2f} ms", f"{row.cpu_times:.2f}",
            )
            for row in self.rows
        ]  # fmt: skip
        found = [markdown(cells)]
        if self.parts:
            sizes = list(dict.fromkeys(row.size for row in self.parts))
            of = {(row.size, row.part): row.cpu_ms for row in self.parts}
            names = sorted(
                {row.part for row in self.parts}, key=lambda part: -max(of.get((size, part), 0.0) for size in sizes)
            )
            parts = [("part, processor time a frame", *(f"{width} x {height}" for width, height in sizes))]
            parts += [(part, *(f"{of.get((size, part), 0.0):.3f} ms" for size in sizes)) for part in names]
            found.append(markdown(parts, words=1))
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        threads = f"{self.threads} thread{'' if self.threads == 1 else 's'}"
        return "\n\n".join([*found, f"CPU level {self.cpu_level}, {threads}, {self.frames} frames a clip; {versions}."])
