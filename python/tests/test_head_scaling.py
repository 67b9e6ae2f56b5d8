"""scripts/sb3-head-scaling: what it changes in a model, that it goes on where it stopped, and the table of the page."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cpp_rl_gym.checkpoint import read
from oracle import REPOSITORY
from support import binary, cpp_rl, make

SCRIPT = REPOSITORY / "scripts" / "sb3-head-scaling"
WHY = REPOSITORY / "docs" / "results" / "why"


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"CPP_RL": str(binary())}
    done = subprocess.run(
        [sys.executable, SCRIPT, *arguments], env=environment, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done


def test_the_table_of_the_page_is_that_of_its_file() -> None:
    printed = [line for line in run("--table", WHY / "sb3.csv").stdout.splitlines() if line.startswith("|")]
    page = (WHY / "README.md").read_text().splitlines()
    assert len(printed) == 12
    assert [line for line in printed if line not in page] == []


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """The script as a module."""
    pytest.importorskip("torch", reason="needs torch: run scripts/test-sb3")
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3: run scripts/test-sb3")
    loader = SourceFileLoader("sb3_head_scaling", str(SCRIPT))
    module = module_from_spec(spec_from_loader(loader.name, loader))
    sys.modules[loader.name] = module
    loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory, script: ModuleType) -> Path:
    """A folder with a parent that the binary trained just now; the script has it train the other."""
    folder = tmp_path_factory.mktemp("heads")
    arguments = ["--algo", "ppo", "--levels", "0,1", "--timesteps", "2048,500", "--seeds", "3", "--quiet"]
    cpp_rl("curriculum", *arguments, "--out", folder / "parents", "--plasticity-interval", "0")
    return folder


def parameters(model: Any) -> dict[str, np.ndarray]:
    return {name: tensor.detach().numpy().copy() for name, tensor in model.policy.named_parameters()}


def moments(model: Any) -> list[np.ndarray]:
    state = model.policy.optimizer.state_dict()["state"]
    return [np.asarray(value) for entry in state.values() for value in entry.values()]


def test_scaling_changes_the_last_policy_layer_alone(script: ModuleType, out: Path) -> None:
    env = make(1, observation="grid")
    jobs = {treatment: script.Job(3, treatment, 0, 500, 2048, out) for treatment in script.TREATMENTS}
    warm, scaled, fresh = (script.model_of(jobs[treatment], env) for treatment in ("warm", "scaled", "fresh"))
    before, after, new = parameters(warm), parameters(scaled), parameters(fresh)
    agent = read(jobs["warm"].parent)
    np.testing.assert_array_equal(before["action_net.weight"], agent.tensors["policy.2.weight"].T)
    for name, tensor in before.items():
        factor = np.float32(0.02 if name.startswith("action_net.") else 1)
        np.testing.assert_array_equal(after[name], tensor * factor, err_msg=name)
    assert not np.array_equal(new["mlp_extractor.policy_net.0.weight"], before["mlp_extractor.policy_net.0.weight"])
    assert len(moments(warm)) > 0 and len(moments(fresh)) == 0
    for one, other in zip(moments(warm), moments(scaled), strict=True):
        np.testing.assert_array_equal(one, other)
    observations = np.random.default_rng(0).integers(0, 2, (300, 4, 8, 8)).astype(np.float32)
    actions = [model.predict(observations, deterministic=True)[0] for model in (warm, scaled)]
    np.testing.assert_array_equal(*actions)


def test_it_goes_on_where_it_stopped(script: ModuleType, out: Path) -> None:
    arguments = ["--seeds", "3,4", "--after", "0", "--timesteps", "500", "--before", "2048", "--out", out]
    first = run(*arguments)
    assert "6 runs, 0 of them finished" in first.stderr and "The direction " in first.stdout
    table = (out / "sb3.csv").read_text()
    assert table.count("\n") == 13 and table.count(",2048,") == 12  # whole rollouts
    script.Job(4, "scaled", 0, 500, 2048, out).file.unlink()
    second = run(*arguments)
    assert "6 runs, 5 of them finished" in second.stderr
    assert second.stderr.count(": done") == 1 and "seed 4, scaled: done" in second.stderr
    assert (second.stdout, (out / "sb3.csv").read_text()) == (first.stdout, table)
    assert run("--table", out / "sb3.csv").stdout == first.stdout


def test_other_lengths_are_not_mixed(script: ModuleType, tmp_path: Path) -> None:
    job = script.Job(0, "warm", 2, 250_000, 250_000, tmp_path)
    assert not job.finished()
    job.file.parent.mkdir(parents=True)
    job.file.write_text('{"result": {"timesteps": 251904}}')
    assert job.finished()
    with pytest.raises(SystemExit, match="is of 251904 timesteps; choose another --out"):
        script.Job(0, "warm", 2, 100_000, 250_000, tmp_path).finished()
