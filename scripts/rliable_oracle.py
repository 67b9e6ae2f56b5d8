"""Numbers out of rliable on fixed scores, with the indices of every resample that its intervals come from.

rliable draws the indices; `recorded` only writes them down, so that another implementation can take the same ones.
Scores and indices are written by task and then run, as rl-stats has them, which is the transpose of rliable's matrices.
"""

from __future__ import annotations

import importlib.metadata
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from rliable import library, metrics

FIXTURE = Path(__file__).resolve().parents[1] / "crates/rl-stats/tests/fixtures/rliable.json"
RESAMPLES = 200
AGGREGATES: dict[str, Callable[[np.ndarray], float]] = {
    "mean": metrics.aggregate_mean,
    "median": metrics.aggregate_median,
    "interquartile_mean": metrics.aggregate_iqm,
    "optimality_gap": metrics.aggregate_optimality_gap,
}


@contextmanager
def recorded(bootstrap: type) -> Iterator[list[Any]]:
    """The indices that a bootstrap class of rliable draws, resample by resample."""
    drawn: list[Any] = []
    original = bootstrap.update_indices

    def update_indices(self: Any) -> Any:
        drawn.append(original(self))
        return drawn[-1]

    with mock.patch.object(bootstrap, "update_indices", update_indices):
        yield drawn
    assert len(drawn) == RESAMPLES, len(drawn)


def by_task(matrix: np.ndarray) -> list[list[Any]]:
    """`[runs, tasks]` as lists of runs by task."""
    return matrix.T.tolist()


def case(name: str, scores: np.ndarray) -> dict[str, Any]:
    """Every aggregate of one matrix `[runs, tasks]`, with its interval."""
    with recorded(library.StratifiedBootstrap) as drawn:
        values, intervals = library.get_interval_estimates(
            {"x": scores}, lambda x: np.array([aggregate(x) for aggregate in AGGREGATES.values()]), reps=RESAMPLES
        )
    return {
        "name": name,
        "scores": by_task(scores),
        "indices": [by_task(indices[0]) for indices in drawn],
        "expected": {
            aggregate: {"value": values["x"][i], "interval": intervals["x"][:, i].tolist()}
            for i, aggregate in enumerate(AGGREGATES)
        },
    }


def comparison(name: str, x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """The probability that x improves on y, with its interval."""
    with recorded(library.StratifiedIndependentBootstrap) as drawn:
        values, intervals = library.get_interval_estimates(
            {"x,y": [x, y]}, lambda x, y: np.array([metrics.probability_of_improvement(x, y)]), reps=RESAMPLES
        )
    return {
        "name": name,
        "x": by_task(x),
        "y": by_task(y),
        # The tasks of x and then those of y.
        "indices": [by_task(of_x[0]) + by_task(of_y[0]) for (of_x, of_y), _ in drawn],
        "expected": {"value": values["x,y"].item(), "interval": intervals["x,y"].ravel().tolist()},
    }


def main() -> None:
    """Writes the fixture."""
    np.random.seed(0)  # rliable draws from NumPy's global generator
    rng = np.random.default_rng(0)
    lottery = np.where(rng.random((7, 5)) < 0.3, rng.normal(0.1, 0.05, (7, 5)), rng.normal(0.98, 0.02, (7, 5)))
    ties = rng.integers(0, 4, (6, 3)) / 2
    fixture = {
        "rliable": importlib.metadata.version("rliable"),
        "cases": [
            case("seven runs, some of which fail", lottery),
            case("two runs of one task", np.array([[0.25], [1.5]])),
            case("ties, and scores beyond the target", ties),
            case("ten runs, negative scores", rng.normal(-1, 3, (10, 2))),
        ],
        "comparisons": [
            comparison("more runs against fewer", lottery, rng.normal(0.7, 0.3, (4, 5))),
            comparison("ties", ties, rng.integers(0, 4, (5, 3)) / 2),
            comparison("the same scores", ties, ties.copy()),
        ],
    }
    text = json.dumps(fixture, separators=(",", ":")).replace('{"name"', '\n{"name"')
    FIXTURE.parent.mkdir(parents=True, exist_ok=True)
    FIXTURE.write_text(text + "\n")


if __name__ == "__main__":
    main()
