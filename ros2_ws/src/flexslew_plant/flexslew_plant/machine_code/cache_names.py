"""Names by which the machine-code cache finds functions again in other processes.

The cache of a function with a closure goes by what it closes over. For that, Numba gives each of
its functions a name, drawn at random in each process: a function that closes over another one would
be compiled again by each process, and never found. Here the name is what the function is made of.

What is compiled has a symbol with a number that Numba counts from 1 in each process. Two closures
of one function, compiled by two processes, would meet under one symbol in a third that loads both
("'descr' is NULL", or the wrong one runs); so each process counts from a number of its own.
"""

import os
from hashlib import sha256
from itertools import count
from typing import Any

from numba.core.bytecode import FunctionIdentity
from numba.core.serialize import dumps


def _offset_counter() -> None:
    FunctionIdentity._unique_ids = count(int.from_bytes(os.urandom(6), "big"))


_offset_counter()
os.register_at_fork(after_in_child=_offset_counter)


def set_cache_name(dispatcher: Any) -> Any:
    """Return a function of Numba after naming it by its place, its file and what it closes over."""
    return _named(dispatcher, dispatcher.py_func, dispatcher.targetoptions)


def set_intrinsic_cache_name(found: Any) -> Any:
    """Return an intrinsic of Numba after naming it likewise: functions that use it have caches."""
    return _named(found, found._defn, found._ctor_kwargs)


def _named(compilable: Any, function: Any, options: dict[str, Any]) -> Any:
    cells = tuple(cell.cell_contents for cell in function.__closure__ or ())
    try:
        stamp = os.stat(function.__code__.co_filename)
    except OSError:  # typed into an interpreter: no other process will look for it
        return compilable
    place = (
        function.__module__,
        function.__qualname__,
        function.__code__.co_firstlineno,
        stamp.st_mtime_ns,
        stamp.st_size,
        sorted(map(str, options.items())),
    )
    compilable._set_uuid(sha256(repr(place).encode() + dumps(cells)).hexdigest())
    return compilable
