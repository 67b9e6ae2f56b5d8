"""Many environments stepped by one call, behind Gymnasium's ``VectorEnv``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from cpp_rl_gym import _checks
from cpp_rl_gym._extension import _native
from cpp_rl_gym.env import Observation, observation_space, seen, stream_seed
from cpp_rl_gym.levels import Level, LevelRule, as_source
from cpp_rl_gym.picture import picture

Actions = npt.NDArray[np.int64]


class CoverageVectorEnv(VectorEnv[Observation, Actions, npt.NDArray[Any]]):
    """Copies of :class:`~cpp_rl_gym.CoverageEnv`, stepped together by one call of compiled code.

    It returns exactly what Gymnasium's ``SyncVectorEnv`` of ``num_envs`` environments returns, infos and random numbers
    included. ``reset(seed=s)`` gives copy ``i`` the seed ``s + i``; a list gives each copy its own. It is
    faster, and other Python threads run while it steps.

    Args:
        num_envs: how many copies.
        level: the level or rule of all copies, as for ``CoverageEnv``.
        levels: instead of ``level``, a level or rule for each copy.
        max_steps: the step limit of an episode.
        observation: "flat" or "grid", as for ``CoverageEnv``.
        sensor: what the agents see, as for ``CoverageEnv``.
        render_mode: None, "ansi" or "rgb_array"; ``render`` returns a tuple with one for each copy.
        autoreset_mode: what happens to a copy whose episode is over. "NextStep": the next ``step`` resets it, whatever
            its action. "SameStep": it is reset at once; the last observation and info of its episode are in
            ``infos["final_obs"]`` and ``infos["final_info"]``. "Disabled": you reset it, with
            ``reset(options={"reset_mask": mask})``, a bool array ``[num_envs]``.
        copy: whether each call returns a new array of observations. Without it every call overwrites and returns
            the same array.

    ``reset(options={"start": (row, column)})`` chooses the start of all copies. A list of pairs has one for each.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 8,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        level: LevelRule = 0,
        *,
        levels: Sequence[LevelRule] | None = None,
        max_steps: int = _native.MAX_STEPS,
        observation: Literal["flat", "grid"] = "flat",
        sensor: str = "full",
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
    ) -> None:
        self.num_envs = _checks.natural("num_envs", num_envs, low=1)
        sources = self._sources(level, levels)
        mode = AutoresetMode(autoreset_mode)
        self.metadata = {**type(self).metadata, "autoreset_mode": mode}  # type: ignore[misc]
        self.render_mode = _checks.one_of("render_mode", render_mode, [None, *self.metadata["render_modes"]])
        self._core = _native.VectorEnv(
            sources,
            max_steps=_checks.natural("max_steps", max_steps, low=1),
            autoreset=mode.value,
            seen=seen(sensor, observation),
            shares_memory=not copy,
            records_path=render_mode == "rgb_array",
        )
        self.single_observation_space = observation_space(self._core.single_shape)
        self.single_action_space = spaces.Discrete(4)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        # np_random of each copy, once there was a reset.
        self._generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._seeds: list[int] = [-1] * self.num_envs

    @property
    def levels(self) -> tuple[Level, ...]:
        """The levels of the current episodes."""
        return tuple(self._core.levels)

    def set_level(self, level: LevelRule) -> None:
        """From their next episodes on, all copies play ``level``."""
        self._core.set_sources(self._sources(level, None))

    def set_levels(self, levels: Sequence[LevelRule]) -> None:
        """From its next episode on, each copy plays its entry of ``levels``."""
        self._core.set_sources(self._sources(None, levels))

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode in each copy, or in those that ``options["reset_mask"]`` names."""
        options = options or {}
        _checks.known_keys("options", options, ["start", "reset_mask"])
        mask = options.get("reset_mask")
        if mask is not None:
            self._check_mask(mask)
        starts = self._starts(options.get("start"))
        seeds = self._check_seeds(seed)
        chosen = range(self.num_envs) if mask is None else np.flatnonzero(mask).tolist()
        fresh = {
            index: seeding.np_random(seeds[index])
            for index in chosen
            if seeds[index] is not None or self._generators[index] is None
        }
        streams = [stream_seed(fresh[index][0]) if index in fresh else None for index in range(self.num_envs)]
        result = self._core.reset(streams, starts, None if mask is None else mask.tolist())
        for index, (generator, used) in fresh.items():
            self._generators[index], self._seeds[index] = generator, used
        return result

    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[Observation, npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any], dict[str, Any]]:
        """Makes one step in each copy: observations, rewards, terminations, truncations, infos."""
        return self._core.step(self._actions(actions))

    def render(self) -> tuple[Any, ...] | None:
        """The states as ``render_mode`` says: strings, or arrays ``[height, width, 3]``."""
        if self.render_mode is None:
            gymnasium.logger.warn(
                "render() does nothing without a render mode: create the environment with "
                'render_mode="ansi" or "rgb_array"'
            )
            return None
        if not self._core.was_reset:
            raise ResetNeeded("there is nothing to render yet; call reset() first")
        if self.render_mode == "ansi":
            return tuple(self._core.texts())
        return tuple(picture(level, path) for level, path in zip(self._core.levels, self._core.paths, strict=True))

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator | None, ...]:  # type: ignore[override]
        """For each copy the generator that seeded its random numbers; None before the first reset."""
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each copy, also where none was passed; -1 before the first reset."""
        return tuple(self._seeds)

    def _sources(self, level: Any, levels: Sequence[LevelRule] | None) -> list[_native.LevelSource]:
        if levels is None:
            return [as_source(level)] * self.num_envs
        if isinstance(levels, str | bytes) or not isinstance(levels, Sequence):
            raise TypeError(f"levels must be a list with a level for each copy, not {levels!r}")
        if len(levels) != self.num_envs:
            raise ValueError(f"{len(levels)} levels for {self.num_envs} copies; pass one for each")
        return [as_source(one) for one in levels]

    def _actions(self, actions: npt.ArrayLike) -> Actions:
        try:
            array = np.asarray(actions)
        except ValueError:  # rows of different lengths
            array = np.empty(0)
        if array.dtype.kind not in "iu" or array.shape != (self.num_envs,):
            raise InvalidAction(
                f"actions must be {self.num_envs} integers, not {type(actions).__name__} of shape {array.shape} "
                f"and dtype {array.dtype}"
            )
        return array.astype(np.int64, copy=False)

    def _check_mask(self, mask: Any) -> None:
        """The rules of Gymnasium's own vector environments."""
        name = "options['reset_mask']"
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
            kind = f"an array of {mask.dtype}" if isinstance(mask, np.ndarray) else type(mask).__name__
            raise TypeError(f"{name} must be a NumPy array of bools, not {kind}")
        if mask.shape != (self.num_envs,):
            raise ValueError(f"{name} must have the shape ({self.num_envs},), not {mask.shape}")
        if not mask.any():
            raise ValueError(f"{name} must name at least one environment to reset")

    def _starts(self, start: Any) -> list[tuple[int, int]] | None:
        if start is None:
            return None
        name = "options['start']"
        if np.ndim(start) < 2:
            return [_checks.position(name, start)] * self.num_envs
        if len(start) != self.num_envs:
            raise ValueError(f"{name} has {len(start)} starts for {self.num_envs} copies; pass a pair for each, or one")
        return [_checks.position(name, one) for one in start]

    def _check_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if isinstance(seed, int | np.integer):
            return [int(seed) + index for index in range(self.num_envs)]
        seeds = [None if one is None else int(one) for one in seed]
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} copies; pass one for each, or a single integer")
        return seeds
