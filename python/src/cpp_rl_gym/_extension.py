"""The compiled extension, or an error that says how to get it."""

from __future__ import annotations

try:
    from cpp_rl_gym import _native
except ImportError as error:
    raise ImportError(
        "the compiled part of cpp_rl_gym is missing, so only its modules checkpoint, runs and sb3 can be used; "
        "with Rust on the machine, build and install the package: pip install ./python"
    ) from error

__all__ = ["_native"]
