"""PPO in one file, in CleanRL's manner, on the vector environment.

python examples/cleanrl_ppo.py [--level 0] [--timesteps 500000] [--seed 0]
"""

from __future__ import annotations

import argparse
import time
from collections import deque

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions import Categorical

import cpp_rl_gym

NUM_ENVS = 64
NUM_STEPS = 64  # of each copy, between two updates
EPOCHS = 4
MINIBATCHES = 8
LEARNING_RATE = 5e-4
GAMMA = 0.99
GAE_LAMBDA = 0.95
CLIP = 0.2
ENTROPY = 0.01
VALUE = 0.5
MAX_GRAD_NORM = 0.5


class Agent(nn.Module):
    """Policy and value, apart from each other."""

    def __init__(self, inputs: int, actions: int) -> None:
        super().__init__()

        def tower(outputs: int, gain: float) -> nn.Sequential:
            layers = [nn.Linear(inputs, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh(), nn.Linear(64, outputs)]
            for layer, scale in zip(layers[::2], (2**0.5, 2**0.5, gain), strict=True):
                nn.init.orthogonal_(layer.weight, scale)
                nn.init.zeros_(layer.bias)
            return nn.Sequential(*layers)

        self.policy, self.critic = tower(actions, 0.01), tower(1, 1.0)

    def value(self, observations: torch.Tensor) -> torch.Tensor:
        """``[B, inputs]`` to ``[B]``."""
        return self.critic(observations).squeeze(-1)


def main() -> None:
    """Trains and prints the mean return of the last 100 episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--level", default="0")
    parser.add_argument("--timesteps", type=int, default=500_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    torch.set_num_threads(1)  # the networks are small

    # "SameStep": an observation after an episode's end is already the next episode's, and the last one of the old
    # episode is in infos["final_obs"]. So every transition is real, and one cut off can be bootstrapped.
    envs = gym.make_vec(cpp_rl_gym.ENV_ID, NUM_ENVS, level=options.level, autoreset_mode="SameStep")
    agent = Agent(envs.single_observation_space.shape[0], int(envs.single_action_space.n))
    optimizer = torch.optim.Adam(agent.parameters(), lr=LEARNING_RATE, eps=1e-5)

    shape = (NUM_STEPS, NUM_ENVS)
    observations = torch.zeros(*shape, *envs.single_observation_space.shape)
    actions, log_probs, rewards, values, overs = (torch.zeros(shape) for _ in range(5))
    returns_so_far, returns = np.zeros(NUM_ENVS), deque(maxlen=100)

    observation = torch.from_numpy(envs.reset(seed=options.seed)[0])
    begin, updates = time.perf_counter(), max(1, options.timesteps // (NUM_STEPS * NUM_ENVS))
    for update in range(1, updates + 1):
        for group in optimizer.param_groups:
            group["lr"] = LEARNING_RATE * (1 - (update - 1) / updates)

        for step in range(NUM_STEPS):
            with torch.no_grad():
                chosen = Categorical(logits=agent.policy(observation))
                action = chosen.sample()
                values[step] = agent.value(observation)
            observations[step], actions[step], log_probs[step] = observation, action, chosen.log_prob(action)
            following, reward, terminated, truncated, infos = envs.step(action.numpy())
            over = terminated | truncated
            returns_so_far += reward
            returns.extend(returns_so_far[over])
            returns_so_far[over] = 0
            # An episode cut off would have gone on: what it would have earned is estimated. Terminated comes first.
            if (cut := truncated & ~terminated).any():
                last = torch.from_numpy(np.stack(infos["final_obs"][cut]))
                with torch.no_grad():
                    reward[cut] += GAMMA * agent.value(last).numpy()
            rewards[step], overs[step] = torch.from_numpy(reward), torch.from_numpy(over)
            observation = torch.from_numpy(following)

        advantages, advantage = torch.zeros(shape), torch.zeros(NUM_ENVS)
        with torch.no_grad():
            next_value = agent.value(observation)
        for step in reversed(range(NUM_STEPS)):
            goes_on = 1 - overs[step]
            delta = rewards[step] + GAMMA * goes_on * next_value - values[step]
            advantage = delta + GAMMA * GAE_LAMBDA * goes_on * advantage
            advantages[step], next_value = advantage, values[step]

        batch = [tensor.flatten(0, 1) for tensor in (observations, actions, log_probs, advantages, advantages + values)]
        for _ in range(EPOCHS):
            for indices in torch.randperm(NUM_STEPS * NUM_ENVS).chunk(MINIBATCHES):
                seen, taken, old_log_probs, gain, target = (tensor[indices] for tensor in batch)
                gain = (gain - gain.mean()) / (gain.std() + 1e-8)
                now = Categorical(logits=agent.policy(seen))
                ratio = (now.log_prob(taken) - old_log_probs).exp()
                policy_loss = -torch.min(gain * ratio, gain * ratio.clamp(1 - CLIP, 1 + CLIP)).mean()
                value_loss = (agent.value(seen) - target).square().mean()
                loss = policy_loss + VALUE * value_loss - ENTROPY * now.entropy().mean()
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), MAX_GRAD_NORM)
                optimizer.step()

        timesteps = update * NUM_STEPS * NUM_ENVS
        if update % 10 == 0 or update == updates:
            rate = timesteps / (time.perf_counter() - begin)
            mean = np.mean(returns) if returns else float("nan")
            print(f"{timesteps:9,} timesteps, {rate:8,.0f} per second, mean return {mean:8.2f}", flush=True)
    envs.close()


if __name__ == "__main__":
    main()
