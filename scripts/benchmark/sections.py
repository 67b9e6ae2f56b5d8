"""The measurements. Each section returns rows of plain numbers, from which tables.py makes its tables."""

# ruff: noqa: RUF002 (multiplication signs are meant)
from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .machine import ONE_THREAD, ROOT, run, say
from .profile import profile
from .programs import ROLLOUT, CppRl, Peer, Timed, whole

Rows = list[dict[str, Any]]
ALGORITHMS = ("ppo", "dqn")
SEEDS = (1, 4, 16, 64)
WIDTHS = (64, 128, 256, 512)
SIDES = (8, 12, 16, 24, 32)
ENVIRONMENTS = (1, 4, 16, 64)
BENCHES = (("coverage-env", "environment"), ("bit-mlp", "steps"), ("torch-engine", "learners"))


@dataclass
class Bench:
    """What every section needs."""

    cpp_rl: CppRl
    cores: list[int]
    repetitions: int
    seconds: float
    """That one timed run should last."""
    venvs: dict[str, Path | None]
    quick: bool

    @property
    def core(self) -> list[int]:
        """The one core of whatever runs on one."""
        return self.cores[:1]

    def values(self, values: Sequence[int]) -> Sequence[int]:
        """The values of an axis, or its ends where only the script is tried out."""
        return (values[0], values[-1]) if self.quick and len(values) > 2 else values

    def length(self, rate: float, seeds: int = 1) -> int:
        """Timesteps per seed that last about as long as is wanted."""
        return whole(rate * self.seconds / seeds)


def compare(b: Bench) -> Rows:
    """cpp-rl, JAX and Stable-Baselines3 in turn, on one core."""
    peers = [Peer.prepare(name, b.venvs[name]) for name in ("jax", "sb3")]
    programs: dict[str, Callable[[str, int], Timed]] = {"cpp-rl": lambda algo, n: b.cpp_rl.train(algo, n, b.core)}
    programs |= {peer.name: lambda algo, n, peer=peer: peer.train(algo, n, b.core) for peer in peers}
    rows: Rows = [{"versions": {"cpp-rl": b.cpp_rl.version()} | {peer.name: peer.versions() for peer in peers}}]
    for algo in ALGORITHMS:
        # A first short run warms up the disk's cache, and tells how long the others have to be.
        lengths = {name: b.length(train(algo, 2 * ROLLOUT).rate) for name, train in programs.items()}
        say(f"{algo}: " + ", ".join(f"{name} {n:,} timesteps" for name, n in lengths.items()))
        for repetition in range(b.repetitions):
            for name, train in programs.items():
                timed = train(algo, lengths[name])
                say(f"{algo}, repetition {repetition}: {name} {timed.rate:,.0f} timesteps/s")
                rows.append({"algo": algo, "repetition": repetition, "program": name, **numbers(timed)})
    return rows


def numbers(timed: Timed) -> dict[str, Any]:
    """A timed run as a row has it."""
    return {
        "timesteps": timed.timesteps,
        "seconds": timed.seconds,
        "rate": timed.rate,
        "wall": timed.process.wall,
        "peak_mb": timed.process.peak_mb,
        "said": (timed.process.output.strip().splitlines() or [""])[-1],
    }


def many_seeds(b: Bench, algo: str, n: int, seeds: int, jobs: int, settings: Sequence[str] = ()) -> dict[str, Any]:
    """Timesteps per second of all seeds together: whole processes, the difference between two lengths."""
    cores = b.cores if jobs > 1 else b.core
    short, long = (
        b.cpp_rl.train(algo, timesteps, cores, seeds=seeds, jobs=jobs, settings=settings).process
        for timesteps in (ROLLOUT, n)
    )
    rate = seeds * (n - ROLLOUT) / (long.wall - short.wall)
    say(f"{algo}, {seeds} seeds, {jobs} jobs {' '.join(settings)}: {rate:,.0f} timesteps/s")
    return {
        "algo": algo, "seeds": seeds, "jobs": jobs, "settings": " ".join(settings), "timesteps": n, "rate": rate,
        "wall": long.wall, "wall_short": short.wall, "peak_mb": long.peak_mb,
    }  # fmt: skip


def cores(b: Bench) -> Rows:
    """16 seeds on all cores and on one, in turn, and what the cores can do together at best."""
    if len(b.cores) == 1:
        sys.exit("bench: the section cores needs more than one core")
    rows = []
    for algo in ALGORITHMS:
        n = b.length(b.cpp_rl.train(algo, 3 * ROLLOUT, b.core).rate, 16)
        for repetition in range(b.repetitions):
            one, all_cores = (many_seeds(b, algo, n, 16, jobs) for jobs in (1, len(b.cores)))
            apart = processes_apart(b, algo, n, 16 // len(b.cores))
            measured = {"one core": one, f"{len(b.cores)} cores": all_cores, "one process per core": apart}
            rows += [{"repetition": repetition, "how": how, **row} for how, row in measured.items()]
    return rows


def processes_apart(b: Bench, algo: str, n: int, seeds: int) -> dict[str, Any]:
    """As `many_seeds`, but with a process for each core, which share nothing: what keeps them from running as fast as
    one alone is the machine.
    """

    def walls(timesteps: int) -> list[float]:
        def train(core: int) -> float:
            return b.cpp_rl.train(algo, timesteps, [core], seeds=seeds).process.wall

        with ThreadPoolExecutor(len(b.cores)) as pool:
            return list(pool.map(train, b.cores))

    seconds = [long - short for short, long in zip(walls(ROLLOUT), walls(n), strict=True)]
    rate = sum(seeds * (n - ROLLOUT) / s for s in seconds)
    say(f"{algo}, {len(b.cores)} processes of {seeds} seeds: {rate:,.0f} timesteps/s")
    return {"algo": algo, "seeds": seeds * len(b.cores), "timesteps": n, "rate": rate}


def seeds(b: Bench) -> Rows:
    """1 to 64 seeds: the engine fused on one core and on all, libtorch with all seeds together on one."""
    rows = []
    for algo in ALGORITHMS:
        for engine in ("fused", "libtorch"):
            settings = [f"engine={engine}"]
            rate = b.cpp_rl.train(algo, 3 * ROLLOUT, b.core, settings=settings).rate
            for count in b.values(SEEDS):
                n = b.length(rate, count)
                for repetition in range(b.repetitions):
                    for jobs in sorted({1, len(b.cores)}) if engine == "fused" else (1,):
                        rows.append({"repetition": repetition, **many_seeds(b, algo, n, count, jobs, settings)})
    return rows


def along(b: Bench, axis: str, values: Sequence[int], options: Callable[[str, int], dict[str, Any]]) -> Rows:
    """One seed on one core, for every value of an axis."""
    rows = []
    for algo in ALGORITHMS:
        for value in b.values(values):
            chosen = options(algo, value)
            n = whole(b.cpp_rl.train(algo, 2 * ROLLOUT, b.core, **chosen).rate * b.seconds / 2)
            for repetition in range(b.repetitions):
                timed = b.cpp_rl.train(algo, n, b.core, **chosen)
                say(f"{algo}, {axis} {value}: {timed.rate:,.0f} timesteps/s")
                rows.append({"algo": algo, axis: value, "repetition": repetition, **numbers(timed)})
    return rows


def width(b: Bench) -> Rows:
    """Two hidden layers of 64 to 512, cpp-rl and JAX in turn."""
    jax = Peer.prepare("jax", b.venvs["jax"])

    def ours(algo: str, wide: int, n: int) -> Timed:
        return b.cpp_rl.train(algo, n, b.core, settings=[f"hidden=[{wide}, {wide}]"])

    def theirs(algo: str, wide: int, n: int) -> Timed:
        return jax.train(algo, n, b.core, wide)

    programs = {"cpp-rl": ours, "jax": theirs}
    rows = []
    for algo in ALGORITHMS:
        for wide in b.values(WIDTHS):
            # Wide networks take seconds per rollout: two of them have to do.
            lengths = {
                name: whole(train(algo, wide, 2 * ROLLOUT).rate * b.seconds / 2) for name, train in programs.items()
            }
            for repetition in range(b.repetitions):
                for name, train in programs.items():
                    timed = train(algo, wide, lengths[name])
                    say(f"{algo}, width {wide}: {name} {timed.rate:,.0f} timesteps/s")
                    row = {"algo": algo, "width": wide, "repetition": repetition, "program": name}
                    rows.append({**row, **numbers(timed)})
    return rows


def maps(b: Bench) -> Rows:
    """Maps of 8×8 to 32×32 cells, with eight targets each."""
    with tempfile.TemporaryDirectory() as folder:

        def level(_: str, side: int) -> dict[str, Any]:
            file = Path(folder) / f"{side}.yaml"
            if not file.exists():
                size = ["--height", str(side), "--width", str(side), "--targets", "8", "--wall-density", "0.15"]
                b.cpp_rl.command("levels", "generate", *size, "--out", str(file), cores=b.core)
            return {"level": str(file)}

        return along(b, "side", SIDES, level)


def environments(b: Bench) -> Rows:
    """1 to 64 environments per seed; PPO's rollout stays 2,048 timesteps long."""

    def options(algo: str, count: int) -> dict[str, Any]:
        steps = [f"n_steps={ROLLOUT // count}"] if algo == "ppo" else []
        return {"settings": [f"num_envs={count}", *steps]}

    return along(b, "environments", ENVIRONMENTS, options)


def mitigations(b: Bench) -> Rows:
    """Every mitigation at its default dose, each in turn with the plain algorithm."""
    rows = []
    for algo in ALGORITHMS:
        n = whole(b.cpp_rl.train(algo, 2 * ROLLOUT, b.core).rate * b.seconds / 4)
        for name in b.cpp_rl.mitigations(algo):
            settings = [f"mitigations=[{name}]"]
            for repetition in range(b.repetitions):
                base, timed = (b.cpp_rl.train(algo, n, b.core, settings=sets) for sets in ([], settings))
                row = {"algo": algo, "mitigation": name, "repetition": repetition, "base": base.rate}
                rows.append({**row, **numbers(timed)})
            say(f"{algo}, {name}: {timed.rate:,.0f} timesteps/s, plain {base.rate:,.0f}")
    return rows


def curriculum(b: Bench) -> Rows:
    """PPO-L2 through the five levels, one seed, as a user starts it."""
    rows = []
    short = ["--timesteps", str(ROLLOUT)] if b.quick else []
    for repetition in range(min(b.repetitions, 3)):
        with tempfile.TemporaryDirectory(dir=b.cpp_rl.scratch) as out:
            command = ["curriculum", "--algo", "ppo-l2", "--seeds", "0", *short, "--out", out, "--quiet"]
            process = b.cpp_rl.command(*command, cores=b.cores)
        say(f"curriculum: {process.wall:.1f} s")
        rows.append({"repetition": repetition, "wall": process.wall, "peak_mb": process.peak_mb})
    return rows


def startup(b: Bench) -> Rows:
    """Doing nothing, and the least that a training can do."""
    rows = []
    commands = {"cpp-rl --version": ["--version"], "cpp-rl train, one rollout": ["train", "--algo", "ppo"]}
    for name, command in commands.items():
        for repetition in range(2 * b.repetitions):
            with tempfile.TemporaryDirectory(dir=b.cpp_rl.scratch) as out:
                least = ["--level", "0", "--timesteps", "1", "--quiet", "--out", out] if "train" in command else []
                process = b.cpp_rl.command(*command, *least, cores=b.core)
            rows.append({"what": name, "repetition": repetition, "wall": process.wall, "peak_mb": process.peak_mb})
    return rows


def memory(b: Bench) -> Rows:
    """1 and 16 seeds in training at once, long enough to fill DQN's replay buffer."""
    rows = []
    for algo, n in (("ppo", 2 * ROLLOUT), ("dqn", whole(2 * ROLLOUT if b.quick else 100_000 + ROLLOUT))):
        for count in (1, 16):
            process = b.cpp_rl.train(algo, n, b.cores, seeds=count, jobs=count).process
            rows.append({"algo": algo, "seeds": count, "timesteps": n, "peak_mb": process.peak_mb})
    return rows


def micro(b: Bench) -> Rows:
    """The criterion benches of the workspace, on one core."""
    rows = []
    with tempfile.TemporaryDirectory() as home:
        for package, name in BENCHES:
            bench = ["bench", "-p", package, "--bench", name]
            # Apart from the run, which has one core; and package by package, since others bring other features.
            cargo(*bench, "--no-run")
            say(f"cargo bench -p {package}")
            # Criterion's shortest run is that of its smallest sample.
            options = ["--sample-size", "10", "--measurement-time", "0.1", "--warm-up-time", "0.1"] if b.quick else []
            environment = ["env", f"CRITERION_HOME={home}"]
            run([*environment, "cargo", *bench, "--", *options], b.core)
            for file in sorted(Path(home).glob("**/new/estimates.json")):
                benchmark = json.loads(file.with_name("benchmark.json").read_text())
                median = json.loads(file.read_text())["median"]
                elements = (benchmark["throughput"] or {}).get("Elements", 1)
                bounds = median["confidence_interval"]
                rows.append({
                    "package": package, "bench": benchmark["full_id"], "elements": elements,
                    "ns": median["point_estimate"], "low": bounds["lower_bound"], "high": bounds["upper_bound"],
                })  # fmt: skip
            shutil.rmtree(home)
            Path(home).mkdir()
    return rows


def limits(b: Bench) -> Rows:
    """What one core can do, and how far the fused engine is from it."""
    bench = ["bench", "-p", "bit-mlp", "--bench", "limits"]
    cargo(*bench, "--no-run")
    lines = run(["cargo", *bench], b.core).output.splitlines()
    fields = [line.split("\t") for line in lines if line.count("\t") == 2]
    return [{"quantity": quantity, "value": value, "unit": unit} for quantity, value, unit in fields]


def profiles(b: Bench) -> Rows:
    """Where the time of a training goes, by perf."""
    return [row for algo in ALGORITHMS for row in profile(b.cpp_rl, algo, b.core, b.seconds)]


def cargo(*arguments: str) -> None:
    """Builds with all cores; what Cargo says goes to stderr."""
    if subprocess.run(["cargo", *arguments], cwd=ROOT, stdout=sys.stderr, env=os.environ | ONE_THREAD).returncode:
        sys.exit(f"bench: cargo {' '.join(arguments)} failed")


SECTIONS: dict[str, tuple[Callable[[Bench], Rows], str]] = {
    "compare": (compare, "8 minutes"),
    "cores": (cores, "3 minutes"),
    "seeds": (seeds, "20 minutes"),
    "width": (width, "25 minutes"),
    "maps": (maps, "5 minutes"),
    "environments": (environments, "4 minutes"),
    "mitigations": (mitigations, "15 minutes"),
    "curriculum": (curriculum, "3 minutes"),
    "startup": (startup, "10 seconds"),
    "memory": (memory, "20 seconds"),
    "micro": (micro, "6 minutes"),
    "limits": (limits, "10 seconds"),
    "profile": (profiles, "30 seconds"),
}
"""What each measures, and how long that takes with the default settings on two cores."""

WITH_LIBTORCH = {"seeds", "micro"}
"""The sections that also measure the engine libtorch."""
