"""Lightly damped linear plants in modal form, as public benchmarks have them."""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm


class ModalPlant(NamedTuple):
    """x' = A x + B u, y = C x with a pair of states per mode: displacement and rate."""

    a: Any
    b: Any
    c: Any

    def held(self, period: float) -> tuple[Any, Any]:
        """Return F and G of x(k + 1) = F x(k) + G u(k), efforts held: of each pair by itself."""
        n, m = self.b.shape
        f, g = np.zeros((n, n)), np.zeros((n, m))
        for k in range(0, n, 2):
            pair = slice(k, k + 2)
            size = np.diag([1.0, max(np.sqrt(-self.a[k + 1, k]), 1.0)])  # rows of like size
            back = np.linalg.inv(size)
            whole = np.zeros((2 + m, 2 + m))
            whole[:2, :2], whole[:2, 2:] = back @ self.a[pair, pair] @ size, back @ self.b[pair]
            step = expm(whole * period)
            f[pair, pair], g[pair] = size @ step[:2, :2] @ back, size @ step[:2, 2:]
        return f, g

    def keys(self, joints: int, outputs: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
        """Return a `testbed` section."""
        system = {"a": self.a.tolist(), "b": self.b.tolist(), "c": self.c.tolist()}
        named = {"outputs": list(outputs)} if outputs else {}
        limits = {"effort_limit": [10.0] * joints}
        return {"kind": "linear", "system": {**system, **named}, **limits, **more}


def modal_plant(
    frequencies: Any, shapes: Any, damping: float = 0.005, read: Any = None
) -> ModalPlant:
    """Return a plant with modes of unit modal mass.

    Args:
        frequencies: of the free modes, zero for a rigid one, shape (n,) [rad/s].
        shapes: how each moves the joints, shape (n, joints).
        damping: ratio of all [-].
        read: how each moves the outputs, shape (n, outputs); None: the joints.
    """
    n, m = np.shape(shapes)
    a, b = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, m))
    c = np.zeros((m if read is None else np.shape(read)[1], 2 * n))
    for k, w in enumerate(frequencies):
        a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, 1.0], [-w * w, -2.0 * damping * w]]
    b[1::2], c[:, ::2] = shapes, np.transpose(shapes if read is None else read)
    return ModalPlant(a, b, c)


def drawn_plant(
    modes: int, joints: int, band: tuple[float, float], rigid: int = 0, seed: int = 3
) -> ModalPlant:
    """Return a plant with frequencies drawn from a band, even on a logarithmic scale [rad/s]."""
    rng = np.random.default_rng(seed)
    frequencies = np.exp(np.sort(rng.uniform(np.log(band[0]), np.log(band[1]), modes)))
    frequencies[:rigid] = 0.0
    return modal_plant(frequencies, rng.standard_normal((modes, joints)))


SPACE_STATION = 135, 3, (0.5, 60.0)  # modes, joints and band of SLICOT's iss: 270 states
CD_PLAYER = 60, 2, (10.0, 7e4)  # of its CDplayer: 120 states
