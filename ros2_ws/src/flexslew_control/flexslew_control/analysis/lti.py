"""Matrices of a linear system with named signals, and how they become a StateSpace.

`series` and `at` are control.series and StateSpace.__call__ in a few lines: law `linear` is checked
as its node starts, which must not wait more than a second for python-control to load.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexslew_control.analysis.signals import in_control
from flexslew_plant.arrays import Matrix

if TYPE_CHECKING:
    import control


@dataclass(frozen=True)
class Lti:
    """x' = A x + B u, y = C x + D u; with a period x(k + 1) = A x(k) + B u(k).

    Args:
        a, b, c, d: shapes (n, n), (n, m), (l, n), (l, m).
        inputs: names, m of them.
        outputs: names, l of them.
        states: names, n of them.
        period: one tick [s]; 0: continuous.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    d: Matrix
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    states: tuple[str, ...]
    period: float = 0.0

    def rows(self, outputs: Sequence[str]) -> "Lti":
        """Return the system with these outputs alone, in this order."""
        rows = [self.outputs.index(name) for name in outputs]
        return Lti(
            self.a, self.b, self.c[rows], self.d[rows], self.inputs, tuple(outputs), self.states,
            self.period,
        )  # fmt: skip

    def state_space(self, name: str = "plant") -> "control.StateSpace":
        """Return it as python-control takes it, a colon in names where the bench has a dot."""
        import control

        return control.StateSpace(
            self.a,
            self.b,
            self.c,
            self.d,
            self.period,
            inputs=in_control(self.inputs),
            outputs=in_control(self.outputs),
            states=in_control(self.states),
            name=name,
            remove_useless_states=False,
        )

    def at(self, z: "np.typing.NDArray[np.complex128]") -> "np.typing.NDArray[np.complex128]":
        """Return C (z - A)^-1 B + D at each z, shape (len(z), l, m)."""
        return transfer((self.a, self.b, self.c, self.d), z)


def transfer(
    system: tuple[Matrix, Matrix, Matrix, Matrix], z: "np.typing.NDArray[np.complex128]"
) -> "np.typing.NDArray[np.complex128]":
    """Return C (z - A)^-1 B + D at each z, shape (len(z), l, m).

    Args:
        system: A, B, C and D.
        z: shape (k,); s of a continuous system.
    """
    a, b, c, d = system
    n, count = len(a), len(z)
    out = np.broadcast_to(d, (count, *d.shape)).astype(np.complex128)
    step = max(1, 2_000_000 // max(n * n, 1))
    for first in range(0, count, step):
        part = slice(first, first + step)
        # A - 1 first: near z = 1 it keeps the digits that z - A would lose
        pencil = (z[part, None, None] - 1.0) * np.eye(n) - (a - np.eye(n))
        out[part] += c @ np.linalg.solve(pencil, np.broadcast_to(b, (len(pencil), *b.shape)))
    return out


def series(first: Lti, then: Lti) -> Lti:
    """Return `then` fed with all outputs of `first`."""
    n, m = len(first.a), len(then.a)
    return Lti(
        np.block([[first.a, np.zeros((n, m))], [then.b @ first.c, then.a]]),
        np.vstack((first.b, then.b @ first.d)),
        np.hstack((then.d @ first.c, then.c)),
        then.d @ first.d,
        first.inputs,
        then.outputs,
        (*first.states, *then.states),
        max(first.period, then.period),
    )


def plain(system: Lti) -> dict[str, Any]:
    """Return it as JSON holds it."""
    matrices = {name.upper(): getattr(system, name).tolist() for name in "abcd"}
    return matrices | {
        "Ts": system.period,
        "inputs": list(system.inputs),
        "outputs": list(system.outputs),
        "states": list(system.states),
    }
