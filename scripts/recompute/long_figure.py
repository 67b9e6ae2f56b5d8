"""The loss over many levels as a figure."""

from __future__ import annotations

import math
from html import escape

from .arms import estimate
from .long import Algorithm
from .svg import COLOURS, sheet

WIDTH, PANEL, LEFT, TOP, GAP = 760, 260, 60, 44, 56

Point = tuple[float, float]


def figure(algorithms: list[Algorithm]) -> str:
    """A panel for each algorithm, a line for each arm: the mean loss by position, with its interval as a band."""
    height = TOP + len(algorithms) * (PANEL + GAP)
    panels = [_panel(algorithm, TOP + place * (PANEL + GAP)) for place, algorithm in enumerate(algorithms)]
    title = "Area of a new agent minus that of one with a past, with 95% intervals"
    return sheet(WIDTH, height, title, [part for panel in panels for part in panel])


def _panel(algorithm: Algorithm, top: float) -> list[str]:
    by_arm = {
        name: [estimate(list(of_seeds)) for of_seeds in zip(*(course.losses for course in courses.values()))]
        for name, courses in algorithm.courses.items()
    }
    last = max(len(points) for points in by_arm.values()) - 1
    values = [value for points in by_arm.values() for point in points for value in point[:3] if value is not None]
    # Whole tenths.
    low, high = math.floor(10 * min(0.0, *values)), math.ceil(10 * max(0.1, *values))

    def x(position: float) -> float:
        return round(LEFT + (WIDTH - LEFT - 20) * position / last, 1)

    def y(loss: float) -> float:
        return round(top + 20 + (PANEL - 20) * (1 - (10 * loss - low) / (high - low)), 1)

    def path(points: list[Point]) -> str:
        return " ".join(f"{x(at)},{y(loss)}" for at, loss in points)

    parts = []
    every = 2 if high - low > 10 else 1
    for tenth in range(low, high + 1):
        if tenth % every == 0:
            colour, at = "#666" if tenth == 0 else "#ddd", y(tenth / 10)
            parts.append(f'<line x1="{x(0)}" x2="{x(last)}" y1="{at}" y2="{at}" stroke="{colour}"/>')
            parts.append(f'<text x="{LEFT - 8}" y="{at + 4:.1f}" text-anchor="end" font-size="10">{tenth / 10:.1f}</text>')
    bottom = top + PANEL
    for position in range(0, last + 1, 5 if last > 10 else 1):
        parts.append(f'<text x="{x(position)}" y="{bottom + 16}" text-anchor="middle" font-size="10">{position}</text>')
    parts.append(f'<text x="{x(last / 2)}" y="{bottom + 34}" text-anchor="middle">position of the level</text>')
    for place, (name, points) in enumerate(by_arm.items()):
        colour = COLOURS[place % len(COLOURS)]
        middle, lower, upper = (list(enumerate(values)) for values in list(zip(*points))[:3])
        # A single seed has no interval.
        if None not in (bound for _, bound in lower):
            band = path(lower + upper[::-1])
            parts.append(f'<polygon points="{band}" fill="{colour}" fill-opacity="0.15"/>')
        parts.append(f'<polyline points="{path(middle)}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<rect x="{LEFT + 200 * place}" y="{top - 4}" width="12" height="12" fill="{colour}"/>')
        parts.append(f'<text x="{LEFT + 200 * place + 18}" y="{top + 6}">{escape(name)}</text>')
    return parts
