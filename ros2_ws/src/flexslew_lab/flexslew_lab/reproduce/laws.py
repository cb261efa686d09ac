"""The public table of output feedback on the testbed, computed again; pi shares its loop."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from flexslew_control.controllers.by_joint import pd_feedforward
from flexslew_control.controllers.by_joint.pd_feedforward import PdFeedforwardSettings
from flexslew_control.controllers.sliding import output_feedback
from flexslew_control.controllers.sliding.output_feedback import OutputFeedback
from flexslew_control.law import Estimator, Law, PlantDescription, Reference
from flexslew_control.planners import make_plan
from flexslew_control.planners.input_shaping.start_coast_stop import StartCoastStop
from flexslew_lab.reproduce.rows import relative
from flexslew_plant.arrays import Matrix
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.csa import CsaInitial, CsaParameters, CsaTestbed

PERIOD = 0.01  # [s]
_GOAL = float(np.pi / 6.0)  # base yaw [rad]
_PITCH = 0.5  # hub pitch at the end [rad]
_FILE = "Sung and Joo"


def plant_of(testbed: CsaTestbed, limit: float = 1e9) -> PlantDescription:
    """Return the testbed on the bench of the tables."""
    return PlantDescription(testbed, PERIOD, np.full(2, limit))


class LawRun(NamedTuple):
    """A closed loop on the ticks."""

    state: Matrix  # (ticks + 1, 2 n)
    effort: Matrix  # (ticks, joints) [N m]


def closed_loop(
    testbed: CsaTestbed,
    controller: tuple[Estimator, Law] | None,
    reference: Callable[[int], Reference],
    duration: float,
    disturbance: float = 0.0,
    from_rest: bool = False,
) -> LawRun:
    """Return the noiseless run of a controller, or of the feedforward alone, with 10 ms hold.

    Args:
        testbed: starts at rest at its `initial`.
        controller: estimator and law; None: the reference's effort.
        reference: of each tick.
        duration: [s].
        disturbance: constant, on the base yaw [N m].
        from_rest: whether the law takes over with no effort, which fills its integral.
    """
    model = testbed.model()
    n, m = model.coordinates, model.joints
    x = np.zeros(2 * n)
    x[:m] = testbed.initial.base_yaw, testbed.initial.hub_pitch
    effort, added, empty = np.zeros(m), np.array([disturbance, 0.0]), np.zeros(0)
    states, efforts = [x], []
    for tick in range(round(duration / PERIOD)):
        now = Measurement(tick, 0, tick * PERIOD, "", x[:m], x[n : n + m], empty, empty, effort)
        requested = reference(tick)
        if controller is None:
            effort = requested.effort
        else:
            estimator, law = controller
            if tick == 0:
                estimator.reset(now)
            estimate = estimator.update(now)
            if tick == 0 and from_rest:
                law.reset(now, estimate, requested, effort)
            effort = law.update(now, estimate, requested)
        x = model.advance(x, effort + added, PERIOD)
        states.append(x)
        efforts.append(effort)
    return LawRun(np.array(states), np.array(efforts))


Case = Literal["tracking_a", "tracking_b", "rigid_hold", "pd", "open_clamped", "open_system"]


def slew(case: Case, start_pitch: float, stiffness: float = 1.0) -> tuple[LawRun, float]:
    """Return a run of the table of Sung and Joo on three modes, 60 s, and the manoeuvre's end [s].

    Args:
        case: the row.
        start_pitch: psi at the start; it ends at 0.5 [rad].
        stiffness: EI of the testbed over that of the models [-].
    """
    initial = CsaInitial(hub_pitch=start_pitch)
    design_testbed = CsaTestbed(variant="printed", modes=1, initial=initial)
    real = CsaTestbed(
        variant="printed",
        modes=3,
        initial=initial,
        parameters=CsaParameters(bending_stiffness=1500.0 * stiffness),
    )
    plant = plant_of(design_testbed)
    plan = make_plan(
        StartCoastStop(
            goal={"base_yaw": _GOAL, "hub_pitch": _PITCH},
            shaper="system" if case == "open_system" else "clamped",
            feedforward="rigid",
        ),
        plant,
    )
    controller: tuple[Estimator, Law] | None = None
    if case == "pd":
        controller = pd_feedforward.build(PdFeedforwardSettings(), plant)
    elif case in ("tracking_a", "tracking_b", "rigid_hold"):
        middle = {"hub_pitch": 0.5 * (start_pitch + _PITCH)}
        # the observer of the paper and of its table
        settings = OutputFeedback(mode=case, operating_point=middle, observer="steady")
        controller = output_feedback.build(settings, plant)
    return closed_loop(real, controller, plan.reference, 60.0), plan.end


def figures(run: LawRun, end: float) -> tuple[float, float, float]:
    """Return residual tip [m], largest yaw error [mdeg] after `end`, and the peak yaw torque."""
    after = run.state[int(np.ceil(end / PERIOD - 1e-9)) :]
    n = run.state.shape[1] // 2
    tip = float(abs(after[:, 2:n].sum(axis=1)).max())
    error = float(np.degrees(abs(after[:, 0] - _GOAL).max()) * 1e3)
    return tip, error, float(abs(run.effort[:, 0]).max())


_TABLE: dict[Case, tuple[tuple[float, ...], tuple[float, ...]]] = {
    # residual tip [m], yaw error [mdeg], peak torque [N m]: psi held, psi 0 -> .5
    "tracking_a": ((0.0031, 4.6, 35.5), (0.0037, 4.2, 33.7)),
    "tracking_b": ((0.0033, 4.2, 35.5), (0.0838, 45.2, 34.2)),
    "rigid_hold": ((1.584, 1925.0, 39.0), (1.504, 1872.0, 41.6)),
    "pd": ((2.611, 2043.0, 45.4), (2.009, 1704.0, 48.8)),
    "open_clamped": ((4.478,), (3.668,)),
    "open_system": ((0.0084,), (0.327,)),
}
_METRICS = ("residual tip [m]", "yaw error after the end [mdeg]", "peak torque [N m]")
_TOLERANCE = (0.10, 0.01, 0.01)
_ROUNDING = (0.00005, 0.05, 0.05)  # half a unit of the table's last digit


def ofc_rows() -> list[dict[str, Any]]:
    """Return the table of the output feedback cases, both columns, and the stiffness errors."""
    rows = []
    for column, pitch, end in ((0, 0.5, 26.552), (1, 0.0, 27.769)):
        where = "psi .5 held" if column == 0 else "psi 0 -> .5"
        for case, references in _TABLE.items():
            run, finish = slew(case, pitch)
            if case == "tracking_a":
                rows.append(relative(f"{where}: end [s]", _FILE, end, finish, 0.001 / end))
            values = zip(_METRICS, references[column], figures(run, finish), strict=False)
            for i, (metric, reference, computed) in enumerate(values):
                slack = max(_TOLERANCE[i], _ROUNDING[i] / reference)
                rows.append(
                    relative(f"{where}, {case}: {metric}", _FILE, reference, computed, slack)
                )
    for stiffness, name, tracking, pd in ((0.9, "-10 %", 0.261, 2.78), (1.1, "+10 %", 0.202, 2.39)):
        for case, reference in (("tracking_a", tracking), ("pd", pd)):
            computed = figures(*slew(case, 0.5, stiffness))[0]
            rows.append(
                relative(f"EI {name}, {case}: residual tip [m]", _FILE, reference, computed, 0.1)
            )
    return rows
