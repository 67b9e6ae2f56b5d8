"""The oracle environment: by hand on a map that is not square, and against models measured elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from conftest import SB3_FIXTURES
from cpp_rl_gym.checkpoint import read
from oracle import OracleEnv, VectorOracle, read_map

DOWN, UP, RIGHT, LEFT = range(4)


def test_a_walk_by_hand() -> None:
    env = OracleEnv([".#T", "..T"])
    observation, _ = env.reset(options={"start": (0, 0)})
    np.testing.assert_array_equal(
        observation,
        [[[1, 0, 1], [1, 1, 1]], [[1, 0, 0], [0, 0, 0]], [[0, 0, 1], [0, 0, 1]], [[1, 0, 0], [0, 0, 0]]],
    )
    walk = [(RIGHT, -1), (UP, -1), (DOWN, -1), (DOWN, -1), (RIGHT, -1), (RIGHT, 2), (RIGHT, -1), (UP, 32)]
    for action, reward in walk:
        assert not env.visited[0, 2]
        observation, got, terminated, truncated, _ = env.step(action)
        assert (got, truncated) == (reward, False)
    assert terminated
    np.testing.assert_array_equal(observation[1], [[0, 0, 1], [0, 0, 0]])
    np.testing.assert_array_equal(observation[3], [[1, 0, 1], [1, 1, 1]])


def test_the_step_limit_truncates_even_if_the_last_target_is_reached() -> None:
    env = OracleEnv(["..T"], max_steps=2)
    env.reset(options={"start": (0, 0)})
    assert env.step(RIGHT)[2:4] == (False, False)
    assert env.step(RIGHT)[2:4] == (True, True)
    env.reset(options={"start": (0, 0)})
    env.step(LEFT)
    assert env.step(LEFT)[1:4] == (-1.0, False, True)


def test_infos_count_and_name_the_open_ways() -> None:
    env = OracleEnv([".#T", "..T"])
    _, info = env.reset(options={"start": (1, 1)})
    assert (info["steps"], info["remaining_targets"], info["action_mask"].tolist()) == (0, 2, [0, 0, 1, 1])
    *_, info = env.step(RIGHT)
    assert (info["steps"], info["remaining_targets"], info["action_mask"].tolist()) == (1, 1, [0, 1, 0, 1])


def test_many_agents_in_arrays_do_what_each_does_alone() -> None:
    maps = [[".#T", "..T"], ["T.#", "..."], ["...", ".T."]]
    many, alone = VectorOracle(maps, max_steps=9), [OracleEnv(rows, max_steps=9) for rows in maps]
    observations, infos = many.reset()
    for _ in range(300):
        actions = many.random.integers(4, size=len(maps))
        starts = [tuple(np.argwhere(observation[1])[0]) for observation in observations]
        if (begun := infos["steps"] == 0).any():
            for i in np.flatnonzero(begun):
                alone[i].reset(options={"start": starts[i]})
        observations, rewards, terminated, truncated, infos = many.step(actions)
        for i, env in enumerate(alone):
            observation, reward, *ends, info = env.step(actions[i])
            assert (reward, *ends) == (rewards[i], terminated[i], truncated[i])
            if not any(ends):
                np.testing.assert_array_equal(observation, observations[i])
                assert info["steps"] == infos["steps"][i]
                assert info["remaining_targets"] == infos["remaining_targets"][i]
                np.testing.assert_array_equal(info["action_mask"], infos["action_mask"][i])


def test_the_levels_have_the_papers_counts() -> None:
    envs = [OracleEnv(read_map(str(level))) for level in range(5)]
    assert [int(env.targets.sum()) for env in envs] == [8, 9, 7, 7, 6]
    assert [len(env.starts()) for env in envs] == [55, 50, 48, 46, 41]


@pytest.mark.parametrize(("name", "tower"), [("ppo_level0", "policy"), ("dqn_level0", "q")])
def test_imported_models_earn_what_stable_baselines3_measured(name: str, tower: str, returns: dict) -> None:
    pytest.importorskip("safetensors", reason="checkpoints are safetensors files")
    checkpoint = read(SB3_FIXTURES / f"{name}.safetensors")
    env = OracleEnv(read_map("0"))
    earned = {}
    for start in env.starts():
        observation, _ = env.reset(options={"start": start})
        earned[start], done = 0.0, False
        while not done:
            action = checkpoint.forward(tower, observation[None])[0].argmax()
            observation, reward, terminated, truncated, _ = env.step(int(action))
            earned[start] += reward
            done = terminated or truncated
    assert earned == returns[name]
