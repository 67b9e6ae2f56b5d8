"""Where the time goes: perf samples, assigned to the lines of our sources that they fell on.

The compiler inlines the arithmetic into a few functions, so that symbols alone say little. The line tables of a release
build tell which of our functions an address came from.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .machine import ROOT, run
from .programs import ROLLOUT, CppRl, whole

# The first that fits names a sample's part. A sample in our binary is "file: functions" of the innermost file that is
# ours, any other is "library: symbol".
PARTS = (
    (r"^ld-linux", "loading the program"),
    (r"first_layer\.rs: .*(SumRows|sum_columns)", "first layer, forward: sums of rows"),
    (r"first_layer\.rs: ", "first layer, gradient of the weight"),
    (r"matmul\.rs: .*\bpack", "packing, transposing, gathering samples"),
    (r"matmul\.rs: ", "dense layers: matrix products, forward and backward; bias gradients"),
    (r"adam\.rs: ", "clipping and Adam"),
    (r"activation\.rs: ", "activations and their derivatives"),
    (r"crates/bit-mlp/", "packing, transposing, gathering samples"),
    (r"crates/coverage-env/", "environment, observations, shuffling"),
    (r"replay\.rs: ", "replay buffer"),
    (r"src/agent/", "losses, advantages, choice of actions"),
    (r"^libc\b.*mem(cpy|move|set)", "copying and clearing memory"),
    (r"^libm\b", "exp and log of the losses and of sampling"),
)


def profile(cpp_rl: CppRl, algo: str, cores: Sequence[int], seconds: float) -> list[dict[str, Any]]:
    """Shares of the samples of one training, start-up included."""
    timesteps = whole(cpp_rl.train(algo, 3 * ROLLOUT, cores).rate * seconds)
    with tempfile.TemporaryDirectory(dir=cpp_rl.scratch) as folder:
        data = Path(folder) / "perf.data"
        # The clock, since virtual machines often have no counters; user space alone needs no privileges.
        record = ["perf", "record", "--quiet", "--event", "cpu-clock:u", "--freq", "1999", "--output", data]
        train = ["train", "--algo", algo, "--level", "0", "--timesteps", str(timesteps), "--jobs", "1", "--quiet"]
        run([*record, "--", cpp_rl.binary, *train, "--out", Path(folder) / "out"], cores)
        fields = ["--fields", "ip,sym,dso", "--show-mmap-events"]
        script = ["perf", "script", "--input", str(data), *fields]
        text = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    samples = Samples(cpp_rl.binary, text)
    total = sum(samples.parts.values())
    if not total:
        sys.exit("bench: perf took no samples")
    return [
        {"algo": algo, "part": part, "share": count / total, "samples": total}
        for part, count in samples.parts.most_common()
    ]


class Samples:
    """perf's samples, counted by part."""

    def __init__(self, binary: Path, script: str) -> None:
        self.binary, self.parts = binary, Counter()
        base, shift = None, self.shift()
        ours: Counter[str] = Counter()
        for line in script.splitlines():
            if "PERF_RECORD_MMAP" in line:
                mapped = re.search(r"\[(0x[0-9a-f]+)\(0x[0-9a-f]+\) @ (0x[0-9a-f]+|0) .*r-xp (.*)$", line)
                if mapped and Path(mapped[3]) == binary:
                    base = int(mapped[1], 16) - int(mapped[2], 16)
            elif sample := re.match(r"\s*([0-9a-f]+) (.*) \((.*)\)$", line):
                address, symbol, object_ = sample.groups()
                if Path(object_) == binary and base is not None:
                    ours[hex(int(address, 16) - base + shift)] += 1
                else:
                    self.parts[part_of(f"{Path(object_).name}: {symbol}")] += 1
        for place, count in zip(self.places(list(ours)), ours.values(), strict=True):
            self.parts[part_of(place)] += count

    def shift(self) -> int:
        """Virtual addresses minus offsets in the file, of the executable segment."""
        headers = subprocess.run(["readelf", "-lW", self.binary], capture_output=True, text=True, check=True).stdout
        segment = re.search(r"LOAD\s+(0x[0-9a-f]+) (0x[0-9a-f]+) \S+ \S+ \S+ R E", headers)
        return int(segment[2], 16) - int(segment[1], 16) if segment else 0

    def places(self, addresses: list[str]) -> list[str]:
        """`file: functions` for each address: the innermost of our files, and the functions from there outwards."""
        command = ["addr2line", "--addresses", "--functions", "--inlines", "--demangle", "--exe", self.binary]
        lines = subprocess.run(command, input="\n".join(addresses), capture_output=True, text=True, check=True).stdout
        return [self.place(frames) for frames in re.split(r"^0x[0-9a-f]+\n", lines, flags=re.MULTILINE)[1:]]

    @staticmethod
    def place(frames: str) -> str:
        """The same from addr2line's pairs of lines, a function's name and its file, the innermost first."""
        names, files = frames.splitlines()[::2], frames.splitlines()[1::2]
        for depth, file in enumerate(files):
            if file.startswith(f"{ROOT}/"):
                return f"{file.removeprefix(f'{ROOT}/').split(':')[0]}: {' < '.join(names[depth:])}"
        return names[0]


def part_of(place: str) -> str:
    """The part of the program that a place or symbol belongs to."""
    return next((part for pattern, part in PARTS if re.search(pattern, place)), "everything else")
