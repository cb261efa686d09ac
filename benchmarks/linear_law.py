"""Law `linear` with 40 states: what an answer costs beside its product of matrix and vector."""

from time import process_time

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_control.controllers.linear.linear_law import LinearLaw
from flexslew_control.law import Estimate, Reference
from flexslew_plant.measurement import Measurement

_STATES, _JOINTS, _APPENDAGES = 40, 2, 2
_BLOCKS, _TICKS = 200, 500


def figures() -> dict[str, float]:
    """Return the processor time of a tick, median over blocks of ticks.

    tick_us: of `LinearLaw.update` [us]; at most 10 is wanted.
    floor_us: of the product of its matrix with a vector of that size, interleaved [us].
    tick_to_floor: of the two [-].
    """
    rng, m, s = np.random.default_rng(1), _JOINTS, _APPENDAGES
    a, _ = np.linalg.qr(rng.standard_normal((_STATES, _STATES)))
    raw = 5 * m + 2 * s
    b, c, d = (rng.standard_normal(of) for of in ((_STATES, raw), (m, _STATES), (m, raw)))
    inputs, outputs, states = (
        tuple(f"{kind}.{k}" for k in range(count))
        for kind, count in (("input", raw), ("output", m), ("state", _STATES))
    )
    system = Lti(0.9 * a, b, c, d, inputs, outputs, states, 0.01)
    law = LinearLaw(system, np.full(m, 1e9), np.zeros((_STATES, m)), True)
    q, tip, none = rng.standard_normal(m), rng.standard_normal(s), np.zeros(0)
    measured = Measurement(1, 0, 0.01, "it", q, q, tip, tip, q)
    reference = Reference(q, q, q, none)
    estimate = Estimate(q, q, none, np.zeros((0, 0)), none)
    matrix, vector = rng.standard_normal((_STATES + m, _STATES + raw)), np.ones(_STATES + raw)
    ticks, floors = [], []
    for _ in range(_BLOCKS):
        begin = process_time()
        for _ in range(_TICKS):
            law.update(measured, estimate, reference)
        middle = process_time()
        for _ in range(_TICKS):
            matrix @ vector
        ticks.append((middle - begin) / _TICKS)
        floors.append((process_time() - middle) / _TICKS)
    tick, floor = (1e6 * float(np.median(times)) for times in (ticks, floors))
    return {"tick_us": tick, "floor_us": floor, "tick_to_floor": tick / floor}
