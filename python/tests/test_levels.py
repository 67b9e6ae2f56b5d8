"""Levels, however they are given, and rules that choose among them."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cpp_rl_gym
from cpp_rl_gym import Curriculum, Level, RandomLevels, as_level
from oracle import REPOSITORY, read_map
from support import LEVELS, make, make_vec


@pytest.mark.parametrize("number", LEVELS)
def test_the_papers_levels_are_built_in(number: int) -> None:
    level = as_level(number)
    rows = read_map(str(number))
    assert level.map.splitlines() == rows
    assert level == as_level(str(number)) == as_level(np.int64(number)) == as_level(level)
    cells = [(row, column) for row in range(8) for column in range(8)]
    assert level.targets == [(row, column) for row, column in cells if rows[row][column] == "T"]
    assert level.starts == [(row, column) for row, column in cells if rows[row][column] == "."]


def test_levels_come_from_files() -> None:
    path = REPOSITORY / "levels" / "2.yaml"
    assert as_level(path) == as_level(str(path)) == as_level(2)


def test_levels_come_from_maps() -> None:
    level = as_level("..#\n.TT\n")
    assert (level.name, level.height, level.width, level.map) == ("map", 2, 3, "..#\n.TT\n")
    assert level.targets == [(1, 1), (1, 2)]
    assert as_level(".T").width == 2
    assert repr(level) == 'Level("map", 2 x 3, 2 targets)'
    assert str(level) == level.map


def test_levels_are_values() -> None:
    level = Level.generate(height=4, width=9, wall_density=0.2, num_targets=3, seed=5)
    again = Level.generate(height=4, width=9, wall_density=0.2, num_targets=3, seed=5)
    assert level == again and hash(level) == hash(again)
    assert level != Level.generate(height=4, width=9, wall_density=0.2, num_targets=3, seed=6)
    assert level != Level.from_map(level.map, "other name")
    assert pickle.loads(pickle.dumps(level)) == copy.deepcopy(level) == level


@pytest.mark.parametrize(
    ("level", "error", "message"),
    [
        (5, ValueError, "no built-in level 5; there are 0 to 4"),
        (-1, ValueError, "no built-in level -1"),
        (True, TypeError, "True is not a level"),
        (1.0, TypeError, "1.0 is not a level"),
        (None, TypeError, "None is not a level"),
        ("5", ValueError, "neither a built-in level .* nor an existing file"),
        ("", ValueError, "neither a built-in level"),
        (Path("no/such.yaml"), ValueError, "no/such.yaml: cannot be read"),
        (Path("."), ValueError, "cannot be read"),
        (REPOSITORY / "Cargo.toml", ValueError, "Cargo.toml"),
        ("...\n.T", ValueError, "row 2, column 3: the row has 2 cells and the first row has 3"),
        ("..\n.X", ValueError, "row 2, column 2: unknown character 'X'"),
        ("..\n..", ValueError, "no target"),
        ("TT\nTT", ValueError, "no start cell"),
        (".#T\n.#.", ValueError, "cannot reach"),
        ("\n", ValueError, "empty"),
        ("." * 20000 + "\nT", ValueError, "more than 16384 cells"),
        ([], ValueError, "no levels"),
        ([0, "..T"], ValueError, "levels of 8 x 8 and of 1 x 3 cells"),
        ([0, [1, None]], TypeError, "None is not a level"),
        (b"0", TypeError, "is not a level"),
        ({"level": 0}, TypeError, "is not a level"),
        (RandomLevels(height=0), ValueError, "height must be from 1"),
        (RandomLevels(height=200, width=200), ValueError, "at most 16384"),
        (RandomLevels(height=2**31, width=2**31), ValueError, "at most 16384"),
        (RandomLevels(width=2.0), TypeError, "width must be an integer"),
        (RandomLevels(wall_density=1.0), ValueError, "wall density of 1"),
        (RandomLevels(wall_density=float("nan")), ValueError, "wall density of NaN"),
        (RandomLevels(num_targets=64), ValueError, "leave no start cell"),
        (RandomLevels(num_targets=0), ValueError, "num_targets must be from 1"),
        (RandomLevels(seed=-1), ValueError, "seed must be from 0"),
        (RandomLevels(num_levels=0), ValueError, "num_levels must be from 1"),
        (Curriculum([]), ValueError, "no levels"),
        (Curriculum([(0, 0)]), ValueError, "the timesteps of a stage must be from 1"),
        (Curriculum([(0, 10), 1]), ValueError, r"stage 1 of the curriculum must be a pair \(level, timesteps\)"),
        (Curriculum([(0, 10), ("T.", 5)]), ValueError, "same height and width"),
    ],
    ids=lambda value: repr(value)[:40],
)
def test_what_is_no_level_is_refused(level: Any, error: type[Exception], message: str) -> None:
    for build in (make, lambda level: make_vec(2, level=level)):
        with pytest.raises(error, match=message):
            build(level)


def test_a_list_gives_each_episode_one_of_its_levels() -> None:
    env = make([0, 1, [2, 3]])
    env.reset(seed=0)
    names = [env.reset()[1]["level"] for _ in range(1200)]
    counts = [names.count(str(number)) for number in range(4)]
    assert np.all(np.abs(np.array(counts) - [400, 400, 200, 200]) < 100)


def test_random_levels_are_fresh_each_episode() -> None:
    env = make(RandomLevels(5, 7, 0.2, 4))
    env.reset(seed=0)
    levels = set()
    for _ in range(300):
        _, info = env.reset()
        level = env.level
        assert info["level"] == level.name
        assert (level.height, level.width, len(level.targets), level.map.count("#")) == (5, 7, 4, 7)
        levels.add(level.map)
    assert len(levels) == 300


def test_a_set_of_random_levels_is_the_set_of_its_seeds() -> None:
    description = {"height": 3, "width": 5, "wall_density": 0.2, "num_targets": 2}
    env = make(RandomLevels(**description, seed=40, num_levels=6))
    env.reset(seed=0)
    met = set()
    for _ in range(200):
        env.reset()
        met.add(env.level)
    assert met == {Level.generate(**description, seed=seed) for seed in range(40, 46)}


def test_a_curriculum_changes_level_with_the_episode_after_its_timesteps() -> None:
    env = make(Curriculum([(0, 5), ([1, 2], 3), (3, 1)]), max_steps=4)
    played = []
    env.reset(seed=0)
    for _ in range(4):
        played.append(env.level.name)
        for _ in range(4):
            env.step(1)
        env = pickle.loads(pickle.dumps(env))
        env.reset()
    # Episodes begin at timesteps 0, 4, 8, 12: the second before the first stage is over.
    assert played == ["0", "0", "3", "3"]


def test_each_copy_has_its_own_level() -> None:
    envs = make_vec(3, levels=[4, "\n".join(read_map("1")), RandomLevels()])
    _, infos = envs.reset(seed=0)
    assert infos["level"][:2].tolist() == ["4", "map"]
    assert [level.name for level in envs.levels[:2]] == ["4", "map"]
    envs.set_levels([0, 1, 2])
    assert envs.reset()[1]["level"].tolist() == ["0", "1", "2"]
    envs.set_level(3)
    assert envs.reset()[1]["level"].tolist() == ["3"] * 3
    with pytest.raises(ValueError, match="2 levels for 3 copies"):
        envs.set_levels([0, 1])
    with pytest.raises(ValueError, match="same height and width"):
        envs.set_level(".T")
    assert cpp_rl_gym.BUILTIN_LEVELS == ("0", "1", "2", "3", "4")
