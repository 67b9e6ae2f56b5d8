"""A state as a picture: cells, walls, targets, the agent and its trail.

It is drawn with NumPy alone. A shape is a *mask*: the share of each pixel that it covers. The mask is computed from the
distance to the edge, so that edges are smooth. Masks of one size are made once.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from cpp_rl_gym._extension import _native

Image = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.floating]
Distances = npt.NDArray[np.floating]
Colour = tuple[int, int, int]
Cell = tuple[int, int]

BACKGROUND: Colour = (236, 239, 244)
FREE: Colour = (255, 255, 255)
VISITED: Colour = (219, 234, 251)
WALL: Colour = (52, 62, 80)
TARGET: Colour = (240, 140, 36)
TARGET_TILE: Colour = (255, 240, 217)
REACHED: Colour = (46, 160, 103)
REACHED_TILE: Colour = (214, 240, 225)
TRAIL_OLD: Colour = (173, 205, 242)
TRAIL_NEW: Colour = (37, 99, 206)
START: Colour = (120, 160, 214)
AGENT: Colour = (214, 48, 73)

LONGEST_SIDE = 640
CELL_SIZES = (8, 72)  # the least and the most pixels that a cell is wide


def picture(level: _native.Level, path: list[Cell]) -> Image:
    """The picture, ``[height, width, 3]``, of an episode on ``level`` in which the agent went along ``path``."""
    size = _cell_size(level.height, level.width)
    image = _tiles(level, size).copy()
    targets, visited = set(level.targets), set(path)
    for cell in visited:
        _paint(image, cell, size, _tile(size), REACHED_TILE if cell in targets else VISITED)
    _draw_trail(image, path, size)
    _paint(image, path[0], size, _ring(size, 0.17, 0.06), START)
    for cell in targets:
        _draw_target(image, cell, size, reached=cell in visited)
    _draw_agent(image, path[-1], size)
    return image


def _cell_size(height: int, width: int) -> int:
    least, most = CELL_SIZES
    return min(max(LONGEST_SIDE // max(height, width), least), most)


@lru_cache(maxsize=8)
def _tiles(level: _native.Level, size: int) -> Image:
    """The map before the agent came, with a margin around it."""
    margin = _margin(size)
    image = np.empty((level.height * size + 2 * margin, level.width * size + 2 * margin, 3), np.uint8)
    image[:] = BACKGROUND
    colours = {".": FREE, "#": WALL, "T": TARGET_TILE}
    for row, line in enumerate(level.map.splitlines()):
        for column, character in enumerate(line):
            _paint(image, (row, column), size, _tile(size), colours[character])
    return image


def _draw_trail(image: Image, path: list[Cell], size: int) -> None:
    """A line through the cells of ``path``, the paler the older."""
    newest = {(one, other): age for age, (one, other) in enumerate(_segments(path))}
    for (one, other), age in sorted(newest.items(), key=lambda item: item[1]):
        share = (age + 1) / len(path)
        colour = tuple(round(old + (new - old) * share) for old, new in zip(TRAIL_OLD, TRAIL_NEW, strict=True))
        _paint_segment(image, one, other, size, (colour[0], colour[1], colour[2]))


def _segments(path: list[Cell]) -> list[tuple[Cell, Cell]]:
    """The moves of ``path``, upper or left cell first; steps against a wall are none."""
    return [(min(move), max(move)) for move in pairwise(path) if move[0] != move[1]]


def _draw_target(image: Image, cell: Cell, size: int, *, reached: bool) -> None:
    """A bull's-eye."""
    colour = REACHED if reached else TARGET
    _paint(image, cell, size, _ring(size, 0.29, 0.075), colour)
    _paint(image, cell, size, _disc(size, 0.11), colour)


def _draw_agent(image: Image, cell: Cell, size: int) -> None:
    _paint(image, cell, size, _disc(size, 0.36), (255, 255, 255))
    _paint(image, cell, size, _disc(size, 0.30), AGENT)
    _paint(image, cell, size, _disc(size, 0.10), (255, 255, 255))


def _margin(size: int) -> int:
    return size // 4


def _paint(image: Image, cell: Cell, size: int, mask: Mask, colour: Colour) -> None:
    """Lays ``colour`` over a cell, as far as ``mask``, ``[size, size]``, covers it."""
    top, left = (_margin(size) + index * size for index in cell)
    _blend(image[top : top + size, left : left + size], mask, colour)


def _paint_segment(image: Image, one: Cell, other: Cell, size: int, colour: Colour) -> None:
    """Lays ``colour`` over the line from a cell's centre to that of its lower or right neighbour."""
    top, left = (_margin(size) + index * size for index in one)
    mask = _segment(size)
    if one[0] != other[0]:
        mask = mask.T
    _blend(image[top : top + mask.shape[0], left : left + mask.shape[1]], mask, colour)


def _blend(part: Image, mask: Mask, colour: Colour) -> None:
    share = mask[:, :, None]
    part[:] = np.rint(part * (1 - share) + np.array(colour) * share)


@lru_cache
def _tile(size: int) -> Mask:
    """A square with round corners and a little room around it."""
    half, radius = size / 2 - max(size * 0.03, 0.5), size * 0.12
    across, down = (np.abs(axis) - (half - radius) for axis in _axes(size, size))
    outside = np.hypot(np.maximum(across, 0), np.maximum(down, 0)) + np.minimum(np.maximum(across, down), 0)
    return _coverage(outside - radius)


@lru_cache
def _disc(size: int, radius: float) -> Mask:
    across, down = _axes(size, size)
    return _coverage(np.hypot(across, down) - radius * size)


@lru_cache
def _ring(size: int, radius: float, thickness: float) -> Mask:
    """A circle drawn with a pen of ``thickness``; both in cells."""
    across, down = _axes(size, size)
    return _coverage(np.abs(np.hypot(across, down) - radius * size) - thickness / 2 * size)


@lru_cache
def _segment(size: int) -> Mask:
    """A line with round ends between the centres of two cells side by side, ``[size, 2 * size]``."""
    across, down = _axes(2 * size, size)
    beyond = np.maximum(np.abs(across) - size / 2, 0)
    return _coverage(np.hypot(beyond, down) - 0.07 * size)


def _axes(width: int, height: int) -> tuple[Distances, Distances]:
    """How far the pixels' centres are right of the middle, ``[1, width]``, and below it, ``[height, 1]``."""
    return np.arange(width)[None, :] + (1 - width) / 2, np.arange(height)[:, None] + (1 - height) / 2


def _coverage(distance: Distances) -> Mask:
    """The share of a pixel inside an edge that is ``distance`` pixels away, negative inside."""
    return np.asarray(np.clip(0.5 - distance, 0, 1))
