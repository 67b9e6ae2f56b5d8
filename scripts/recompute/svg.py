"""What all figures have in common."""

from __future__ import annotations

COLOURS = ["#0072b2", "#e69f00", "#009e73", "#cc79a7"]


def sheet(width: float, height: float, title: str, parts: list[str]) -> str:
    """A white sheet with a title and these parts."""
    head = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}" '
        'font-family="sans-serif" font-size="12"><rect width="100%" height="100%" fill="white"/>',
        f'<text x="10" y="18" font-size="14">{title}</text>',
    ]
    return "\n".join([*head, *parts, "</svg>\n"])
