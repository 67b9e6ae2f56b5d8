"""Levels, and rules that give each episode its level.

Wherever a level is asked for, these will do:

=============================================  ==================================================================
``0`` to ``4``, ``"0"`` to ``"4"``             a built-in level; ``BUILTIN_LEVELS`` lists them
``"levels/mine.yaml"``, a ``Path``             a level in a file
``"..T\\n.#T"``                                 a map: ``.`` free, ``#`` wall, ``T`` target, a line per row
a :class:`Level`                               itself
=============================================  ==================================================================

Environments also take a rule in place of a level: a list of any of these (one of them is drawn for each episode), a
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
    """The level that is meant; the module's documentation has a table. Raises ValueError or TypeError if none is."""
    if isinstance(level, Level):
        return level
    if isinstance(level, str):
        # A map of one row can be told from a path since it has nothing but a map's characters, a target among them.
        is_map = "\n" in level or ("T" in level and set(level) <= set(".#T"))
        return Level.from_map(level) if is_map else Level.resolve(level)
    if isinstance(level, os.PathLike):
        return Level.from_path(level)
    ids = f"{BUILTIN_LEVELS[0]} to {BUILTIN_LEVELS[-1]}"
    if isinstance(level, bool) or not hasattr(level, "__index__"):
        raise TypeError(f"{level!r} is no level; pass one of {ids}, a path, a map as a string, or a cpp_rl_gym.Level")
    number = str(int(level))
    if number not in BUILTIN_LEVELS:
        raise ValueError(f"no built-in level {number}; there are {ids} (a level of your own is a path or a map)")
    return Level.resolve(number)


@dataclass(frozen=True)
class RandomLevels:
    """A generated level for each episode.

    Levels are numbered ``seed``, ``seed + 1``, …; the same description with the same number is the same level, always
    and everywhere (``Level.generate`` makes one). Each episode draws one of ``num_levels`` of them, or of 2**32 if that
    is None, so that hardly any comes twice. To study generalisation, train on ``RandomLevels(num_levels=200)`` and
    evaluate on ``RandomLevels(seed=200)``, levels never trained on.
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
    """One level after the other, each for so many timesteps; the last goes on for ever.

    ``stages`` are pairs ``(level, timesteps)``, where the level may also be a list or a :class:`RandomLevels`. An
    episode keeps its level to its end: the next one is played on the next stage's as soon as the environment has made
    the timesteps of the stages before. In a vector environment each copy counts its own: eight copies with stages of
    25_000 make 200_000 timesteps of each stage.
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
    """The rule that is meant; raises ValueError or TypeError if none is."""
    if isinstance(level, RandomLevels | Curriculum):
        return level._source()
    if isinstance(level, str | bytes) or not isinstance(level, Sequence):
        return _native.LevelSource.fixed(as_level(level))  # type: ignore[arg-type] # it refuses bytes
    return _native.LevelSource.one_of([as_source(one) for one in level])
