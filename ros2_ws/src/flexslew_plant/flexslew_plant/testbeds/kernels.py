"""A testbed's equations of motion as functions that Numba compiles into the shared kernels.

A `Kernels` object is an argument of every kernel of `dynamics`; Numba compiles each of them again
for each object, with its functions built in, and keeps the machine code on disk.
"""

import hashlib
import inspect
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from numba.core import types
from numba.core.imputils import lower_constant
from numba.extending import NativeValue, models, register_model, typeof_impl, unbox

from flexslew_plant.arrays import called, merged
from flexslew_plant.errors import BadInput
from flexslew_plant.machine_code.compile_errors import convert_compile_errors

# how many arguments of each function come before those that it writes into
_READ = {
    "terms": 3,
    "residual_jacobian": 4,
    "potential": 3,
    "actuation": 4,
    "kinematics": 3,
    "reading": 2,
    "acceleration": 4,
    "next_jump": 2,
    "advance": 4,
}
_KNOWN: dict[str, "Kernels"] = {}  # by token, for Numba's compiler and for its files


@dataclass(frozen=True, eq=False)
class Kernels:
    """The equations M(q, t) a + h(q, v, t) = B u of one kind of testbed.

    Plain functions of the subset of Python that Numba compiles. x = [q, v] is the state with the
    joints before the modes, p the numbers that `Model.packed` holds, t the time [s]:

    terms(p, t, x, joints, coupling, modal, bias): writes the blocks of a mass matrix with a modal
        block that is diagonal, shapes (m, m), (m, k), (k,), and h, shape (n,);
        or, for any mass matrix (full_mass), terms(p, t, x, mass, bias), shape (n, n) and (n,).
    residual_jacobian(p, t, x, a, dq, dv): writes the partial derivatives of M a + h - B u (its
        efforts only where B depends on q) at fixed a, shapes (n, positions) and (n, n).
    potential(p, t, q): returns the potential energy [J].
    actuation(p, t, x, effort, force): adds B u to the generalised forces, shape (n,); left out,
        the efforts act on the first coordinates.
    kinematics(p, t, x, rate): writes q' = N(q) v, shape (positions,); left out, q' = v.
    reading(p, x, position, rate): writes where each joint is and how fast, each (joints,); left
        out, the first entries of q and v.
    acceleration(p, t, x, effort, a): writes M^-1 (B u - h), shape (n,), in fewer operations than
        from the terms: the same but for rounding, and for members alone.
    next_jump(p, t): returns the first time after t at which an acceleration that is a function of
        time jumps, infinity where none does [s]; no step goes across. Left out, none does.
    advance(p, t, effort, dt, x): replaces x by the state dt later with the effort held: the exact
        solution of linear equations. Left out, x is integrated by steps of order 8.

    Args:
        terms, residual_jacobian, potential, actuation, kinematics, reading, acceleration,
            next_jump, advance: as above.
        full_mass: whether terms writes the whole mass matrix.
        extra_positions: how many entries q has more than v (a quaternion: 1); needs kinematics.
        any_size: whether they are compiled once for all sizes of a state rather than for each: for
            equations that take long to compile and have loops that outweigh the others; needs
            actuation and kinematics, and functions that their author has compiled.
        token: names the functions in the compiler's files; made from their names and sources.
    """

    terms: Callable[..., None]
    residual_jacobian: Callable[..., None]
    potential: Callable[..., float]
    actuation: Callable[..., None] | None = None
    kinematics: Callable[..., None] | None = None
    reading: Callable[..., None] | None = None
    acceleration: Callable[..., None] | None = None
    next_jump: Callable[..., float] | None = None
    advance: Callable[..., None] | None = None
    full_mass: bool = False
    extra_positions: int = 0
    any_size: bool = False
    token: str = field(init=False)

    def __post_init__(self) -> None:
        """Make the token.

        Raises:
            ValueError: extra positions without kinematics, or any size without both.
        """
        if self.any_size and (self.actuation is None or self.kinematics is None):
            raise ValueError("any_size needs actuation and kinematics")
        if self.extra_positions and self.kinematics is None:
            raise ValueError("extra_positions needs kinematics, which gives their rates")
        names = [(name, function.__qualname__) for name, function in self.functions.items()]
        digest = hashlib.sha256(f"{self.full_mass} {self.extra_positions} {names}".encode())
        for path in sorted(set().union(*map(_sources, self.functions.values()))):
            digest.update(path.read_bytes())
        name = f"{self.terms.__module__}.{self.terms.__qualname__}"
        object.__setattr__(self, "token", f"{name}:{digest.hexdigest()[:16]}")
        _KNOWN[self.token] = self

    @cached_property
    def compiled(self) -> dict[str, Any]:
        """The functions that were given, by name, for use inside compiled code."""
        require_equations(self)
        return {
            name: _compile_function(name, function) for name, function in self.functions.items()
        }

    @property
    def functions(self) -> dict[str, Callable[..., Any]]:
        """The functions that were given, by name."""
        names = tuple(f.name for f in fields(self) if f.default in (MISSING, None) and f.init)
        given = {name: getattr(self, name) for name in names}
        return {name: function for name, function in given.items() if function is not None}

    def __reduce__(self) -> tuple[Callable[[str], "Kernels"], tuple[str]]:
        """Return how the compiler's files name this object: by its token."""
        return known, (self.token,)


def known(token: str) -> Kernels:
    """Return the object with this token; KeyError where its module has not been imported."""
    return _KNOWN[token]


@called
def select(condition: bool, yes: float, no: float) -> float:
    """Return `yes` where the condition holds, else `no`: a branch that batches can take, too."""
    return yes if condition else no


@cache
def _compile_function(name: str, function: Callable[..., Any]) -> Any:
    """Return one of the functions of a Kernels object for use inside compiled code.

    It is one for all objects that share it: of two, the compiler would take one for the other.
    """
    if hasattr(function, "py_func"):  # the author has compiled it
        return function
    arguments = tuple(inspect.signature(function).parameters)
    return convert_compile_errors(merged(*arguments[_READ[name] :])(function))


def _sources(function: Callable[..., Any]) -> set[Path]:
    """Return the files of a function and of all compiled ones that it calls."""
    found: set[Path] = set()
    waiting, seen = [getattr(function, "py_func", function)], set()
    while waiting:
        now = waiting.pop()
        seen.add(now)
        found.add(Path(inspect.getfile(now)))
        called = (now.__globals__.get(name) for name in now.__code__.co_names)
        waiting += {getattr(c, "py_func", None) for c in called} - seen - {None}
    return found


def _no_equations(*_: Any) -> Any:
    """Stand for the equations of a black box; never called."""


NO_EQUATIONS = Kernels(_no_equations, _no_equations, _no_equations)


def require_equations(kernels: Kernels) -> None:
    """Check that a testbed has equations.

    Raises:
        BadInput: it is a black box.
    """
    if kernels is NO_EQUATIONS:
        raise BadInput(
            "the testbed is a black box without equations; name one with equations as the design "
            "model, for example `model: {kind: identified, ...}`, or do without this"
        )


class KernelsType(types.Type):
    """The Numba type of a Kernels object: all of it is known at compile time."""

    def __init__(self, token: str) -> None:
        super().__init__(name=f"Kernels({token})")
        self.token = token

    @property
    def kernels(self) -> Kernels:
        """The functions."""
        return _KNOWN[self.token]


@typeof_impl.register(Kernels)
def _typeof(value: Kernels, context: Any) -> KernelsType:
    return KernelsType(value.token)


register_model(KernelsType)(models.OpaqueModel)


@unbox(KernelsType)
def _unbox(kind: KernelsType, value: Any, context: Any) -> NativeValue:
    return NativeValue(context.context.get_dummy_value())


@lower_constant(KernelsType)
def _constant(context: Any, builder: Any, kind: KernelsType, value: Any) -> Any:
    return context.get_dummy_value()
