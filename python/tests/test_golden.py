"""The recorded trajectories that the Rust crate's tests follow too; their README describes them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oracle import REPOSITORY, OracleEnv
from support import make, make_vec

GOLDEN = sorted((REPOSITORY / "crates" / "coverage-env" / "tests" / "golden").glob("*.json"))
IMPLEMENTATIONS = ["single", "vector", "oracle"]


def test_there_are_recordings() -> None:
    assert len(GOLDEN) == 4


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_recorded_episodes_are_followed(path: Path, implementation: str) -> None:
    golden = json.loads(path.read_text())
    for episode in golden["episodes"]:
        env = build(implementation, golden["map"], episode["max_steps"])
        env.reset(options={"start": tuple(episode["start"])})
        for step in episode["steps"]:
            observation, *outcome, info = play(env, step["action"])
            assert outcome == [step["reward"], step["terminated"], step["truncated"]]
            assert np.argwhere(observation[1]).tolist() == [step["agent"]]
            assert "".join(str(int(cell)) for cell in observation[3].flat) == step["visited"]
        assert info["steps"] == len(episode["steps"])


def build(implementation: str, rows: list[str], max_steps: int) -> Any:
    if implementation == "oracle":
        return OracleEnv(rows, max_steps)
    options = {"level": "\n".join(rows), "max_steps": max_steps, "observation": "grid"}
    return make(**options) if implementation == "single" else make_vec(3, **options)


def play(env: Any, action: int) -> tuple[Any, ...]:
    """A step of a single environment, or of the last of several."""
    if not hasattr(env, "num_envs"):
        return env.step(action)
    observations, rewards, terminated, truncated, infos = env.step([1, 2, action])
    return observations[-1], rewards[-1], terminated[-1], truncated[-1], {"steps": infos["steps"][-1]}
