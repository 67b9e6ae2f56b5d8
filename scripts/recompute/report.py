"""What a report has: seeds.csv, the tables as CSV, and the names of arms and pairs in report.json."""

from __future__ import annotations

import csv
import json
import math
from collections import defaultdict
from pathlib import Path

# A table's numbers are compared in this share of themselves: far beyond the last digit that is printed.
TOLERANCE = 1e-9
BEFORE = -1

Values = dict[int, float]


class Report:
    """The numbers of single seeds, by arm, measure, stage and level."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.json = json.loads((directory / "report.json").read_text(encoding="utf-8"))
        self.arms = [arm["name"] for arm in self.json["arms"]]
        self.levels = [level["name"] for level in self.json["levels"]]
        # Forks have no place in tables with a column per level, nor in means over levels.
        self.forks = {arm["name"] for arm in self.json["arms"] if arm["protocol"] == "fork"}
        self.is_curriculum = {arm["name"]: arm["protocol"] == "curriculum" for arm in self.json["arms"]}
        self.stages = {
            arm["name"]: [self.levels[stage["level"]] for stage in arm["stages"]] for arm in self.json["arms"]
        }
        self._values: dict[tuple[str, str, int, str], Values] = defaultdict(dict)
        self._own: dict[tuple[str, str], dict[int, int]] = defaultdict(dict)
        with (directory / "seeds.csv").open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                stage = int(row["stage"]) if row["stage"] else BEFORE
                seed, value = int(row["seed"]), float(row["value"])
                self._values[row["arm"], row["measure"], stage, row["level"]][seed] = value
                # A stage that is done has its timesteps.
                if row["measure"] == "timesteps":
                    self._own[row["arm"], row["level"]][seed] = stage

    def after(self, arm: str, measure: str, stage: int, level: str) -> Values:
        """By seed: a measure on a level after a stage, or before all."""
        return self._values.get((arm, measure, stage, level), {})

    def right_after(self, arm: str, measure: str, level: str) -> Values:
        """By seed: a measure on a level right after training on it."""
        own = self._own.get((arm, level), {})
        values = {seed: self.after(arm, measure, stage, level).get(seed) for seed, stage in own.items()}
        return {seed: values[seed] for seed in sorted(values) if values[seed] is not None}

    def table(self, name: str) -> list[dict[str, str]] | None:
        """The rows of a table; none where the report has no such table."""
        path = self.directory / "tables" / f"{name}.csv"
        if not path.exists():
            return None
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))


class Checks:
    """What was compared, and what differs."""

    def __init__(self) -> None:
        self.compared = 0
        self.differences: list[str] = []

    def text(self, place: str, printed: str | None, expected: str) -> None:
        self.compared += 1
        if (printed or "") != expected:
            self.differences.append(f"{place}: the report has {printed or 'nothing'!r}, computed is {expected!r}")

    def number(self, place: str, printed: str | None, expected: float | None) -> None:
        """A number, or a cell that should be empty."""
        if expected is None or not printed:
            self.text(place, printed, "" if expected is None else repr(expected))
            return
        self.compared += 1
        # A row of the table may be damaged.
        try:
            value = float(printed)
        except ValueError:
            value = math.nan
        if value != expected and not abs(value - expected) <= TOLERANCE * max(1.0, abs(expected)):
            self.differences.append(f"{place}: the report has {printed}, computed is {expected!r}")
