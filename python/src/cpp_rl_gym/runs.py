"""cpp-rl's runs and reports as pandas frames.

    runs = cpp_rl_gym.load_runs("runs")
    runs.progress.groupby(["arm", "curriculum", "stage"])["rollout/ep_rew_mean"].mean()

This module needs pandas, and not the compiled extension.
"""

from __future__ import annotations

import importlib
import io
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from cpp_rl_gym.checkpoint import MissingPackageError

if TYPE_CHECKING:
    import pandas as pd

DEPTH = 4  # folders below a given one in which cpp-rl looks for runs: command, arm, curriculum, seed
KEYS = ("run", "arm", "curriculum", "treatment", "seed")


class Runs(NamedTuple):
    """What runs have logged. Every frame begins with the columns of ``KEYS``, which say whose row it is.

    ``run`` is the run's directory below the folder that was given, ``curriculum`` the name of its sequence of stages.
    ``treatment`` is that of a fork, such as ``after-0:head-0.02`` (it goes on after stage 0 under the treatment
    ``head-0.02``), and empty for a run that is no fork.
    The other columns are those of the files; docs/metrics.md explains them. A column that a run does not have is NaN.
    """

    progress: pd.DataFrame
    """A row for each row of a run's progress.csv."""
    plasticity: pd.DataFrame
    """A row for each measurement of plasticity."""
    evaluations: pd.DataFrame
    """A row for each evaluated episode of the ``policy`` ``greedy`` or ``sampled``."""
    settings: pd.DataFrame
    """A row for each run: its ``state`` (``finished``, ``running`` …) and its settings."""
    learning: pd.DataFrame
    """A row for each policy and level of each evaluation in the midst of a stage (``--evaluate-every``)."""


def load_runs(folder: str | os.PathLike[str]) -> Runs:
    """Reads all runs in and below ``folder``, those that are still training included.

    Raises FileNotFoundError if there is no run, and ValueError for a file that cannot be understood.
    """
    pandas, folder = _pandas(), Path(folder)
    frames: dict[str, list[Any]] = {name: [] for name in ("progress", "plasticity", "evaluations", "learning")}
    settings = []
    for path in sorted(_find(folder, DEPTH)):
        manifest = _manifest(path)
        of_run = {**manifest, "run": str(path.relative_to(folder)), "treatment": _treatment(manifest)}
        keys = {key: of_run[key] for key in KEYS}
        settings.append({**keys, "state": manifest["status"]["state"], **manifest["config"]})
        for name, found in frames.items():
            if (path / f"{name}.csv").exists():
                found.append(_logged(path / f"{name}.csv", keys))
    if not settings:
        raise FileNotFoundError(f"there is no run in or below {folder}; pass the folder that cpp-rl was given as --out")
    none = pandas.DataFrame(columns=list(KEYS))
    for rows in frames["evaluations"]:
        if "policy" not in rows:  # a run of version 0.1.0
            rows["policy"] = "greedy"
    tables = {name: pandas.concat(found, ignore_index=True) if found else none for name, found in frames.items()}
    return Runs(**tables, settings=pandas.DataFrame(settings))


def load_report(folder: str | os.PathLike[str]) -> dict[str, pd.DataFrame]:
    """Reads the tables of a report that ``cpp-rl compare --out`` or ``cpp-rl study`` wrote, by name.

    ``seeds`` is seeds.csv: one number of one seed a row, by arm, sequence, treatment, seed, stage, level and measure.

    Raises FileNotFoundError if there are none.
    """
    tables = Path(folder) / "tables"
    found = {path.stem: _read_csv(path) for path in sorted(tables.glob("*.csv"))}
    if not found:
        raise FileNotFoundError(f"there is no table in {tables}; pass the folder that `cpp-rl compare --out` wrote")
    if (seeds := Path(folder) / "seeds.csv").exists():
        found["seeds"] = _read_csv(seeds)
    return found


def _find(folder: Path, depth: int) -> Iterator[Path]:
    """The directories with a manifest, ``folder`` itself or below; links are not followed."""
    if (folder / "manifest.json").exists():
        yield folder
    elif depth > 0 and folder.is_dir():
        for entry in os.scandir(folder):
            if entry.is_dir(follow_symlinks=False):
                yield from _find(Path(entry.path), depth - 1)


def _manifest(path: Path) -> dict[str, Any]:
    file = path / "manifest.json"
    try:
        manifest: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if lacking := [key for key in ("arm", "curriculum", "seed", "status", "config") if key not in manifest]:
            raise ValueError(f"it lacks {', '.join(lacking)}")
    except ValueError as error:
        raise ValueError(f"{file}: not the manifest of a run ({error})") from error
    return manifest


def _treatment(manifest: dict[str, Any]) -> str:
    """As in seeds.csv; runs of older versions say nothing of forks."""
    fork = manifest.get("fork")
    return f"after-{fork['after']}:{fork['name']}" if fork else ""


def _logged(path: Path, keys: dict[str, Any]) -> Any:
    """The rows of a log, behind the run's keys."""
    text = path.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]  # a run that is training may be in the middle of its last line
    try:
        rows = _read_csv(io.StringIO(whole))
    except ValueError as error:
        raise ValueError(f"{path}: not a table ({error})") from error
    for place, (key, value) in enumerate(keys.items()):
        rows.insert(place, key, value)
    return rows


def _read_csv(file: Path | io.StringIO) -> Any:
    """A table, its floats to the last bit. Levels stay text, although the built-in ones have numbers for names."""
    pandas = _pandas()
    # From 3.1 on pandas reads floats exactly and does not want to be asked for it.
    exact = tuple(int(part) for part in pandas.__version__.split(".")[:2]) >= (3, 1)
    options = {} if exact else {"float_precision": "round_trip"}
    rows = pandas.read_csv(file, dtype={"level": str, "treatment": str}, **options)
    # A run that is no fork has an empty treatment, not one that is missing.
    return rows.fillna({"treatment": ""}) if "treatment" in rows else rows


def _pandas() -> Any:
    try:
        return importlib.import_module("pandas")
    except ImportError as error:
        raise MissingPackageError("pandas") from error
