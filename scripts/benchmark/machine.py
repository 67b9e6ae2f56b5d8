"""What a measurement ran on, and how a program is run: pinned, with its wall time and peak memory."""

from __future__ import annotations

import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
# One thread for every library that would start its own; XLA's runs on the thread that calls it.
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "PYTHONDONTWRITEBYTECODE": "1",
}
SIMD = ("avx2", "fma", "avx512f", "avx512bw", "avx512dq", "avx512vl", "asimd", "sve")


def say(text: str) -> None:
    """One line of progress."""
    print(f"bench: {text}", file=sys.stderr, flush=True)


def available_cores() -> list[int]:
    """The cores that this process may use."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


@dataclass(frozen=True)
class Process:
    """A program that has ended well."""

    output: str
    wall: float
    """Seconds from its start to its end."""
    peak_mb: float
    """The most memory it held, in MB of 10⁶ bytes."""


def run(command: Sequence[str | Path], cores: Sequence[int]) -> Process:
    """Runs a program on these cores alone; ends this script with the program's own words if it fails."""

    def pin() -> None:
        if hasattr(os, "sched_setaffinity"):  # not on macOS, which knows no pinning
            os.sched_setaffinity(0, cores)

    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        begun = time.perf_counter()
        child = subprocess.Popen(
            list(map(str, command)), stdout=out, stderr=err, cwd=ROOT, env=os.environ | ONE_THREAD, preexec_fn=pin
        )
        _, status, usage = os.wait4(child.pid, 0)
        wall = time.perf_counter() - begun
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            err.seek(0)
            sys.exit(f"bench: {' '.join(map(str, command))} failed ({child.returncode}):\n{err.read().strip()}")
        out.seek(0)
        unit = 1 if sys.platform == "darwin" else 1024
        return Process(out.read(), wall, usage.ru_maxrss * unit / 1e6)


def first_line(*command: str) -> str:
    """The first line that a program prints, or nothing where there is no such program."""
    try:
        result = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    except OSError:
        return ""
    return (result.stdout.splitlines() or [""])[0].strip()


def describe() -> dict[str, Any]:
    """Processor, caches, memory and versions; and how busy the machine is, which decides what numbers are worth."""
    cpuinfo = read("/proc/cpuinfo")
    model = re.search(r"^model name\s*:\s*(.*)$", cpuinfo, re.MULTILINE)
    flags = re.search(r"^(?:flags|Features)\s*:\s*(.*)$", cpuinfo, re.MULTILINE)
    flags = set(flags[1].split()) if flags else set()
    memory = re.search(r"MemTotal:\s*(\d+) kB", read("/proc/meminfo"))
    caches = {}
    for index in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, kind, size = (read(index / name).strip() for name in ("level", "type", "size"))
        if kind != "Instruction":
            caches[f"L{level}"] = size
    return {
        "processor": model[1] if model else platform.processor() or platform.machine(),
        "cores": len(available_cores()),
        "simd": [flag for flag in SIMD if flag in flags],
        "caches": caches,
        "memory_gb": round(int(memory[1]) / 1e6, 1) if memory else None,
        "system": f"{platform.system()} {platform.release()}",
        "rustc": first_line("rustc", "--version"),
        "commit": first_line("git", "describe", "--always", "--dirty", "--abbrev=12"),
        "load": round(os.getloadavg()[0], 2),
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
    }


def processor_time() -> tuple[int, int] | None:
    """Ticks that all cores have wanted to work, and of these the ticks that the host gave to others; Linux only."""
    fields = read("/proc/stat").split("\n", 1)[0].split()[1:9]
    if len(fields) < 8:
        return None
    user, nice, system, _idle, _iowait, irq, softirq, steal = map(int, fields)
    return user + nice + system + irq + softirq + steal, steal


def read(path: str | Path) -> str:
    """A file's text, or nothing where there is none."""
    try:
        return Path(path).read_text()
    except OSError:
        return ""
