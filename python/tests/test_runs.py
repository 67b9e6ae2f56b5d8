"""load_runs and load_report, on runs and a report that the binary made in this test run."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import cpp_rl_gym
from oracle import REPOSITORY
from support import cpp_rl

pandas = pytest.importorskip("pandas", reason="the frames are pandas's")

LOGS = ("progress", "plasticity", "evaluations", "learning")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A curriculum of PPO and a run of DQN, two seeds each."""
    folder = tmp_path_factory.mktemp("runs")
    common = ["--timesteps", "2048", "--seeds", "0,4", "--quiet", "--jobs", "1", "--out", folder / "runs"]
    cpp_rl("curriculum", "--algo", "ppo", "--levels", "0,1", "--evaluate-every", "2048", *common)
    cpp_rl("train", "--algo", "dqn", "--level", "3", "--set", "gamma=0.9", "--plasticity-interval", "0", *common)
    cpp_rl("compare", folder / "runs", "--quiet", "--out", folder / "report")
    return folder


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_frames_hold_what_the_files_hold(folder: Path) -> None:
    runs = cpp_rl_gym.load_runs(folder)
    found = {str(path.parent.relative_to(folder)): path.parent for path in folder.glob("**/manifest.json")}
    assert len(found) == 4
    for name in LOGS:
        frame = getattr(runs, name)
        assert list(frame.columns[:5]) == ["run", "arm", "curriculum", "treatment", "seed"]
        assert {"stage", "level"} <= set(frame.columns)
        total = 0
        for run, path in found.items():
            theirs = rows(path / f"{name}.csv") if (path / f"{name}.csv").exists() else []
            ours = frame[frame.run == run].to_dict("records")
            assert len(ours) == len(theirs)
            for row, text in zip(ours, theirs, strict=True):
                for column, value in text.items():
                    same = str(row[column]) == value or str(row[column]).lower() == value.lower()
                    assert same or float(row[column]) == float(value), (name, column, row[column], value)
            total += len(theirs)
        assert total == len(frame) > 0


def test_rows_say_whose_they_are(folder: Path) -> None:
    progress = cpp_rl_gym.load_runs(folder / "runs").progress
    assert set(progress.groupby(["arm", "curriculum", "seed", "stage", "level"]).size().index) == {
        *(("ppo", "curriculum", seed, stage, str(stage)) for seed in (0, 4) for stage in (0, 1)),
        *(("dqn", "level-3", seed, 0, "3") for seed in (0, 4)),
    }
    # A column of another algorithm is NaN.
    assert progress[progress.arm == "ppo"]["rollout/exploration_rate"].isna().all()


def test_settings_have_a_row_for_each_run(folder: Path) -> None:
    settings = cpp_rl_gym.load_runs(folder).settings.set_index(["arm", "seed"])
    assert settings.loc[("dqn", 4), "gamma"] == 0.9
    assert settings.loc[("ppo", 0), "gamma"] == 0.99
    assert settings.loc[("ppo", 0), "hidden"] == [64, 64]
    assert set(settings.state) == {"finished"}


def test_the_mean_of_the_evaluations_is_that_of_the_binary(folder: Path) -> None:
    evaluations = cpp_rl_gym.load_runs(folder).evaluations
    assert set(evaluations.policy) == {"greedy", "sampled"}
    evaluations = evaluations[evaluations.policy == "greedy"]
    for run, found in evaluations[evaluations.phase == "after"].groupby("run"):
        last = found[found.stage == found.stage.max()].groupby("level")["return"].mean()
        printed = json.loads(cpp_rl("eval", folder / run, "--format", "json"))["levels"]
        assert last.to_dict() == {level["level"]: level["mean"] for level in printed}


def test_evaluations_that_name_no_policy_are_greedy(folder: Path, tmp_path: Path) -> None:
    [path] = [path.parent for path in folder.glob("**/ppo/**/seed-4/manifest.json")]
    (tmp_path / "manifest.json").write_text((path / "manifest.json").read_text())
    lines = (path / "evaluations.csv").read_text().splitlines()
    old = [line.rpartition(",")[0] for line in lines if not line.endswith(",sampled")]
    (tmp_path / "evaluations.csv").write_text("".join(f"{line}\n" for line in old))
    evaluations = cpp_rl_gym.load_runs(tmp_path).evaluations
    assert len(evaluations) == len(old) - 1 and set(evaluations.policy) == {"greedy"}


def test_one_run_may_be_given(folder: Path) -> None:
    [path] = [path.parent for path in folder.glob("**/ppo/**/seed-4/manifest.json")]
    runs = cpp_rl_gym.load_runs(path)
    assert set(runs.progress.run) == {"."} and set(runs.settings.seed) == {4}


def test_a_line_that_is_being_written_is_left_out(folder: Path, tmp_path: Path) -> None:
    [path] = [path.parent for path in folder.glob("**/ppo/**/seed-4/manifest.json")]
    for name in ("manifest.json", "progress.csv"):
        (tmp_path / name).write_text((path / name).read_text())
    with (tmp_path / "progress.csv").open("a") as file:
        file.write("1,1,20")
    runs = cpp_rl_gym.load_runs(tmp_path)
    assert len(runs.progress) == len(rows(path / "progress.csv"))
    assert list(runs.plasticity.columns) == ["run", "arm", "curriculum", "treatment", "seed"] and runs.plasticity.empty


def test_a_report_is_its_tables(folder: Path) -> None:
    report = cpp_rl_gym.load_report(folder / "report")
    assert {path.stem for path in (folder / "report" / "tables").glob("*.csv")} | {"seeds"} == set(report)
    text = rows(folder / "report" / "tables" / "returns.csv")
    assert [(row.arm, row.level, row["mean"]) for _, row in report["returns"].iterrows()] == [
        (row["arm"], row["level"], float(row["mean"])) for row in text
    ]


def test_a_report_has_the_numbers_of_single_seeds(folder: Path) -> None:
    seeds = cpp_rl_gym.load_report(folder / "report")["seeds"]
    columns = ["arm", "sequence", "treatment", "seed", "stage", "level", "measure", "value"]
    assert list(seeds.columns) == columns
    assert set(seeds.treatment) == {""}, "none of these runs is a fork"
    assert seeds.value.tolist() == [float(row["value"]) for row in rows(folder / "report" / "seeds.csv")]


def test_forks_name_their_treatment(folder: Path, tmp_path: Path) -> None:
    [path] = [path.parent for path in folder.glob("**/ppo/**/seed-4/manifest.json")]
    manifest = json.loads((path / "manifest.json").read_text())
    for name, fork in (("parent", None), ("fork", {"parent": "parent", "after": 0, "name": "head", "treatment": {}})):
        (tmp_path / name).mkdir()
        (tmp_path / name / "manifest.json").write_text(json.dumps({**manifest, "fork": fork}))
        (tmp_path / name / "progress.csv").write_text((path / "progress.csv").read_text())
    runs = cpp_rl_gym.load_runs(tmp_path)
    assert set(runs.progress.groupby("run").treatment.first().items()) == {("parent", ""), ("fork", "after-0:head")}


def test_the_readmes_example_runs(folder: Path) -> None:
    text = (REPOSITORY / "python" / "README.md").read_text()
    [code] = [block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "load_runs" in block]
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "curriculum" in done.stdout


def test_what_is_no_run_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="there is no run in or below"):
        cpp_rl_gym.load_runs(tmp_path)
    with pytest.raises(FileNotFoundError, match="there is no table in"):
        cpp_rl_gym.load_report(folder / "runs")
    for text, message in (("{", "not the manifest of a run"), ("{}", "it lacks arm, curriculum, seed, status, config")):
        (tmp_path / "manifest.json").write_text(text)
        with pytest.raises(ValueError, match=message):
            cpp_rl_gym.load_runs(tmp_path)


def test_no_extension_is_needed_and_pandas_is_named(folder: Path) -> None:
    """In the sources, where there is no extension."""

    def run(hidden: str) -> subprocess.CompletedProcess[str]:
        hide = f"import sys; sys.modules[{hidden!r}] = None"
        code = f"{hide}\nimport cpp_rl_gym; print(len(cpp_rl_gym.load_runs('runs').progress))"
        environment = os.environ | {"PYTHONPATH": str(REPOSITORY / "python" / "src")}
        return subprocess.run([sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True)

    assert int(run("cpp_rl_gym._native").stdout) == 6
    assert "this needs the package pandas; install it with: pip install pandas" in run("pandas").stderr
