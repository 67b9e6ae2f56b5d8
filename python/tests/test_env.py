"""The environment as Gymnasium's users meet it."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import Error, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match

import cpp_rl_gym
from oracle import OracleEnv, read_map
from support import DOWN, LEFT, LEVELS, RIGHT, UP, assert_same, make, random_maps

RENDER_MODES = [None, "ansi", "human", "rgb_array"]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("render_mode", RENDER_MODES)
@pytest.mark.parametrize("level", LEVELS)
def test_gymnasiums_checker_has_nothing_to_say(
    level: int, render_mode: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(cpp_rl_gym.CoverageEnv.metadata, "render_fps", 1000)  # windows wait between frames
    check_env(make(level, render_mode=render_mode))
    check_env(make(level, render_mode=render_mode, observation="grid"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("level", ["..T\n.#T", [0, 1], cpp_rl_gym.RandomLevels(3, 9, 0.3, 4)])
def test_gymnasiums_checker_accepts_other_levels(level: Any) -> None:
    check_env(make(level))


def test_the_step_limit_is_the_environments_own() -> None:
    env = gym.make(cpp_rl_gym.ENV_ID, level=0, max_steps=3)
    assert env.spec.max_episode_steps is None
    assert "TimeLimit" not in str(env)
    env.reset(seed=0, options={"start": (0, 0)})
    assert [env.step(UP)[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]


def test_the_module_in_the_id_is_imported() -> None:
    env = gym.make("cpp_rl_gym:cpp_rl/Coverage-v0")
    assert isinstance(env.unwrapped, cpp_rl_gym.CoverageEnv)
    assert env.unwrapped.level == cpp_rl_gym.as_level(0)
    assert gym.make(env.spec).unwrapped.level == env.unwrapped.level


def test_a_walk_by_hand() -> None:
    env = make(".#T\n..T", observation="grid")
    observation, info = env.reset(options={"start": (0, 0)})
    np.testing.assert_array_equal(
        observation,
        [[[1, 0, 1], [1, 1, 1]], [[1, 0, 0], [0, 0, 0]], [[0, 0, 1], [0, 0, 1]], [[1, 0, 0], [0, 0, 0]]],
    )
    assert observation.dtype == np.float32
    assert info.pop("action_mask").tolist() == [1, 0, 0, 0]
    assert info == {"steps": 0, "remaining_targets": 2, "level": "map"}
    for action, reward in [(RIGHT, -1), (DOWN, -1), (RIGHT, -1), (RIGHT, 2), (LEFT, -1), (RIGHT, -1), (UP, 32)]:
        observation, got, terminated, truncated, info = env.step(action)
        assert (got, truncated) == (reward, False)
        assert terminated == (reward == 32)
    assert (info["steps"], info["remaining_targets"]) == (7, 0)
    np.testing.assert_array_equal(observation[3], [[1, 0, 1], [1, 1, 1]])


def test_both_ends_may_come_at_once() -> None:
    env = make("..T", max_steps=2)
    env.reset(options={"start": (0, 0)})
    env.step(RIGHT)
    assert env.step(RIGHT)[1:4] == (32.0, True, True)


def test_flat_observations_are_the_grid_in_one_row() -> None:
    flat, grid = make("..#T\n.T..\n...."), make("..#T\n.T..\n....", observation="grid")
    assert flat.observation_space.shape == (48,)
    assert grid.observation_space.shape == (4, 3, 4)
    np.testing.assert_array_equal(flat.reset(seed=2)[0], grid.reset(seed=2)[0].ravel())
    for action in [RIGHT, DOWN, LEFT, LEFT, UP]:
        np.testing.assert_array_equal(flat.step(action)[0], grid.step(action)[0].ravel())


@pytest.mark.parametrize("rows", [*map(read_map, map(str, LEVELS)), *random_maps(40)], ids=str)
def test_it_follows_the_oracle(rows: list[str]) -> None:
    """Hundreds of random episodes a map; starts are the environment's, since the two draw them differently."""
    env, oracle = make("\n".join(rows), observation="grid", max_steps=60), OracleEnv(rows, max_steps=60)
    random = np.random.default_rng(1)
    for _ in range(25):
        observation, info = env.reset()
        start = tuple(np.argwhere(observation[1])[0].tolist())
        assert info.pop("level") == "map"
        assert_same((observation, info), oracle.reset(options={"start": start}))
        done = False
        while not done:
            action = int(random.integers(4))
            ours, theirs = env.step(action), oracle.step(action)
            assert_same(ours, theirs)
            done = ours[2] or ours[3]


class SameStart(gym.Wrapper):
    """Starts where it is told, for Gymnasium's comparison of two environments."""

    def __init__(self, env: gym.Env, start: tuple[int, int]) -> None:
        super().__init__(env)
        self.start = start

    def reset(self, **arguments: Any) -> tuple[np.ndarray, dict[str, Any]]:
        observation, info = self.env.reset(seed=arguments.get("seed"), options={"start": self.start})
        return observation, {key: value for key, value in info.items() if key != "level"}


def test_gymnasium_finds_no_difference_from_the_oracle() -> None:
    oracle = SameStart(OracleEnv(read_map("3")), (7, 1))
    check_environments_match(SameStart(make(3, observation="grid"), (7, 1)), oracle, num_steps=2000)


def test_seeds_repeat_and_differ() -> None:
    def starts(env: gym.Env, seed: int) -> list[np.ndarray]:
        return [env.reset(seed=seed)[0]] + [env.reset()[0] for _ in range(5)]

    assert_same(starts(make(), 4), starts(make(), 4))
    env = make()
    assert_same(starts(env, 4), starts(env, 4))
    assert not np.array_equal(starts(env, 4), starts(env, 5))
    with pytest.raises(Error, match="Seed"):
        env.reset(seed=-1)


def test_a_generator_that_is_set_is_used() -> None:
    env, other = make(), make()
    env.reset(seed=1)
    env.np_random = np.random.default_rng(9)
    other.np_random = np.random.default_rng(9)
    assert_same(env.reset(), other.reset())


def test_starts_are_uniform() -> None:
    env = make("..T\n.#.", observation="grid")
    env.reset(seed=0)
    counts = np.sum([env.reset()[0][1] for _ in range(4000)], axis=0)
    assert counts[0, 2] == counts[1, 1] == 0
    assert np.all(np.abs(counts[[0, 0, 1, 1], [0, 1, 0, 2]] - 1000) < 165)  # six standard deviations


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("level", [2, [0, 3], cpp_rl_gym.RandomLevels(4, 7, 0.2, 3), ".T\n.."])
def test_copies_go_on_exactly_alike(level: Any, duplicate: Any) -> None:
    env = make(level, max_steps=30, render_mode="rgb_array")
    untouched = duplicate(env)
    env.reset(seed=3)
    env.step(RIGHT)
    twin = duplicate(env)
    random = np.random.default_rng(0)
    assert_same(env.render(), twin.render())
    for _ in range(400):
        action = random.integers(4)
        result = env.step(action)
        assert_same(result, twin.step(action))
        if result[2] or result[3]:
            over = duplicate(env)
            with pytest.raises(ResetNeeded):
                over.step(action)
            assert_same(env.reset(), twin.reset())
            assert env.level == twin.level
    with pytest.raises(ResetNeeded):
        untouched.step(0)
    assert_same(untouched.reset(seed=8), env.reset(seed=8))


@pytest.mark.parametrize(
    "action", [4, -1, 2**70, 1.0, np.float32(1), "1", None, [1], np.array([1]), np.array([0, 1])], ids=repr
)
def test_what_is_no_action_is_refused(action: Any) -> None:
    env = make()
    env.reset(seed=0)
    before = pickle.dumps(env)
    with pytest.raises(InvalidAction, match="0 down, 1 up, 2 right or 3 left"):
        env.step(action)
    assert pickle.dumps(env) == before


@pytest.mark.parametrize("action", [2, np.int64(2), np.uint8(2), np.array(2)], ids=repr)
def test_any_integer_is_an_action(action: Any) -> None:
    env = make()
    env.reset(options={"start": (0, 0)})
    assert env.step(action)[0].reshape(4, 8, 8)[1, 0, 1] == 1


def test_steps_outside_an_episode_are_refused() -> None:
    env = make(max_steps=1)
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(0)
    with pytest.raises(ResetNeeded, match="call reset"):
        make(render_mode="ansi").render()
    env.reset(seed=0)
    env.step(0)
    with pytest.raises(ResetNeeded, match="over"):
        env.step(0)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ((3, 4), "row 3, column 4: it is a wall of level 0"),
        ((2, 4), "row 2, column 4: it is a target of level 0"),
        ((8, 0), "lies outside level 0, which has 8 rows and 8 columns"),
        ((0, -1), "lies outside"),
        (5, r"must be a pair \(row, column\)"),
        ((1, 2, 3), r"must be a pair \(row, column\)"),
        ((2**40, 0), "must be from"),
    ],
    ids=repr,
)
def test_bad_starts_are_refused(start: Any, message: str) -> None:
    env = make()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.reset(options={"start": start})
    env.step(0)  # the episode before goes on


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"max_steps": 0}, ValueError, "max_steps must be from 1"),
        ({"max_steps": 2.5}, TypeError, "max_steps must be an integer"),
        ({"max_steps": 2**40}, ValueError, "max_steps must be from 1"),
        ({"observation": "image"}, ValueError, "observation must be 'flat' or 'grid'"),
        ({"sensor": "nose"}, ValueError, "sensor must be 'full'"),
    ],
)
def test_bad_arguments_are_refused(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make(**options)


def test_other_bad_arguments_are_refused() -> None:
    with pytest.raises(ValueError, match="render_mode must be None or 'ansi' or 'human' or 'rgb_array'"):
        cpp_rl_gym.CoverageEnv(render_mode="gif")
    with pytest.raises(TypeError, match=r"options\['start'\] must be an integer"):
        make().reset(options={"start": (0.5, 1)})
    with pytest.raises(ValueError, match="options has no 'strat'; there is 'start'"):
        make().reset(options={"strat": (0, 0)})


def test_the_level_can_be_changed_between_episodes() -> None:
    env = make(0)
    env.reset(seed=0)
    env.set_level(4)
    assert env.level.name == "0"
    env.step(0)
    assert env.reset()[1]["level"] == env.level.name == "4"
    with pytest.raises(ValueError, match="must have the same height and width"):
        env.set_level("..T")
    assert env.reset()[1]["level"] == "4"
