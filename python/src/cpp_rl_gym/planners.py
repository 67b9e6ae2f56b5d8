"""The planners that an agent is compared with."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from cpp_rl_gym._checks import natural, position
from cpp_rl_gym._extension import _native
from cpp_rl_gym.levels import LevelLike, as_level


class Plan(NamedTuple):
    """The actions of an episode and the return that they earn."""

    actions: npt.NDArray[np.int64]
    """``[length]``: 0 down, 1 up, 2 right, 3 left; to the end of the episode."""
    return_: float


def plan(
    level: LevelLike,
    start: tuple[int, int],
    planner: Literal["optimal", "astar"] = "optimal",
    *,
    max_steps: int = _native.MAX_STEPS,
) -> Plan:
    """Plans an episode on ``level`` from the cell ``start``, ``(row, column)``.

    ``"optimal"`` gives the best possible return. It is proved, and takes levels of up to 22 targets. ``"astar"`` is the
    paper's baseline: it always goes to the nearest target, along a shortest path. For many starts pass the same
    :class:`~cpp_rl_gym.Level`, so that ``"optimal"`` solves it once. Raises ValueError if no episode can start there.
    """
    row, column = position("start", start)
    limit = natural("max_steps", max_steps, low=1)
    actions, return_, _, _ = as_level(level).plan(planner, row, column, limit)
    return Plan(actions, return_)
