"""Age and orders: docs/results/why/protocol-2.md, sections 3 and 4, written from its definitions."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator

from . import numbers as n
from .arms import AREA, SHIFTED, Arm, Life, estimate, judged, lives, means
from .output import Row

ENTROPY = "before/plasticity/policy_entropy/visited"


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
    found = {seed: stages for (s, m, seed), stages in arm.values.items() if (s, m) == (sequence, measure)}
    return {seed: stages[last] for seed, stages in found.items() if last in stages}


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
    words = {"old - young": ("age matters",) * 2, "curriculum - old": ("other levels matter",) * 2}
    pooled = {name: difference(*of, _stages(arm)) for name, of in contrasts.items()}
    for row in judged(pooled, words):
        yield ["all", *row]
    for stage in _stages(arm):
        for name, of in contrasts.items():
            yield [stage, name, *estimate(difference(*of, [stage])), None, ""]


# --- 4. Orders -------------------------------------------------------------------------------------------------------

SLOPE, LOSS = "slope over positions 1 to the last", "area with a past minus at position 0"


def has_orders(arm: Arm) -> bool:
    return any(sequence.startswith("order-") and SHIFTED not in sequence for sequence in arm.sequences())


def is_balanced(all_lives: list[Life]) -> bool:
    """Whether every level stands at every position equally often."""
    counts = Counter((at, level) for life in all_lives for at, (level, _) in enumerate(life.stages))
    levels = {level for _, level in counts}
    return len(counts) == len(levels) * len(all_lives[0].stages) and len(set(counts.values())) == 1


def slopes(all_lives: list[Life]) -> dict[int, float]:
    """Of the area over positions 1 to the last, the mean of each level over these subtracted; by seed."""
    levels = means((level, area) for life in all_lives for level, area in life.stages[1:])
    return {
        life.seed: n.slope([(at, area - levels[level]) for at, (level, area) in enumerate(life.stages) if at > 0])
        for life in all_lives
    }


def losses(all_lives: list[Life]) -> dict[int, float]:
    """Mean area at positions 1 to the last minus that at position 0, the mean of each level at position 0 subtracted from
    both; by seed. So what is a seed's own cancels, and the means of levels do so where orders are balanced."""
    first = means(life.stages[0] for life in all_lives)
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
    """Slope over positions and loss, of each arm, and of each arm against the first. The rule is for the first alone."""
    all_lives = {name: lives(arm) for name, arm in sorted(arms.items())}
    of = {name: (slopes(of_arm), losses(of_arm)) for name, of_arm in all_lives.items()}
    for name, (slope, loss) in of.items():
        row = estimate(list(slope.values()))
        verdict = "the loss grows" if row[2] is not None and row[2] < 0 else "no growth shown"
        verdict = verdict if is_balanced(all_lives[name]) else "orders are not balanced"
        yield [name, SLOPE, *row, verdict if name == min(of) else ""]
        yield [name, LOSS, *estimate(list(loss.values())), ""]
    (one, first), *others = of.items()
    for other, second in others:
        for title, a, b in zip((SLOPE, LOSS), first, second):
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
    levels = means((level, area) for _, _, level, _, area in after)
    places = means((at, area) for *_, at, area in after)
    groups: dict[tuple[str, str], list[float]] = defaultdict(list)
    for _, before, level, at, area in after:
        groups[level, before].append(area - levels[level] - places[at] + whole)
    rests = [n.mean(values) for values in groups.values()]
    yield ["largest minus smallest", "", max(rests) - min(rests), None, None, len(after)]
    for (level, before), values in sorted(groups.items()):
        low, high = n.bootstrap([values], lambda scores: n.mean(scores[0])) or (None, None)
        yield [level, before, n.mean(values), low, high, len(values)]
