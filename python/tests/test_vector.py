"""Vector environments: what many single ones do, in one call."""

from __future__ import annotations

import copy
import pickle
import threading
import time
from itertools import combinations
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

import cpp_rl_gym
from cpp_rl_gym import Curriculum, RandomLevels
from oracle import VectorOracle
from support import assert_same, make, make_vec, random_maps

MODES = list(AutoresetMode)
COPIES = 6


def pairs(mode: AutoresetMode, levels: list[Any], **options: Any) -> tuple[gym.vector.VectorEnv, SyncVectorEnv]:
    """A vector environment, and Gymnasium's own made of single ones."""
    ours = make_vec(len(levels), levels=levels, autoreset_mode=mode, **options)
    theirs = SyncVectorEnv([lambda level=level: make(level, **options) for level in levels], autoreset_mode=mode)
    return ours, theirs


def map_families(count: int) -> list[list[str]]:
    """Levels for a vector environment each: of one size, as it demands, and mostly not square."""
    families = []
    for seed, rows in enumerate(random_maps(count, seed=3)):
        shape = {"height": len(rows), "width": len(rows[0]), "num_targets": 1 + seed % 3, "wall_density": 0.2}
        try:
            levels = [cpp_rl_gym.Level.generate(**shape, seed=seed + index).map for index in range(COPIES - 1)]
        except ValueError:  # too small for so many targets
            levels = []
        families.append(["\n".join(rows), *levels])
    return families


FAMILIES = map_families(30)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("observation", ["flat", "grid"])
@pytest.mark.parametrize("mode", MODES)
def test_they_are_single_environments_step_for_step(mode: AutoresetMode, observation: str) -> None:
    """Thousands of random episodes on random maps, infos included."""
    random, episodes = np.random.default_rng(5), 0
    for seed, levels in enumerate(FAMILIES):
        ours, theirs = pairs(mode, levels, max_steps=25, observation=observation)
        assert_same(ours.reset(seed=seed), theirs.reset(seed=seed))
        for _ in range(200):
            actions = random.integers(4, size=len(levels))
            result = ours.step(actions)
            assert_same(result, theirs.step(actions))
            over = result[2] | result[3]
            episodes += int(over.sum())
            if mode == AutoresetMode.DISABLED and over.any():
                assert_same(*(env.reset(options={"reset_mask": over}) for env in (ours, theirs)))
    assert episodes > 1000, episodes


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_they_draw_levels_as_single_environments_do(mode: AutoresetMode) -> None:
    levels = [[0, 1], RandomLevels(), Curriculum([(2, 70), (RandomLevels(num_levels=3), 50), (4, 1)]), 3]
    ours, theirs = pairs(mode, levels, max_steps=20)
    random = np.random.default_rng(0)
    assert_same(ours.reset(seed=[4, None, 9, 0])[1]["level"][2:], theirs.reset(seed=[4, None, 9, 0])[1]["level"][2:])
    assert_same(ours.reset(seed=11), theirs.reset(seed=11))
    for _ in range(300):
        actions = random.integers(4, size=4)
        assert_same(ours.step(actions), theirs.step(actions))
    assert [level.name for level in ours.levels] == [env.level.name for env in theirs.envs]


def test_they_follow_the_oracle_of_arrays() -> None:
    """Thousands of episodes against the other implementation; starts are taken over from the environment."""
    random, episodes = np.random.default_rng(6), 0
    for levels in FAMILIES:
        count = len(levels)
        options = {"levels": levels, "max_steps": 40, "observation": "grid", "autoreset_mode": "SameStep"}
        envs, oracle = make_vec(count, **options), VectorOracle([level.splitlines() for level in levels], 40)
        observations, _ = envs.reset(seed=1)
        starts = np.argwhere(observations[:, 1])[:, 1:]
        np.testing.assert_array_equal(oracle.reset(starts)[0], observations)
        for _ in range(250):
            actions = random.integers(4, size=count)
            ours, theirs = envs.step(actions), oracle.step(actions)
            over = ours[2] | ours[3]
            episodes += int(over.sum())
            assert_same(ours[1:4], theirs[1:4])
            if over.any():
                oracle._begin(np.flatnonzero(over), np.argwhere(ours[0][over, 1])[:, 1:])
                theirs = (oracle._observe(), *theirs[1:4], oracle._infos())
            np.testing.assert_array_equal(ours[0], theirs[0])
            for key, value in theirs[4].items():
                np.testing.assert_array_equal(ours[4][key], value)
    assert episodes > 1000, episodes


def arrays_in(data: Any) -> list[np.ndarray]:
    """All arrays in tuples and dictionaries, and those in arrays of objects."""
    if isinstance(data, np.ndarray):
        return [data, *(array for item in data.flat for array in arrays_in(item))] if data.dtype == object else [data]
    parts = data.values() if isinstance(data, dict) else data if isinstance(data, tuple) else ()
    return [array for part in parts for array in arrays_in(part)]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("observation", ["flat", "grid"])
def test_spaces_types_and_metadata(mode: AutoresetMode, observation: str) -> None:
    envs = make_vec(3, level=1, autoreset_mode=mode, observation=observation, max_steps=5)
    single = make(1, observation=observation)
    assert envs.metadata["autoreset_mode"] is mode
    assert cpp_rl_gym.CoverageVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert (envs.single_observation_space, envs.single_action_space) == (single.observation_space, single.action_space)
    assert envs.observation_space == gym.vector.utils.batch_space(single.observation_space, 3)
    assert envs.action_space == gym.spaces.MultiDiscrete([4, 4, 4])
    results = [(*envs.reset(seed=0), None)]
    for _ in range(5):
        observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
        results.append((observations, infos, (rewards, terminated, truncated)))
        assert (rewards.dtype, terminated.dtype, truncated.dtype) == (np.float64, np.bool_, np.bool_)
        assert observations in envs.observation_space
    arrays = [array for result in results for array in arrays_in(result)]
    assert len(arrays) > 50
    assert not any(np.shares_memory(one, other) for one, other in combinations(arrays, 2))
    assert "num_envs=3" in str(envs)
    assert gym.make_vec(envs.spec).num_envs == 3
    envs.close()
    assert envs.closed


def test_it_is_what_make_vec_makes() -> None:
    assert isinstance(gym.make_vec(cpp_rl_gym.ENV_ID, 2), cpp_rl_gym.CoverageVectorEnv)
    assert isinstance(gym.make_vec(cpp_rl_gym.ENV_ID, 2, vectorization_mode="sync"), SyncVectorEnv)


def test_gymnasiums_wrappers_fit() -> None:
    envs = RecordEpisodeStatistics(make_vec(2, level=0, max_steps=7))
    envs.reset(seed=0)
    for _ in range(7):
        *_, infos = envs.step(np.zeros(2, np.int64))
    assert infos["episode"]["l"].tolist() == [7, 7]
    listed = DictInfoToList(make_vec(2, level=0))
    _, infos = listed.reset(seed=0)
    assert [info["remaining_targets"] for info in infos] == [8, 8]


def test_seeds() -> None:
    envs, other = make_vec(4), make_vec(4)
    first = envs.reset(seed=7)
    assert envs.np_random_seed == (7, 8, 9, 10)
    assert_same(first, other.reset(seed=[7, 8, 9, 10]))
    assert_same(envs.reset(), other.reset())
    assert_same(first, envs.reset(seed=7))
    unseeded = make_vec(2)
    assert unseeded.np_random_seed == (-1, -1)
    observations = unseeded.reset()
    assert_same(observations, make_vec(2).reset(seed=unseeded.np_random_seed))
    assert len(unseeded.np_random) == 2
    with pytest.raises(ValueError, match="3 seeds for 2 copies"):
        unseeded.reset(seed=[1, 2, 3])


def test_starts_can_be_chosen() -> None:
    envs = make_vec(2, level=0, observation="grid")
    observations, _ = envs.reset(options={"start": (7, 0)})
    assert np.argwhere(observations[:, 1]).tolist() == [[0, 7, 0], [1, 7, 0]]
    observations, _ = envs.reset(options={"start": [(7, 0), (0, 3)]})
    assert np.argwhere(observations[:, 1]).tolist() == [[0, 7, 0], [1, 0, 3]]
    for start, message in [
        ([(7, 0), (3, 4)], "it is a wall"),
        ([(7, 0)], "1 starts for 2 copies"),
        (3, "must be a pair"),
    ]:
        with pytest.raises(ValueError, match=message):
            envs.reset(options={"start": start})


def test_a_reset_that_fails_changes_nothing() -> None:
    envs, twin = make_vec(2, level=[0, 1]), make_vec(2, level=[0, 1])
    assert_same(envs.reset(seed=0), twin.reset(seed=0))
    with pytest.raises(ValueError, match="outside"):
        envs.reset(options={"start": [(0, 0), (9, 9)]})
    for _ in range(500):
        assert_same(envs.step([0, 1]), twin.step([0, 1]))


def test_a_first_reset_that_fails_leaves_seeding_to_the_next() -> None:
    envs = make_vec(2)
    with pytest.raises(ValueError, match="outside"):
        envs.reset(seed=0, options={"start": (9, 9)})
    assert envs.np_random_seed == (-1, -1)
    assert_same(envs.reset(), make_vec(2).reset(seed=envs.np_random_seed))


def test_masks_choose_whom_to_reset() -> None:
    envs = make_vec(3, autoreset_mode="Disabled", max_steps=2, observation="grid")
    with pytest.raises(ResetNeeded, match="first reset must be of all"):
        envs.reset(options={"reset_mask": np.array([True, False, True])})
    envs.reset(seed=0)
    before = envs.step([0, 0, 0])[0]
    options = {"reset_mask": np.array([False, True, False]), "start": (0, 0)}
    observations, infos = envs.reset(options=options)
    assert list(options) == ["reset_mask", "start"]
    np.testing.assert_array_equal(observations[[0, 2]], before[[0, 2]])
    assert observations[1, 1, 0, 0] == 1
    assert infos["_steps"].tolist() == infos["_level"].tolist() == [False, True, False]
    assert envs.step([0, 0, 0])[3].tolist() == [True, False, True]
    with pytest.raises(ResetNeeded, match="environment 0 is over"):
        envs.step([0, 0, 0])


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        ([True, True], TypeError, "must be a NumPy array of bools, not list"),
        (np.array([1, 0]), TypeError, "not an array of int"),
        (np.array([True]), ValueError, r"must have the shape \(2,\), not \(1,\)"),
        (np.array([False, False]), ValueError, "at least one"),
    ],
    ids=repr,
)
def test_bad_masks_are_refused(mask: Any, error: type[Exception], message: str) -> None:
    envs = make_vec(2)
    envs.reset()
    with pytest.raises(error, match=message):
        envs.reset(options={"reset_mask": mask})


@pytest.mark.parametrize(
    "actions",
    [[0, 4], [0, -1], [0.0, 1.0], [0], [0, 1, 2], 0, None, [[0], [1]], ["0", "1"], [[0], [1, 2]], [True, False]],
    ids=repr,
)
def test_bad_actions_are_refused(actions: Any) -> None:
    envs = make_vec(2)
    envs.reset(seed=0)
    before = pickle.dumps(envs)
    with pytest.raises(InvalidAction, match=r"integers|is not an action"):
        envs.step(actions)
    assert pickle.dumps(envs) == before


@pytest.mark.parametrize("actions", [[3, 1], (3, 1), np.array([3, 1], np.uint8), np.array([3, 0, 1, 0])[::2]], ids=repr)
def test_any_integers_are_actions(actions: Any) -> None:
    envs, twin = make_vec(2), make_vec(2)
    assert_same(envs.reset(seed=0), twin.reset(seed=0))
    assert_same(envs.step(actions), twin.step(np.array([3, 1])))


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"num_envs": 0}, ValueError, "num_envs must be from 1"),
        ({"num_envs": 2, "levels": [0]}, ValueError, "1 levels for 2 copies"),
        ({"num_envs": 2, "levels": "01"}, TypeError, "levels must be a list"),
        ({"num_envs": 2, "levels": [0, "..T"]}, ValueError, "same height and width"),
        ({"autoreset_mode": "Later"}, ValueError, "AutoresetMode"),
        ({"render_mode": "human"}, ValueError, "render_mode must be None or 'ansi' or 'rgb_array'"),
        ({"observation": "image"}, ValueError, "observation must be"),
        ({"sensor": "nose"}, ValueError, "sensor must be 'full'"),
        ({"max_steps": 0}, ValueError, "max_steps must be from 1"),
    ],
    ids=repr,
)
def test_bad_arguments_are_refused(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        cpp_rl_gym.CoverageVectorEnv(**options)


def test_before_the_first_reset() -> None:
    envs = make_vec(2, render_mode="ansi")
    with pytest.raises(ResetNeeded):
        envs.step([0, 0])
    with pytest.raises(ResetNeeded):
        envs.render()
    with pytest.raises(ValueError, match="options has no 'mask'"):
        envs.reset(options={"mask": None})


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda envs: pickle.loads(pickle.dumps(envs))])
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_copies_go_on_exactly_alike(mode: AutoresetMode, duplicate: Any) -> None:
    envs = make_vec(4, level=[0, RandomLevels()], autoreset_mode=mode, max_steps=15, copy=False)
    random = np.random.default_rng(0)
    envs.reset(seed=1)
    for _ in range(5):
        for _ in range(13):
            envs.step(random.integers(4, size=4))
        twin = duplicate(envs)
        for _ in range(40):
            actions = random.integers(4, size=4)
            assert_same(envs.step(actions), twin.step(actions))
        assert_same(envs.reset(), twin.reset())


def test_without_copies_there_is_one_array() -> None:
    envs, twin = make_vec(3, copy=False), make_vec(3)
    observations, _ = envs.reset(seed=0)
    expected, _ = twin.reset(seed=0)
    np.testing.assert_array_equal(observations, expected)
    for _ in range(50):
        again, *ours = envs.step([0, 2, 1])
        expected, *theirs = twin.step([0, 2, 1])
        assert again is observations
        np.testing.assert_array_equal(again, expected)
        assert_same(ours, theirs)
    observations.flags.writeable = False
    with pytest.raises(ValueError, match=r"writ"):
        envs.step([0, 0, 0])


def test_other_threads_run_meanwhile() -> None:
    """Resetting many copies on generated levels takes a while, in which this thread counts."""
    envs = make_vec(500, level=RandomLevels(20, 20, 0.3, 9))
    envs.reset(seed=0)
    busy = threading.Thread(target=envs.reset)
    ticks, begin = 0, time.perf_counter()
    busy.start()
    while busy.is_alive():
        time.sleep(0.001)
        ticks += 1
    assert ticks > 10, (ticks, time.perf_counter() - begin)


def test_use_by_two_threads_at_once_raises_and_harms_nothing() -> None:
    envs = make_vec(300, level=RandomLevels(20, 20, 0.3, 9))
    envs.reset(seed=0)
    errors: list[BaseException] = []

    def work() -> None:
        try:
            for _ in range(3):
                envs.reset()
        except RuntimeError as error:
            errors.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all("borrowed" in str(error) for error in errors)
    envs.step(np.zeros(300, np.int64))
