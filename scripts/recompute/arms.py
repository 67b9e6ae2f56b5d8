"""The arms of a seeds.csv without forks, and the contrasts between them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from . import numbers as n
from . import outcomes
from .output import Row

LEVEL = 0.05
AREA = "area"
# In the name of a sequence of which each seed begins at another level.
SHIFTED = "-shift-"
# What the columns of an estimate are called.
ESTIMATE = ["mean", "low", "high", "seeds"]


@dataclass
class Arm:
    """One arm: values by sequence, measure and seed, each by stage; those from scratch by level and measure, each by seed."""

    values: dict[tuple[str, str, int], dict[int, float]] = field(default_factory=lambda: defaultdict(dict))
    level: dict[tuple[str, int], str] = field(default_factory=dict)
    scratch: dict[tuple[str, str], dict[int, float]] = field(default_factory=lambda: defaultdict(dict))

    def sequences(self) -> list[str]:
        return sorted({sequence for sequence, _ in self.level})


def read(path: Path) -> dict[str, Arm]:
    """The arms of a seeds.csv without forks, or of one that is compressed."""
    arms: dict[str, Arm] = {}
    for row in outcomes.read(path):
        if row["treatment"]:
            continue
        sequence, stage, level = row["sequence"], int(row["stage"]), row["level"]
        arm = arms.setdefault(row["arm"].split(",")[0].removesuffix(" (from scratch)"), Arm())
        seed, value = int(row["seed"]), float(row["value"])
        if sequence.startswith("level-"):
            arm.scratch[level, row["measure"]][seed] = value
        else:
            arm.level[sequence, stage] = level
            arm.values[sequence, row["measure"], seed][stage] = value
    return arms


@dataclass
class Life:
    """One seed's levels and areas, stage by stage."""

    seed: int
    stages: list[tuple[str, float]]
    sequence: str = ""


def lives(arm: Arm) -> list[Life]:
    """One of each seed, all of them finished.

    A seed that goes through several orders, or has fewer stages than others, raises a ValueError.
    """
    found: dict[int, Life] = {}
    last = 0
    for (sequence, measure, seed), areas in sorted(arm.values.items()):
        if measure != AREA:
            continue
        if seed in found:
            raise ValueError(f"seed {seed} goes through several orders: give a study whose seeds take them in turn")
        found[seed] = Life(seed, [(arm.level[sequence, stage], areas[stage]) for stage in sorted(areas)], sequence)
        last = max(last, *areas)
    short = [str(seed) for seed, life in sorted(found.items()) if len(life.stages) <= last]
    if short:
        raise ValueError(f"seeds {', '.join(short)} have fewer than {last + 1} stages: let their runs end first")
    return [found[seed] for seed in sorted(found)]


def means(pairs: Iterable[tuple[object, float]]) -> dict[object, float]:
    """The mean of the values of each key."""
    groups: dict[object, list[float]] = defaultdict(list)
    for key, value in pairs:
        groups[key].append(value)
    return {key: n.mean(values) for key, values in groups.items()}


def estimate(values: list[float]) -> Row:
    """Mean, t interval and number of values."""
    low, high = n.t_interval(values) or (None, None)
    return [n.mean(values) if values else None, low, high, len(values)]


def judged(contrasts: dict[str, list[float]], words: dict[str, tuple[str, str]]) -> Iterator[Row]:
    """Each contrast with its interval, its two-sided p-value after Holm's correction, and the verdict: the first of its
    words below 0, the second above."""
    p_values = {name: n.p_value(values) for name, values in contrasts.items()}
    adjusted = n.holm({name: p for name, p in p_values.items() if p is not None})
    for name, values in contrasts.items():
        p = adjusted.get(name)
        is_decided = p is not None and p < LEVEL
        yield [name, *estimate(values), p, words[name][n.mean(values) > 0] if is_decided else "undecided"]
