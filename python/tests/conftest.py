"""Fixtures shared by the tests."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from cpp_rl_gym.checkpoint import Checkpoint
from oracle import REPOSITORY

SB3_FIXTURES = REPOSITORY / "tests" / "fixtures" / "sb3"


@pytest.fixture(scope="session")
def returns() -> dict[str, dict[tuple[int, int], float]]:
    """Model -> start cell -> return, as Stable-Baselines3 measured it."""
    measured = json.loads((SB3_FIXTURES / "returns.json").read_text())
    return {name: {tuple(row["start"]): row["return"] for row in rows} for name, rows in measured.items()}


def random_checkpoint(algorithm: str = "ppo", *, height: int = 2, width: int = 3, optimizer: bool = True) -> Checkpoint:
    """A small checkpoint of a non-square map, with random tensors."""
    inputs = 4 * height * width
    towers = {"ppo": {"policy": (inputs, 5, 4), "value": (inputs, 6, 7, 1)}, "dqn": {"q": (inputs, 5, 6, 4)}}[algorithm]
    random = np.random.default_rng(7)
    checkpoint = Checkpoint(
        algorithm=algorithm,
        activation={"ppo": "tanh", "dqn": "relu"}[algorithm],
        towers=towers,
        height=height,
        width=width,
        tensors={},
        adam_step=12 if optimizer else 0,
        num_timesteps=3456,
        seed=2**40,
        stage=1,
        level="3",
        source='a "quoted" source, nämlich "crc32":"12345678"',
        counters={"updates": 12, "target_calls": 99 if algorithm == "dqn" else 0},
    )
    prefixes = [""] + ["target/"] * (algorithm == "dqn") + ["exp_avg/", "exp_avg_sq/"] * optimizer
    for name, shape in list(checkpoint.parameters()):
        for prefix in prefixes:
            checkpoint.tensors[prefix + name] = (
                random.random(shape, np.float32) - np.float32(prefix != "exp_avg_sq/") / 2
            )
    return checkpoint


def assert_equal(left: Checkpoint, right: Checkpoint) -> None:
    """Every field and every bit of every tensor."""
    assert left.tensors.keys() == right.tensors.keys()
    for name, tensor in left.tensors.items():
        np.testing.assert_array_equal(tensor, right.tensors[name], err_msg=name)
    assert {**vars(left), "tensors": 0} == {**vars(right), "tensors": 0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A fresh folder; afterwards nothing half-written may be left in it."""
    yield tmp_path
    assert not list(tmp_path.glob(".*.part"))


@pytest.fixture(autouse=True, scope="session")
def windows_without_a_screen() -> None:
    """Lets pygame open its windows nowhere."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
