"""PyTorch's ``.pth`` files, written and read with NumPy alone.

Such a file is a zip. ``data.pkl`` in it is a pickle of dictionaries, lists and numbers. A tensor stands there as a call
that names a storage, and ``data/<key>`` holds the bytes of that storage. Reading calls nothing that a file names: only
the few names below are known, and they build NumPy arrays. What is written, ``torch.load(weights_only=True)`` reads.
See torch/serialization.py and torch/_weights_only_unpickler.py in PyTorch's sources.
"""

from __future__ import annotations

import io
import pickle
import struct
import zipfile
from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import numpy as np

_STORAGES = {
    "FloatStorage": np.dtype("<f4"),
    "DoubleStorage": np.dtype("<f8"),
    "LongStorage": np.dtype("<i8"),
    "IntStorage": np.dtype("<i4"),
    "BoolStorage": np.dtype("?"),
}


@dataclass(frozen=True)
class Name:
    """Something of another package that a pickle names, e.g. ``Name("torch.optim.adamw", "AdamW")``."""

    module: str
    name: str


def dumps(value: Any) -> bytes:
    """A pickle (protocol 2) of dictionaries, lists, tuples, numbers, strings and :class:`Name`\\ s."""
    return b"\x80\x02" + _pickled(value, []) + b"."


def save(value: Any) -> bytes:
    """A ``.pth`` file of dictionaries, lists, numbers and float32 arrays of any shape."""
    storages: list[np.ndarray] = []
    document = b"\x80\x02" + _pickled(value, storages) + b"."
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("archive/data.pkl", document)
        archive.writestr("archive/byteorder", "little")
        for key, storage in enumerate(storages):
            archive.writestr(f"archive/data/{key}", storage.tobytes())
        archive.writestr("archive/version", "3\n")
    return buffer.getvalue()


def load(raw: bytes) -> Any:
    """What a ``.pth`` file holds, its tensors as arrays.

    Raises an error of zipfile's or pickle's, ValueError or KeyError for a file that is damaged or holds anything else.
    """
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        [root] = [name.removesuffix("data.pkl") for name in archive.namelist() if name.endswith("/data.pkl")]
        if f"{root}byteorder" in archive.namelist() and archive.read(f"{root}byteorder") != b"little":
            raise ValueError("its numbers are big-endian")
        return _Reader(archive, root).load()


class _Reader(pickle.Unpickler):
    """Knows the names that a file of tensors needs, and refuses all others."""

    def __init__(self, archive: zipfile.ZipFile, root: str) -> None:
        super().__init__(io.BytesIO(archive.read(f"{root}data.pkl")))
        self._archive, self._root = archive, root

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        if module == "torch" and name in _STORAGES:
            return _STORAGES[name]
        raise pickle.UnpicklingError(f"{module}.{name} is not a part of weights")

    def persistent_load(self, pid: Any) -> np.ndarray:
        kind, dtype, key, _device, _count = pid
        if kind != "storage":
            raise pickle.UnpicklingError(f"{kind!r} is not a storage")
        return np.frombuffer(self._archive.read(f"{self._root}data/{key}"), dtype)


def _tensor(storage: np.ndarray, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], *_: Any) -> np.ndarray:
    """A tensor's array, copied; strides count elements."""
    if min((offset, *shape, *strides)) < 0 or len(shape) != len(strides):
        raise ValueError(f"a tensor has offset {offset}, shape {shape} and strides {strides}")
    last = offset + sum((n - 1) * stride for n, stride in zip(shape, strides, strict=True))
    if 0 not in shape and last >= len(storage):
        raise ValueError(f"a tensor of shape {shape} is larger than its storage of {len(storage)}")
    by_bytes = [stride * storage.itemsize for stride in strides]
    return np.lib.stride_tricks.as_strided(storage[offset:], shape, by_bytes).copy()


def _pickled(value: Any, storages: list[np.ndarray]) -> bytes:
    """The opcodes that put ``value`` on the stack; arrays go to ``storages``."""

    def many(values: Any) -> bytes:
        return b"(" + b"".join(_pickled(item, storages) for item in values)

    if value is None or isinstance(value, bool):
        return {None: b"N", True: b"\x88", False: b"\x89"}[value]
    if isinstance(value, int):
        return b"J" + struct.pack("<i", value)
    if isinstance(value, float):
        return b"G" + struct.pack(">d", value)
    if isinstance(value, str):
        text = value.encode()
        return b"X" + struct.pack("<I", len(text)) + text
    if isinstance(value, Name):
        return f"c{value.module}\n{value.name}\n".encode()
    if isinstance(value, tuple):
        return many(value) + b"t"
    if isinstance(value, list):
        return b"]" + many(value) + b"e"
    if isinstance(value, dict):
        return b"}" + many(part for item in value.items() for part in item) + b"u"
    if isinstance(value, np.ndarray) and value.dtype == np.float32:
        storages.append(np.ascontiguousarray(value, "<f4"))
        strides = tuple(int(np.prod(value.shape[axis + 1 :])) for axis in range(value.ndim))
        storage = _pickled(("storage", Name("torch", "FloatStorage"), str(len(storages) - 1), "cpu", value.size), [])
        hooks = _pickled(Name("collections", "OrderedDict"), []) + b")R"
        rebuild = _pickled(Name("torch._utils", "_rebuild_tensor_v2"), [])
        rest = b"".join(_pickled(part, []) for part in (0, value.shape, strides, False))
        return rebuild + b"(" + storage + b"Q" + rest + hooks + b"tR"
    raise TypeError(f"{type(value).__name__} cannot be written")
