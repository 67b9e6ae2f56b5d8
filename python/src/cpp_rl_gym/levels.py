"""Levels, and rules that give each episode its level.

A level can be given as:

=============================================  ==================================================================
``0`` to ``4``, ``"0"`` to ``"4"``             a built-in level; ``BUILTIN_LEVELS`` lists them
``"levels/mine.yaml"``, a ``Path``             a level in a file
``"..T\\n.#T"``                                 a map: ``.`` free, ``#`` wall, ``T`` target, a line per row
a :class:`Level`                               that level
=============================================  ==================================================================

Environments also take a rule in place of a level. A rule is a list of any of these (one is drawn for each episode), a
:class:`RandomLevels`, or a :class:`Curriculum`. All levels of one environment must have the same height and width.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cpp_rl_gym._checks import natural, pair
from cpp_rl_gym._extension import _native

Level = _native.Level
BUILTIN_LEVELS: tuple[str, ...] = tuple(_native.BUILTIN_LEVELS)

LevelLike = int | str | os.PathLike[str] | Level
"""What :func:`as_level` takes."""


def as_level(level: LevelLike) -> Level:
    """Finds a level; the module's documentation lists what can be passed. Raises ValueError or TypeError otherwise."""
    if isinstance(level, Level):
        return level
    if isinstance(level, str):
        # A map of one row has only a map's characters, and a target among them. No path looks like this.
        is_map = "\n" in level or ("T" in level and set(level) <= set(".#T"))
        return Level.from_map(level) if is_map else Level.resolve(level)
    if isinstance(level, os.PathLike):
        return Level.from_path(level)
    ids = f"{BUILTIN_LEVELS[0]} to {BUILTIN_LEVELS[-1]}"
    if isinstance(level, bool) or not hasattr(level, "__index__"):
        raise TypeError(
            f"{level!r} is not a level; pass one of {ids}, a path, a map as a string, or a cpp_rl_gym.Level"
        )
    number = str(int(level))
    if number not in BUILTIN_LEVELS:
        raise ValueError(f"no built-in level {number}; there are {ids} (a level of your own is a path or a map)")
    return Level.resolve(number)


@dataclass(frozen=True)
class RandomLevels:
    """A generated level for each episode.

    Levels are numbered ``seed``, ``seed + 1``, …. The same description and number give the same level on every machine;
    ``Level.generate`` makes one. Each episode draws one of ``num_levels`` levels. If that is None there are 2**32, so
    that a level hardly ever comes twice. To measure generalisation, train on ``RandomLevels(num_levels=200)`` and
    evaluate on ``RandomLevels(seed=200)``: these levels were not trained on.
    """

    height: int = 8
    width: int = 8
    wall_density: float = 0.15
    """The share of cells that are walls, in [0, 1)."""
    num_targets: int = 8
    seed: int = 0
    num_levels: int | None = None

    def _source(self) -> _native.LevelSource:
        return _native.LevelSource.generated(
            natural("height", self.height, low=1),
            natural("width", self.width, low=1),
            float(self.wall_density),
            natural("num_targets", self.num_targets, low=1),
            natural("seed", self.seed, high=2**64 - 1),
            None if self.num_levels is None else natural("num_levels", self.num_levels, low=1),
        )


@dataclass(frozen=True)
class Curriculum:
    """One level after another, each for a number of timesteps; the last one has no end.

    ``stages`` are pairs ``(level, timesteps)``. The level may also be a list or a :class:`RandomLevels`. An episode
    keeps its level to its end. A new episode takes the level of the next stage once the timesteps of all stages before
    are over. In a vector environment each copy counts its own timesteps: eight copies with stages of 25_000 make
    200_000 timesteps of each stage.
    """

    stages: Sequence[tuple[LevelLike | Sequence[LevelLike] | RandomLevels, int]]

    def _source(self) -> _native.LevelSource:
        stages = []
        for number, stage in enumerate(self.stages):
            level, timesteps = pair(f"stage {number} of the curriculum", stage, "(level, timesteps)")
            stages.append((natural("the timesteps of a stage", timesteps, low=1, high=2**63), as_source(level)))
        return _native.LevelSource.stages(stages)


LevelRule = LevelLike | Sequence[Any] | RandomLevels | Curriculum
"""What environments take as ``level``."""


def as_source(level: LevelRule) -> _native.LevelSource:
    """Makes a rule of a level or rule; raises ValueError or TypeError if it is neither."""
    if isinstance(level, RandomLevels | Curriculum):
        return level._source()
    if isinstance(level, str | bytes) or not isinstance(level, Sequence):
        return _native.LevelSource.fixed(as_level(level))  # type: ignore[arg-type] # it refuses bytes
    return _native.LevelSource.one_of([as_source(one) for one in level])
