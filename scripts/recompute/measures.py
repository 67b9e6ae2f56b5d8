"""Which measure before a stage goes with the area of the stage: docs/results/why/protocol-3.md, its last outcomes."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from itertools import accumulate
from operator import add, itemgetter, mul

from . import numbers as n
from .arms import Arm, lives, means
from .output import Row

RESAMPLES = 10_000
# Differences to a mean below this are of rounding, and would part what ties.
DIGITS = 12

SHOWN = [
    "policy_entropy/visited",
    "action_gap/visited",
    "policy.1/saturated_units/visited",
    "value.1/saturated_units/visited",
    "policy.1/dormant_0.1/visited",
    "value.1/dormant_0.1/visited",
    "q.1/dormant_0.1/visited",
    "policy.1/effective_rank/visited",
    "value.1/effective_rank/visited",
    "q.1/effective_rank/visited",
    "policy.1/weight_magnitude",
    "value.1/weight_magnitude",
    "q.1/weight_magnitude",
]


def _without_levels(levels: list[str], values: list[float]) -> list[float]:
    middle = means(zip(levels, values))
    return [round(value - middle[level], DIGITS) for level, value in zip(levels, values)]


class Ranked:
    """Values whose ranks are told when each of them is there several times, or not at all."""

    def __init__(self, values: list[float]) -> None:
        places = sorted(range(len(values)), key=values.__getitem__)
        ordered = [values[place] for place in places]
        first = {value: at for at, value in reversed(list(enumerate(ordered)))}
        end = {value: at for at, value in enumerate(ordered, 1)}
        self.ordered = itemgetter(*places)
        self.first = itemgetter(*(first[value] for value in values))
        self.end = itemgetter(*(end[value] for value in values))

    def ranks(self, counts: list[int]) -> list[int]:
        """Twice the rank of each value minus one, ties sharing their mean. Their weighted mean is the sum of the counts."""
        until = [0, *accumulate(self.ordered(counts))]
        return list(map(add, self.first(until), self.end(until)))


class Weighted:
    """Ranks of values that are there so many times, by their `Ranked.ranks`."""

    def __init__(self, counts: list[int], ranks: list[int]) -> None:
        self.cube = sum(counts) ** 3
        self.weighted = list(map(mul, counts, ranks))
        self.spread = sum(map(mul, self.weighted, ranks)) - self.cube

    def spearman(self, counts: list[int], other: list[int]) -> float | None:
        """With other ranks of as many values; none where either is the same throughout."""
        spread = self.spread * (sum(map(mul, map(mul, counts, other), other)) - self.cube)
        return (sum(map(mul, self.weighted, other)) - self.cube) / math.sqrt(spread) if spread else None


def correlations(
    seeds: list[int], areas: list[float], measured: dict[str, list[float]]
) -> Iterator[tuple[str, float | None, n.Bounds]]:
    """Spearman's of each measure with the area, and its percentile interval. A seed is drawn whole, with all its stages.
    There is no interval where a resample has none."""
    names = sorted(set(seeds))
    owner = itemgetter(*(names.index(seed) for seed in seeds))
    area, ranked = Ranked(areas), {name: Ranked(values) for name, values in measured.items()}
    once = [1] * len(seeds)
    of_area = Weighted(once, area.ranks(once))
    found = {name: of_area.spearman(once, of.ranks(once)) for name, of in ranked.items()}
    drawn: dict[str, list[float | None]] = {name: [] for name, value in found.items() if value is not None}
    for [taken] in n.draws((len(names),), RESAMPLES) if drawn and len(names) > 1 else []:
        times = [0] * len(names)
        for place in taken:
            times[place] += 1
        counts = owner(times)
        of_area = Weighted(counts, area.ranks(counts))
        for name, values in drawn.items():
            values.append(of_area.spearman(counts, ranked[name].ranks(counts)))
    for name, value in found.items():
        distribution = drawn.get(name)
        yield name, value, n.percentile(distribution) if distribution and None not in distribution else None


def measures(arm: Arm) -> Iterator[Row]:
    """Measure, rank correlation, its bounds, and how many stages and seeds it is of: all that have the measure, but for
    position 0."""
    stages = [(life, at, *stage) for life in lives(arm) for at, stage in enumerate(life.stages) if at > 0]
    # Measures of the same stages are drawn together.
    groups: dict[tuple[int, ...], dict[str, list[float]]] = defaultdict(dict)
    for name in SHOWN:
        column = f"before/plasticity/{name}"
        values = [arm.values.get((life.sequence, column, life.seed), {}).get(at) for life, at, *_ in stages]
        there = tuple(place for place, value in enumerate(values) if value is not None and math.isfinite(value))
        if len(there) > 1:
            groups[there][name] = [values[place] for place in there]
    rows = {}
    for there, measured in groups.items():
        among = [stages[place] for place in there]
        levels, seeds = [level for *_, level, _ in among], [life.seed for life, *_ in among]
        areas = _without_levels(levels, [area for *_, area in among])
        residuals = {name: _without_levels(levels, values) for name, values in measured.items()}
        for name, value, bounds in correlations(seeds, areas, residuals):
            rows[name] = [name, value, *(bounds or (None, None)), len(among), len(set(seeds))]
    yield from (rows[name] for name in SHOWN if name in rows)
