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
