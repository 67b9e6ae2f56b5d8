"""Stable-Baselines3 on the package: its checker, and that it learns as on the paper's own environment."""

from __future__ import annotations

from typing import Any

import pytest

import cpp_rl_gym
from support import LEVELS, make

torch = pytest.importorskip("torch", reason="needs torch: run scripts/test-sb3")
sb3 = pytest.importorskip("stable_baselines3", reason="needs stable-baselines3: run scripts/test-sb3")

from stable_baselines3.common.callbacks import BaseCallback  # noqa: E402
from stable_baselines3.common.env_checker import check_env  # noqa: E402

from cpp_rl_gym.sb3 import PPO_ARGUMENTS  # noqa: E402


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("render_mode", [None, "ansi", "human", "rgb_array"])
@pytest.mark.parametrize("level", [*LEVELS, "..T\n.#T", [0, 1], cpp_rl_gym.RandomLevels(3, 9, 0.3, 4)], ids=str)
def test_its_checker_has_nothing_to_say(level: Any, render_mode: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(cpp_rl_gym.CoverageEnv.metadata, "render_fps", 1000)
    check_env(make(level, render_mode=render_mode), skip_render_check=False)


class MeanReturns(BaseCallback):
    """``rollout/ep_rew_mean`` after each rollout."""

    def __init__(self) -> None:
        super().__init__()
        self.curve: list[tuple[int, float]] = []

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        returns = [episode["r"] for episode in self.model.ep_info_buffer]
        self.curve.append((self.num_timesteps, sum(returns) / len(returns)))


def test_ppo_passes_a_return_of_zero_as_on_the_papers_environment() -> None:
    torch.set_num_threads(1)
    watch = MeanReturns()
    model = sb3.PPO("MlpPolicy", make(0), seed=0, device="cpu", **PPO_ARGUMENTS)
    model.learn(200_000, callback=watch)
    print("\n".join(f"{timesteps:7} timesteps: ep_rew_mean {mean:8.2f}" for timesteps, mean in watch.curve[::8]))
    passed = next((timesteps for timesteps, mean in watch.curve if mean > 0), None)
    print(f"passed 0 after {passed} timesteps; at the end {watch.curve[-1][1]:.2f}")
    assert passed is not None and passed <= 160_000
