"""The package as it is installed, and as it lies in the repository."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import cpp_rl_gym
from oracle import REPOSITORY


def without(module: str, code: str, path: Path | None = None) -> str:
    """What ``code`` prints where ``module`` cannot be imported."""
    environment = os.environ | ({"PYTHONPATH": str(path)} if path else {})
    command = [sys.executable, "-c", f"import sys; sys.modules[{module!r}] = None\n{code}"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout


def test_every_public_name_is_there() -> None:
    for name in cpp_rl_gym.__all__:
        assert getattr(cpp_rl_gym, name) is not None
    assert set(cpp_rl_gym.__all__) <= set(dir(cpp_rl_gym))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        cpp_rl_gym.nothing  # noqa: B018


def test_it_is_typed() -> None:
    folder = Path(cpp_rl_gym.__file__).parent
    assert {"py.typed", "_native.pyi"} <= {path.name for path in folder.iterdir()}


def test_the_converters_do_without_the_extension() -> None:
    code = "import cpp_rl_gym.sb3, cpp_rl_gym.checkpoint; print(cpp_rl_gym.__file__, cpp_rl_gym.sb3.main.__name__)"
    source = REPOSITORY / "python" / "src"
    assert without("cpp_rl_gym._native", code, source).startswith(str(source))


@pytest.mark.parametrize(
    "code", ["cpp_rl_gym.plan", "from cpp_rl_gym import CoverageEnv", "gymnasium.make('cpp_rl/Coverage-v0')"]
)
def test_what_needs_the_extension_says_how_to_get_it(code: str) -> None:
    program = f"import gymnasium, cpp_rl_gym\ntry:\n    {code}\nexcept ImportError as error:\n    print(error)"
    assert "pip install ./python" in without("cpp_rl_gym._native", program)


def test_the_package_can_be_imported_without_gymnasium() -> None:
    program = "import importlib.util as u; u.find_spec = lambda name: None\nimport cpp_rl_gym.sb3; print('imported')"
    assert without("gymnasium", program) == "imported\n"


DAMAGE = {
    "a foreign level": (0, lambda level: cpp_rl_gym.as_level("..T")),
    "an agent off the map": (1, lambda agent: 64),
    "an agent in a wall": (1, lambda agent: 3 * 8 + 4),
    "a visited wall": (2, lambda visited: [visited[0] | 1 << (3 * 8 + 4)]),
    "too many visited cells": (2, lambda visited: [2**64 - 1, 1]),
    "a wrong count": (3, lambda remaining: remaining + 1),
    "too many steps": (4, lambda steps: 201),
    "half a generator": (7, lambda generator: generator[:20]),
    "a path off the map": (8, lambda path: [64]),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_was_pickled_is_not_trusted(damage: str) -> None:
    env = cpp_rl_gym.CoverageEnv(0)
    env.reset(seed=0)
    restore, (source, max_steps, seen, saved) = env._core.__reduce__()
    part, change = DAMAGE[damage]
    saved = (*saved[:part], change(saved[part]), *saved[part + 1 :])
    with pytest.raises(ValueError, match=r"state|saved"):
        restore(source, max_steps, seen, saved)


def test_what_was_pickled_names_a_sensor_that_exists() -> None:
    restore, (source, max_steps, _, saved) = cpp_rl_gym.CoverageEnv(0)._core.__reduce__()
    with pytest.raises(ValueError, match='no sensor "nose"'):
        restore(source, max_steps, ("nose", False), saved)
