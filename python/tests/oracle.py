"""The environment's rules once more, in plain NumPy: what tests and the Stable-Baselines3 scripts measure against.

It shares no code with crates/coverage-env, so that agreement between the two means something.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
MAX_STEPS = 200
MOVES = ((1, 0), (-1, 0), (0, 1), (0, -1))  # down, up, right, left: (row, column)


def read_map(level: str | Path) -> list[str]:
    """Rows of a level: an id in levels/ (``"0"``) or a path to a YAML file with a ``map: |`` block."""
    path = Path(level) if Path(level).suffix else REPOSITORY / "levels" / f"{level}.yaml"
    lines = iter(path.read_text().splitlines())
    for line in lines:
        if line.split("#")[0].strip() == "map: |":
            break
    rows = []
    for line in lines:
        if not line.startswith(" "):
            break
        rows.append(line.strip())
    if not rows or len({len(row) for row in rows}) != 1 or set("".join(rows)) - set(".#T"):
        raise ValueError(f"{path}: no rectangular map of '.', '#' and 'T'")
    return rows


class OracleEnv(gym.Env[np.ndarray, int]):
    """One agent on one map.

    Observation float32 ``[4, H, W]``: not a wall, agent, targets, visited. Actions: 0 down, 1 up, 2 right, 3 left.
    Reward: -1, or 2 on the first visit of a target, and 30 more on the last of them. Terminated when every target is
    visited; truncated after 200 steps; both may hold. ``reset(options={"start": (row, column)})`` chooses the start.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own declaration)

    def __init__(self, rows: list[str], max_steps: int = MAX_STEPS) -> None:
        cells = np.array([list(row) for row in rows])
        self.free = cells != "#"  # bool [H, W]
        self.targets = cells == "T"  # bool [H, W]
        self.visited = np.zeros_like(self.free)  # bool [H, W]
        self.agent = (0, 0)
        self.steps = 0
        self.max_steps = max_steps
        self.observation_space = gym.spaces.Box(0.0, 1.0, (4, *cells.shape), np.float32)
        self.action_space = gym.spaces.Discrete(4)

    def starts(self) -> list[tuple[int, int]]:
        """Free cells that are not targets, row-major."""
        return [(int(row), int(column)) for row, column in np.argwhere(self.free & ~self.targets)]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        super().reset(seed=seed)
        starts = self.starts()
        start = (options or {}).get("start")
        self.agent = starts[self.np_random.integers(len(starts))] if start is None else tuple(start)
        self.visited = np.zeros_like(self.free)
        self.visited[self.agent] = True
        self.steps = 0
        return self._observe(), self._info()

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        if self._is_open(action):
            self.agent = (self.agent[0] + MOVES[int(action)][0], self.agent[1] + MOVES[int(action)][1])
        first = bool(self.targets[self.agent] and not self.visited[self.agent])
        self.visited[self.agent] = True
        self.steps += 1
        terminated = bool(self.visited[self.targets].all())
        truncated = self.steps >= self.max_steps
        reward = (2.0 if first else -1.0) + (30.0 if terminated else 0.0)
        return self._observe(), reward, terminated, truncated, self._info()

    def _is_open(self, action: int) -> bool:
        row, column = self.agent[0] + MOVES[int(action)][0], self.agent[1] + MOVES[int(action)][1]
        height, width = self.free.shape
        return bool(0 <= row < height and 0 <= column < width and self.free[row, column])

    def _info(self) -> dict[str, Any]:
        return {
            "steps": self.steps,
            "remaining_targets": int((self.targets & ~self.visited).sum()),
            "action_mask": np.array([self._is_open(action) for action in range(4)], np.int8),
        }

    def _observe(self) -> np.ndarray:
        agent = np.zeros_like(self.free)
        agent[self.agent] = True
        return np.stack([self.free, agent, self.targets, self.visited]).astype(np.float32)


class VectorOracle:
    """Many agents at once in arrays, each on its own map of one size; an agent starts the next episode when one ends.

    The same rules in another way: no loop over agents. Observations are ``[n, 4, H, W]``; the infos are those of
    :class:`OracleEnv`, an array for each key.
    """

    def __init__(self, maps: list[list[str]], max_steps: int = MAX_STEPS, seed: int = 0) -> None:
        cells = np.array([[list(row) for row in rows] for rows in maps])
        self.free = cells != "#"  # bool [n, H, W]
        self.targets = cells == "T"  # bool [n, H, W]
        self.visited = np.zeros_like(self.free)  # bool [n, H, W]
        self.agents = np.zeros((len(maps), 2), np.int64)  # (row, column)
        self.steps = np.zeros(len(maps), np.int64)
        self.max_steps = max_steps
        self.random = np.random.default_rng(seed)
        self._walled = np.pad(self.free, ((0, 0), (1, 1), (1, 1)))  # bool [n, H + 2, W + 2]
        self._all = np.arange(len(maps))

    def reset(self, starts: np.ndarray | None = None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Begins an episode for every agent, at ``starts``, ``[n, 2]``, or at random."""
        self._begin(self._all, starts)
        return self._observe(), self._infos()

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Moves every agent. Where an episode ends, the observation and info are already those of the next."""
        ahead = self.agents + np.array(MOVES)[actions]
        is_open = self._walled[self._all, ahead[:, 0] + 1, ahead[:, 1] + 1]
        self.agents = np.where(is_open[:, None], ahead, self.agents)
        here = (self._all, self.agents[:, 0], self.agents[:, 1])
        first = self.targets[here] & ~self.visited[here]
        self.visited[here] = True
        self.steps += 1
        terminated = self._remaining() == 0
        truncated = self.steps >= self.max_steps
        rewards = np.where(first, 2.0, -1.0) + 30.0 * (terminated & first)
        if (over := np.flatnonzero(terminated | truncated)).size:
            self._begin(over)
        return self._observe(), rewards, terminated, truncated, self._infos()

    def _begin(self, agents: np.ndarray, starts: np.ndarray | None = None) -> None:
        if starts is None:
            height, width = self.free.shape[1:]
            chance = self.random.random((len(agents), height * width))
            chance[~(self.free & ~self.targets)[agents].reshape(len(agents), -1)] = -1
            starts = np.stack(np.divmod(chance.argmax(axis=1), width), axis=1)
        self.agents[agents] = starts
        self.visited[agents] = False
        self.visited[agents, starts[:, 0], starts[:, 1]] = True
        self.steps[agents] = 0

    def _remaining(self) -> np.ndarray:
        return (self.targets & ~self.visited).sum(axis=(1, 2))

    def _infos(self) -> dict[str, np.ndarray]:
        ahead = self.agents[:, None] + np.array(MOVES)  # [n, 4, 2]
        masks = self._walled[self._all[:, None], ahead[..., 0] + 1, ahead[..., 1] + 1]
        return {
            "steps": self.steps.copy(),
            "remaining_targets": self._remaining(),
            "action_mask": masks.astype(np.int8),
        }

    def _observe(self) -> np.ndarray:
        agents = np.zeros_like(self.free)
        agents[self._all, self.agents[:, 0], self.agents[:, 1]] = True
        return np.stack([self.free, agents, self.targets, self.visited], axis=1).astype(np.float32)
