"""Checks of arguments, with messages that help."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from typing import Any


def natural(name: str, value: Any, *, low: int = 0, high: int = 2**32 - 1) -> int:
    """An integer from ``low`` to ``high``."""
    try:
        number = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be an integer, not {value!r}") from None
    if not low <= number <= high:
        raise ValueError(f"{name} must be from {low} to {high}, not {number}")
    return number


def pair(name: str, value: Any, form: str) -> tuple[Any, Any]:
    """Two things."""
    try:
        first, second = value
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a pair {form}, not {value!r}") from None
    return first, second


def position(name: str, value: Any) -> tuple[int, int]:
    """A cell, ``(row, column)``; whether it is on the map is seen later."""
    row, column = pair(name, value, "(row, column)")
    limits = {"low": -(2**31), "high": 2**31}
    return natural(f"the row of {name}", row, **limits), natural(f"the column of {name}", column, **limits)


def one_of(name: str, value: Any, choices: Sequence[Any]) -> Any:
    """One of some choices."""
    if value not in choices:
        raise ValueError(f"{name} must be {' or '.join(repr(choice) for choice in choices)}, not {value!r}")
    return value


def known_keys(name: str, mapping: Iterable[str], known: Sequence[str]) -> None:
    """Nothing but these keys: a misspelt one would be ignored."""
    if unknown := sorted(set(mapping) - set(known)):
        raise ValueError(f"{name} has no {unknown[0]!r}; there is {' and '.join(repr(key) for key in known)}")
