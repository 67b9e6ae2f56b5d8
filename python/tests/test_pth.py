"""pth.py: PyTorch's files without PyTorch, and beside it where it is installed."""

from __future__ import annotations

import io
import pickle
import zipfile

import numpy as np
import pytest

from cpp_rl_gym import pth

DOCUMENT = {
    "weights": {"a.weight": np.arange(6, dtype=np.float32).reshape(2, 3), "step": np.array(7, np.float32)},
    "groups": [{"lr": 1e-4, "betas": (0.9, 0.999), "fused": None, "amsgrad": False, "params": [0, -1]}],
    "empty": {"state": {}, "list": [], "none": np.zeros((0, 4), np.float32)},
}


def assert_document(found: dict) -> None:
    for name, array in DOCUMENT["weights"].items():
        np.testing.assert_array_equal(np.asarray(found["weights"][name]), array)
        assert np.asarray(found["weights"][name]).dtype == np.float32
    assert found["groups"] == DOCUMENT["groups"]
    assert (found["empty"]["state"], found["empty"]["list"]) == ({}, [])
    assert tuple(found["empty"]["none"].shape) == (0, 4)


def with_pickle(document: bytes, storage: bytes = b"") -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("archive/data.pkl", document)
        archive.writestr("archive/data/0", storage)
    return buffer.getvalue()


def test_what_is_saved_is_loaded() -> None:
    assert_document(pth.load(pth.save(DOCUMENT)))


def test_torch_loads_what_is_saved() -> None:
    torch = pytest.importorskip("torch", reason="needs torch: run scripts/test-sb3")
    assert_document(torch.load(io.BytesIO(pth.save(DOCUMENT)), weights_only=True))


def test_what_torch_saves_is_loaded() -> None:
    torch = pytest.importorskip("torch", reason="needs torch: run scripts/test-sb3")
    square = torch.arange(12.0).reshape(3, 4)
    views = {"transposed": square.T, "column": square[:, 2], "double": square.double(), "count": torch.tensor(5)}
    buffer = io.BytesIO()
    torch.save(views, buffer)
    loaded = pth.load(buffer.getvalue())
    for name, tensor in views.items():
        np.testing.assert_array_equal(loaded[name], tensor.numpy())
        assert loaded[name].dtype == tensor.numpy().dtype


@pytest.mark.parametrize("named", [("os", "system"), ("builtins", "eval"), ("torch", "load"), ("numpy", "ndarray")])
def test_a_file_calls_nothing_of_its_choice(named: tuple[str, str]) -> None:
    with pytest.raises(pickle.UnpicklingError, match="is not a part of weights"):
        pth.load(with_pickle(pth.dumps(pth.Name(*named))))


@pytest.mark.parametrize(
    ("offset", "shape", "strides"),
    [(0, (5,), (1,)), (4, (1,), (1,)), (0, (2, 2), (3, 1)), (-1, (1,), (1,)), (0, (2,), ())],
)
def test_a_tensor_stays_within_its_storage(offset: int, shape: tuple, strides: tuple) -> None:
    with pytest.raises(ValueError, match="a tensor"):
        pth._tensor(np.zeros(4, np.float32), offset, shape, strides)


def test_other_objects_are_not_written() -> None:
    with pytest.raises(TypeError, match="set cannot be written"):
        pth.save({"a": {1, 2}})
