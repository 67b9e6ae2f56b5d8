"""The bridge between cpp-rl and Python: every file here was written by the binary in this test run.

The binary is that of the variable CPP_RL, or the repository's own release build.
"""

from __future__ import annotations

import json
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpp_rl_gym
from conftest import assert_equal
from cpp_rl_gym.checkpoint import read, to_bytes
from cpp_rl_gym.sb3 import DEFAULT_ACTIVATION, main
from oracle import REPOSITORY
from support import cpp_rl

pytest.importorskip("safetensors", reason="checkpoints are safetensors files")

EXAMPLE = REPOSITORY / "python" / "examples" / "evaluate_checkpoint.py"
PRESETS = ("ppo", "ppo-l2", "dqn")
BLOCKS = ["--set", "layer_norm=true", "--set", "activation=crelu"]
# Networks and sensors that Stable-Baselines3 does not have: preset, settings, and what an export says of them.
OTHERS = {
    "norm": ("ppo", BLOCKS[:2], "has no normalised layers"),
    "crelu": ("dqn", BLOCKS[2:], "has no activation crelu"),
    "fourier": ("ppo", ["--set", "activation=fourier"], "has no activation fourier"),
    "ppo-both": ("ppo", BLOCKS, "has no normalised layers"),
    "dqn-both": ("dqn", BLOCKS, "has no normalised layers"),
    "local": ("ppo", ["--set", "sensor=local"], "would not know its sensor local"),
    "dqn-local": ("dqn", ["--set", "sensor=local", *BLOCKS], "has no normalised layers"),
}
TIMESTEPS = 2048  # one rollout of PPO


@dataclass(frozen=True)
class Trained:
    """A checkpoint that the binary wrote, and where it comes from."""

    path: Path
    preset: str
    stage: int
    level: str

    def evaluation(self, level: str) -> dict[tuple[int, int], float]:
        """Start cell -> return, as `cpp-rl eval` says."""
        return evaluation(self.path, level)


def evaluation(path: Path, level: str) -> dict[tuple[int, int], float]:
    [found] = json.loads(cpp_rl("eval", path, "--levels", level, "--format", "json"))["levels"]
    return {tuple(episode["start"]): episode["return"] for episode in found["episodes"]}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of all presets, as `train` and as `curriculum` make them; and a level."""
    folder = tmp_path_factory.mktemp("runs")
    common = ["--timesteps", str(TIMESTEPS), "--seeds", "3", "--quiet", "--jobs", "1", "--plasticity-interval", "0"]
    for preset in PRESETS:
        cpp_rl("train", "--algo", preset, "--level", "2", "--out", folder / "train", *common)
        cpp_rl("curriculum", "--algo", preset, "--levels", "0,1", "--out", folder / "curriculum", *common)
    for name, (preset, settings, _) in OTHERS.items():
        arm = ["--set", f"name={name}", *settings]
        cpp_rl("curriculum", "--algo", preset, *arm, "--levels", "0,1", "--out", folder / "others", *common)
    # Many targets, so that returns differ from start to start although the agents are poor.
    spec = ["--wall-density", "0.1", "--targets", "30", "--seed", "1"]
    (folder / "dense.yaml").write_text(cpp_rl("levels", "generate", *spec))
    return folder


@pytest.fixture(scope="module", params=[f"{preset} {command}" for preset in PRESETS for command in ("train", "later")])
def trained(runs: Path, request: pytest.FixtureRequest) -> Trained:
    preset, command = request.param.split()
    if command == "train":
        stage, level, run = 0, "2", runs / "train" / preset / "level-2" / "seed-3"
    else:
        stage, level, run = 1, "1", runs / "curriculum" / preset / "curriculum" / "seed-3"
    return Trained(run / "checkpoints" / f"stage-{stage}.safetensors", preset, stage, level)


@pytest.fixture(scope="module", params=OTHERS)
def other(runs: Path, request: pytest.FixtureRequest) -> Trained:
    run = runs / "others" / request.param / "curriculum" / "seed-3"
    return Trained(run / "checkpoints" / "stage-1.safetensors", request.param, 1, "1")


def test_it_is_read(trained: Trained) -> None:
    agent = read(trained.path)
    assert (agent.algorithm, agent.level, agent.stage, agent.seed) == (
        *(trained.preset.removesuffix("-l2"), trained.level, trained.stage, 3),
    )
    assert agent.num_timesteps == TIMESTEPS * (trained.stage + 1)
    assert agent.adam_step > 0 and agent.counters["updates"] > 0
    assert agent.counters["target_calls"] == (agent.num_timesteps if agent.algorithm == "dqn" else 0)
    assert agent.source.startswith("cpp-rl ")
    for name, _ in agent.parameters():  # all of it was trained
        assert np.any(agent.tensors[f"exp_avg/{name}"]) and np.any(agent.tensors[f"exp_avg_sq/{name}"])
    assert to_bytes(agent) == trained.path.read_bytes()


def test_greedy_evaluation_is_the_same_from_every_start(trained: Trained, runs: Path) -> None:
    check_evaluation(trained, runs)


def test_greedy_evaluation_of_other_networks_is_the_same_from_every_start(other: Trained, runs: Path) -> None:
    agent, (_, settings, _) = read(other.path), OTHERS[other.preset]
    assert agent.layer_norm == ("layer_norm=true" in settings)
    chosen = [setting.removeprefix("activation=") for setting in settings if setting.startswith("activation=")]
    assert [agent.activation] == (chosen or [DEFAULT_ACTIVATION[agent.algorithm]])
    assert agent.sensor == ("local" if "sensor=local" in settings else "full")
    assert to_bytes(agent) == other.path.read_bytes()
    for name, _ in agent.parameters():  # norms are trained too
        assert np.any(agent.tensors[f"exp_avg/{name}"])
    check_evaluation(other, runs)


def test_other_networks_are_not_exported(
    other: Trained, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(other.path), str(folder / "a.zip")]) == 2
    assert OTHERS[other.preset][2] in capsys.readouterr().err
    assert not (folder / "a.zip").exists()


def check_evaluation(trained: Trained, runs: Path) -> None:
    """That Python's arithmetic earns what `cpp-rl eval` says, start by start."""
    evaluate = runpy.run_path(str(EXAMPLE))["evaluate"]
    agent, kinds = read(trained.path), set()
    for name in (trained.level, str(runs / "dense.yaml")):
        level = cpp_rl_gym.as_level(name)
        theirs, ours = trained.evaluation(name), evaluate(agent, level)
        assert {start: theirs[start] for start in level.starts} == dict(zip(level.starts, ours.tolist(), strict=True))
        kinds |= set(theirs.values())
    assert len(kinds) > 3  # or the comparison would say little


def test_the_example_evaluates_it(trained: Trained) -> None:
    command = [sys.executable, EXAMPLE, trained.path, "--level", trained.level]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    returns = list(trained.evaluation(trained.level).values())
    assert re.search(rf"checkpoint  mean +{np.mean(returns):.3f} ", printed), printed


def test_it_goes_to_stable_baselines3_and_back(trained: Trained, folder: Path) -> None:
    """By the command line; what comes back is evaluated by the binary."""
    assert main(["export", str(trained.path), str(folder / "a.zip")]) == 0
    origin = ["--level", trained.level, "--stage", str(trained.stage)]
    assert main(["import", str(folder / "a.zip"), str(folder / "b.safetensors"), *origin]) == 0
    there, back = read(trained.path), read(folder / "b.safetensors")
    back.source = there.source
    assert_equal(back, there)
    assert evaluation(folder / "b.safetensors", trained.level) == trained.evaluation(trained.level)


def test_stable_baselines3_computes_the_same(trained: Trained, folder: Path) -> None:
    sb3 = pytest.importorskip("stable_baselines3", reason="needs stable-baselines3: run scripts/test-sb3")
    import torch

    assert main(["export", str(trained.path), str(folder / "a.zip")]) == 0
    agent = read(trained.path)
    model = {"ppo": sb3.PPO, "dqn": sb3.DQN}[agent.algorithm].load(folder / "a.zip")
    observations = np.random.default_rng(1).integers(0, 2, (200, 4, 8, 8)).astype(np.float32)
    for tower, outputs in outputs_of(model, torch.from_numpy(observations)):
        mine = agent.forward(tower, observations)
        if tower == "policy":  # torch's Categorical normalises its logits
            mine = mine - np.log(np.exp(mine).sum(1, keepdims=True))
        np.testing.assert_allclose(mine, outputs.detach().numpy(), atol=1e-5, rtol=1e-5)


def test_a_replay_buffer_is_read_and_left_out_of_models(runs: Path, folder: Path) -> None:
    """The transitions are steps of the environment: the observations before and after, unpacked, say so."""
    arm = ["--set", "name=saved", "--set", "replay_saved=true"]
    common = ["--timesteps", str(TIMESTEPS), "--seeds", "3", "--quiet", "--jobs", "1", "--plasticity-interval", "0"]
    cpp_rl("train", "--algo", "dqn", "--level", "2", *arm, *common, "--out", folder)
    path = folder / "saved" / "level-2" / "seed-3" / "checkpoints" / "stage-0.safetensors"
    agent, plain = read(path), read(runs / "train" / "dqn" / path.relative_to(folder / "saved"))
    assert to_bytes(agent) == path.read_bytes()
    buffer = {name.removeprefix("buffer/replay/"): t for name, t in agent.tensors.items() if name.startswith("buffer/")}
    assert buffer.keys() == {"inputs", "actions", "rewards", "terminated"}
    assert agent.tensors.keys() - plain.tensors.keys() == {f"buffer/replay/{name}" for name in buffer}
    packed = buffer["inputs"].astype("<u8").view(np.uint8)
    observations = np.unpackbits(packed, axis=-1, bitorder="little").reshape(TIMESTEPS, 2, 4, 8, 8)
    level = cpp_rl_gym.as_level("2")
    free = np.array([[cell != "#" for cell in row] for row in level.map.splitlines()])
    assert (observations[:, :, 0] == free).all() and (observations[:, :, 1].sum(axis=(2, 3)) == 1).all()
    moved = np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])[buffer["actions"]]
    before, after = (np.argwhere(observations[:, i, 1])[:, 1:] for i in (0, 1))
    assert (((after - before) == moved).all(axis=1) | (after == before).all(axis=1)).all()
    found = (observations[:, :, 3] & observations[:, :, 2]).sum(axis=(2, 3), dtype=np.int64)
    gained = found[:, 1] - found[:, 0]
    assert (buffer["rewards"] == np.where(gained == 1, 2 + 30 * buffer["terminated"].astype(int), -1)).all()

    assert main(["export", str(path), str(folder / "a.zip")]) == 0
    assert main(["import", str(folder / "a.zip"), str(folder / "b.safetensors"), "--level", "2", "--stage", "0"]) == 0
    assert_equal(replace(read(folder / "b.safetensors"), source=""), replace(plain, source=""))


def outputs_of(model: Any, observations: Any) -> Iterator[tuple[str, Any]]:
    """The outputs of every tower of a Stable-Baselines3 model."""
    if hasattr(model, "q_net"):
        yield "q", model.q_net(observations)
        yield "target/q", model.q_net_target(observations)
    else:
        yield "policy", model.policy.get_distribution(observations).distribution.logits
        yield "value", model.policy.predict_values(observations)
