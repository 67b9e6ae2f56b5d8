"""Age and orders: docs/results/why/protocol-2.md, sections 3 and 4, written from its definitions."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from . import numbers as n
from . import outcomes
from .output import Row

LEVEL = 0.05
AREA, ENTROPY = "area", "before/plasticity/policy_entropy/visited"


@dataclass
class Arm:
    """One arm: values by sequence, measure, seed and stage; those from scratch by level, measure and seed."""

    values: dict[tuple[str, str, int, int], float] = field(default_factory=dict)
    level: dict[tuple[str, int], str] = field(default_factory=dict)
    scratch: dict[tuple[str, str], dict[int, float]] = field(default_factory=lambda: defaultdict(dict))

    def sequences(self) -> list[str]:
        return sorted({sequence for sequence, _ in self.level})

    def seeds(self, sequence: str) -> list[int]:
        return sorted({seed for s, measure, seed, _ in self.values if (s, measure) == (sequence, AREA)})

    def areas(self, sequence: str, seed: int) -> list[tuple[str, float]]:
        """Level and area of each stage."""
        found = {at: value for (s, m, of, at), value in self.values.items() if (s, m, of) == (sequence, AREA, seed)}
        return [(self.level[sequence, stage], found[stage]) for stage in sorted(found)]


def read(path: Path) -> dict[str, Arm]:
    """The arms of a seeds.csv without forks, or of one that is compressed."""
    arms: dict[str, Arm] = {}
    for row in outcomes.read(path):
        if row["treatment"]:
            continue
        sequence, stage, level = row["sequence"], row["stage"], row["level"]
        arm = arms.setdefault(row["arm"].split(",")[0].removesuffix(" (from scratch)"), Arm())
        seed, value = int(row["seed"]), float(row["value"])
        if sequence.startswith("level-"):
            arm.scratch[level, row["measure"]][seed] = value
        else:
            arm.level[sequence, int(stage)] = level
            arm.values[sequence, row["measure"], seed, int(stage)] = value
    return arms


def estimate(values: list[float]) -> Row:
    """Mean, t interval and number of values."""
    low, high = n.t_interval(values) or (None, None)
    return [n.mean(values) if values else None, low, high, len(values)]


def judged(contrasts: dict[str, list[float]], words: dict[str, str]) -> Iterator[Row]:
    """Each contrast with its interval, its two-sided p-value after Holm's correction, and the verdict in these words."""
    p_values = {name: n.p_value(values) for name, values in contrasts.items()}
    adjusted = n.holm({name: p for name, p in p_values.items() if p is not None})
    for name, values in contrasts.items():
        p = adjusted.get(name)
        is_decided = p is not None and p < LEVEL
        yield [name, *estimate(values), p, words[name] if is_decided else "undecided"]


# --- 3. Age ----------------------------------------------------------------------------------------------------------

AGES = ["young", "old", "curriculum"]
# The sequence with all levels in their order.
CURRICULUM = "curriculum-01234"


def _aged(arm: Arm, age: str, stage: int, measure: str) -> dict[int, float]:
    """Values of the stage that follows the switch, by seed."""
    if age == "curriculum":
        sequence, last = CURRICULUM, stage
    else:
        sequence, last = f"{age}-{stage}", stage if age == "old" else 1
    found = ((seed, at, value) for (s, m, seed, at), value in arm.values.items() if (s, m) == (sequence, measure))
    return {seed: value for seed, at, value in found if at == last}


def has_ages(arm: Arm) -> bool:
    return {CURRICULUM, "young-2", "old-2"} <= set(arm.sequences())


def _stages(arm: Arm) -> list[int]:
    return sorted(int(s.removeprefix("old-")) for s in arm.sequences() if s.startswith("old-"))


def ages(arm: Arm) -> Iterator[Row]:
    """Area and entropy at the switch by stage and age."""
    for stage in _stages(arm):
        for age in AGES:
            areas, entropies = (list(_aged(arm, age, stage, measure).values()) for measure in (AREA, ENTROPY))
            yield [stage, age, *estimate(areas), n.mean(entropies) if entropies else None]
        yield [stage, "from scratch", *estimate(list(arm.scratch[str(stage), AREA].values())), None]


def age_contrasts(arm: Arm) -> Iterator[Row]:
    """The two contrasts over all stages, judged, and at each stage."""

    def difference(one: str, other: str, stages: list[int]) -> list[float]:
        pairs = [(_aged(arm, one, stage, AREA), _aged(arm, other, stage, AREA)) for stage in stages]
        seeds = sorted(set.intersection(*(set(values) for pair in pairs for values in pair)))
        return [n.mean([a[seed] - b[seed] for a, b in pairs]) for seed in seeds]

    contrasts = {"old - young": ("old", "young"), "curriculum - old": ("curriculum", "old")}
    words = {"old - young": "age matters", "curriculum - old": "other levels matter"}
    pooled = {name: difference(*of, _stages(arm)) for name, of in contrasts.items()}
    for row in judged(pooled, words):
        yield ["all", *row]
    for stage in _stages(arm):
        for name, of in contrasts.items():
            yield [stage, name, *estimate(difference(*of, [stage])), None, ""]


# --- 4. Orders -------------------------------------------------------------------------------------------------------


def has_orders(arm: Arm) -> bool:
    return any(sequence.startswith("order-") for sequence in arm.sequences())


@dataclass
class Life:
    """One seed's levels and areas, stage by stage."""

    seed: int
    stages: list[tuple[str, float]]


def lives(arm: Arm) -> list[Life]:
    """One of each seed, all of them finished.

    A seed that goes through several orders, or has fewer stages than others, raises a ValueError.
    """
    found: dict[int, Life] = {}
    for sequence in arm.sequences():
        for seed in arm.seeds(sequence):
            if seed in found:
                raise ValueError(f"seed {seed} goes through several orders: give a study whose seeds take them in turn")
            found[seed] = Life(seed, arm.areas(sequence, seed))
    most = max(len(life.stages) for life in found.values())
    short = [str(seed) for seed, life in sorted(found.items()) if len(life.stages) < most]
    if short:
        raise ValueError(f"seeds {', '.join(short)} have fewer than {most} stages: let their runs end first")
    return [found[seed] for seed in sorted(found)]


def is_balanced(all_lives: list[Life]) -> bool:
    """Whether every level stands at every position equally often."""
    counts = Counter((at, level) for life in all_lives for at, (level, _) in enumerate(life.stages))
    levels = {level for _, level in counts}
    return len(counts) == len(levels) * len(all_lives[0].stages) and len(set(counts.values())) == 1


def _means(pairs: Iterator[tuple[object, float]]) -> dict[object, float]:
    groups: dict[object, list[float]] = defaultdict(list)
    for key, value in pairs:
        groups[key].append(value)
    return {key: n.mean(values) for key, values in groups.items()}


def _slope(values: list[tuple[int, float]]) -> float:
    x = n.mean([float(at) for at, _ in values])
    return sum((at - x) * value for at, value in values) / sum((at - x) ** 2 for at, _ in values)


def slopes(all_lives: list[Life]) -> dict[int, float]:
    """Of the area over positions 1 to the last, the mean of each level over these subtracted; by seed."""
    levels = _means((level, area) for life in all_lives for level, area in life.stages[1:])
    return {
        life.seed: _slope([(at, area - levels[level]) for at, (level, area) in enumerate(life.stages) if at > 0])
        for life in all_lives
    }


def losses(all_lives: list[Life]) -> dict[int, float]:
    """Mean area at positions 1 to the last minus that at position 0, the mean of each level at position 0 subtracted from
    both; by seed. So what is a seed's own cancels, and the means of levels do so where orders are balanced."""
    first = _means(life.stages[0] for life in all_lives)
    lost = {}
    for life in all_lives:
        here = [area - first[level] for level, area in life.stages if level in first]
        if len(here) > 1:
            lost[life.seed] = n.mean(here[1:]) - here[0]
    return lost


def positions(arm: Arm) -> Iterator[Row]:
    """Mean area by position and level."""
    all_lives = lives(arm)
    levels = sorted({level for life in all_lives for level, _ in life.stages})
    for position in range(len(all_lives[0].stages)):
        here = [life.stages[position] for life in all_lives]
        for level in levels:
            yield [position, level, *estimate([area for of, area in here if of == level])]
        yield [position, "all", *estimate([area for _, area in here])]


def order_contrasts(arms: dict[str, Arm]) -> Iterator[Row]:
    """Slope over positions and loss, of each arm, and of each arm against the first."""
    all_lives = {name: lives(arm) for name, arm in sorted(arms.items())}
    of = {name: (slopes(of_arm), losses(of_arm)) for name, of_arm in all_lives.items()}
    for name, (slope, loss) in of.items():
        row = estimate(list(slope.values()))
        verdict = "the loss grows" if row[2] is not None and row[2] < 0 else "no growth shown"
        yield [name, "slope over positions 1 to the last", *row, verdict if is_balanced(all_lives[name]) else "orders are not balanced"]
        yield [name, "area with a past minus at position 0", *estimate(list(loss.values())), ""]
    (one, first), *others = of.items()
    for other, second in others:
        for title, a, b in zip(["slope", "area with a past minus at position 0"], first, second):
            yield [f"{other} - {one}", title, *estimate([b[seed] - a[seed] for seed in sorted(a.keys() & b.keys())]), ""]


def predecessors(arm: Arm) -> Iterator[Row]:
    """What remains of the area of a level after another one, without the means of level and position, which the intervals
    take as they are."""
    after = [
        (life.seed, life.stages[at - 1][0], level, at, area)
        for life in lives(arm)
        for at, (level, area) in enumerate(life.stages)
        if at > 0
    ]
    whole = n.mean([area for *_, area in after])
    levels = _means((level, area) for _, _, level, _, area in after)
    places = _means((at, area) for *_, at, area in after)
    groups: dict[tuple[str, str], list[float]] = defaultdict(list)
    for _, before, level, at, area in after:
        groups[level, before].append(area - levels[level] - places[at] + whole)
    means = [n.mean(values) for values in groups.values()]
    yield ["largest minus smallest", "", max(means) - min(means), None, None, len(after)]
    for (level, before), values in sorted(groups.items()):
        low, high = n.bootstrap([values], lambda scores: n.mean(scores[0])) or (None, None)
        yield [level, before, n.mean(values), low, high, len(values)]
