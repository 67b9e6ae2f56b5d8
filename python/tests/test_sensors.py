"""What agents see: the same rules for every sensor."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

import cpp_rl_gym
from support import RIGHT, assert_same, make, make_vec

WIDE = "..T.#\n#...T"
each_sensor = pytest.mark.parametrize("sensor", cpp_rl_gym.SENSORS)


def test_the_whole_map_is_the_default() -> None:
    assert cpp_rl_gym.SENSORS[0] == "full"
    ours, theirs = make(WIDE), make(WIDE, sensor="full")
    assert_same(ours.reset(seed=1), theirs.reset(seed=1))


def test_a_local_view_by_hand() -> None:
    env = make(WIDE, sensor="local", observation="grid")
    observation, _ = env.reset(options={"start": (0, 0)})
    assert env.observation_space.shape == (4, 3, 3)
    no_wall, agent, target, visited = observation
    np.testing.assert_array_equal(no_wall, [[0, 0, 0], [0, 1, 1], [0, 0, 1]])
    np.testing.assert_array_equal(agent, [[0, 0, 0], [0, 1, 0], [0, 0, 0]])
    assert not target.any()
    np.testing.assert_array_equal(visited, agent)
    assert env.step(RIGHT)[0][2].tolist() == [[0, 0, 0], [0, 0, 1], [0, 0, 0]]


@pytest.mark.filterwarnings("error")
@each_sensor
def test_gymnasiums_checker_has_nothing_to_say(sensor: str) -> None:
    check_env(make(WIDE, sensor=sensor))
    check_env(make(WIDE, sensor=sensor, observation="grid"))


@each_sensor
def test_flat_observations_are_the_grid_in_one_row(sensor: str) -> None:
    flat, grid = make(WIDE, sensor=sensor), make(WIDE, sensor=sensor, observation="grid")
    assert flat.observation_space.shape == (np.prod(grid.observation_space.shape),)
    np.testing.assert_array_equal(flat.reset(seed=1)[0], grid.reset(seed=1)[0].ravel())
    for action in np.random.default_rng(0).integers(4, size=50):
        (row, *ours), (array, *theirs) = flat.step(action), grid.step(action)
        np.testing.assert_array_equal(row, array.ravel())
        assert_same(ours, theirs)
        if ours[1] or ours[2]:
            np.testing.assert_array_equal(flat.reset()[0], grid.reset()[0].ravel())


@each_sensor
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_copies_see_what_single_environments_see(sensor: str, mode: str) -> None:
    options = {"level": WIDE, "sensor": sensor, "observation": "grid", "max_steps": 9}
    ours = make_vec(3, autoreset_mode=mode, **options)
    theirs = SyncVectorEnv([lambda: make(**options)] * 3, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert_same(ours.reset(seed=4), theirs.reset(seed=4))
    random = np.random.default_rng(1)
    for _ in range(100):
        actions = random.integers(4, size=3)
        assert_same(ours.step(actions), theirs.step(actions))


@each_sensor
def test_pickled_environments_see_the_same(sensor: str) -> None:
    for env in (make(WIDE, sensor=sensor), make_vec(2, level=WIDE, sensor=sensor)):
        env.reset(seed=0)
        twin = pickle.loads(pickle.dumps(env))
        assert_same(env.reset(), twin.reset())
