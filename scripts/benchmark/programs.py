"""cpp-rl, the JAX programs and Stable-Baselines3: how they are set up, and how fast one run of each was."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .machine import ROOT, Process, run, say

PEERS = ROOT / "scripts" / "peers"
PACKAGES = {
    "jax": ["jax==0.10.2", "optax==0.2.8"],
    "sb3": ["stable-baselines3==2.9.2", "torch==2.11.0"],
}
MODULES = {"jax": "jax, optax", "sb3": "stable_baselines3, torch"}
ROLLOUT = 2048
"""Timesteps of PPO's rollout, and between two rows of DQN's log: what all lengths are rounded to."""
WIDTH = 64
"""Of the paper's hidden layers."""


@dataclass(frozen=True)
class Timed:
    """One run: timesteps made within `seconds` of training, as the program's own clock has it."""

    timesteps: int
    seconds: float
    process: Process

    @property
    def rate(self) -> float:
        """Timesteps per second."""
        return self.timesteps / self.seconds


@dataclass
class CppRl:
    """The binary as users build it."""

    binary: Path
    scratch: Path
    """Runs are written below it and deleted again: on a disk, as those of users."""

    @staticmethod
    def build(scratch: Path, libtorch: bool) -> CppRl:
        """Builds what is missing, and the engine libtorch too where it is wanted."""
        say("building cpp-rl")
        env = os.environ | {"CPP_RL_LIBTORCH": str(int(libtorch))}
        subprocess.run([ROOT / "scripts" / "cpp-rl", "--version"], check=True, stdout=sys.stderr, env=env)
        target = Path(os.environ.get("CARGO_TARGET_DIR", "target"))
        return CppRl(ROOT / target / "release" / "cpp-rl", scratch)

    def command(self, *arguments: str, cores: Sequence[int]) -> Process:
        """Any command of the tool."""
        return run([self.binary, *arguments], cores)

    def train(
        self,
        algo: str,
        timesteps: int,
        cores: Sequence[int],
        *,
        level: str = "0",
        seeds: int = 1,
        jobs: int = 1,
        settings: Sequence[str] = (),
    ) -> Timed:
        """Trains; the clock is that of seed 0's progress.csv, from its first row to its last.

        So start-up, the evaluations before and after, the checkpoint and the first `ROLLOUT` timesteps are left out,
        and logging is in.
        """
        sets = [part for setting in settings for part in ("--set", setting)]
        arguments = ["--algo", algo, "--level", level, "--timesteps", str(timesteps), "--seeds", f"0..{seeds}", *sets]
        with tempfile.TemporaryDirectory(dir=self.scratch) as out:
            options = ["--jobs", str(jobs), "--out", out, "--quiet"]
            process = self.command("train", *arguments, *options, cores=cores)
            (log,) = Path(out).glob("*/*/seed-0/progress.csv")
            with log.open(newline="") as file:
                rows = list(csv.DictReader(file))
        made = [int(row["time/total_timesteps"]) for row in rows]
        elapsed = [float(row["time/time_elapsed"]) for row in rows]
        if len(rows) == 1:
            return Timed(made[0], elapsed[0], process)
        return Timed(made[-1] - made[0], elapsed[-1] - elapsed[0], process)

    def mitigations(self, algo: str) -> list[str]:
        """The names of all mitigations that this preset can have."""
        listed = json.loads(self.command("config", "mitigations", "--format", "json", cores=[0]).output)
        names = [mitigation["name"] for mitigation in listed]
        show = [self.binary, "config", "show", "--algo", algo, "--set"]
        fits = [subprocess.run([*show, f"mitigations=[{name}]"], capture_output=True).returncode == 0 for name in names]
        return [name for name, fit in zip(names, fits, strict=True) if fit]

    def version(self) -> str:
        """As the binary says it."""
        return self.command("--version", cores=[0]).output.strip()


@dataclass
class Peer:
    """A Python program with a virtual environment of its own."""

    name: str
    python: Path

    @staticmethod
    def prepare(name: str, folder: Path | None) -> Peer:
        """The peer in `folder`, or in `.venv-bench-NAME`, made if it is missing or broken."""
        venv = folder or ROOT / f".venv-bench-{name}"
        python = venv / "bin" / "python"
        probe = [str(python), "-c", f"import {MODULES[name]}"]
        if not python.exists() or subprocess.run(probe, capture_output=True).returncode:
            if folder:
                sys.exit(f"bench: {folder} lacks what {name} needs: {MODULES[name]}")
            say(f"making {venv.name}")
            make_venv(venv)
            install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *PACKAGES[name]]
            subprocess.run(install, check=True)
        return Peer(name, python)

    def train(self, algo: str, timesteps: int, cores: Sequence[int], width: int = WIDTH) -> Timed:
        """One seed; the clock is the program's own, which leaves out imports, compilation and warming up. JAX alone can
        have hidden layers of another `width`.
        """
        assert width == WIDTH or self.name == "jax"
        if self.name == "jax":
            units = str(timesteps // ROLLOUT if algo == "ppo" else timesteps)
            script = [f"jax_{algo}.py", "1"] if width == WIDTH else ["jax_wide.py", algo, str(width)]
            command = [self.python, PEERS / script[0], *script[1:], units]
        else:
            command = [self.python, PEERS / "sb3.py", algo, str(timesteps)]
        process = run(command, cores)
        rate = re.search(rf"{self.name} {algo}: ([\d.]+) timesteps/s", process.output)
        if not rate:
            sys.exit(f"bench: no rate in what {self.name} printed: {process.output}")
        return Timed(timesteps, timesteps / float(rate[1]), process)

    def versions(self) -> dict[str, str]:
        """Of the packages that matter."""
        names = ("jax", "jaxlib", "optax", "stable-baselines3", "torch", "numpy")
        code = f"""
import importlib.metadata as m, json, platform
def version(name):
    try: return m.version(name)
    except m.PackageNotFoundError: return None
found = {{name: version(name) for name in {names!r}}}
print(json.dumps({{"python": platform.python_version()}} | {{k: v for k, v in found.items() if v}}))
"""
        return json.loads(subprocess.run([self.python, "-c", code], capture_output=True, text=True, check=True).stdout)


def whole(timesteps: float, least: int = 2) -> int:
    """So many timesteps in whole rollouts, at least `least` of them."""
    return ROLLOUT * max(least, round(timesteps / ROLLOUT))


def make_venv(venv: Path) -> None:
    """An empty virtual environment with pip."""
    make = [sys.executable, "-m", "venv", "--clear"]
    if subprocess.run([*make, venv], capture_output=True).returncode:
        # Debian has venv without ensurepip unless python3-venv is installed; the pip outside can then bring one.
        subprocess.run([*make, "--without-pip", venv], check=True)
        pip = [sys.executable, "-m", "pip", "--python", venv / "bin" / "python", "install", "--quiet", "pip"]
        subprocess.run(pip, check=True, env={**os.environ, "PIP_REQUIRE_VIRTUALENV": "0"})
