"""The examples in the README and in examples/ run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from conftest import SB3_FIXTURES
from oracle import REPOSITORY

EXAMPLES = REPOSITORY / "python" / "examples"
README = (REPOSITORY / "python" / "README.md").read_text()
# Those of the section with the examples; test_runs.py has the one about runs.
BLOCKS = re.findall(r"```python\n(.*?)```", README.partition("## The environment")[0], re.DOTALL)


def run(*command: str, folder: Path) -> str:
    """What a Python program prints; it must succeed without a warning."""
    environment = os.environ | {"PYTHONWARNINGS": "error::UserWarning"}
    done = subprocess.run(
        [sys.executable, *command], cwd=folder, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_readme_has_three_examples() -> None:
    assert len(BLOCKS) == 3


@pytest.mark.parametrize("number", range(3))
def test_the_readmes_examples_run(number: int, tmp_path: Path) -> None:
    code = BLOCKS[number]
    for package in ("stable_baselines3", "PIL"):
        if package in code:
            pytest.importorskip(package)
    code = code.replace("model.learn(200_000)", "model.learn(100)")
    run("-c", code, folder=tmp_path)


def test_a_checkpoint_is_evaluated(tmp_path: Path, returns: dict) -> None:
    pytest.importorskip("safetensors", reason="checkpoints are safetensors files")
    for name in ("ppo_level0", "dqn_level0"):
        path = SB3_FIXTURES / f"{name}.safetensors"
        printed = run(str(EXAMPLES / "evaluate_checkpoint.py"), str(path), folder=tmp_path)
        measured = returns[name].values()  # by Stable-Baselines3 itself
        assert f"mean {sum(measured) / len(measured):8.3f}" in printed
        assert re.search(r"optimal  mean +\d", printed)


def test_stable_baselines3_trains(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3", reason="needs stable-baselines3: run scripts/test-sb3")
    assert "the optimum is 42.91" in run(str(EXAMPLES / "train_sb3.py"), "--timesteps", "2048", folder=tmp_path)


def test_the_single_file_learner_learns(tmp_path: Path) -> None:
    pytest.importorskip("torch", reason="needs torch: run scripts/test-sb3")
    printed = run(str(EXAMPLES / "cleanrl_ppo.py"), "--timesteps", "120000", folder=tmp_path)
    means = [float(mean) for mean in re.findall(r"mean return +(-?[\d.]+)", printed)]
    assert means[-1] > means[0] + 15, printed
