"""Throughput of Stable-Baselines3 with the paper's hyper-parameters. usage: sb3.py ppo|dqn TIMESTEPS

The environment is the tests' in plain NumPy, one for each model, as the paper had it; its share of the time is printed.
"""

# ruff: noqa: E402 (the path to the modules comes first)
from __future__ import annotations

import sys
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(REPOSITORY / "python" / part) for part in ("src", "tests")]

import stable_baselines3 as sb3
import torch

from cpp_rl_gym.sb3 import DQN_ARGUMENTS, PPO_ARGUMENTS
from oracle import OracleEnv, read_map

ALGORITHMS = {"ppo": (sb3.PPO, PPO_ARGUMENTS), "dqn": (sb3.DQN, DQN_ARGUMENTS)}
WARM_UP = 2048


class TimedEnv(OracleEnv):
    """Notes how long its steps and resets take."""

    seconds = 0.0

    def step(self, action):  # noqa: ANN001, ANN201, D102 (as Gymnasium has it)
        begun = time.perf_counter()
        result = super().step(action)
        self.seconds += time.perf_counter() - begun
        return result


def learn(algorithm: str, timesteps: int) -> tuple[float, float, int]:
    """Seconds of training a fresh model, seconds of these in the environment, and timesteps made."""
    make, arguments = ALGORITHMS[algorithm]
    env = TimedEnv(read_map("0"))
    model = make("MlpPolicy", env, seed=0, device="cpu", **arguments)
    begun = time.perf_counter()
    model.learn(timesteps, log_interval=None)
    return time.perf_counter() - begun, env.seconds, model.num_timesteps


def main() -> None:
    """Warms up, then measures."""
    algorithm, timesteps = sys.argv[1], int(sys.argv[2])
    torch.set_num_threads(1)
    learn(algorithm, WARM_UP)
    seconds, environment, made = learn(algorithm, timesteps)
    share = environment / seconds
    print(f"sb3 {algorithm}: {made / seconds:.1f} timesteps/s, {share:.1%} of the time in the environment's steps")


if __name__ == "__main__":
    main()
