"""Coverage path planning for Gymnasium, and converters from and to Stable-Baselines3.

An agent on a grid must visit every target cell in as few moves as it can. Importing this package registers the
environment ``cpp_rl/Coverage-v0`` with Gymnasium:

    import gymnasium
    import cpp_rl_gym

    env = gymnasium.make("cpp_rl/Coverage-v0", level=0)
    envs = gymnasium.make_vec("cpp_rl/Coverage-v0", num_envs=256, level=0)

:class:`CoverageEnv` describes the rules. It is the environment that ``cpp-rl`` trains on: both use the same Rust code,
which is a compiled extension here. The modules :mod:`cpp_rl_gym.checkpoint`, :mod:`cpp_rl_gym.sb3` and
:mod:`cpp_rl_gym.runs` do not need the extension.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cpp_rl_gym.env import SENSORS as SENSORS
    from cpp_rl_gym.env import CoverageEnv as CoverageEnv
    from cpp_rl_gym.levels import BUILTIN_LEVELS as BUILTIN_LEVELS
    from cpp_rl_gym.levels import Curriculum as Curriculum
    from cpp_rl_gym.levels import Level as Level
    from cpp_rl_gym.levels import RandomLevels as RandomLevels
    from cpp_rl_gym.levels import as_level as as_level
    from cpp_rl_gym.planners import Plan as Plan
    from cpp_rl_gym.planners import plan as plan
    from cpp_rl_gym.runs import Runs as Runs
    from cpp_rl_gym.runs import load_report as load_report
    from cpp_rl_gym.runs import load_runs as load_runs
    from cpp_rl_gym.vector import CoverageVectorEnv as CoverageVectorEnv

ENV_ID = "cpp_rl/Coverage-v0"

# Each is imported when it is first used, since most need the extension.
_HOMES = {
    "BUILTIN_LEVELS": "levels",
    "CoverageEnv": "env",
    "CoverageVectorEnv": "vector",
    "Curriculum": "levels",
    "Level": "levels",
    "Plan": "planners",
    "RandomLevels": "levels",
    "Runs": "runs",
    "SENSORS": "env",
    "as_level": "levels",
    "load_report": "runs",
    "load_runs": "runs",
    "plan": "planners",
}

__all__ = ["ENV_ID", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})


def _register() -> None:
    """Makes the environment known to Gymnasium, unless it already is or there is no Gymnasium."""
    if importlib.util.find_spec("gymnasium") is None:
        return
    from gymnasium.envs.registration import register, registry

    if ENV_ID not in registry:
        # Without max_episode_steps: the step limit is the environment's own, and a wrapper would truncate once more.
        register(
            id=ENV_ID,
            entry_point="cpp_rl_gym.env:CoverageEnv",
            vector_entry_point="cpp_rl_gym.vector:CoverageVectorEnv",
        )


_register()
