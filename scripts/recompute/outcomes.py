"""The rows of a seeds.csv that tell of a stage on its own level."""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterator
from pathlib import Path

Row = dict[str, str]


def read(path: Path) -> Iterator[Row]:
    """A stage is evaluated on all levels; its outcome is that on the one that it is trained on. The file may be compressed.
    It is read twice, since a study of many levels has far more rows than outcomes.
    """

    def stage(row: Row) -> tuple[str, ...]:
        return row["arm"], row["sequence"], row["stage"], row["level"]

    trained = {stage(row) for row in _rows(path) if row["measure"] == "timesteps"}
    return (row for row in _rows(path) if stage(row) in trained)


def _rows(path: Path) -> Iterator[Row]:
    """Those after a stage."""
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rb") as file:
        for row in csv.DictReader(io.TextIOWrapper(file, encoding="utf-8", newline="")):
            if row["stage"]:
                yield row
