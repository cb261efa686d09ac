"""The numbers that an object of any class holds, found and set by where they stand.

What a law or an estimator remembers is in floats and arrays somewhere below it. Frozen dataclasses
(models, plans, settings) remember nothing and are shared, not copied.
"""

from collections import deque
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import is_dataclass
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, TypeAlias

import numpy as np

Place: TypeAlias = tuple[Any, ...]  # attribute names, keys and indices from the root on
Number: TypeAlias = "float | np.typing.NDArray[np.float64]"

_OPAQUE = (str, bytes, type, ModuleType, FunctionType, BuiltinFunctionType, MethodType,
           np.random.Generator)  # fmt: skip


def numbers(root: Any) -> dict[Place, Number]:
    """Return every float and every array of floats below an object, by place."""
    found: dict[Place, Number] = {}
    seen: set[int] = set()

    def walk(value: Any, place: Place) -> None:
        if isinstance(value, float | np.floating):
            found[place] = float(value)
        elif isinstance(value, np.ndarray):
            if value.dtype == np.float64 and value.size:
                found[place] = value
        elif not isinstance(value, tuple) and id(value) in seen:
            return
        else:
            seen.add(id(value))
            for key, part in _parts(value):
                walk(part, (*place, key))

    walk(root, ())
    return found


def assign(root: Any, place: Place, value: Number) -> Any:
    """Return the object with another number at a place; tuples on the way are replaced."""
    if not place:
        return value
    key, rest = place[0], place[1:]
    part = dict(_parts(root))[key]
    other = assign(part, rest, value)
    if other is part:
        return root
    if isinstance(root, tuple):
        parts = [other if k == key else old for k, old in enumerate(root)]
        return type(root)(*parts) if hasattr(root, "_fields") else tuple(parts)
    if isinstance(root, dict | list | deque):
        root[key] = other
    else:
        setattr(root, key, other)
    return root


def copied(root: Any, constant: dict[Place, Number] | None = None) -> Any:
    """Return a copy that shares what remembers nothing.

    Args:
        root: to copy.
        constant: arrays by place that are shared, too.
    """
    memo: dict[int, Any] = {id(part): part for part in _frozen(root, set())}
    memo |= {
        id(array): array for array in (constant or {}).values() if not isinstance(array, float)
    }
    return deepcopy(root, memo)


def _is_frozen(value: Any) -> bool:
    return is_dataclass(value) and bool(getattr(value, "__dataclass_params__").frozen)  # noqa: B009


def _parts(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield what stands directly below an object, with its key."""
    if isinstance(value, dict):
        yield from value.items()
    elif isinstance(value, list | tuple | deque):
        yield from enumerate(value)
    elif isinstance(value, _OPAQUE) or _is_frozen(value):
        return
    else:
        yield from vars(value).items() if hasattr(value, "__dict__") else ()
        for kind in type(value).__mro__:
            slots = kind.__dict__.get("__slots__", ())
            for name in (slots,) if isinstance(slots, str) else slots:
                if hasattr(value, name):
                    yield name, getattr(value, name)


def _frozen(value: Any, seen: set[int]) -> Iterator[Any]:
    """Yield the frozen dataclasses below an object."""
    if id(value) in seen or isinstance(value, float | np.ndarray):
        return
    seen.add(id(value))
    if _is_frozen(value):
        yield value
        return
    for _, part in _parts(value):
        yield from _frozen(part, seen)
