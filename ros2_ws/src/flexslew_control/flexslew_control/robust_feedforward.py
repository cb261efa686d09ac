"""The planner whose feedforward suits an ensemble of models: little vibration whatever the error.

One feedforward flies every member of the ensemble, each under its own feedback. The weights U
minimise
    sum_i Y_i^T W_i Y_i / members + rho ||U||^2,
with Y_i the terminal error (20) of papers/000 on member i. W_i is the mean over one more duration
of tip^2 + (lever angle errors)^2 that Y_i leads to in the closed loop, linearised at the goal: an
error counts by the vibration that it leaves, not by its unit.

What M1 costs, worst residual at up to 20 % error of EI and largest effort: 0.27 m, 125 N m in 25 s
(0.18 m takes 253 N m); 0.18 m, 104 N m in 30 s; 0.07 m, 53 N m in 40 s. The plan that is exact for
one model leaves 0.64, 0.44 and 0.29 m. Every plan here gives up some of the nominal residual.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flexslew_control.basis import Basis, BasisName
from flexslew_control.gauss_newton import Progress, Update
from flexslew_control.manoeuvre import Manoeuvre, TerminalMap, stage_times, substeps_for
from flexslew_control.optimized_feedforward import on_ticks
from flexslew_control.plan import Plan
from flexslew_control.slew_request import CsaGoal, CsaModel, Feedback, csa_manoeuvre
from flexslew_control.trajectories import Profile, rest_to_rest
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.csa import CsaInitial
from flexslew_plant.errors import PlanFailed
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds import with_stiffness

_Error = Annotated[float, Field(gt=-0.9, le=5.0)]
_Errors = Annotated[tuple[_Error, ...], Field(min_length=1, max_length=25)]
_HALVINGS = 12  # of a step that makes things worse
_DOUBLINGS = 14  # of the first interval of the Gramian
_WATCHED = 75.0  # after the end, for the residual of the summary [s]


@section
class RobustFeedforward:
    """The `plan` section for method robust_feedforward."""

    method: Literal["robust_feedforward"] = "robust_feedforward"
    model: CsaModel = CsaModel()
    initial: CsaInitial = CsaInitial()
    goal: CsaGoal = CsaGoal()
    start: NonNegative = 0.0  # [s]
    duration: Positive = 30.0  # T_c [s]
    reference: Profile = "cubic"
    feedback: Feedback = Feedback()
    stiffness_errors: _Errors = (-0.2, -0.1, 0.0, 0.1, 0.2)  # of EI, relative; one a member [-]
    payload_errors: _Errors = (0.0,)  # of hub_inertia_1 and _2; every pair is a member [-]
    basis: BasisName = "hat"
    functions: Annotated[int, Field(ge=1, le=200)] = 11  # n_u, per joint
    lever: NonNegative = 5.0  # as how many metres of the tip a radian counts [m/rad]
    rho: Positive = 4.0e-8  # what torque costs [1/(N m)^2]
    max_iterations: Annotated[int, Field(ge=1)] = 60
    tolerance: Positive = 1e-3  # relative change of the weights


@dataclass(frozen=True)
class Member:
    """One model of the ensemble, as a slew.

    Args:
        stiffness_error: of its EI [-].
        payload_error: of its hub's inertias [-].
        manoeuvre: the slew under the feedback.
        lever: as how many metres of the tip a radian counts [m/rad].
    """

    stiffness_error: float
    payload_error: float
    manoeuvre: Manoeuvre
    lever: float

    @property
    def weight(self) -> Matrix:
        """W^(1/2), shape (2 n, 2 n): |W^(1/2) Y| is the later vibration [m]."""
        m = self.manoeuvre
        n, joints = m.model.coordinates, m.model.joints
        rest = np.concatenate((m.goal, np.zeros(n - joints)))
        a = m.model.linearise(rest).with_feedback(m.kp, m.kd).state_matrix
        seen = np.zeros((joints + 1, 2 * n))
        seen[:joints, :joints] = self.lever * np.eye(joints)
        seen[joints, joints:n] = 1.0  # the tip
        # integral of e^(A^T t) C^T C e^(A t), doubled again and again; it needs no damping
        h = m.duration / 2.0**_DOUBLINGS
        step, one = a * h, np.eye(2 * n)
        power = one + step @ (one + step @ (one + step @ (one + step / 4.0) / 3.0) / 2.0)
        gramian = h / m.duration * seen.T @ seen
        for _ in range(_DOUBLINGS):
            gramian = gramian + power.T @ gramian @ power
            power = power @ power
        values, vectors = np.linalg.eigh(0.5 * (gramian + gramian.T))
        return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)

    def flown(self, basis: Basis, weights: Matrix) -> tuple[float, Vector]:
        """Return the largest tip deflection after the end [m] and the peak effort of the joints.

        Args:
            basis: of the feedforward.
            weights: shape (n_u, joints) [N m].
        """
        m = self.manoeuvre
        n, joints = m.model.coordinates, m.model.joints
        pieces = (len(basis.nodes) - 1) * substeps_for(m, basis)
        step = m.duration / pieces
        edges = step * np.arange(pieces + int(np.ceil(_WATCHED / step)) + 1, dtype=np.float64)
        path = m.fly(edges, basis.values(stage_times(edges)) @ weights)
        wanted = rest_to_rest(m.reference, m.start, m.goal, m.duration, edges)
        effort = (
            basis.values(edges) @ weights
            + m.kp * (wanted.position - path[:, :joints])
            + m.kd * (wanted.velocity - path[:, n : n + joints])
        )
        tip = path[pieces:, joints:n].sum(axis=1)
        return float(np.abs(tip).max()), np.abs(effort).max(axis=0)


def ensemble(settings: RobustFeedforward) -> tuple[Member, ...]:
    """Return a member for every pair of a stiffness error and a payload error."""
    members = []
    for payload in settings.payload_errors:
        p = settings.model.parameters
        loaded = replace(
            settings.model,
            parameters=replace(
                p,
                hub_inertia_1=p.hub_inertia_1 * (1.0 + payload),
                hub_inertia_2=p.hub_inertia_2 * (1.0 + payload),
            ),
        )
        slew = csa_manoeuvre(
            loaded,
            settings.initial,
            settings.goal,
            settings.duration,
            settings.feedback,
            settings.reference,
        )
        for error in settings.stiffness_errors:
            model = with_stiffness(slew.model, 1.0 + error)
            members.append(Member(error, payload, replace(slew, model=model), settings.lever))
    return tuple(members)


def plan_robust_feedforward(
    settings: RobustFeedforward, period: float, effort_limit: Vector, progress: Progress
) -> Plan:
    """Return the plan whose feedforward suits the whole ensemble; see make_plan.

    Raises:
        PlanFailed: the iteration does not settle, or a member needs more than the drives have.
    """
    members = ensemble(settings)
    nominal = csa_manoeuvre(
        settings.model,
        settings.initial,
        settings.goal,
        settings.duration,
        settings.feedback,
        settings.reference,
    )
    basis = Basis(settings.basis, settings.functions, settings.duration)
    history = _optimised(settings, members, basis, progress)
    weights = history[-1][0].reshape(nominal.model.joints, -1).T
    flown = [member.flown(basis, weights) for member in members]
    peaks = np.array([peak for _, peak in flown])
    for j, name in enumerate(nominal.model.joint_names):
        worst = int(np.argmax(peaks[:, j]))
        if not peaks[worst, j] <= effort_limit[j]:
            raise PlanFailed(
                f"the ensemble needs {peaks[worst, j]:.4g} N m on {name} (EI "
                f"{100.0 * members[worst].stiffness_error:+g} %), the limit is "
                f"{effort_limit[j]:g} N m; use a longer duration than {settings.duration:g} s or "
                f"a larger rho than {settings.rho:g}"
            )
    plan = on_ticks(settings, nominal, basis, weights, period, effort_limit)
    last = history[-1][1]
    found: dict[str, Any] = {
        "objective": last.objective,
        "norm_input": last.norm_input,
        "iterations": len(history),
        "worst_residual": max(residual for residual, _ in flown),
        "members": [
            {
                "stiffness_error": member.stiffness_error,
                "payload_error": member.payload_error,
                "residual": residual,  # largest tip deflection in 75 s after the end [m]
                "peak_effort": peak.tolist(),
            }
            for member, (residual, peak) in zip(members, flown, strict=True)
        ],
        "worst_peak_effort": peaks.max(axis=0).tolist(),
        "weights": weights.T.tolist(),
    }
    return replace(plan, summary=found | plan.summary)


def _optimised(
    settings: RobustFeedforward, members: tuple[Member, ...], basis: Basis, progress: Progress
) -> list[tuple[Vector, Update]]:
    """Return the weights U of every update, the last ones optimal.

    Gauss-Newton, (rho I + G^T G) U+ = G^T (G U - Y) with the members' rows stacked, a step halved
    while it makes the objective larger.

    Raises:
        PlanFailed: it does not settle.
    """
    substeps = max(substeps_for(member.manoeuvre, basis) for member in members)
    maps = [TerminalMap(member.manoeuvre, basis, substeps) for member in members]
    scales = [member.weight / np.sqrt(len(members)) for member in members]
    pairs = list(zip(scales, maps, strict=True))
    u = np.zeros(settings.functions * members[0].manoeuvre.model.joints)
    y = np.concatenate([w @ at.terminal_error(u) for w, at in pairs])
    cost = float(y @ y)
    history: list[tuple[Vector, Update]] = []
    for k in range(settings.max_iterations):
        g = np.vstack([w @ at.sensitivity() for w, at in pairs])
        normal = g.T @ g
        normal.flat[:: len(u) + 1] += settings.rho
        step = np.linalg.solve(normal, g.T @ (g @ u - y)) - u
        for _ in range(_HALVINGS):
            new = u + step
            y = np.concatenate([w @ at.terminal_error(new) for w, at in pairs])
            finite = np.isfinite(y).all() and np.abs(y).max() < 1e6
            value = float(y @ y + settings.rho * (new @ new)) if finite else np.inf
            if value <= cost * (1.0 + 1e-12):
                break
            step = 0.5 * step
        else:
            break
        u, cost = new, value
        size = float(np.linalg.norm(u))
        change = float(np.linalg.norm(step)) / max(size, 1e-300)
        history.append((u, Update(k + 1, cost, float(np.linalg.norm(y)), size, change, True)))
        progress(history[-1][1])
        if change <= settings.tolerance or size == 0.0:
            return history
    reached = f"relative change {history[-1][1].change:.1e}" if history else "no step helps"
    raise PlanFailed(
        f"the ensemble did not converge after {len(history)} updates: {reached}, allowed "
        f"{settings.tolerance:.1e}; use a longer duration than {settings.duration:g} s or a larger "
        f"rho than {settings.rho:g}"
    )
