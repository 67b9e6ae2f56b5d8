"""checkpoint.py: what is written is read, and anything else is refused with a remedy."""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from conftest import SB3_FIXTURES, assert_equal, random_checkpoint
from cpp_rl_gym.checkpoint import CheckpointError, from_bytes, read, to_bytes, write

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


def test_what_later_versions_may_add_is_kept() -> None:
    """Optional fields of the header, and tensors under prefixes of their own."""
    checkpoint = random_checkpoint()
    checkpoint.extra = {"mitigation": {"name": "l2-init", "dose": 0.5}}
    checkpoint.tensors["initial/policy.0.bias"] = np.arange(5, dtype=np.float32)
    raw = to_bytes(checkpoint)
    assert_equal(from_bytes(raw, "c"), checkpoint)
    assert to_bytes(from_bytes(raw, "c")) == raw
    assert checkpoint.forward("policy", np.zeros((1, 4, 2, 3))).shape == (1, 4)


def test_normalised_layers_are_kept_but_not_computed() -> None:
    checkpoint = random_checkpoint()
    checkpoint.norm = "layer"
    for name in ("policy.0.norm.weight", "exp_avg/policy.0.norm.weight"):
        checkpoint.tensors[name] = np.ones(5, np.float32)
    assert_equal(from_bytes(to_bytes(checkpoint), "c"), checkpoint)
    with pytest.raises(ValueError, match="are normalised"):
        checkpoint.forward("policy", np.zeros((1, 4, 2, 3)))


@pytest.mark.parametrize("name", ["policy.9.weight", "target/policy.0.bias", "exp_avg/policy.9.bias"])
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
