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
    visited; otherwise truncated after 200 steps. ``reset(options={"start": (row, column)})`` chooses the start.
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
        return self._observe(), {}

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        row, column = self.agent[0] + MOVES[int(action)][0], self.agent[1] + MOVES[int(action)][1]
        height, width = self.free.shape
        if 0 <= row < height and 0 <= column < width and self.free[row, column]:
            self.agent = (row, column)
        first = bool(self.targets[self.agent] and not self.visited[self.agent])
        self.visited[self.agent] = True
        self.steps += 1
        terminated = bool(self.visited[self.targets].all())
        truncated = not terminated and self.steps >= self.max_steps
        reward = (2.0 if first else -1.0) + (30.0 if terminated else 0.0)
        return self._observe(), reward, terminated, truncated, {}

    def _observe(self) -> np.ndarray:
        agent = np.zeros_like(self.free)
        agent[self.agent] = True
        return np.stack([self.free, agent, self.targets, self.visited]).astype(np.float32)
