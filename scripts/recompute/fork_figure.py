"""The recovered shares as a figure."""

from __future__ import annotations

import re
from html import escape

from .forks import Contrast
from .svg import COLOURS, sheet

ROW, LABELS, PANEL, GAP, TOP = 22, 320, 300, 24, 62
LOW, HIGH = -0.75, 1.75


def _label(treatment: str) -> str:
    """One name for the last layer that acts, whatever the algorithm calls it."""
    return re.sub(r"\b(policy|q)\.2-", "last layer × ", treatment)


def figure(pooled: dict[str, list[Contrast]], by_switch: dict[str, list[Contrast]]) -> str:
    """A panel for each algorithm, a row for each treatment: the share over all switches with its interval, and a smaller
    point for each switch."""
    treatments = sorted({_label(c.treatment) for contrasts in pooled.values() for c in contrasts}, key=lambda name: (name.count("+"), name))
    switches = sorted({c.switch for contrasts in by_switch.values() for c in contrasts})
    height = TOP + ROW * len(treatments) + 44
    width = LABELS + len(pooled) * (PANEL + GAP)
    parts = []
    for place, switch in enumerate(switches):
        x = LABELS + 110 * place
        parts.append(f'<circle cx="{x}" cy="34" r="3" fill="{COLOURS[place % len(COLOURS)]}"/><text x="{x + 8}" y="38">after stage {switch}</text>')
    x = LABELS + 110 * len(switches)
    parts.append(f'<circle cx="{x}" cy="34" r="5" fill="black"/><text x="{x + 10}" y="38">all, with 95% interval</text>')
    shares = [c.share for contrasts in (*pooled.values(), *by_switch.values()) for c in contrasts if c.share is not None]
    if any(not LOW <= share <= HIGH for share in shares):
        parts.append(f'<text x="{x + 190}" y="38" font-size="10">what lies beyond an edge is drawn on it</text>')
    for row, treatment in enumerate(treatments):
        parts.append(f'<text x="{LABELS - 10}" y="{TOP + ROW * row + 16}" text-anchor="end">{escape(treatment)}</text>')
    for panel, (name, contrasts) in enumerate(pooled.items()):
        parts += _panel(panel, name, contrasts, by_switch.get(name, []), treatments, switches)
    return sheet(width, height, "Share of the lost area that each treatment at a switch gives back", parts)


def _panel(
    panel: int, name: str, contrasts: list[Contrast], single: list[Contrast], treatments: list[str], switches: list[str]
) -> list[str]:
    left = LABELS + panel * (PANEL + GAP)

    def x(share: float) -> float:
        return left + PANEL * (min(max(share, LOW), HIGH) - LOW) / (HIGH - LOW)

    bottom = TOP + ROW * len(treatments)
    parts = [f'<text x="{left + PANEL / 2}" y="{TOP - 6}" text-anchor="middle" font-weight="bold">{escape(name)}</text>']
    for tick in (-0.5, 0, 0.2, 0.8, 1, 1.5):
        dashed = ' stroke-dasharray="3 3"' if tick in (0.2, 0.8) else ""
        colour = "#bbb" if tick in (-0.5, 1.5) else "#666"
        parts.append(f'<line x1="{x(tick)}" x2="{x(tick)}" y1="{TOP}" y2="{bottom}" stroke="{colour}"{dashed}/>')
        parts.append(f'<text x="{x(tick)}" y="{bottom + 16}" text-anchor="middle" font-size="10">{tick:g}</text>')
    parts.append(f'<text x="{left + PANEL / 2}" y="{bottom + 34}" text-anchor="middle">recovered share</text>')
    for c in single:
        if c.share is not None and _label(c.treatment) in treatments:
            colour = COLOURS[switches.index(c.switch) % len(COLOURS)]
            y = TOP + ROW * treatments.index(_label(c.treatment)) + 5 + 4 * switches.index(c.switch)
            parts.append(f'<circle cx="{x(c.share)}" cy="{y}" r="3" fill="{colour}"/>')
    for c in contrasts:
        y = TOP + ROW * treatments.index(_label(c.treatment)) + 11
        if c.share is None:
            parts.append(f'<text x="{x(0)}" y="{y + 4}" font-size="10">no loss</text>')
            continue
        if c.bounds:
            parts.append(f'<line x1="{x(c.bounds[0])}" x2="{x(c.bounds[1])}" y1="{y}" y2="{y}" stroke="black" stroke-width="2"/>')
        parts.append(f'<circle cx="{x(c.share)}" cy="{y}" r="5" fill="black"/>')
    return parts
