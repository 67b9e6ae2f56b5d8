"""Trains Stable-Baselines3's PPO, with the paper's hyper-parameters, on one level.

python examples/train_sb3.py [--level 0] [--timesteps 200000] [--seed 0]
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

import cpp_rl_gym
from cpp_rl_gym.sb3 import PPO_ARGUMENTS


def main() -> None:
    """Trains, evaluates, and compares with the optimum."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--level", default="0")
    parser.add_argument("--timesteps", type=int, default=200_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.set_num_threads(1)  # the networks are small

    env = gym.make(cpp_rl_gym.ENV_ID, level=options.level)
    model = PPO("MlpPolicy", env, seed=options.seed, device="cpu", verbose=1, **PPO_ARGUMENTS)
    model.learn(options.timesteps)

    mean, deviation = evaluate_policy(model, model.get_env(), n_eval_episodes=50)
    level = cpp_rl_gym.as_level(options.level)
    optima = [cpp_rl_gym.plan(level, start).return_ for start in level.starts]
    print(f"return {mean:.2f} ± {deviation:.2f} in 50 episodes; the optimum is {sum(optima) / len(optima):.2f}")


if __name__ == "__main__":
    main()
