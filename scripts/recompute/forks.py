"""What treatments at a switch give back: docs/results/why/protocol.md, written from its definitions."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from . import numbers as n
from . import outcomes

# A recovered share above, below and above which a treatment is sufficient, excluded and more than enough.
SUFFICIENT, EXCLUDED, HELPS = 0.8, 0.2, 1.0
LEVEL = 0.025
# The treatment that makes a new agent, and the names of the three factors as the study's grid writes them.
FRESH = "weights-fresh+optimizer-fresh"
WEIGHTS, OPTIMIZER = "weights-fresh", "optimizer-fresh"
# "fresh-X" is a new agent under the treatment X. It is what X is compared with, and no candidate itself.
NEW = "fresh-"

Values = dict[int, float]


@dataclass
class Algorithm:
    """One arm of the study: values by treatment, stage and measure, each of them by seed. The curriculum is ''."""

    name: str
    values: dict[tuple[str, int, str], Values] = field(default_factory=lambda: defaultdict(dict))
    scratch: dict[tuple[str, str], Values] = field(default_factory=lambda: defaultdict(dict))
    level: dict[int, str] = field(default_factory=dict)
    sequences: set[str] = field(default_factory=set)

    def treatments(self) -> list[str]:
        """All but the curriculum's own."""
        return sorted({treatment for treatment, _, _ in self.values if treatment})

    def candidates(self) -> list[str]:
        """Those that may give back what is lost."""
        return [treatment for treatment in self.treatments() if treatment != FRESH and treatment not in self.new_agents()]

    def new_agents(self) -> dict[str, str]:
        """The treatment that each new agent under a treatment is compared with."""
        of = {treatment: treatment.removeprefix(NEW) for treatment in self.treatments() if treatment.startswith(NEW)}
        return {new: treatment for new, treatment in of.items() if treatment in self.treatments()}

    def switches(self) -> list[int]:
        """The stages after which there are forks."""
        return sorted({stage - 1 for treatment, stage, _ in self.values if treatment})

    def area(self, treatment: str, switch: int) -> Values:
        return self.values.get((treatment, switch + 1, "area"), {})


@dataclass
class Contrast:
    """A treatment at one switch, or over all of them, against the curriculum and the new agent."""

    treatment: str
    switch: str
    seeds: int
    warm: float
    treated: float
    fresh: float
    share: float | None
    bounds: n.Bounds
    loss: float
    p: dict[str, float]
    gain: tuple[float, n.Bounds]
    adjusted: dict[str, float] = field(default_factory=dict)

    def verdict(self) -> str:
        if self.share is None:
            return "no loss"
        holds = [rule for rule in ("sufficient", "excluded", "helps") if self.adjusted[rule] < LEVEL]
        words = {"sufficient": "sufficient", "excluded": "excluded", "helps": "the past helps"}
        return ", ".join(words[rule] for rule in holds) or "undecided"


def read(path: Path) -> dict[str, Algorithm]:
    """The arms of a seeds.csv, or of one that is compressed."""
    algorithms: dict[str, Algorithm] = {}
    for row in outcomes.read(path):
        # "ppo, after 0: last-fresh" and "ppo (from scratch)" belong to ppo.
        name = row["arm"].split(", after ")[0].removesuffix(" (from scratch)")
        algorithm = algorithms.setdefault(name, Algorithm(name))
        stage, seed, value = int(row["stage"]), int(row["seed"]), float(row["value"])
        if row["sequence"].startswith("level-"):
            algorithm.scratch[row["level"], row["measure"]][seed] = value
            continue
        algorithm.sequences.add(row["sequence"])
        treatment = row["treatment"]
        if treatment:
            after, treatment = treatment.removeprefix("after-").split(":", 1)
            # The control of a fork is the curriculum once more.
            treatment = "" if treatment == "none" else treatment
            # Later stages of a fork are no outcome of the switch.
            if stage != int(after) + 1:
                continue
        if row["measure"] == "timesteps":
            algorithm.level[stage] = row["level"]
        algorithm.values[treatment, stage, row["measure"]][seed] = value
    forked = {name: algorithm for name, algorithm in algorithms.items() if algorithm.switches()}
    for name, algorithm in forked.items():
        if len(algorithm.sequences) > 1:
            sequences = ", ".join(sorted(algorithm.sequences))
            raise ValueError(f"{path}: {name} has several sequences ({sequences}): give a seeds.csv of one")
        if FRESH not in algorithm.treatments():
            raise ValueError(f"{path}: {name} has no treatment {FRESH}, with which the others are compared: add it to the fork")
    return forked


def _above(values: Sequence[float]) -> float:
    """The p-value of Student's one-sided test that the mean is above 0."""
    p = n.p_value(values)
    if p is None:
        return 0.0 if values[0] > 0 else 1.0
    return p / 2 if n.mean(values) > 0 else 1 - p / 2


def contrast(treatment: str, switch: str, warm: Values, treated: Values, fresh: Values) -> Contrast | None:
    seeds = sorted(warm.keys() & treated.keys() & fresh.keys())
    if len(seeds) < 2:
        return None
    gained = [treated[seed] - warm[seed] for seed in seeds]
    lost = [fresh[seed] - warm[seed] for seed in seeds]
    rest = [treated[seed] - fresh[seed] for seed in seeds]

    def beyond(share: float) -> list[float]:
        return [x - share * y for x, y in zip(gained, lost)]

    loss = _above(lost)
    bounds = n.fieller(list(zip(gained, lost)))
    is_lost = loss < LEVEL and bounds is not None
    return Contrast(
        treatment,
        switch,
        len(seeds),
        n.mean([warm[seed] for seed in seeds]),
        n.mean([treated[seed] for seed in seeds]),
        n.mean([fresh[seed] for seed in seeds]),
        n.mean(gained) / n.mean(lost) if is_lost else None,
        bounds if is_lost else None,
        loss,
        {
            "sufficient": _above(beyond(SUFFICIENT)),
            "excluded": _above([-value for value in beyond(EXCLUDED)]),
            "helps": _above(beyond(HELPS)),
        },
        (n.mean(rest), n.t_interval(rest)),
    )


def _adjust(contrasts: list[Contrast]) -> list[Contrast]:
    """Holm over all treatments and rules of a family."""
    told = [contrast for contrast in contrasts if contrast.share is not None]
    p = {f"{place} {rule}": value for place, c in enumerate(told) for rule, value in c.p.items()}
    adjusted = n.holm(p)
    for place, contrast in enumerate(told):
        contrast.adjusted = {rule: adjusted[f"{place} {rule}"] for rule in contrast.p}
    return contrasts


def over_switches(algorithm: Algorithm, treatment: str, switches: list[int]) -> Values:
    """The mean area over the switches, of the seeds that have all of them."""
    areas = [algorithm.area(treatment, switch) for switch in switches]
    seeds = set.intersection(*(set(area) for area in areas)) if areas else set()
    return {seed: n.mean([area[seed] for area in areas]) for seed in seeds}


def pooled(algorithm: Algorithm) -> list[Contrast]:
    """The primary family: every treatment over all switches."""
    switches = algorithm.switches()
    warm, fresh = (over_switches(algorithm, of, switches) for of in ("", FRESH))
    contrasts = (
        contrast(treatment, "all", warm, over_switches(algorithm, treatment, switches), fresh)
        for treatment in algorithm.candidates()
    )
    return _adjust([found for found in contrasts if found])


def by_switch(algorithm: Algorithm) -> list[Contrast]:
    """The secondary family: every treatment at every switch."""
    contrasts = []
    for switch in algorithm.switches():
        warm, fresh = algorithm.area("", switch), algorithm.area(FRESH, switch)
        for treatment in algorithm.candidates():
            treated = algorithm.area(treatment, switch)
            contrasts.append(contrast(treatment, str(switch), warm, treated, fresh))
    return _adjust([found for found in contrasts if found])


def beside_new(algorithm: Algorithm) -> Iterator[tuple[str, str, float, float, float, n.Bounds, int]]:
    """The area of an agent with its past under a treatment, that of a new agent under the same one, and their difference: over
    all switches, and at each."""
    switches = algorithm.switches()
    for name, treatment in algorithm.new_agents().items():
        for switch, among in [("all", switches), *((str(switch), [switch]) for switch in switches)]:
            past, new = (over_switches(algorithm, of, among) for of in (treatment, name))
            seeds = sorted(past.keys() & new.keys())
            if len(seeds) > 1:
                differences = [past[seed] - new[seed] for seed in seeds]
                means = (n.mean([areas[seed] for seed in seeds]) for areas in (past, new))
                yield treatment, switch, *means, n.mean(differences), n.t_interval(differences), len(seeds)


def effects(algorithm: Algorithm) -> Iterator[tuple[str, float, n.Bounds, int]]:
    """Main effects and interactions of the 2 x 2 x 2 design on the area, over all switches: difference of the means of
    the cells whose product of signs is + and of those where it is -."""
    switches = algorithm.switches()
    scaled = [name for name in algorithm.treatments() if name.endswith("-0.02") and "+" not in name]
    if len(scaled) != 1:
        return
    factors = [WEIGHTS, OPTIMIZER, scaled[0]]
    cells = {}
    for on in itertools.product((False, True), repeat=3):
        name = "+".join(factor for factor, is_on in zip(factors, on) if is_on)
        cells[on] = over_switches(algorithm, name, switches)
    seeds = sorted(set.intersection(*(set(cell) for cell in cells.values())))
    if len(seeds) < 2:
        return
    for chosen in itertools.chain.from_iterable(itertools.combinations(range(3), size) for size in (1, 2, 3)):
        def of(seed: int) -> float:
            signs = {on: math.prod(1 if on[place] else -1 for place in chosen) for on in cells}
            return sum(sign * cells[on][seed] for on, sign in signs.items()) / 4

        values = [of(seed) for seed in seeds]
        yield " × ".join(factors[place] for place in chosen), n.mean(values), n.t_interval(values), len(seeds)


# What is shown of an agent before the first update of the stage after the switch, on states that it visits there.
SHOWN = [
    "policy_entropy/visited",
    "logit_scale/visited",
    "action_gap/visited",
    "policy.1/saturated_units/visited",
    "value.1/saturated_units/visited",
    "q.1/dormant_0.1/visited",
    "policy.1/effective_rank/visited",
    "value.1/effective_rank/visited",
    "q.1/effective_rank/visited",
    "policy.1/weight_magnitude",
    "q.1/weight_magnitude",
]


def measures(algorithm: Algorithm, before: Algorithm) -> Iterator[tuple[str, dict[str, float], float | None, n.Bounds, int]]:
    """Each measure at the switch: its mean over seeds and switches by treatment, and its rank correlation with the area
    over the treatments. That is of each seed and switch, then the mean over switches, with an interval over seeds."""
    switches = algorithm.switches()
    treatments = ["", *sorted([FRESH, *algorithm.candidates()])]
    for name in SHOWN:
        found = {
            (treatment, switch): before.values.get((treatment, switch + 1, f"before/plasticity/{name}"), {})
            for treatment in treatments
            for switch in switches
        }
        means = {}
        for treatment in treatments:
            values = [value for switch in switches for value in found[treatment, switch].values()]
            if values:
                means[treatment] = n.mean(values)
        if len(means) < len(treatments):
            continue
        by_seed: dict[int, list[float]] = defaultdict(list)
        for switch in switches:
            areas = {treatment: algorithm.area(treatment, switch) for treatment in treatments}
            for seed in set.intersection(*(set(areas[t]) & set(found[t, switch]) for t in treatments)):
                correlation = n.rank_correlation(
                    [found[t, switch][seed] for t in treatments], [areas[t][seed] for t in treatments]
                )
                if correlation is not None:
                    by_seed[seed].append(correlation)
        correlations = [n.mean(values) for values in by_seed.values()]
        mean = n.mean(correlations) if correlations else None
        yield name, means, mean, n.t_interval(correlations), len(correlations)
