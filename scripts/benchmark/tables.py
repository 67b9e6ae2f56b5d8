"""From rows to Markdown: medians, and in brackets the least and the most."""

# ruff: noqa: RUF001 (multiplication signs are meant)
from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

Rows = list[dict[str, Any]]
NAMES = {"cpp-rl": "cpp-rl", "jax": "JAX, fully jitted", "sb3": "Stable-Baselines3"}


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table, the first column to the left."""
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def spread(values: Sequence[float], form: str = ",.0f") -> str:
    """Median and range; the value alone where there is one."""
    middle = format(median(values), form)
    return middle if len(values) == 1 else f"{middle} [{min(values):{form}}, {max(values):{form}}]"


def group(rows: Rows, *keys: str) -> dict[tuple, Rows]:
    """Rows by the values of some columns, in order of appearance."""
    groups: dict[tuple, Rows] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return groups


def column(rows: Rows, key: str) -> list[float]:
    """The values of one column."""
    return [row[key] for row in rows]


def machines(results: dict[str, dict[str, Any]]) -> str:
    """What the numbers of these sections belong to: a line for every machine and commit."""
    lines: dict[str, list[str]] = {}
    for section, result in results.items():
        stolen = result["machine"].get("stolen")  # only Linux tells
        load = f"{section} {result['machine']['load']:.2f}" + (f" ({stolen:.1%})" if stolen is not None else "")
        lines.setdefault(machine_line(result["machine"]), []).append(load)
    what = "Load average before each section (and share of the processor's time that the host gave to others)"
    return "\n\n".join(f"{line} {what}: {', '.join(loads)}." for line, loads in lines.items())


def machine_line(machine: dict[str, Any]) -> str:
    """A machine with the commit that was measured there, its load left out."""
    caches = ", ".join(f"{level} {size}" for level, size in machine["caches"].items())
    simd = ", ".join(machine["simd"]) or "none of those asked for"
    return (
        f"Measured on {machine['date']} at commit `{machine['commit']}`: {machine['processor']}, {machine['cores']} "
        f"cores ({simd}; {caches}), {machine['memory_gb']} GB, {machine['system']}, {machine['rustc']}."
    )


def compare(rows: Rows) -> str:
    """Rates, and ratios of runs of the same repetition."""
    versions, rows = rows[0]["versions"], rows[1:]
    lines = []
    for (algo,), runs in group(rows, "algo").items():
        rates = {program: column(found, "rate") for (program,), found in group(runs, "program").items()}
        for program, values in rates.items():
            pairs = zip(rates["cpp-rl"], values, strict=True)
            ratio = "" if program == "cpp-rl" else spread([ours / theirs for ours, theirs in pairs], ".2f")
            runs_of = [row for row in runs if row["program"] == program]
            made = f"{runs_of[0]['timesteps']:,}"
            wall, peak = spread(column(runs_of, "wall"), ".1f"), f"{median(column(runs_of, 'peak_mb')):,.0f}"
            lines.append([f"{algo.upper()}, {NAMES[program]}", spread(values), ratio, made, wall, peak])
    head = ["program", "timesteps/s", "cpp-rl is faster by", "timesteps timed", "whole process, s", "peak memory, MB"]
    told = [f"{NAMES['cpp-rl']}: {versions['cpp-rl']}"]
    told += [f"{NAMES[p]}: " + ", ".join(f"{k} {v}" for k, v in versions[p].items()) for p in ("jax", "sb3")]
    return table(head, lines) + "\n\nVersions: " + "; ".join(told) + "."


def cores(rows: Rows) -> str:
    """One core against all, repetition by repetition."""
    lines = []
    for (algo,), runs in group(rows, "algo").items():
        rates = {how: column(found, "rate") for (how,), found in group(runs, "how").items()}
        one = rates["one core"]
        for how, values in rates.items():
            ratios = [many / single for many, single in zip(values, one, strict=True)]
            lines.append([f"{algo.upper()}, {how}", spread(values), "" if values is one else spread(ratios, ".2f")])
    return table(["16 seeds", "timesteps/s of all seeds", "against 1 core"], lines)


def seeds(rows: Rows) -> str:
    """Rates by number of seeds."""
    counts = list(dict.fromkeys(row["seeds"] for row in rows))
    lines = []
    for (algo, settings, jobs), runs in group(rows, "algo", "settings", "jobs").items():
        by_count = group(runs, "seeds")
        cells = [spread(column(by_count[(count,)], "rate")) for count in counts]
        where = "1 core" if jobs == 1 else f"{jobs} cores"
        lines.append([f"{algo.upper()}, {settings.split('=')[-1]}, {where}", *cells])
    return table(["timesteps/s of all seeds", *(f"{n} seed{'s' * (n > 1)}" for n in counts)], lines)


def along(axis: str, label: Callable[[int], str]) -> Callable[[Rows], str]:
    """Rates by the values of an axis."""

    def make(rows: Rows) -> str:
        values = list(dict.fromkeys(row[axis] for row in rows))
        lines = []
        for (algo,), runs in group(rows, "algo").items():
            cells = [spread(column(found, "rate")) for found in group(runs, axis).values()]
            lines.append([algo.upper(), *cells])
        return table(["timesteps/s, one seed, one core", *map(label, values)], lines)

    return make


def width(rows: Rows) -> str:
    """Rates by width, and ratios of runs of the same repetition."""
    widths = list(dict.fromkeys(row["width"] for row in rows))
    lines = []
    for (algo,), runs in group(rows, "algo").items():
        rates: dict[str, list[list[float]]] = {}
        for (program, _), found in group(runs, "program", "width").items():
            rates.setdefault(program, []).append(column(found, "rate"))
        lines += [[f"{algo.upper()}, {NAMES[program]}", *map(spread, values)] for program, values in rates.items()]
        ratios = [
            [ours / theirs for ours, theirs in zip(*pair, strict=True)]
            for pair in zip(rates["cpp-rl"], rates["jax"], strict=True)
        ]
        lines.append([f"{algo.upper()}, cpp-rl is faster by", *(spread(values, ".2f") for values in ratios)])
    return table(["timesteps/s, one seed, one core", *(f"{wide} wide" for wide in widths)], lines)


def mitigations(rows: Rows) -> str:
    """What each costs: the plain algorithm's rate over its own, repetition by repetition."""
    algos = list(dict.fromkeys(row["algo"] for row in rows))
    cells: dict[str, dict[str, str]] = {}
    for (name, algo), runs in group(rows, "mitigation", "algo").items():
        costs = [100 * (row["base"] / row["rate"] - 1) for row in runs]
        cells.setdefault(name, {})[algo] = spread(costs, ".0f")
    lines = [[f"`{name}`", *(cost.get(algo, "–") for algo in algos)] for name, cost in cells.items()]
    return table(["more time for a timestep, %", *map(str.upper, algos)], lines)


def processes(name: Callable[[dict[str, Any]], str]) -> Callable[[Rows], str]:
    """Wall time and peak memory of whole processes."""

    def make(rows: Rows) -> str:
        groups: dict[str, Rows] = {}
        for row in rows:
            groups.setdefault(name(row), []).append(row)
        lines = [
            [what, len(runs), spread(column(runs, "wall"), ".3g"), spread(column(runs, "peak_mb"))]
            for what, runs in groups.items()
        ]
        return table(["", "runs", "wall time, s", "peak memory, MB"], lines)

    return make


def memory(rows: Rows) -> str:
    """The slope between few and many seeds."""
    lines = []
    for (algo,), runs in group(rows, "algo").items():
        few, many = runs[0], runs[-1]
        slope = (many["peak_mb"] - few["peak_mb"]) / (many["seeds"] - few["seeds"])
        lines.append([algo.upper(), f"{few['peak_mb']:,.0f}", f"{many['peak_mb']:,.0f}", f"{slope:.1f}"])
    head = ["all seeds in training at once", "1 seed, MB", "16 seeds, MB", "each further seed, MB"]
    return table(head, lines)


def micro(rows: Rows) -> str:
    """Medians of criterion, and rates where they have elements."""
    lines = []
    for row in rows:
        each = row["ns"] / row["elements"]
        rate = f"{1e3 / each:,.2f}" if row["elements"] > 1 else ""
        interval = f"{duration(row['ns'])} [{duration(row['low'])}, {duration(row['high'])}]"
        lines.append([f"`{row['package']}`: {row['bench']}", interval, row["elements"], rate])
    return table(["bench", "median [95% interval]", "steps in it", "million steps/s"], lines)


def duration(ns: float) -> str:
    """With a unit that suits it."""
    unit, scale = next((pair for pair in (("s", 1e9), ("ms", 1e6), ("µs", 1e3)) if ns >= pair[1]), ("ns", 1))
    return f"{ns / scale:.3g} {unit}"


def limits(rows: Rows) -> str:
    """As the bench prints them."""
    return table(["quantity", "value"], [[row["quantity"], f"{row['value']} {row['unit']}".strip()] for row in rows])


def profile(rows: Rows) -> str:
    """Shares by part."""
    parts = sorted({row["part"] for row in rows}, key=lambda part: -sum(r["share"] for r in rows if r["part"] == part))
    algos = list(dict.fromkeys(row["algo"] for row in rows))
    share = {(row["algo"], row["part"]): f"{row['share']:.1%}" for row in rows}
    lines = [[part, *(share.get((algo, part), "") for algo in algos)] for part in parts]
    return table(["part of the time", *map(str.upper, algos)], lines)


TABLES: dict[str, Callable[[Rows], str]] = {
    "compare": compare,
    "cores": cores,
    "seeds": seeds,
    "width": width,
    "maps": along("side", lambda side: f"{side}×{side}"),
    "environments": along("environments", lambda count: f"{count} environment{'s' * (count > 1)}"),
    "mitigations": mitigations,
    "curriculum": processes(lambda _: "PPO-L2 through the five levels"),
    "startup": processes(lambda row: f"`{row['what']}`"),
    "memory": memory,
    "micro": micro,
    "limits": limits,
    "profile": profile,
}


def markdown(section: str, result: dict[str, Any]) -> str:
    """A section's table."""
    return TABLES[section](result["rows"])


def fill(document: Path, blocks: dict[str, str]) -> list[str]:
    """Puts every block between its markers in a document; returns the sections that it has no markers for."""
    text = document.read_text()
    missing = []
    for section, block in blocks.items():
        pattern = rf"(<!-- bench: {section} -->\n).*?(?=<!-- end -->)"
        text, found = re.subn(pattern, lambda m, block=block: f"{m[1]}{block}\n", text, flags=re.DOTALL)
        if not found:
            missing.append(section)
    document.write_text(text)
    return missing
