"""The main tables, each computed from seeds.csv and compared with the report's."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from . import numbers as n
from .report import BEFORE, Checks, Report, Values

THRESHOLDS = ("0.5", "0.9")
LEAST_AREA = 0.05

Row = dict[str, str]
Pairs = dict[int, tuple[float, float]]


def _rows(checks: Checks, name: str, rows: list[Row] | None, keys: Iterable[tuple[str, ...]], heads: tuple[str, ...]):
    """The row of each key; a row that is missing, or one too many, is a difference."""
    keys, found = list(keys), {tuple(row[head] for head in heads): row for row in rows or []}
    checks.text(f"{name}: rows", "; ".join(map(str, sorted(found))), "; ".join(map(str, sorted(keys))))
    return [(key, found[key]) for key in keys if key in found]


def _interval(checks: Checks, place: str, row: Row, column: str, value: float | None, bounds: n.Bounds) -> None:
    checks.number(f"{place}, {column}", row.get(column), value)
    for name, bound in zip(("low", "high"), bounds or (None, None)):
        checks.number(f"{place}, {column} {name}", row.get(f"{column} {name}"), bound)


def right_after_training(report: Report, checks: Checks) -> None:
    """Mean and standard deviation on each level right after training on it."""
    name, rows = "right-after-training", report.table("right-after-training")
    rows = [row for row in rows or [] if row["arm"] in report.arms]
    arms = [arm for arm in report.arms if arm not in report.forks]
    cells = {(arm, level): report.right_after(arm, "return", level) for arm in arms for level in report.levels}
    # Where no cell has several seeds, the deviation is that of one seed over its start cells.
    over_seeds = any(len(values) > 1 for values in cells.values())
    for (arm,), row in _rows(checks, name, rows, [(arm,) for arm in arms], ("arm",)):
        most = max((len(cells[arm, level]) for level in report.levels), default=0)
        checks.number(f"{name}: {arm}, seeds", row["seeds"], most)
        for level in report.levels:
            values, column = list(cells[arm, level].values()), f"level {level}"
            place = f"{name}: {arm}, {column}"
            if not values:
                checks.text(place, row.get(f"{column} mean", row.get(column)), "")
                continue
            deviation = n.deviation(values) if len(values) > 1 else None
            if not over_seeds:
                [deviation] = report.right_after(arm, "return_std", level).values()
            checks.number(f"{place} mean", row.get(f"{column} mean"), n.mean(values))
            checks.number(f"{place} std", row.get(f"{column} std"), deviation)
            other = len(values) if len(values) != most else None
            checks.number(f"{place} seeds", row.get(f"{column} seeds"), other)


def returns(report: Report, checks: Checks) -> None:
    """Mean, median and interquartile mean over seeds, level by level."""
    name = "returns"
    cells = {(arm, level): report.right_after(arm, "return", level) for arm in report.arms for level in report.levels}
    cells = {key: list(values.values()) for key, values in cells.items() if values}
    for (arm, level), row in _rows(checks, name, report.table(name), cells, ("arm", "level")):
        place, values = f"{name}: {arm}, {level}", cells[arm, level]
        checks.number(f"{place}, seeds", row["seeds"], len(values))
        _interval(checks, place, row, "mean", n.mean(values), n.mean_interval(values))
        _interval(checks, place, row, "median", n.median(values), n.median_interval(values))
        bounds = n.bootstrap([values], lambda scores: n.interquartile_mean(scores[0]))
        _interval(checks, place, row, "IQM", n.interquartile_mean(values), bounds)
        normalised = list(report.right_after(arm, "normalised_return", level).values())
        mean = n.mean(normalised) if normalised else None
        _interval(checks, place, row, "mean, normalised", mean, n.mean_interval(normalised))


def aggregates(report: Report, checks: Checks) -> None:
    """Normalised returns over levels."""
    name = "aggregates"
    scores: dict[str, dict[str, Values]] = {}
    for arm in (arm for arm in report.arms if arm not in report.forks):
        by_level = {level: report.right_after(arm, "normalised_return", level) for level in report.levels}
        returns = {level: report.right_after(arm, "return", level) for level in report.levels}
        # A level without a proved optimum leaves the arm without a row.
        if any(returns.values()) and all(len(by_level[level]) == len(returns[level]) for level in report.levels):
            scores[arm] = {level: values for level, values in by_level.items() if values}
    statistics: dict[str, Callable[[list[list[float]]], float]] = {
        "mean": lambda scores: n.mean([n.mean(task) for task in scores]),
        "median": lambda scores: n.median([n.mean(task) for task in scores]),
        "IQM": lambda scores: n.interquartile_mean([score for task in scores for score in task]),
        "optimality gap": lambda scores: n.mean([1 - min(score, 1.0) for task in scores for score in task]),
    }
    for (arm,), row in _rows(checks, name, report.table(name), [(arm,) for arm in scores], ("arm",)):
        by_level = scores[arm]
        tasks = [list(values.values()) for values in by_level.values()]
        least, most = min(map(len, tasks)), max(map(len, tasks))
        checks.text(f"{name}: {arm}, seeds", row["seeds"], str(most) if least == most else f"{least}–{most}")
        checks.text(f"{name}: {arm}, levels", row["levels"], ", ".join(by_level))
        first, *others = by_level.values()
        is_whole = all(other.keys() == first.keys() for other in others)
        for column, statistic in statistics.items():
            if not is_whole:
                bounds = n.bootstrap(tasks, statistic)
            elif column in ("mean", "optimality gap"):
                bounds = n.mean_interval([statistic([[task[seed]] for task in tasks]) for seed in range(most)])
            else:
                bounds = n.bootstrap_whole(tasks, statistic)
            _interval(checks, f"{name}: {arm}", row, column, statistic(tasks), bounds)


def continual_learning(report: Report, checks: Checks) -> None:
    """The measures of the matrix of returns, seed by seed."""
    name = "continual-learning"
    measured: dict[str, list[dict[str, float | None]]] = {}
    sampled: dict[str, list[float | None]] = {}
    for arm in filter(report.is_curriculum.get, report.arms):
        levels = report.stages[arm]
        times = [BEFORE, *range(len(levels))]
        r = {(i, j): report.after(arm, "normalised_return", i, level) for i in times for j, level in enumerate(levels)}
        seeds = [seed for seed in sorted(r[times[-1], 0]) if all(seed in values for values in r.values())]
        if seeds:
            measured[arm] = [_measures({ij: v[seed] for ij, v in r.items()}, len(levels)) for seed in seeds]
        measure = "sampled_normalised_return"
        r = {(i, j): report.after(arm, measure, i, level) for i in times for j, level in enumerate(levels)}
        seeds = [seed for seed in sorted(r[times[-1], 0]) if all(seed in values for values in r.values())]
        of_seeds = [_measures({ij: v[seed] for ij, v in r.items()}, len(levels)) for seed in seeds]
        sampled[arm] = [measures["forward transfer"] for measures in of_seeds]
    for (arm,), row in _rows(checks, name, report.table(name), [(arm,) for arm in measured], ("arm",)):
        place, seeds = f"{name}: {arm}", measured[arm]
        checks.number(f"{place}, seeds", row["seeds"], len(seeds))
        for column in seeds[0]:
            values = [seed[column] for seed in seeds if seed[column] is not None]
            mean = n.mean(values) if values else None
            _interval(checks, place, row, column, mean, n.mean_interval(values))
        if any(value is not None for values in sampled.values() for value in values):
            values = [value for value in sampled[arm] if value is not None]
            mean = n.mean(values) if values else None
            _interval(checks, place, row, "sampled forward transfer", mean, n.mean_interval(values))
        areas = _transfer_by_areas(report, arm)
        value, bounds, count = areas or (None, None, len(seeds))
        _interval(checks, place, row, "transfer by areas", value, bounds)
        other = count if count != len(seeds) else None
        checks.number(f"{place}, transfer by areas seeds", row.get("transfer by areas seeds"), other)


def _measures(r: dict[tuple[int, int], float], stages: int) -> dict[str, float | None]:
    """Of one seed: R[i, j] by stage, -1 standing before the first."""
    last = stages - 1

    def mean(values: list[float]) -> float | None:
        return n.mean(values) if values else None

    each = range(stages)
    return {
        "average performance": mean([r[last, j] for j in each]),
        "backward transfer": mean([r[last, j] - r[j, j] for j in each[:-1]]),
        "forward transfer": mean([r[j - 1, j] - r[BEFORE, j] for j in each[1:]]),
        "forgetting": mean([r[j, j] - r[last, j] for j in each]),
        "isolated forgetting": mean([r[j - 1, i] - r[j, i] for i in each for j in each[i + 1 :]]),
        "zero-shot transfer": mean([r[j, i] - r[j - 1, i] for i in each for j in each[:i]]),
    }


def _scratch_of(report: Report) -> dict[str, str]:
    """The arm from scratch of each curriculum."""
    arms = report.arms
    return {arms[pair["curriculum"]]: arms[pair["from_scratch"]] for pair in report.json["pairs"]}


def _pairs(report: Report, arm: str, scratch: str, measure: str, level: str) -> Pairs:
    """By seed that has both: in the curriculum, from scratch."""
    both = [report.right_after(one, "return", level) for one in (arm, scratch)]
    ours, theirs = (report.right_after(one, measure, level) for one in (arm, scratch))
    seeds = [seed for seed in both[0] if seed in both[1] and seed in ours and seed in theirs]
    return {seed: (ours[seed], theirs[seed]) for seed in seeds}


def _over_levels(by_level: dict[str, Pairs]) -> Pairs:
    """By seed that has all levels: the means over them."""
    first, *others = by_level.values()
    seeds = [seed for seed in first if all(seed in other for other in others)]

    def mean(seed: int, side: int) -> float:
        return n.mean([pairs[seed][side] for pairs in by_level.values()])

    return {seed: (mean(seed, 0), mean(seed, 1)) for seed in seeds}


def _transfer_by_areas(report: Report, arm: str) -> tuple[float, n.Bounds, int] | None:
    scratch = _scratch_of(report).get(arm)
    if scratch is None:
        return None
    by_level = {level: _pairs(report, arm, scratch, "area", level) for level in report.levels}
    by_level = {level: pairs for level, pairs in by_level.items() if pairs}
    pairs = [(a - b, 1 - b) for a, b in _over_levels(by_level).values()] if by_level else []
    return _ratio(pairs)


def _ratio(pairs: list[tuple[float, float]]) -> tuple[float, n.Bounds, int] | None:
    """A ratio of means; none where the denominator is next to nothing."""
    if not pairs or n.mean([denominator for _, denominator in pairs]) < LEAST_AREA:
        return None
    return (*n.ratio_of_means(pairs), len(pairs))


COLUMNS = {
    "area": ("area", "area from scratch", "difference of areas", "p of areas", "seeds with more area"),
    "normalised_return": (
        "final",
        "final from scratch",
        "difference of finals",
        "p of finals",
        "seeds with better finals",
    ),
}


def against_from_scratch(report: Report, checks: Checks) -> None:
    """Each level in the curriculum against learning it from scratch, paired by seed."""
    name, expected = "against-from-scratch", {}
    for arm, scratch in _scratch_of(report).items():
        first = report.stages[arm][0]
        both = {
            level: _pairs(report, arm, scratch, "return", level)
            for level in report.levels
            if report.right_after(arm, "return", level) and report.right_after(scratch, "return", level)
        }
        by_measure = {
            measure: {level: _pairs(report, arm, scratch, measure, level) for level in both} for measure in COLUMNS
        }
        tests = {}
        for measure, by_level in by_measure.items():
            tests[measure] = n.holm(
                {
                    level: p
                    for level, pairs in by_level.items()
                    if level != first and (p := n.p_value([a - b for a, b in pairs.values()])) is not None
                }
            )
        for level in both:
            pairs = {measure: by_level[level] for measure, by_level in by_measure.items()}
            p_values = {measure: tests[measure].get(level) for measure in COLUMNS}
            expected[arm, level] = (len(both[level]), scratch, pairs, p_values, level != first)
        over = {
            measure: _over_levels({level: pairs for level, pairs in by_level.items() if pairs})
            for measure, by_level in by_measure.items()
            if any(by_level.values())
        }
        over = {measure: pairs for measure, pairs in over.items() if pairs}
        if over:
            leader = "normalised_return" if "normalised_return" in over else "area"
            levels = [level for level, pairs in by_measure[leader].items() if pairs]
            p_values = {measure: n.p_value([a - b for a, b in pairs.values()]) for measure, pairs in over.items()}
            expected[arm, f"mean of {', '.join(levels)}"] = (len(over[leader]), None, over, p_values, False)
    for key, row in _rows(checks, name, report.table(name), expected, ("arm", "level")):
        _contrast(report, checks, f"{name}: {key[0]}, {key[1]}", row, key[1], *expected[key])


def _contrast(
    report: Report,
    checks: Checks,
    place: str,
    row: Row,
    level: str,
    count: int,
    scratch: str | None,
    by_measure: dict[str, Pairs],
    p_values: dict[str, float | None],
    has_share: bool,
) -> None:
    """One row. Only a single level has a `scratch` arm whose runs are counted."""
    checks.number(f"{place}, pairs", row["pairs"], count)
    for threshold in THRESHOLDS:
        times = report.right_after(scratch, f"time_to_{threshold}", level).values() if scratch else ()
        reached = f"{sum(time != float('inf') for time in times)}/{len(times)}" if times else ""
        checks.text(f"{place}, reach {threshold}", row[f"reach {threshold} from scratch"], reached)
    solved = [100 * share for share in report.right_after(scratch, "solved_share", level).values()] if scratch else []
    checks.number(f"{place}, solved", row["solved from scratch %"], n.mean(solved) if solved else None)
    for measure, columns in COLUMNS.items():
        pairs = list(by_measure.get(measure, {}).values())
        ours, theirs, difference, p, share = columns
        differences = [a - b for a, b in pairs]
        checks.number(f"{place}, {ours}", row[ours], n.mean([a for a, _ in pairs]) if pairs else None)
        checks.number(f"{place}, {theirs}", row[theirs], n.mean([b for _, b in pairs]) if pairs else None)
        mean = n.mean(differences) if pairs else None
        _interval(checks, place, row, difference, mean, n.mean_interval(differences))
        checks.number(f"{place}, {p}", row[p], p_values.get(measure) if pairs else None)
        above = sum((a > b) + (a == b) / 2 for a, b in pairs)
        if pairs and has_share:
            _interval(checks, place, row, share, above / len(pairs), n.share_interval(above, len(pairs)))
        else:
            _interval(checks, place, row, share, None, None)
        other = len(pairs) if pairs and len(pairs) != count else None
        for column in (ours, theirs, difference):
            checks.number(f"{place}, {column} seeds", row.get(f"{column} seeds"), other)
    areas = [(b - a, b) for a, b in by_measure.get("area", {}).values()]
    value, bounds, seeds = _ratio(areas) or (None, None, count)
    _interval(checks, place, row, "relative loss of area", value, bounds)
    other = seeds if seeds != count else None
    checks.number(f"{place}, relative loss seeds", row.get("relative loss of area seeds"), other)


def treatments(report: Report, checks: Checks) -> None:
    """Areas of forks beside those of the runs that they come from and of runs from scratch, paired by seed."""
    name, expected = "treatments", {}
    arms = report.arms
    for pair in report.json["forks"]:
        fork = arms[pair["fork"]]
        untreated, scratch = (arms[pair[of]] if pair[of] is not None else "" for of in ("curriculum", "from_scratch"))
        for stage in report.json["arms"][pair["fork"]]["stages"]:
            number, level = stage["stage"], report.levels[stage["level"]]
            treated = report.after(fork, "area", number, level)
            before = report.after(untreated, "area", number, level)
            new = report.right_after(scratch, "area", level)
            if treated:
                finals = (
                    report.after(untreated, "normalised_return", number, level),
                    report.after(fork, "normalised_return", number, level),
                    report.right_after(scratch, "normalised_return", level),
                )
                expected[fork, str(number)] = treated, before, new, finals
    for key, row in _rows(checks, name, report.table(name), expected, ("arm", "stage")):
        place, (treated, before, new, finals) = f"{name}: {key[0]}, stage {key[1]}", expected[key]
        for measure, three in (("area", (before, treated, new)), ("final", finals)):
            for way, values in zip(("untreated", "treated", "from scratch"), three):
                values = [values[seed] for seed in three[1] if seed in values]
                checks.number(f"{place}, {measure} {way}", row[f"{measure} {way}"], n.mean(values) if values else None)
        gains = [treated[seed] - before[seed] for seed in sorted(treated) if seed in before]
        _interval(checks, place, row, "treated - untreated", n.mean(gains) if gains else None, n.mean_interval(gains))
        seeds = [seed for seed in sorted(treated) if seed in before and seed in new]
        pairs = [(treated[seed] - before[seed], new[seed] - before[seed]) for seed in seeds]
        lost = [loss for _, loss in pairs]
        bounds = n.mean_interval(lost) if lost else None
        _interval(checks, place, row, "from scratch - untreated", n.mean(lost) if lost else None, bounds)
        is_lost = bounds is not None and bounds[0] > 0
        share, bounds = n.ratio_of_means(pairs) if is_lost else (None, None)
        _interval(checks, place, row, "recovered share", share if bounds else None, bounds)


ALL = (right_after_training, returns, aggregates, continual_learning, against_from_scratch, treatments)
