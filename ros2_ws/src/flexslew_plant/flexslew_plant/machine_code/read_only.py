"""Machine code of one kind for arrays that may be written and for those that may only be read.

Numba takes the two for two types, and compiles for each: in a notebook arrays may be written, what
a bench hands out may not. Here every array is a read-only one unless the function writes into it.
"""

import inspect
from typing import Any

from numba import types
from numba.core import sigutils


def for_all_access(dispatcher: Any, written: tuple[str, ...], strided: bool = False) -> Any:
    """Return a function of Numba that is compiled once for both kinds of arrays.

    Args:
        dispatcher: what Numba has made of the function.
        written: arguments that it writes into.
        strided: whether matrices may be parts of wider ones; it is compiled for those.
    """
    names = tuple(inspect.signature(dispatcher.py_func).parameters)
    compile_it, registered = dispatcher.compile, set[tuple[Any, ...]]()

    def compile_for_all(signature: Any) -> Any:
        given, result = sigutils.normalize_signature(signature)
        taken = tuple(
            kind if name in written else read_only(kind)
            for name, kind in zip(names, map(_strided, given) if strided else given, strict=True)
        )
        entry = compile_it(taken if result is None else result(*taken))
        if taken != given and given not in registered:
            # registered with the dispatcher, which else comes here at every such call, for a
            # quarter of a millisecond; if registered twice, as by two compiled callers, the
            # dispatcher would never choose by itself
            registered.add(given)
            dispatcher._insert([kind._code for kind in given], entry, False)
        return entry

    dispatcher.compile = compile_for_all
    return dispatcher


def read_only(kind: Any) -> Any:
    """Return the type of an array as that of one that may only be read; others as they are."""
    return kind.copy(readonly=True) if isinstance(kind, types.Array) else kind


def _strided(kind: Any) -> Any:
    matrix = isinstance(kind, types.Array) and kind.ndim > 1
    return kind.copy(layout="A") if matrix else kind
