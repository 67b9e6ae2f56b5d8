"""seeds.csv, computed from the files of the runs themselves."""

from __future__ import annotations

import csv
import json
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from . import numbers as n
from .report import BEFORE, Checks, Report
from .tables import THRESHOLDS

Key = tuple[str, str, str, int, int, str, str]


def seeds(report: Report, roots: list[Path], checks: Checks) -> None:
    """Compares every row of seeds.csv with what the runs below these folders say."""
    with (report.directory / "seeds.csv").open(encoding="utf-8", newline="") as file:
        written = {_key(row): row["value"] for row in csv.DictReader(file)}
    found = {manifest.parent for root in roots for manifest in root.rglob("manifest.json")}
    computed: dict[Key, float] = {}
    for run in report.json["runs"]:
        # The report may have been made from another folder. Arm, sequence and seed end every path; those of a fork and
        # of the run that it comes from differ in the folders above.
        shared = {path: _shared(Path(run["path"]), path) for path in found}
        most = max([3, *shared.values()])
        same = [path for path in found if shared[path] == most]
        if len(same) != 1:
            checks.differences.append(f"{run['path']}: {len(same)} runs of this name are there")
            continue
        computed.update(_of_run(report, report.arms[run["arm"]], same[0]))
    for key in sorted(written.keys() | computed.keys()):
        checks.number(f"seeds.csv: {key}", written.get(key), computed.get(key))


def _shared(one: Path, other: Path) -> int:
    """How many folders two paths have in common, from the last one up."""
    pairs = list(zip(reversed(one.parts), reversed(other.resolve().parts)))
    return next((count for count, (a, b) in enumerate(pairs) if a != b), len(pairs))


def _key(row: dict[str, str]) -> Key:
    stage = int(row["stage"]) if row["stage"] else BEFORE
    return row["arm"], row["sequence"], row["treatment"], int(row["seed"]), stage, row["level"], row["measure"]


def _of_run(report: Report, arm: str, path: Path) -> Iterator[tuple[Key, float]]:
    manifest = json.loads((path / "manifest.json").read_text(encoding="utf-8"))
    done, fork = manifest["stages_done"], manifest.get("fork")
    # A fork lists the stages of its whole sequence, and trains those after its checkpoint.
    first = fork["after"] + 1 if fork else 0
    treatment = f"after-{fork['after']}:{fork['name']}" if fork else ""
    levels = {level["name"]: level for level in report.json["levels"]}

    def key(stage: int, level: str, measure: str) -> Key:
        return arm, manifest["curriculum"], treatment, manifest["seed"], stage, level, measure

    episodes: dict[tuple[str, int, str], list[dict[str, str]]] = defaultdict(list)
    for row in _rows(path / "evaluations.csv"):
        stage = int(row["stage"]) if row["phase"] == "after" else BEFORE
        if stage < done and row["level"] in levels:
            # Files of version 0.1.0 have greedy episodes alone, and do not say so.
            prefix = "sampled_" if row.get("policy", "greedy") == "sampled" else ""
            episodes[prefix, stage, row["level"]].append(row)
    for (prefix, stage, level), rows in episodes.items():
        for measure, value in _evaluation(levels[level], rows):
            yield key(stage, level, prefix + measure), value
    progress, plasticity = _by_stage(path / "progress.csv"), _by_stage(path / "plasticity.csv")
    for stage, entry in list(enumerate(manifest["stages"][:done]))[first:]:
        level = entry["level"]
        yield key(stage, level, "timesteps"), entry["timesteps"]
        curve = [
            (float(row["time/total_timesteps"]), float(row["rollout/ep_rew_mean"] or "nan"))
            for row in progress[stage]
        ]
        curve = [(time, _normalised(levels[level], value)) for time, value in curve if not math.isnan(value)]
        if curve and curve[0][1] is not None:
            for measure, value in outcomes_of(curve):
                yield key(stage, level, measure), value
        # The row at timestep 0 is before the first update.
        begin = [row for row in plasticity[stage] if int(row["timesteps"]) == 0]
        updates = [row for row in plasticity[stage] if int(row["timesteps"]) > 0]
        for prefix, rows in (("before/", begin), ("", updates)):
            for measure, value in (rows or [{}])[-1].items():
                is_place = measure in ("stage", "level", "timesteps", "cumulative_timesteps")
                if not is_place and not math.isnan(float(value)):
                    yield key(stage, level, prefix + measure), float(value)


def _rows(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _by_stage(path: Path) -> dict[int, list[dict[str, str]]]:
    stages: dict[int, list[dict[str, str]]] = defaultdict(list)
    for row in _rows(path):
        stages[int(row["stage"])].append(row)
    return stages


def _normalised(level: dict, value: float) -> float | None:
    """The share of the way from the worst return, -1 a step, to the mean optimum."""
    if level["optimal"] is None:
        return None
    worst = -max(level["max_steps"], 1)
    return (value - worst) / (n.mean([start["return"] for start in level["optimal"]["starts"]]) - worst)


def _evaluation(level: dict, rows: list[dict[str, str]]) -> Iterator[tuple[str, float]]:
    returns, lengths = ([float(row[column]) for row in rows] for column in ("return", "length"))
    solved = [row["solved"] == "true" for row in rows]
    yield "return", n.mean(returns)
    yield "return_std", n.deviation(returns)
    yield "solved_share", n.mean(solved)
    yield "length", n.mean(lengths)
    if level["optimal"] is None:
        return
    yield "normalised_return", _normalised(level, n.mean(returns))
    optimal = {"{} {}".format(*start["start"]): start["length"] for start in level["optimal"]["starts"]}
    best = [optimal[row["start"]] for row in rows]
    yield "steps", sum(lengths) / sum(best)
    if any(solved):
        both = [(length, least) for length, least, is_solved in zip(lengths, best, solved) if is_solved]
        yield "steps_solved", sum(length for length, _ in both) / sum(least for _, least in both)


def outcomes_of(curve: list[tuple[float, float]]) -> Iterator[tuple[str, float]]:
    """The area under a normalised learning curve, and when it reaches the thresholds."""
    (first, value), (last, _) = curve[0], curve[-1]
    steps = zip(curve, curve[1:])
    area = sum((later - time) * (after + before) / 2 for (time, before), (later, after) in steps)
    yield "area", area / (last - first) if last > first else value
    for threshold in THRESHOLDS:
        yield f"time_to_{threshold}", next((time for time, v in curve if v >= float(threshold)), math.inf)
