"""The environment, behind Gymnasium's ``Env``."""

from __future__ import annotations

from typing import Any, ClassVar, Literal, cast

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.error import ResetNeeded

from cpp_rl_gym import _checks
from cpp_rl_gym._extension import _native
from cpp_rl_gym.levels import Level, LevelRule, as_source
from cpp_rl_gym.picture import picture
from cpp_rl_gym.window import Window

Observation = npt.NDArray[np.float32]

#: The names of all sensors, the default first.
SENSORS: tuple[str, ...] = tuple(_native.sensors())


class CoverageEnv(gymnasium.Env[Observation, np.int64]):
    """An agent on a grid must visit every target in as few moves as it can.

    **Actions**, ``Discrete(4)``: 0 down, 1 up, 2 right, 3 left. A move into a wall or off the map leaves the agent
    where it is, and is a step like any other.

    **Observations**, float32, each value 0 or 1. They are four maps of the level, which are 1 where (0) there is no
    wall, (1) the agent is, (2) there is a target, visited or not, (3) the agent has been, its start included. With
    ``observation="flat"`` they are one vector, ``Box(0, 1, (4 * H * W,))``, channel by channel and row by row. Dense
    layers take vectors, and so does Stable-Baselines3 without a warning. With ``"grid"`` they are
    ``Box(0, 1, (4, H, W))``, for convolutions and for models trained on the paper's own environment. Another ``sensor``
    has another shape ``[C, H, W]``.

    **Reward**: -1 for a step. A step to a target not visited before earns +2 instead, and the last target +30 more.

    **Episodes** start on a cell drawn uniformly from those that are neither wall nor target. They are *terminated* when
    every target is visited, and *truncated* after ``max_steps`` steps. Both may hold at once. Then nothing is left to
    earn, so look at ``terminated`` first.

    **Info**: ``steps`` so far in the episode, ``remaining_targets``, and ``action_mask``, int8 ``[4]``, 1 for each
    action that moves the agent. Every action is allowed; ``action_space.sample(mask)`` takes the mask. ``reset`` adds
    ``level``, the level's name.

    **Randomness**: ``reset(seed=…)`` seeds a stream of random numbers from ``np_random``. The same seed gives the same
    levels and starts, also in a vector environment.

    Args:
        level: the level, or a rule that gives each episode its level; see :mod:`cpp_rl_gym.levels`.
        max_steps: the step limit of an episode. Do not add a ``TimeLimit`` to it.
        observation: "flat" or "grid".
        sensor: what the agent sees; "full" is the whole map, as described above. :data:`cpp_rl_gym.SENSORS` has all.
        render_mode: None, "ansi" (a string), "rgb_array" (a picture) or "human" (a window; needs pygame).

    ``reset(options={"start": (row, column)})`` chooses the start of this episode; rows and columns count from 0.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi", "human", "rgb_array"], "render_fps": 8}  # type: ignore[misc]

    def __init__(
        self,
        level: LevelRule = 0,
        *,
        max_steps: int = _native.MAX_STEPS,
        observation: Literal["flat", "grid"] = "flat",
        sensor: str = "full",
        render_mode: str | None = None,
    ) -> None:
        source = as_source(level)
        self.render_mode = _checks.one_of("render_mode", render_mode, [None, *self.metadata["render_modes"]])
        self.action_space = spaces.Discrete(4)
        self._core = _native.Env(
            source,
            max_steps=_checks.natural("max_steps", max_steps, low=1),
            seen=seen(sensor, observation),
            records_path=render_mode in ("human", "rgb_array"),
        )
        self.observation_space = observation_space(self._core.shape)
        self._window: Window | None = None
        # The generator that the core's random numbers were seeded from.
        self._seeded_from: np.random.Generator | None = None

    @property
    def level(self) -> Level:
        """The level of the current episode."""
        return self._core.level

    def set_level(self, level: LevelRule) -> None:
        """From the next episode on, plays ``level``; its height and width must be those of the levels so far."""
        self._core.set_source(as_source(level))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode; see the class for ``seed`` and ``options``."""
        options = options or {}
        _checks.known_keys("options", options, ["start"])
        start = options.get("start")
        if start is not None:
            start = _checks.position("options['start']", start)
        super().reset(seed=seed)
        if self._seeded_from is not self.np_random:
            self._seeded_from = self.np_random
            self._core.seed(stream_seed(self.np_random))
        result = self._core.reset(start)
        if self.render_mode == "human":
            self.render()
        return result

    def step(self, action: np.int64 | int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Makes one step: observation, reward, terminated, truncated, info."""
        result = self._core.step(action)
        if self.render_mode == "human":
            self.render()
        return result

    def render(self) -> Any:
        """The state as ``render_mode`` says: a string, an array ``[height, width, 3]``, or in a window."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                "render() does nothing without a render mode: create the environment with "
                'render_mode="ansi", "human" or "rgb_array"'
            )
            return None
        if not self._core.was_reset:
            raise ResetNeeded("there is nothing to render yet; call reset() first")
        if self.render_mode == "ansi":
            return self._core.text()
        frame = picture(self._core.level, self._core.path)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = Window("cpp_rl/Coverage-v0", self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}  # a window stays where it is


def seen(sensor: str, observation: str) -> tuple[str, bool]:
    """What an environment sees with, as the extension takes it."""
    _checks.one_of("sensor", sensor, SENSORS)
    return sensor, _checks.one_of("observation", observation, ["flat", "grid"]) == "grid"


def observation_space(shape: tuple[int, ...]) -> spaces.Space[Observation]:
    """The space of observations of this shape."""
    return cast("spaces.Space[Observation]", spaces.Box(0.0, 1.0, shape, np.float32))


def stream_seed(generator: np.random.Generator) -> int:
    """The seed of the random numbers that an environment with this ``np_random`` uses."""
    return int(generator.integers(2**64, dtype=np.uint64))
