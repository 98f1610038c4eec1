"""The tables of a result as Parquet beside the CSV files, a row group for each part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from .._extras import require
from ..extraction.columns import INTEGERS, WORDS
from ..io.atomic import writing

__all__ = ["as_parquet"]

_TABLES = ("motion", "objects", "velocity", "trajectory")


def as_parquet(files: Mapping[str, Path], rows: Sequence[Mapping[str, int]] | None) -> list[Path]:
    """Write each table of a result as Parquet too.

    Parameters
    ----------
    files : mapping of str to Path
        Of an `Extraction`.
    rows : sequence of mappings, optional
        How many rows each part has in each table; by default all are one row group.

    Returns
    -------
    list of Path
        The files that were written.

    Raises
    ------
    MissingExtraError
        If pyarrow is not installed.
    """
    pyarrow = require("pyarrow", extra="parquet", purpose="writing Parquet")
    csv = require("pyarrow.csv", extra="parquet", purpose="writing Parquet")
    parquet = require("pyarrow.parquet", extra="parquet", purpose="writing Parquet")
    written = []
    for name in _TABLES:
        if name not in files:
            continue
        header = files[name].open(encoding="utf-8").readline().strip().split(",")
        kinds = {
            column: pyarrow.string()
            if column in WORDS
            else pyarrow.int64()
            if column in INTEGERS
            else pyarrow.float64()
            for column in header
        }
        told = csv.ConvertOptions(column_types=kinds, null_values=[""], strings_can_be_null=False)
        table = csv.read_csv(files[name], convert_options=told)
        counts = [part.get(name, 0) for part in rows] if rows is not None else [table.num_rows]
        path = files[name].with_suffix(".parquet")
        with writing(path) as partial, parquet.ParquetWriter(partial, table.schema) as file:
            begin = 0
            for count in counts:
                file.write_table(table.slice(begin, count), row_group_size=max(count, 1))
                begin += count
        written.append(path)
    return written
