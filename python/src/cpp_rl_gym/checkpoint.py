"""cpp-rl's checkpoints: one safetensors file that holds weights, optimiser state and where they come from.

Tensors are C-contiguous, and float32 unless something else is said. Layer ``i`` of a tower is ``{tower}.{i}.weight``,
shape ``[in, out]`` (torch's ``nn.Linear`` keeps ``[out, in]``), and ``{tower}.{i}.bias``, shape ``[out]``. A
normalised layer has ``scale`` and ``shift`` too, shape ``[out]``. PPO has the towers ``policy`` and ``value``; DQN
has ``q``. Adam's moments carry the same names behind ``exp_avg/`` and ``exp_avg_sq/``, all of them or none. Copies of
the parameters carry them behind a name of their own, such as DQN's target network, ``target/q``. ``extra/{name}`` is
a list that a mitigation keeps. ``buffer/{name}`` is an array that an algorithm leaves to the next stage, of any
shape, and of float32, uint8, uint16 or uint64: DQN's replay buffer, where ``replay_saved`` or ``replay_kept`` is set.

``__metadata__`` has one key, ``cpp-rl``: a compact JSON object with the fields of :class:`Checkpoint`. Its first field
is ``crc32``: the checksum of the whole file while those eight digits are ``00000000``. docs/checkpoints.md has the
format in full.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

FORMAT = 1
TOWERS: dict[str, tuple[str, ...]] = {"ppo": ("policy", "value"), "dqn": ("q",)}
Activation = Literal["tanh", "relu", "crelu", "fourier"]
ACTIVATIONS: dict[Activation, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "relu": lambda x: np.maximum(x, 0),
    "crelu": lambda x: np.maximum(np.concatenate((x, -x), axis=1), 0),  # Abbas et al. 2023
    "fourier": lambda x: np.concatenate((np.sin(x), np.cos(x)), axis=1),  # Lewandowski et al. 2024
}
PAIRS: tuple[Activation, ...] = ("crelu", "fourier")  # those of which a unit gives two numbers
COUNTERS = ("updates", "target_calls")
OPTIONAL = ("layer_norm", "sensor", "extra")  # fields of the header that are left out at their defaults
CHANNELS = 4  # of the sensor ``full``
EPSILON = 1e-5  # what normalised layers add to the variance
MOMENTS = ("exp_avg", "exp_avg_sq")
LIST = "extra/"  # what the names of lists begin with
BUFFER = "buffer/"  # what the names of arrays begin with that an algorithm leaves to the next stage
BUFFER_TYPES = ("float32", "uint8", "uint16", "uint64")

_CRC_MARK = rb"\"crc32\":\""
_ZEROS = b"00000000"


class CheckpointError(Exception):
    """A file is not a checkpoint that can be used; the message names the file, the fault and the remedy."""


@dataclass
class Checkpoint:
    """Weights and optimiser state of one agent.

    ``tensors`` maps the names of the module's documentation to arrays. ``towers`` maps each tower to its layer
    sizes, e.g. ``{"q": (256, 64, 64, 4)}``: the inputs, then the units of each layer. ``sensor`` is what the agent sees
    with, and says how many inputs there are: ``4 * height * width`` of ``full``. ``layer_norm`` says whether hidden
    layers are normalised (Ba et al. 2016). A unit of the activation ``crelu`` or ``fourier`` gives two numbers, so that
    the next layer takes twice as many.

    ``adam_step`` is 0 when there is no optimiser state. ``counters`` may have ``updates`` (epochs of PPO, gradient steps
    of DQN) and ``target_calls`` (environment steps that time the copies into DQN's target network); a missing one is 0.
    ``extra`` has the counts that mitigations keep, by name.
    """

    algorithm: Literal["ppo", "dqn"]
    activation: Activation
    towers: dict[str, tuple[int, ...]]
    height: int
    width: int
    tensors: dict[str, np.ndarray]
    adam_step: int = 0
    num_timesteps: int = 0
    seed: int | None = None
    stage: int | None = None
    level: str | None = None
    source: str = ""
    counters: dict[str, int] = field(default_factory=dict)
    layer_norm: bool = False
    sensor: str = "full"
    extra: dict[str, int] = field(default_factory=dict)

    def parameters(self) -> Iterator[tuple[str, tuple[int, ...]]]:
        """Name and shape of every trained tensor, tower by tower and layer by layer."""
        for tower, sizes in self.towers.items():
            for i, (inputs, outputs) in enumerate(pairwise(sizes)):
                doubled = self.activation in PAIRS and i > 0
                yield f"{tower}.{i}.weight", (2 * inputs if doubled else inputs, outputs)
                yield f"{tower}.{i}.bias", (outputs,)
                if self.layer_norm and i < len(sizes) - 2:
                    yield f"{tower}.{i}.scale", (outputs,)
                    yield f"{tower}.{i}.shift", (outputs,)

    def copies(self) -> list[str]:
        """The names of all copies of the parameters, such as DQN's ``target``."""
        first = f"/{next(iter(self.towers))}.0.weight"
        prefixes = (name.removesuffix(first) for name in self.tensors if name.endswith(first))
        return [name for name in prefixes if name not in MOMENTS and not f"{name}/".startswith((LIST, BUFFER))]

    def forward(self, tower: str, observations: np.ndarray) -> np.ndarray:
        """Outputs ``[B, out]`` of a tower, or of a copy such as ``target/q``, on observations ``[B, ...]``.

        The observations are those of :attr:`sensor`, flat or as grids.
        """
        x = np.asarray(observations, np.float32).reshape(len(observations), -1)
        last = len(self.towers[tower.rpartition("/")[2]]) - 2
        for i in range(last + 1):
            x = x @ self.tensors[f"{tower}.{i}.weight"] + self.tensors[f"{tower}.{i}.bias"]
            if i < last:
                if self.layer_norm:
                    centred = x - x.mean(axis=1, keepdims=True)
                    x = centred / np.sqrt((centred**2).mean(axis=1, keepdims=True) + np.float32(EPSILON))
                    x = x * self.tensors[f"{tower}.{i}.scale"] + self.tensors[f"{tower}.{i}.shift"]
                x = ACTIVATIONS[self.activation](x)
        return x

    def fault(self) -> str | None:
        """What contradicts the format, or None."""
        if self.algorithm not in TOWERS:
            return f"algorithm {self.algorithm!r} is not one of {', '.join(TOWERS)}"
        if self.activation not in ACTIVATIONS:
            return f"activation {self.activation!r} is not one of {', '.join(ACTIVATIONS)}"
        if not isinstance(self.layer_norm, bool):
            return f"layer_norm is {self.layer_norm!r}, not true or false"
        if tuple(self.towers) != TOWERS[self.algorithm]:
            return f"{self.algorithm} has the towers {TOWERS[self.algorithm]}, not {tuple(self.towers)}"
        for tower, sizes in self.towers.items():
            if len(sizes) < 2 or any(not isinstance(n, int) or n < 1 for n in sizes):
                return f"tower {tower} has the sizes {list(sizes)}"
            # What other sensors have on these maps, the compiled part knows.
            if self.sensor == "full" and sizes[0] != CHANNELS * self.height * self.width:
                return f"tower {tower} takes {sizes[0]} inputs, not 4 x {self.height} x {self.width}"
        if odd := sorted(self.counters.keys() - set(COUNTERS)):
            return f"counter {odd[0]!r} is not one of {', '.join(COUNTERS)}"
        for name, count in (self.counters | self.extra).items():
            if isinstance(count, bool) or not isinstance(count, int) or count < 0:
                return f"counter {name} is {count!r}, not a whole number from 0"
        return self._tensor_fault()

    def _tensor_fault(self) -> str | None:
        copies = {*self.copies()} | ({"target"} if self.algorithm == "dqn" else set())
        if any(name.startswith(tuple(f"{moment}/" for moment in MOMENTS)) for name in self.tensors):
            if self.adam_step < 1:
                return "it has optimiser state but adam_step 0"
            copies.update(MOMENTS)
        elif self.adam_step != 0:
            return f"adam_step is {self.adam_step} but there is no optimiser state"
        own = dict(self.parameters())
        expected = own | {f"{copy}/{name}": shape for copy in copies for name, shape in own.items()}
        if missing := sorted(expected.keys() - self.tensors.keys()):
            return f"it lacks the tensors {', '.join(missing)}"
        buffers = {name: tensor for name, tensor in self.tensors.items() if name.startswith(BUFFER)}
        for name, tensor in buffers.items():
            if tensor.dtype.name not in BUFFER_TYPES:
                return f"{name} is {tensor.dtype}, not one of {', '.join(BUFFER_TYPES)}"
        lists = {name: (tensor.size,) for name, tensor in self.tensors.items() if name.startswith(LIST)}
        expected |= lists
        if unknown := sorted(self.tensors.keys() - expected.keys() - buffers.keys()):
            return f"it has unknown tensors {', '.join(unknown)}"
        for name, shape in expected.items():
            tensor = self.tensors[name]
            if tensor.dtype != np.float32 or tensor.shape != shape:
                return f"{name} is {tensor.dtype} {list(tensor.shape)}, not float32 {list(shape)}"
        return None


def to_bytes(checkpoint: Checkpoint) -> bytes:
    """The file of a checkpoint; raises ValueError if its fields contradict each other."""
    if fault := checkpoint.fault():
        raise ValueError(f"not a valid checkpoint: {fault}")
    c = checkpoint
    document = {
        "crc32": _ZEROS.decode(),
        "format": FORMAT,
        "kind": "stage",
        "algorithm": c.algorithm,
        "activation": c.activation,
        "layer_norm": c.layer_norm,
        "sensor": c.sensor,
        "towers": {tower: list(sizes) for tower, sizes in c.towers.items()},
        "height": c.height,
        "width": c.width,
        "adam_step": c.adam_step,
        "num_timesteps": c.num_timesteps,
        "seed": c.seed,
        "stage": c.stage,
        "level": c.level,
        "source": c.source,
        "counters": c.counters,
        "extra": dict(sorted(c.extra.items())),
    }
    for name, default in zip(OPTIONAL, (False, "full", {}), strict=True):
        if document[name] == default:
            del document[name]
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False)
    tensors = {name: np.ascontiguousarray(tensor) for name, tensor in c.tensors.items()}
    raw: bytes = _safetensors().save(tensors, metadata={"cpp-rl": text})
    at = _digits_at(raw)
    if at is None:  # cannot happen while the JSON above starts with crc32
        raise ValueError("the checksum's place cannot be found")
    return raw[:at] + b"%08x" % zlib.crc32(raw) + raw[at + 8 :]


def from_bytes(raw: bytes, name: str | Path) -> Checkpoint:
    """Reads a file's bytes; ``name`` is how errors call it."""

    def fail(what: str) -> CheckpointError:
        return CheckpointError(f"{name}: {what}")

    document = _document(raw, fail)
    at = _digits_at(raw)
    if at is None:
        raise fail("the header has no checksum where one belongs; the file is damaged, copy or write it again")
    crc, wanted = zlib.crc32(raw[:at] + _ZEROS + raw[at + 8 :]), raw[at : at + 8].decode("ascii", "replace")
    if f"{crc:08x}" != wanted:
        raise fail(f"checksum is {crc:08x} where the file says {wanted}; it is damaged, copy or write it again")
    if document.get("kind") != "stage":
        raise fail(f"a checkpoint of kind {document.get('kind')!r}; pass a run's checkpoints/stage-<k>.safetensors")
    names, found = {entry.name for entry in fields(Checkpoint)} - {"tensors"}, set(document)
    if odd := (found - names - {"crc32", "format", "kind"}) | (names - set(OPTIONAL) - found):
        keys = ", ".join(sorted(odd))
        raise fail(f"its metadata has missing or unknown keys: {keys}; write it again with a matching cpp-rl")
    values = {name: document[name] for name in names & found}
    try:
        values["towers"] = {tower: tuple(sizes) for tower, sizes in values["towers"].items()}
        checkpoint = Checkpoint(tensors=_safetensors().load(raw), **values)
        fault = checkpoint.fault()
    except Exception as error:  # the library's own errors have no common base
        raise fail(f"not a readable checkpoint ({error})") from error
    if fault:
        raise fail(fault)
    return checkpoint


def read(path: str | Path) -> Checkpoint:
    """Reads and verifies a checkpoint: format, checksum, names and shapes of every tensor."""
    try:
        raw = Path(path).read_bytes()
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read ({error.strerror})") from error
    return from_bytes(raw, path)


def write(checkpoint: Checkpoint, path: str | Path, *, force: bool = False) -> None:
    """Writes a checkpoint; the file appears whole or not at all."""
    write_aside(path, to_bytes(checkpoint), force=force)


def write_aside(path: str | Path, raw: bytes, *, force: bool) -> None:
    """Writes to a neighbour of ``path``, syncs it and renames it; refuses an existing ``path`` unless ``force``."""
    path = Path(path)
    refuse_existing(path, force=force)
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with aside.open("wb") as file:
            file.write(raw)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        aside.unlink(missing_ok=True)


def refuse_existing(path: str | Path, *, force: bool) -> None:
    """Raises if ``path`` would be overwritten without ``force``."""
    if Path(path).exists() and not force:
        raise CheckpointError(f"{path}: exists already; pass --force to replace it, or choose another name")


def _document(raw: bytes, fail: Any) -> dict[str, Any]:
    """The metadata's JSON object, its format verified."""
    foreign = "not a cpp-rl checkpoint"
    if len(raw) < 8 or (size := struct.unpack("<Q", raw[:8])[0]) > len(raw) - 8:
        raise fail(f"{foreign}: not a safetensors file, or cut short")
    try:
        header = json.loads(raw[8 : 8 + size])
        document: dict[str, Any] = json.loads(header["__metadata__"]["cpp-rl"])
        version = document["format"]
    except (ValueError, KeyError, TypeError) as error:
        raise fail(f"{foreign}: its safetensors header has no readable `cpp-rl` metadata") from error
    if version != FORMAT:
        raise fail(f"checkpoint format {version}; this version reads format {FORMAT}, install a matching cpp-rl-gym")
    return document


def _digits_at(raw: bytes) -> int | None:
    """Where the checksum's eight digits start, if the header names them exactly once."""
    end = 8 + struct.unpack("<Q", raw[:8])[0]
    header = raw[:end]
    return header.index(_CRC_MARK) + len(_CRC_MARK) if header.count(_CRC_MARK) == 1 else None


def _safetensors() -> Any:
    try:
        import safetensors.numpy
    except ImportError as error:
        raise MissingPackageError("safetensors") from error
    return safetensors.numpy


class MissingPackageError(Exception):
    """An optional package is not installed."""

    def __init__(self, package: str) -> None:
        super().__init__(f"this needs the package {package}; install it with: pip install {package}")
