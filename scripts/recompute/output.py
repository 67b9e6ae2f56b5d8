"""Tables as Markdown and as CSV."""

from __future__ import annotations

import csv
import sys
from pathlib import Path

Row = list[object]
# Heads and rows, by title.
Tables = dict[str, tuple[list[str], list[Row]]]


def _short(value: object) -> str:
    if value is None:
        return "–"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _in_full(value: object) -> object:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else value


def markdown(heads: list[str], rows: list[Row]) -> str:
    lines = [heads, ["---"] * len(heads), *([_short(value) for value in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def write(tables: Tables, folder: Path) -> None:
    """A CSV of each table, every number in full."""
    folder.mkdir(parents=True, exist_ok=True)
    for title, (heads, rows) in tables.items():
        with open(folder / f"{title}.csv", "w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(heads)
            writer.writerows([_in_full(value) for value in row] for row in rows)


def show(tables: Tables) -> None:
    """All tables on standard output, which may be closed early."""
    try:
        for title, (heads, rows) in tables.items():
            print(f"## {title}\n\n{markdown(heads, rows)}")
    except BrokenPipeError:
        sys.stderr.close()
