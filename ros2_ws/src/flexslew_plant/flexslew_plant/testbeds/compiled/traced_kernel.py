"""Testbeds in a batch by vector instructions, from their equations as they stand.

The equations run once on numbers that take notes (tape, trace); what comes out is one loop over
members without a branch (written). Short equations are written as whole steps, all numbers of which
stay in registers or near them; long ones stage by stage, for a block of members that fits into the
first cache. Where a testbed bounds its frequencies the scheme of short equations is Nystrom's of
order 5 (see nystrom), in steps short enough for metrics good to 1e-11, else that of the bench, of
order 8. A step of Nystrom's is a loop for each stage: while one member's stage waits for its
results the processor works on the next member's, which a whole step is too long for.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from scipy.integrate import DOP853

from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.machine_code.frame import aligned_frame
from flexslew_plant.testbeds.compiled.batch_kernel import (
    BATCH_WIDTH,
    BatchKernel,
    rows_of,
    skip,
)
from flexslew_plant.testbeds.compiled.generated import generated
from flexslew_plant.testbeds.compiled.nystrom import NYSTROM
from flexslew_plant.testbeds.compiled.sine_cosine import angle_sum, sine_cosine
from flexslew_plant.testbeds.compiled.tape import Number, Tape, TraceError
from flexslew_plant.testbeds.compiled.trace import TracedEquations
from flexslew_plant.testbeds.compiled.written import BlockLayout, needed, sine_numbers_of, written
from flexslew_plant.testbeds.model import Model

_REACH = 0.1  # largest frequency times step at which order 5 is good for 1e-11 [-]
_WHOLE = 2000  # operations of a step that is written as a whole
_BLOCK = 16  # members of a block


class _Scheme(NamedTuple):
    """An explicit Runge-Kutta scheme."""

    weights: Matrix  # a_ij, the last row those of the result, (stages + 1, stages)
    times: Vector  # (stages,)


def _scheme(kind: Any, stages: int) -> _Scheme:
    weights = np.zeros((stages + 1, stages))
    inner = kind.A[:stages, :stages]
    weights[:stages, : inner.shape[1]] = inner
    weights[stages] = kind.B[:stages]
    return _Scheme(weights, np.array(kind.C[:stages], dtype=np.float64))


_ORDER_8 = _scheme(DOP853, 12)
_KNOWN: dict[Any, tuple[list[int], dict[bytes, BatchKernel | None]]] = {}


def traced_kernel(model: Model, bounded: bool) -> BatchKernel | None:
    """Return how a testbed flies in a batch; None where its equations branch from member to member.

    So do steps that may not go across jumps of accelerations: see next_jump of Kernels.

    Args:
        model: of a testbed; others with the same sizes, kinds and zeros share the kernel.
        bounded: whether it bounds its frequencies.
    """
    return traced_kernels([model], model.packed[None], bounded)[0]


def traced_kernels(
    models: Sequence[Model], packed: Matrix, bounded: bool
) -> list[BatchKernel | None]:
    """Return how each of many testbeds flies in a batch; see traced_kernel.

    Args:
        models: with equal kernels and sizes.
        packed: their numbers, shape (models, P).
        bounded: whether they bound their frequencies.
    """
    plain = np.where((packed == 0.0) | (abs(packed) == 1.0), packed, np.inf)
    first = _known_or_traced(models[0], packed[0], plain[0], bounded)
    fixed, _ = _KNOWN.get(_key(models[0], plain[0], bounded), ([], {}))
    varying = np.array([model.time_varying for model in models])
    dependencies = np.column_stack(
        (plain, packed[:, fixed], varying)
    )  # all that a kernel depends on
    same_key = (dependencies.view(np.int64) == dependencies[0].view(np.int64)).all(axis=1).tolist()
    return [
        first if same else _known_or_traced(model, numbers, zeros, bounded)
        for same, model, numbers, zeros in zip(same_key, models, packed, plain, strict=True)
    ]


def _key(model: Model, plain: Vector, bounded: bool) -> tuple[Any, ...]:
    """Return what is equal for models that differ in numbers, and not in zeros and ones."""
    return model.kernels, model.sizes, plain.tobytes(), bounded


def _known_or_traced(
    model: Model, packed: Vector, plain: Vector, bounded: bool
) -> BatchKernel | None:
    if model.time_varying and model.kernels.next_jump is not None:
        return None
    key = _key(model, plain, bounded)
    if key in _KNOWN:
        fixed, found = _KNOWN[key]
        same_key = packed[fixed].tobytes()
        if same_key in found:
            return found[same_key]
    else:
        fixed, found = _KNOWN.setdefault(key, ([], {}))
    equations = TracedEquations(model)
    try:
        kernel = _kernel(model, equations, bounded and "kinematics" not in model.kernels.functions)
    except TraceError:
        kernel = None
    seen = sorted(equations.tape.fixed)
    if seen != fixed:  # what another branch has looked at counts from now on, too
        fixed[:] = sorted({*fixed, *seen})
        found.clear()
    found[packed[fixed].tobytes()] = kernel
    return kernel


def _kernel(model: Model, equations: TracedEquations, bounded: bool) -> BatchKernel | None:
    tape, states = equations.tape, len(equations.x)
    reads = "reading" in model.kernels.functions
    rows = rows_of(states, model.efforts, model.joints, model.modes, reads)
    entries = {"x": 0, "u": rows.effort, "constants": rows.end}
    t, h = tape.input("t", 0), tape.input("h", 0)
    read: Callable[[int, Vector], None] = skip
    joints = equations.joints() if reads else ()
    slopes = equations.slopes(t, equations.x)
    stages = len(NYSTROM.times if bounded else _ORDER_8.times)
    is_short = len(needed(tape, slopes).steps) * stages <= _WHOLE
    bounded = bounded and is_short
    found = [slopes]  # by stage what later ones need, then the results
    if bounded:
        found = equations.nystrom_step(t, h, NYSTROM)
    elif is_short:
        found = [equations.step(t, h, *_ORDER_8)]
    constants = needed(tape, [*found[-1], *joints]).constants
    end = rows.end + len(constants) * BATCH_WIDTH

    def function(name: str, loops: list[dict[int, Any]], layout: BlockLayout) -> Any:
        return _function(name, written(name, tape, loops, layout))

    if reads:
        layout = BlockLayout(entries, constants, BATCH_WIDTH, "filled, w")
        read = function("read", [_by_position(joints, rows.position, BATCH_WIDTH)], layout)
    if is_short:
        loops, size = list[dict[int, Any]](), end
        for values in _stage_outputs(tape, found):
            loops.append(_by_position(values, size, BATCH_WIDTH))
            size += len(values) * BATCH_WIDTH
        loops.append(_by_position(found[-1], 0, BATCH_WIDTH))
        advance = _whole_steps(
            function("step", loops, BlockLayout(entries, constants, BATCH_WIDTH))
        )
    else:
        counts = (states, model.efforts, len(constants), states, states)
        x, u, of_block, at, slope = (end + _BLOCK * sum(counts[:k]) for k in range(5))
        layout = BlockLayout({"x": at, "u": u, "constants": of_block}, constants, _BLOCK)
        slopes_of = function("slopes", [_by_position(slopes, slope, _BLOCK)], layout)
        work = _Work(states, states + model.efforts, len(constants), rows.end, x, at, slope)
        advance = _by_stages(slopes_of, _ORDER_8, work)
        size = slope + _BLOCK * states * (1 + stages)

    def place(packed: Matrix) -> Vector:
        w = np.zeros(size)
        w[rows.end : end] = tape.evaluated(packed, constants).ravel()
        return w

    return BatchKernel(advance, read, rows, size, place, _REACH if bounded else np.inf)


def _by_position(values: Any, at: int, width: int) -> dict[int, Any]:
    """Return values by where in w they begin."""
    return {at + i * width: value for i, value in enumerate(values)}


def _stage_outputs(tape: Tape, found: list[Any]) -> list[list[Number]]:
    """Return what each stage but the last keeps for the later ones, the last being the result."""
    kept, known = list[list[Number]](), set[int]()
    for stage, values in enumerate(found[:-1]):
        sine_numbers = [
            sine_number
            for sine_number in sine_numbers_of(tape, values)
            if sine_number.index not in known
        ]
        entries = [value for value in values if isinstance(value, Number)]
        known |= {value.index for value in entries}
        later = {k for after in found[stage + 1 :] for k in needed(tape, after, known).steps}
        kept.append(
            [*entries, *(sine_number for sine_number in sine_numbers if sine_number.index in later)]
        )
        known |= {value.index for value in kept[-1]}
    return kept


def _function(name: str, text: str) -> Any:
    names = {
        "np": np,
        "aligned_frame": aligned_frame,
        "sine_cosine": sine_cosine,
        "turned": angle_sum,
    }
    return vectorised(generated(name, text, names))


@lru_cache
def _whole_steps(step: Callable[..., None]) -> Any:
    @vectorised
    def advance(t: float, dt: float, steps: int, filled: int, w: Vector) -> None:
        h = dt / steps
        for i in range(steps):
            step(t + i * h, h, w)

    return advance


class _Work(NamedTuple):
    """Where a block of members is worked on: sizes in rows, places in the flat array."""

    states: int
    given: int  # states and efforts
    constants: int
    constants_from: int  # rows of BATCH_WIDTH
    x: int  # from here on rows of _BLOCK: states, efforts and constants
    at: int  # state of a stage
    slope: int  # of a stage, and behind it those of all


def _by_stages(slopes_of: Callable[..., None], scheme: _Scheme, work: _Work) -> Any:
    states, given, constants, constants_from, x, at, _ = work
    size, step_of = states * _BLOCK, _step(slopes_of, scheme, work)

    @vectorised
    def advance(t: float, dt: float, steps: int, filled: int, w: Vector) -> None:
        h = dt / steps
        for member in range(0, filled, _BLOCK):
            for i in range(given):
                for k in range(_BLOCK):
                    w[x + i * _BLOCK + k] = w[i * BATCH_WIDTH + member + k]
            for i in range(constants):
                for k in range(_BLOCK):
                    to = x + (given + i) * _BLOCK + k
                    w[to] = w[constants_from + i * BATCH_WIDTH + member + k]
            for i in range(steps):
                step_of(t + i * h, h, w)
                for k in range(size):
                    w[x + k] = w[at + k]
            for i in range(states):
                for k in range(_BLOCK):
                    w[i * BATCH_WIDTH + member + k] = w[x + i * _BLOCK + k]

    return advance


def _step(slopes_of: Callable[..., None], scheme: _Scheme, work: _Work) -> Callable[..., None]:
    """Return what writes the state of a block a step later to `at`."""
    weights, times = scheme
    stages, size = len(times), work.states * _BLOCK
    x, at, slope, kept = work.x, work.at, work.slope, work.slope + size

    @vectorised
    def step(t: float, h: float, w: Vector) -> None:
        for stage in range(stages + 1):
            for k in range(size):
                w[at + k] = w[x + k]
            for j in range(stage):
                weight = h * weights[stage, j]
                if weight != 0.0:
                    for k in range(size):
                        w[at + k] += weight * w[kept + j * size + k]
            if stage < stages:
                slopes_of(t + times[stage] * h, h, w)
                for k in range(size):
                    w[kept + stage * size + k] = w[slope + k]

    return cast(Callable[..., None], step)
