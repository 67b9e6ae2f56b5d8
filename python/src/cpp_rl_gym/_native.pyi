from typing import Any, Final, final

import numpy as np
import numpy.typing as npt
from typing_extensions import Self

__all__ = ["BUILTIN_LEVELS", "MAX_STEPS", "RENDER_LEGEND", "Env", "Level", "LevelSource", "VectorEnv", "sensors"]

MAX_STEPS: Final[int]
BUILTIN_LEVELS: Final[list[str]]
RENDER_LEGEND: Final[str]

def sensors() -> list[str]:
    """The names of all sensors, the default first."""

@final
class Level:
    """A map of free cells (``.``), walls (``#``) and targets (``T``), checked and immutable.

    Every free cell is a start from which every target can be reached. Levels compare equal if their names and maps do.
    """

    @staticmethod
    def resolve(id_or_path: str) -> Level:
        """The built-in level of that id, or else the level in the file at that path."""
    @staticmethod
    def from_path(path: Any) -> Level:
        """The level in a YAML file."""
    @staticmethod
    def from_map(map: str, name: str = "map") -> Level:
        """The level drawn with the characters ``.``, ``#`` and ``T``, a line per row."""
    @staticmethod
    def generate(*, height: int, width: int, wall_density: float, num_targets: int, seed: int) -> Level:
        """The generated level number ``seed`` of this description."""
    @property
    def name(self) -> str:
        """What the level is called."""
    @property
    def height(self) -> int:
        """The number of rows."""
    @property
    def width(self) -> int:
        """The number of columns."""
    @property
    def map(self) -> str:
        """The map as text, a line per row."""
    @property
    def targets(self) -> list[tuple[int, int]]:
        """The target cells, ``(row, column)``, row by row."""
    @property
    def starts(self) -> list[tuple[int, int]]:
        """The cells where an episode may start, ``(row, column)``, row by row."""
    def plan(
        self, planner: str, row: int, column: int, max_steps: int
    ) -> tuple[npt.NDArray[np.int64], float, int, bool]:
        """The actions of an episode, to its end; its return, its length, and whether it is solved."""
    def __hash__(self) -> int: ...
    def __eq__(self, value: object, /) -> bool: ...

@final
class LevelSource:
    """A rule that gives each episode its level."""

    @staticmethod
    def fixed(level: Level) -> LevelSource:
        """Always ``level``."""
    @staticmethod
    def generated(
        height: int, width: int, wall_density: float, num_targets: int, seed: int, num_levels: int | None
    ) -> LevelSource:
        """Generated levels with the seeds ``seed``, ``seed + 1``, …: ``num_levels`` of them, or 2**32."""
    @staticmethod
    def one_of(sources: list[LevelSource]) -> LevelSource:
        """Any of ``sources``, uniformly, anew for each episode."""
    @staticmethod
    def stages(stages: list[tuple[int, LevelSource]]) -> LevelSource:
        """One source after the other, each for its number of timesteps."""
    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of its levels."""

@final
class Env:
    """One environment."""

    def __new__(cls, source: LevelSource, *, max_steps: int, seen: tuple[str, bool], records_path: bool) -> Self: ...
    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of its observations."""
    def seed(self, seed: int) -> None: ...
    def set_source(self, source: LevelSource) -> None: ...
    def reset(self, start: tuple[int, int] | None = None) -> tuple[npt.NDArray[np.float32], dict[str, Any]]: ...
    def step(self, action: Any) -> tuple[npt.NDArray[np.float32], float, bool, bool, dict[str, Any]]: ...
    def text(self) -> str: ...
    @property
    def was_reset(self) -> bool: ...
    @property
    def level(self) -> Level: ...
    @property
    def timesteps(self) -> int: ...
    @property
    def path(self) -> list[tuple[int, int]]: ...
    @staticmethod
    def restore(source: LevelSource, max_steps: int, seen: tuple[str, bool], saved: Any) -> Env: ...

@final
class VectorEnv:
    """Many environments, stepped by one call."""

    def __new__(
        cls,
        sources: list[LevelSource],
        *,
        max_steps: int,
        autoreset: str,
        seen: tuple[str, bool],
        shares_memory: bool,
        records_path: bool,
    ) -> Self: ...
    def set_sources(self, sources: list[LevelSource]) -> None: ...
    def reset(
        self,
        seeds: list[int | None],
        starts: list[tuple[int, int]] | None = None,
        mask: list[bool] | None = None,
    ) -> tuple[npt.NDArray[np.float32], dict[str, Any]]: ...
    def step(
        self, actions: npt.NDArray[np.int64]
    ) -> tuple[
        npt.NDArray[np.float32],
        npt.NDArray[np.float64],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
        dict[str, Any],
    ]: ...
    def texts(self) -> list[str]: ...
    @property
    def was_reset(self) -> bool: ...
    @property
    def single_shape(self) -> tuple[int, ...]:
        """The shape of one observation."""
    @property
    def levels(self) -> list[Level]: ...
    @property
    def paths(self) -> list[list[tuple[int, int]]]: ...
    @staticmethod
    def restore(
        sources: list[LevelSource],
        max_steps: int,
        autoreset: str,
        seen: tuple[str, bool],
        shares_memory: bool,
        saved: Any,
    ) -> VectorEnv: ...
