"""What several tests of the environment need."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import cpp_rl_gym
from oracle import REPOSITORY

LEVELS = range(5)
DOWN, UP, RIGHT, LEFT = range(4)


def make(level: Any = 0, **options: Any) -> gym.Env:
    """The environment without wrappers."""
    return gym.make(cpp_rl_gym.ENV_ID, level=level, **options).unwrapped


def make_vec(num_envs: int, **options: Any) -> gym.vector.VectorEnv:
    return gym.make_vec(cpp_rl_gym.ENV_ID, num_envs, vectorization_mode="vector_entry_point", **options)


def random_maps(count: int, *, seed: int = 0) -> list[list[str]]:
    """Maps of random sizes, few of them square, as rows."""
    random, maps = np.random.default_rng(seed), []
    for number in range(count):
        height, width = random.integers(2, 12, size=2).tolist()
        level = cpp_rl_gym.Level.generate(
            height=height,
            width=width,
            wall_density=float(random.uniform(0, 0.4)),
            num_targets=int(random.integers(1, max(2, height * width // 4))),
            seed=number,
        )
        maps.append(level.map.splitlines())
    return maps


def assert_same(left: Any, right: Any) -> None:
    """The same values, types and shapes, all the way down."""
    assert data_equivalence(left, right, exact=True), f"{left}\n--- differs from ---\n{right}"


def binary() -> Path:
    """That of the variable CPP_RL, or the repository's own release build."""
    target = REPOSITORY / os.environ.get("CARGO_TARGET_DIR", "target")
    path = Path(os.environ.get("CPP_RL") or target / "release" / "cpp-rl")
    if not path.is_file():
        pytest.fail(f"{path} is missing; build it with `cargo build --release --bin cpp-rl`, or set CPP_RL to it")
    return path


def cpp_rl(*arguments: str | Path) -> str:
    """What the binary prints."""
    done = subprocess.run([binary(), *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
