"""Benches that are shaken and measured in machine code: what a campaign flies."""

from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from flexslew_control.law import PlantDescription
from flexslew_control.linear.free_platform import rate_outputs
from flexslew_control.planners.entry import PlanTask
from flexslew_control.planners.excitation.excitation import Excitation, plan_excitation
from flexslew_control.planners.slew import Feedback
from flexslew_lab.identification.identification import Experiment
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import initial_state, read_testbed
from flexslew_plant.testbeds.compiled.bound import ADVANCE

PERIOD = 0.01


def bench(**values: Any) -> Any:
    """Return a testbed of these keys."""
    return read_testbed(values, "here")


def plant_of(testbed: Any, period: float = PERIOD) -> PlantDescription:
    """Return it with its own limits."""
    return PlantDescription(testbed, period, np.array(testbed.effort_limit))


def truth(testbed: Any) -> tuple[Vector, Vector, Matrix]:
    """Return frequencies [rad/s] and damping ratios of the free modes, rising, and the inertia.

    The inertia is what the efforts of the joints feel where their positions are read.
    """
    model = testbed.model()
    rest = model.rest({})
    linear, rigid = model.linearise(rest), slice(model.before_modes)
    poles = linear.eigenvalues
    poles = poles[poles.imag > 1e-6]
    poles = poles[np.argsort(np.abs(poles))]
    moved = np.linalg.solve(linear.mass[rigid, rigid], linear.input_matrix[rigid])
    felt = np.linalg.inv(rate_outputs(model, rest)[:, rigid] @ moved)
    inertia: Matrix = np.asarray(felt, dtype=np.float64)
    return np.abs(poles), -poles.real / np.abs(poles), inertia


@lru_cache
def _kernel() -> Any:
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    kernel: Any = compiled(_flown)
    sizes = types.float64, types.int64, types.int64
    kernel.compile(
        types.UniTuple(matrix, 2)(
            ADVANCE, vector, vector, matrix, vector, vector, matrix, matrix, *sizes
        )
    )
    kernel.disable_compile()
    return kernel


def _flown(
    advance: Any,
    p: Vector,
    start: Vector,
    push: Matrix,
    kp: Vector,
    kd: Vector,
    tip: Matrix,
    noise: Matrix,
    period: float,
    n: int,
    before_modes: int,
) -> tuple[Matrix, Matrix]:
    """Return what was measured and the efforts: PD about rest on what the sensors say."""
    ticks, m = push.shape
    x, applied = start.copy(), np.empty((ticks, m))
    measured = np.empty((ticks + 1, noise.shape[1]))
    for k in range(ticks + 1):
        for j in range(m):
            measured[k, j] = x[j] + noise[k, j]
            measured[k, m + j] = x[n + j] + noise[k, m + j]
        for a in range(tip.shape[0]):
            bend = 0.0
            for i in range(tip.shape[1]):
                bend += tip[a, i] * x[m + i]
            measured[k, 2 * m + a] = bend + noise[k, 2 * m + a]
        if k == ticks:
            break
        for j in range(m):
            applied[k, j] = push[k, j] - kp[j] * (measured[k, j] - start[j])
            applied[k, j] -= kd[j] * measured[k, m + j]
        advance(p, k * period, applied[k], period, 1, before_modes, x)
    return measured, applied


def shaken(
    testbed: Any,
    plan: dict[str, Any],
    gains: tuple[Vector, Vector],
    rng: np.random.Generator,
    ratio: float = 0.1,
    believed: Any = None,
    period: float = PERIOD,
) -> Experiment:
    """Return the experiment on a bench whose sensors' noise is a part of what each signal does.

    Args:
        testbed: that is shaken.
        plan: keys of the excitation.
        gains: kp and kd of the feedback.
        rng: of the noise.
        ratio: of the standard deviations; 0.1 is 20 dB.
        believed: that the plan is made for; None: the testbed.
        period: one tick [s].
    """
    asked = validated(Excitation, plan, "here")
    feedback = Feedback(kp=tuple(gains[0]), kd=tuple(gains[1]))
    made = plan_excitation(PlanTask(asked, plant_of(believed or testbed, period), feedback))
    model = testbed.model()
    outputs = 2 * model.joints + len(model.appendages.names)
    push = np.vstack((made.effort, np.zeros((200, model.joints))))

    def fly(noise: Matrix) -> tuple[Matrix, Matrix]:
        flown: tuple[Matrix, Matrix] = _kernel()(
            model.integrate, model.packed, initial_state(testbed), push, *gains,
            np.ascontiguousarray(model.appendages.tip), noise, period,
            model.coordinates, model.before_modes,
        )  # fmt: skip
        return flown

    quiet = np.zeros((len(push) + 1, outputs))
    size = fly(quiet)[0].std(axis=0)
    measured, effort = fly(ratio * size * rng.standard_normal(quiet.shape))
    names = model.joint_names
    told = [
        *(Output(f"position.{n}", "rad", Quantity.JOINT_POSITION, n) for n in names),
        *(Output(f"rate.{n}", "rad/s", Quantity.JOINT_RATE, n) for n in names),
        *(Output(f"tip.{a}", "m", Quantity.DEFLECTION) for a in model.appendages.names),
    ]
    record = Record(
        period, effort, measured, names, tuple(told), "here", np.full(len(names), np.inf)
    )
    return Experiment(record, made, testbed)
