"""Evaluates a checkpoint of cpp-rl from every start cell, with NumPy alone.

python examples/evaluate_checkpoint.py runs/train/ppo/level-0/seed-0/checkpoints/stage-0.safetensors [--level 0]
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np

import cpp_rl_gym
from cpp_rl_gym import checkpoint


def evaluate(agent: checkpoint.Checkpoint, level: cpp_rl_gym.Level) -> np.ndarray:
    """The return from each start cell, row by row, of the actions that ``agent`` prefers."""
    tower = {"ppo": "policy", "dqn": "q"}[agent.algorithm]
    starts = level.starts
    envs = gym.make_vec(cpp_rl_gym.ENV_ID, len(starts), level=level, sensor=agent.sensor)
    observations, _ = envs.reset(options={"start": starts})
    returns, running = np.zeros(len(starts)), np.ones(len(starts), bool)
    while running.any():
        actions = agent.forward(tower, observations).argmax(axis=1)
        observations, rewards, terminated, truncated, _ = envs.step(actions)
        returns += rewards * running
        running &= ~(terminated | truncated)
    return returns


def main() -> None:
    """Prints the returns beside those of the planners."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint")
    parser.add_argument("--level", default="0")
    options = parser.parse_args()
    level = cpp_rl_gym.as_level(options.level)
    agent = checkpoint.read(options.checkpoint)
    if (agent.height, agent.width) != (level.height, level.width):
        parser.error(f"the checkpoint is for maps of {agent.height} x {agent.width}, the level is {level!r}")

    rows = {f"{agent.algorithm} checkpoint": evaluate(agent, level)}
    for planner in ("astar", "optimal"):
        rows[planner] = np.array([cpp_rl_gym.plan(level, start, planner).return_ for start in level.starts])
    print(f"return from the {len(level.starts)} start cells of level {level.name}")
    for name, returns in rows.items():
        print(f"{name:>16}  mean {returns.mean():8.3f}  std {returns.std():7.3f}  min {returns.min():6.0f}")


if __name__ == "__main__":
    main()
