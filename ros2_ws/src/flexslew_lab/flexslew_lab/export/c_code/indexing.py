"""Entries and parts of arrays, read and written."""

from typing import Any

import numpy as np

from flexslew_lab.export.c_code.operations import Operations, is_array, require_concrete
from flexslew_lab.export.c_code.values import (
    Array,
    Computed,
    ConcreteRequired,
    Scalar,
    Tick,
    Unsupported,
    is_symbolic,
    row_major,
)


def item(ops: Operations, value: Any, key: Any) -> Any:
    """Return value[key]."""
    if not is_array(value):
        if isinstance(key, slice):
            require_concrete((key.start, key.stop, key.step), "part of a tuple")
            return value[key]
        return value[require_concrete(key, "entry of a tuple")]
    keys = key if isinstance(key, tuple) else (key,)
    if isinstance(value, np.ndarray) and not is_symbolic(keys):
        return value[key]
    if any(is_array(one) or isinstance(one, list) for one in keys):
        return _select_entries(ops, value, keys)
    part = _part(ops, ops.array(value), keys)
    if part.shape:
        return part
    if not part.start[1] and part.start[0] in part.known:
        return part.known[part.start[0]]
    return Scalar(part.entry(()), part.kind)


def _part(ops: Operations, array: Array, keys: tuple[Any, ...]) -> Array:
    """Return a view of an array."""
    if Ellipsis in [key for key in keys if not isinstance(key, Scalar | Tick)]:
        at = next(k for k, key in enumerate(keys) if key is Ellipsis)
        given = sum(key is not None for key in keys) - 1
        keys = (*keys[:at], *(slice(None),) * (array.ndim - given), *keys[at + 1 :])
    shape, strides, axis = list[int](), list[int](), 0
    number, terms = array.start[0], [array.start[1]] if array.start[1] else []
    for key in keys:
        if key is None:
            shape.append(1)
            strides.append(0)
            continue
        size, stride = array.shape[axis], array.strides[axis]
        axis += 1
        if isinstance(key, slice):
            require_concrete((key.start, key.stop, key.step), "part of an array")
            start, stop, step = key.indices(size)
            shape.append(len(range(start, stop, step)))
            strides.append(stride * step)
            number += start * stride if shape[-1] else 0
        elif is_symbolic(key):
            text = ops.text(ops.temporary(Scalar(ops.text(key), "i")))
            terms.append(text if stride == 1 else f"{text} * {stride}")
        else:
            index = int(key)
            if not -size <= index < size:
                raise ConcreteRequired(f"entry {index} of {size}")
            number += index % size * stride
    shape += array.shape[axis:]
    strides += array.strides[axis:]
    first = number, " + ".join(terms)
    return Array(array.name, tuple(shape), tuple(strides), first, array.kind, array.known)


def _select_entries(ops: Operations, value: Any, keys: tuple[Any, ...]) -> Computed:
    """Return the entries that an array of constant indices chooses along one axis."""
    if keys[0] is Ellipsis:
        keys = (*(slice(None),) * (value.ndim - len(keys) + 1), *keys[1:])
    full = [isinstance(key, slice) and key == slice(None) for key in keys]
    if sum(full) != len(keys) - 1:
        raise Unsupported("entries chosen along several axes")
    axis = full.index(False)
    rows, array = _rows(keys[axis]), ops.array(value)
    table = rows % array.shape[axis] if rows.size else rows

    def entry(index: tuple[str, ...]) -> str:
        at = index[axis]
        chosen = str(table[int(at)]) if at.isdigit() else ops.table(table).entry((at,))
        return array.entry((*index[:axis], chosen, *index[axis + 1 :]))

    shape = (*array.shape[:axis], rows.size, *array.shape[axis + 1 :])
    return Computed(shape, entry, array.kind)


def _rows(key: Any) -> Any:
    """Return the constant indices that a list, or a mask, stands for."""
    rows = np.asarray(require_concrete(key, "chosen entries"))
    return np.flatnonzero(rows) if rows.dtype == bool else rows


def set_item(ops: Operations, target: Any, key: Any, value: Any) -> None:
    """Carry out target[key] = value."""
    if isinstance(target, dict):
        target[require_concrete(key, "key")] = ops.materialised(value)
        return
    if not isinstance(target, Array):
        raise Unsupported(f"writing into a {type(target).__name__} that was made before")
    keys = key if isinstance(key, tuple) else (key,)
    chosen = [axis for axis, one in enumerate(keys) if is_array(one) or isinstance(one, list)]
    if chosen:
        axis, value = chosen[0], ops.materialised(value)
        for k, row in enumerate(_rows(keys[axis]).tolist()):
            one = item(ops, value, (slice(None),) * axis + (k,)) if is_array(value) else value
            set_item(ops, target, (*keys[:axis], row, *keys[axis + 1 :]), one)
        return
    ops.write(_part(ops, target, keys), value)


def reshaped(ops: Operations, value: Any, shape: tuple[int, ...]) -> Array:
    """Return an array in another shape, as a view where it is contiguous."""
    array = ops.array(value)
    if not array.contiguous:
        array = ops.stored(*ops.entries(array))
    if -1 in shape:
        known = int(np.prod([size for size in shape if size != -1]))
        shape = tuple(array.size // known if size == -1 else size for size in shape)
    return Array(array.name, shape, row_major(shape), array.start, array.kind)
