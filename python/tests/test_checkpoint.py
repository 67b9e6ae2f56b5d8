"""checkpoint.py: what is written is read, and anything else is refused with a remedy."""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from conftest import SB3_FIXTURES, assert_equal, random_checkpoint
from cpp_rl_gym.checkpoint import Checkpoint, CheckpointError, from_bytes, read, to_bytes, write

pytest.importorskip("safetensors", reason="checkpoints are safetensors files")


def header(raw: bytes) -> dict:
    return json.loads(raw[8 : 8 + struct.unpack("<Q", raw[:8])[0]])


def with_header(raw: bytes, change: dict) -> bytes:
    """The file with other metadata fields and a right checksum."""
    end = 8 + struct.unpack("<Q", raw[:8])[0]
    top = header(raw)
    document = json.loads(top["__metadata__"]["cpp-rl"]) | change | {"crc32": "00000000"}
    top["__metadata__"]["cpp-rl"] = json.dumps(document)
    text = json.dumps(top, separators=(",", ":")).replace(r"\"crc32\": \"", r"\"crc32\":\"").encode()
    text += b" " * (-len(text) % 8)
    blank = struct.pack("<Q", len(text)) + text + raw[end:]
    return blank.replace(b"00000000", b"%08x" % zlib.crc32(blank), 1)


@pytest.mark.parametrize("algorithm", ["ppo", "dqn"])
@pytest.mark.parametrize("optimizer", [True, False])
def test_what_is_written_is_read(folder: Path, algorithm: str, optimizer: bool) -> None:
    checkpoint = random_checkpoint(algorithm, optimizer=optimizer)
    write(checkpoint, folder / "c.safetensors")
    assert_equal(read(folder / "c.safetensors"), checkpoint)
    assert to_bytes(read(folder / "c.safetensors")) == (folder / "c.safetensors").read_bytes()


def test_the_file_follows_the_format() -> None:
    raw = to_bytes(random_checkpoint("dqn"))
    text = header(raw)["__metadata__"]["cpp-rl"]
    digits = json.loads(text)["crc32"]
    assert text.startswith(f'{{"crc32":"{digits}","format":1,"kind":"stage","algorithm":"dqn","activation":"relu",')
    order = ["towers", "height", "width", "adam_step", "num_timesteps", "seed", "stage", "level", "source", "counters"]
    assert list(json.loads(text))[5:] == order
    blank = raw.replace(digits.encode(), b"00000000", 1)
    assert f"{zlib.crc32(blank):08x}" == digits
    shapes = {name: entry["shape"] for name, entry in header(raw).items() if name != "__metadata__"}
    assert shapes["q.0.weight"] == shapes["target/q.0.weight"] == shapes["exp_avg_sq/q.0.weight"] == [24, 5]
    assert {entry["dtype"] for name, entry in header(raw).items() if name != "__metadata__"} == {"F32"}


def test_every_damaged_byte_is_noticed() -> None:
    raw = to_bytes(random_checkpoint(optimizer=False))
    for at in range(len(raw)):
        damaged = raw[:at] + bytes([raw[at] ^ 1]) + raw[at + 1 :]
        with pytest.raises(CheckpointError, match=r"^c: "):
            from_bytes(damaged, "c")
    for length in range(0, len(raw), 97):
        with pytest.raises(CheckpointError, match=r"^c: "):
            from_bytes(raw[:length], "c")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "checkpoint format 2; this version reads format 1"),
        ({"kind": "latest"}, "stage-<k>.safetensors"),
        ({"novelty": 1}, "missing or unknown keys: novelty"),
        ({"algorithm": "sac"}, "algorithm 'sac' is not one of ppo, dqn"),
        ({"activation": "gelu"}, "activation 'gelu'"),
        ({"extra": {"resets": 0.5}}, "counter resets is 0.5, not a whole number"),
        ({"height": 3}, "takes 24 inputs, not 4 x 3 x 3"),
        ({"towers": {"policy": [24, 5, 4], "value": [24, 1]}}, "value"),
        ({"towers": {"policy": 4}}, "not a readable checkpoint"),
        ({"adam_step": 0}, "optimiser state but adam_step 0"),
        ({"counters": {"episodes": 1}}, "counter 'episodes' is not one of updates, target_calls"),
        ({"counters": {"updates": -1}}, "counter updates is -1, not a whole number"),
        ({"counters": [1]}, "not a readable checkpoint"),
    ],
)
def test_wrong_metadata_is_named(change: dict, message: str) -> None:
    raw = with_header(to_bytes(random_checkpoint()), change)
    with pytest.raises(CheckpointError, match=message):
        from_bytes(raw, "c")


@pytest.mark.parametrize("counters", [{}, {"updates": 7}, {"target_calls": 7}, {"target_calls": 1, "updates": 2}])
def test_any_of_the_counters_may_be_missing(counters: dict) -> None:
    raw = with_header(to_bytes(random_checkpoint("dqn")), {"counters": counters})
    assert from_bytes(raw, "c").counters == counters


def test_what_mitigations_keep_is_kept() -> None:
    """Counts, lists, and further copies of the parameters."""
    checkpoint = random_checkpoint()
    checkpoint.extra = {"resets/units": 7, "a/count": 2**60}
    checkpoint.tensors["extra/resets/ages"] = np.arange(5, dtype=np.float32)
    checkpoint.tensors |= {f"l2_init/first/{name}": np.ones(shape, np.float32) for name, shape in checkpoint.parameters()}
    raw = to_bytes(checkpoint)
    assert_equal(from_bytes(raw, "c"), checkpoint)
    assert to_bytes(from_bytes(raw, "c")) == raw
    assert from_bytes(raw, "c").copies() == ["l2_init/first"]
    # The policy of the copy has nothing but ones: its first layer's sums are all 1 + 1 on one input that is 1.
    observation = np.eye(1, 24)
    expected = 1 + 5 * np.tanh(2)
    np.testing.assert_allclose(checkpoint.forward("l2_init/first/policy", observation), [[expected] * 4], rtol=1e-6)
    del checkpoint.tensors["l2_init/first/value.1.bias"]
    with pytest.raises(ValueError, match=r"lacks the tensors l2_init/first/value\.1\.bias"):
        to_bytes(checkpoint)


def test_what_an_algorithm_leaves_to_the_next_stage_is_kept() -> None:
    checkpoint = random_checkpoint("dqn")
    checkpoint.tensors |= {
        "buffer/replay/inputs": np.arange(12, dtype=np.uint64).reshape(3, 2, 2),
        "buffer/replay/rewards": np.full(3, -1, np.float32),
        "buffer/replay/actions": np.array([0, 3, 1], np.uint8),
        "buffer/cells": np.zeros((0, 2), np.uint16),
    }
    raw = to_bytes(checkpoint)
    assert_equal(from_bytes(raw, "c"), checkpoint)
    assert to_bytes(from_bytes(raw, "c")) == raw
    assert checkpoint.copies() == ["target"]
    checkpoint.tensors["buffer/cells"] = np.zeros(2, np.int32)
    with pytest.raises(ValueError, match=r"buffer/cells is int32, not one of float32, uint8"):
        to_bytes(checkpoint)


@pytest.mark.parametrize("activation", ["crelu", "fourier"])
def test_normalised_layers_of_units_with_two_values_by_hand(activation: Any) -> None:
    """One layer of two units; their sums are 1 and 3, so that they lie one standard deviation from their mean."""
    tensors: dict[str, np.ndarray] = {
        "q.0.weight": np.zeros((8, 2)),
        "q.0.bias": np.array([1, 3]),
        "q.0.scale": np.array([2, 3]),
        "q.0.shift": np.array([0, 1]),
        # The positive parts of both units, then the negative ones; or their sines, then their cosines.
        "q.1.weight": np.eye(4),
        "q.1.bias": np.zeros(4),
    }
    tensors |= {f"target/{name}": tensor for name, tensor in tensors.items()}
    tensors = {name: tensor.astype(np.float32) for name, tensor in tensors.items()}
    network: dict[str, Any] = {"towers": {"q": (8, 2, 4)}, "height": 1, "width": 2, "tensors": tensors}
    checkpoint = Checkpoint(algorithm="dqn", activation=activation, layer_norm=True, **network)
    one = 1 / np.sqrt(1 + 1e-5)
    first, second = -2 * one, 3 * one + 1
    expected = {
        "crelu": [0, second, -first, 0],
        "fourier": [np.sin(first), np.sin(second), np.cos(first), np.cos(second)],
    }
    np.testing.assert_allclose(checkpoint.forward("q", np.ones((1, 8))), [expected[activation]], rtol=1e-6)
    raw = to_bytes(checkpoint)
    assert_equal(from_bytes(raw, "c"), checkpoint)
    for change, message in (
        ({"layer_norm": False}, r"unknown tensors q\.0\.scale"),
        ({"layer_norm": 1}, "layer_norm is 1, not true or false"),
        ({"activation": "relu"}, r"q\.1\.weight is float32 \[4, 4\], not float32 \[2, 4\]"),
    ):
        with pytest.raises(CheckpointError, match=message):
            from_bytes(with_header(raw, change), "c")


def test_inputs_are_those_of_the_sensor() -> None:
    """Of all but the default, this reader does not know how many there are."""
    raw = to_bytes(random_checkpoint())
    assert b"sensor" not in raw and b"layer_norm" not in raw and b"extra" not in raw
    elsewhere = with_header(raw, {"sensor": "local", "height": 9})
    assert from_bytes(elsewhere, "c").sensor == "local"


@pytest.mark.parametrize("name", ["policy.9.weight", "target/policy.0.bias", "exp_avg/policy.9.bias", "policy.0.scale"])
def test_unknown_tensors_of_the_networks_are_named(name: str) -> None:
    checkpoint = random_checkpoint()
    checkpoint.tensors[name] = np.zeros(1, np.float32)
    with pytest.raises(ValueError, match=f"unknown tensors {name}"):
        to_bytes(checkpoint)


def test_other_files_are_refused(folder: Path) -> None:
    from safetensors.numpy import save

    with pytest.raises(CheckpointError, match=r"absent\.safetensors: cannot be read"):
        read(folder / "absent.safetensors")
    for foreign in (b"", b"text, certainly longer than eight bytes", save({"a": np.zeros(3)})):
        with pytest.raises(CheckpointError, match="not a cpp-rl checkpoint"):
            from_bytes(foreign, "c")


def test_contradictions_are_not_written() -> None:
    checkpoint = random_checkpoint()
    short = {name: tensor for name, tensor in checkpoint.tensors.items() if name != "exp_avg/value.1.bias"}
    wrong = checkpoint.tensors | {"policy.0.bias": np.zeros(5)}
    for tensors, message in ((short, "lacks the tensors exp_avg/value.1.bias"), (wrong, "policy.0.bias is float64")):
        with pytest.raises(ValueError, match=message):
            to_bytes(replace(checkpoint, tensors=tensors))


def test_an_existing_file_stays_unless_forced(folder: Path) -> None:
    path = folder / "c.safetensors"
    write(random_checkpoint("ppo"), path)
    with pytest.raises(CheckpointError, match="exists already; pass --force"):
        write(random_checkpoint("dqn"), path)
    assert read(path).algorithm == "ppo"
    write(random_checkpoint("dqn"), path, force=True)
    assert read(path).algorithm == "dqn"
    with pytest.raises(CheckpointError, match="cannot be written"):
        write(random_checkpoint(), folder / "no-such-folder" / "c.safetensors")


@pytest.mark.parametrize("name", ["ppo_level0", "dqn_level0"])
def test_the_fixtures_are_checkpoints(name: str) -> None:
    checkpoint = read(SB3_FIXTURES / f"{name}.safetensors")
    assert (checkpoint.height, checkpoint.width, checkpoint.level) == (8, 8, "0")
    assert to_bytes(checkpoint) == (SB3_FIXTURES / f"{name}.safetensors").read_bytes()
