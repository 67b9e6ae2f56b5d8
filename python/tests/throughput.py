"""Steps per second: ``python tests/throughput.py``. The package beside plain NumPy, in one run, both unwrapped.

Time is that of the processor, so that a busy machine does not blur the comparison, and of several repetitions the
fastest counts. All make observations and the same infos, and all reset as episodes end.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np

import cpp_rl_gym
from oracle import OracleEnv, VectorOracle, read_map

COPIES = 256
REPETITIONS = 5


def measure(steps: int = 20_000) -> dict[str, float]:
    """Steps per second on level 0, by what makes them."""
    actions = np.random.default_rng(0).integers(4, size=(steps // COPIES + 1, COPIES))
    ours = gym.make(cpp_rl_gym.ENV_ID, level=0).unwrapped
    runs = {
        "NumPy, one environment": single(OracleEnv(read_map("0")), actions),
        "cpp_rl_gym, one environment": single(ours, actions),
        f"NumPy, {COPIES} copies in arrays": many(VectorOracle([read_map("0")] * COPIES), actions),
    }
    for name, options in {"": {}, ", copy=False": {"copy": False}, ', "grid"': {"observation": "grid"}}.items():
        envs = gym.make_vec(cpp_rl_gym.ENV_ID, num_envs=COPIES, level=0, **options).unwrapped
        runs[f"cpp_rl_gym, {COPIES} copies{name}"] = many(envs, actions)
    return {name: max(rate(run) for _ in range(REPETITIONS)) for name, run in runs.items()}


def single(env: gym.Env, actions: np.ndarray) -> Callable[[], int]:
    chosen = list(actions.flat)

    def run() -> int:
        env.reset(seed=0)
        for action in chosen:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return len(chosen)

    return run


def many(envs: VectorOracle | gym.vector.VectorEnv, actions: np.ndarray) -> Callable[[], int]:
    def run() -> int:
        envs.reset()
        for chosen in actions:
            envs.step(chosen)
        return actions.size

    return run


def rate(run: Callable[[], int]) -> float:
    begin = time.process_time()
    steps = run()
    return steps / (time.process_time() - begin)


if __name__ == "__main__":
    for name, steps in measure(200_000).items():
        print(f"{steps:12,.0f} steps/s  {name}")
