"""The rows of a seeds.csv that tell of a stage on its own level."""

from __future__ import annotations

import csv
import gzip
import io
from pathlib import Path

Row = dict[str, str]


def read(path: Path) -> list[Row]:
    """A stage is evaluated on all levels; its outcome is that on the one that it is trained on. The file may be compressed."""
    opener = gzip.open if path.suffix == ".gz" else open
    with opener(path, "rb") as file:
        rows = [row for row in csv.DictReader(io.TextIOWrapper(file, encoding="utf-8", newline="")) if row["stage"]]

    def stage(row: Row) -> tuple[str, ...]:
        return row["arm"], row["sequence"], row["stage"], row["level"]

    trained = {stage(row) for row in rows if row["measure"] == "timesteps"}
    return [row for row in rows if stage(row) in trained]
