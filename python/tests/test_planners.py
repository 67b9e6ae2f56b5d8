"""Plans, played in the environment."""

from __future__ import annotations

import json
import threading
from typing import Any

import numpy as np
import pytest

import cpp_rl_gym
from oracle import REPOSITORY
from support import LEVELS, make

FIXTURE = REPOSITORY / "crates" / "coverage-env" / "tests" / "fixtures" / "planner_returns.json"


@pytest.mark.parametrize("planner", ["optimal", "astar"])
@pytest.mark.parametrize("number", LEVELS)
def test_plans_earn_what_they_say(number: int, planner: str) -> None:
    env, level = make(number), cpp_rl_gym.as_level(number)
    for start in level.starts:
        actions, return_ = cpp_rl_gym.plan(level, start, planner)
        env.reset(options={"start": start})
        results = [env.step(action) for action in actions]
        assert sum(result[1] for result in results) == return_
        assert [result[2] for result in results] == [False] * (len(actions) - 1) + [True]


def test_optima_are_those_measured_elsewhere() -> None:
    for number, starts in json.loads(FIXTURE.read_text()).items():
        level = cpp_rl_gym.as_level(number)
        assert [tuple(entry["start"]) for entry in starts] == level.starts
        for entry in starts:
            assert cpp_rl_gym.plan(level, entry["start"]).return_ == entry["optimal"]


def test_optimal_is_the_default_and_never_worse() -> None:
    for start in cpp_rl_gym.as_level(3).starts:
        best = cpp_rl_gym.plan(3, start)
        assert best.return_ >= cpp_rl_gym.plan(3, start, "astar").return_
        assert best.actions.dtype == np.int64


def test_the_step_limit_counts() -> None:
    actions, return_ = cpp_rl_gym.plan("....T", (0, 0), max_steps=2)
    assert (len(actions), return_) == (2, -2.0)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((0, (3, 4)), ValueError, "row 3, column 4: it is a wall"),
        ((0, (9, 0)), ValueError, "lies outside"),
        ((0, (0, 0), "best"), ValueError, 'no planner "best"; there are "optimal" and "astar"'),
        ((0, (0, 0), 3), TypeError, "planner"),
        (("." + "T" * 23, (0, 0)), ValueError, "limited to 22"),
        ((9, (0, 0)), ValueError, "no built-in level 9"),
    ],
)
def test_bad_arguments_are_refused(arguments: tuple[Any, ...], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        cpp_rl_gym.plan(*arguments)


def test_threads_may_plan_on_one_level() -> None:
    level = cpp_rl_gym.Level.generate(height=9, width=7, wall_density=0.1, num_targets=9, seed=0)
    plans: dict[tuple[int, int], float] = {}

    def work(start: tuple[int, int]) -> None:
        plans[start] = cpp_rl_gym.plan(level, start).return_

    threads = [threading.Thread(target=work, args=(start,)) for start in level.starts]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert plans == {start: cpp_rl_gym.plan(level, start).return_ for start in level.starts}
