"""Many levels one after another: docs/results/why/protocol-3.md, written from its definitions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from . import numbers as n
from .arms import AREA, SHIFTED, Arm, Life, estimate, judged, lives
from .output import Row

LEAST_STAGES = 4


@dataclass
class Course:
    """One seed's way through the levels: its areas, and those of a new agent of that seed on the same levels."""

    life: Life
    scratch: list[float]

    @property
    def areas(self) -> list[float]:
        return [area for _, area in self.life.stages]

    @property
    def losses(self) -> list[float]:
        return [new - area for new, area in zip(self.scratch, self.areas)]

    def late_minus_early(self) -> float:
        """The mean loss over the last third minus that over the first third with a past, which begins at position 1."""
        third = (len(self.losses) - 1) // 3
        return n.mean(self.losses[-third:]) - n.mean(self.losses[1 : 1 + third])

    def slope(self) -> float:
        return n.slope(list(enumerate(self.losses))[1:])

    def loss(self) -> float:
        return n.mean(self.losses[1:])


@dataclass
class Algorithm:
    """The base, which is also trained from scratch, and its treatments."""

    base: str
    treatments: list[str]
    arms: dict[str, Arm]

    @cached_property
    def courses(self) -> dict[str, dict[int, Course]]:
        """Of each arm, by seed."""
        scratch = self.arms[self.base].scratch
        levels = {level for level, _ in scratch}
        found: dict[str, dict[int, Course]] = {}
        for name in [self.base, *self.treatments]:
            found[name] = {}
            for life in lives(self.arms[name]):
                new = {level: scratch.get((level, AREA), {}).get(life.seed) for level, _ in life.stages}
                missing = [level for level, area in new.items() if area is None]
                if missing:
                    where = f"{self.base}, seed {life.seed}"
                    raise ValueError(f"{where} has no run from scratch on {', '.join(missing)}: let them end first")
                # The thirds go by the number of stages.
                if len(life.stages) < len(levels):
                    raise ValueError(f"{name} has {len(life.stages)} of {len(levels)} stages: let its runs end first")
                if len(life.stages) < LEAST_STAGES:
                    raise ValueError(f"{name} has too few stages for thirds: give a study with {LEAST_STAGES} or more")
                found[name][life.seed] = Course(life, [new[level] for level, _ in life.stages])
        return found


def has_long(arm: Arm) -> bool:
    return any(SHIFTED in sequence for sequence in arm.sequences())


def algorithms(arms: dict[str, Arm]) -> list[Algorithm]:
    """Each arm that is also trained from scratch, with those whose names go on from its own."""
    long = {name: arm for name, arm in sorted(arms.items()) if has_long(arm)}
    bases = [name for name, arm in long.items() if arm.scratch]
    of: dict[str, list[str]] = {base: [] for base in bases}
    for name in sorted(long.keys() - of.keys()):
        candidates = [base for base in bases if name.startswith(f"{base}-")]
        if not candidates:
            raise ValueError(f"{name} has no base that is also trained from scratch: give a study that has one")
        of[max(candidates, key=len)].append(name)
    return [Algorithm(base, sorted(treatments), long) for base, treatments in of.items()]


def _sure(arm: Arm, life: Life) -> list[float]:
    """By position but 0: the timesteps of the stage before that were left when it had reached 0.9."""

    def of(measure: str) -> dict[int, float]:
        values = arm.values.get((life.sequence, measure, life.seed), {})
        if len(values) < len(life.stages):
            raise ValueError(f"seed {life.seed} lacks {measure} of some stage: keep these rows")
        return values

    timesteps, reached = of("timesteps"), of("time_to_0.9")
    # A time that is never reached is infinite.
    return [max(timesteps[at] - reached[at], 0.0) for at in range(len(life.stages) - 1)]


def sureness(algorithm: Algorithm) -> list[float]:
    """Of each seed of the base, the rank correlation of how long it was sure with the loss that follows."""
    arm = algorithm.arms[algorithm.base]
    courses = algorithm.courses[algorithm.base].values()
    found = (n.rank_correlation(_sure(arm, course.life), course.losses[1:]) for course in courses)
    return [correlation for correlation in found if correlation is not None]


def _growth(values: list[float]) -> str:
    low, high = n.t_interval(values) or (0.0, 0.0)
    return "the loss grows" if low > 0 else "the loss shrinks" if high < 0 else "no growth shown"


def contrasts(algorithm: Algorithm) -> dict[str, list[float]]:
    """Of a seed's mean area over all positions but 0. A treatment whose name goes on from another's adds to that one."""
    area = {name: {seed: n.mean(c.areas[1:]) for seed, c in of.items()} for name, of in algorithm.courses.items()}
    found = {}
    for name in algorithm.treatments:
        others = [algorithm.base, *(other for other in algorithm.treatments if name.startswith(f"{other}-"))]
        for other in others:
            seeds = sorted(area[name].keys() & area[other].keys())
            found[f"{name} - {other}"] = [area[name][seed] - area[other][seed] for seed in seeds]
        found[f"{name} - from scratch"] = [-course.loss() for course in algorithm.courses[name].values()]
    return found


def table(algorithm: Algorithm) -> Iterator[Row]:
    """Arm or contrast, outcome, its estimate, the p-value after Holm's correction and the verdict."""
    for name, courses in algorithm.courses.items():
        growth = [course.late_minus_early() for course in courses.values()]
        slopes, losses = ([of(course) for course in courses.values()] for of in (Course.slope, Course.loss))
        verdict = _growth(growth) if name == algorithm.base else ""
        yield [name, "loss, late minus early", *estimate(growth), None, verdict]
        yield [name, "slope of the loss", *estimate(slopes), None, ""]
        yield [name, "loss", *estimate(losses), None, ""]
    found = contrasts(algorithm)
    for name, *row in judged(found, {name: ("less area", "more area") for name in found}):
        yield [name, "area", *row]
    correlations = sureness(algorithm)
    low, high = n.t_interval(correlations) or (0.0, 0.0)
    verdict = "the loss follows it" if low > 0 or high < 0 else "undecided"
    yield [algorithm.base, "rank correlation of the loss with how long it was sure", *estimate(correlations), None, verdict]


def positions(algorithm: Algorithm) -> Iterator[Row]:
    """Arm, position, outcome and its estimate. New agents are those on the levels that the base has there."""
    for name, courses in algorithm.courses.items():
        of_arm = list(courses.values())
        for at in range(len(of_arm[0].scratch)):
            yield [name, at, "area", *estimate([course.areas[at] for course in of_arm])]
            yield [name, at, "loss", *estimate([course.losses[at] for course in of_arm])]
    base = list(algorithm.courses[algorithm.base].values())
    for at in range(len(base[0].scratch)):
        yield [f"{algorithm.base} (from scratch)", at, "area", *estimate([course.scratch[at] for course in base])]
