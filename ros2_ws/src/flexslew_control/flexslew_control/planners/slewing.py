"""How a planner of slews makes a plan: from the bench to the slew, the plan and its residual."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.linalg import LinAlgError

from flexslew_control.analysis.linear_plant import PlantPath, motors
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.one_axis import (
    RELEVANT,
    has_single_axis,
    in_three_axes,
    more_modes,
    reduced,
)
from flexslew_control.planners.checks.one_way import shared_out
from flexslew_control.planners.checks.remedies import (
    PlanFunction,
    require_stable_loop,
    suggest_duration,
)
from flexslew_control.planners.entry import PlanTask
from flexslew_control.planners.held_efforts import end_error, exact_on_ticks, joints_at_rest
from flexslew_control.planners.progress import ignore
from flexslew_control.planners.residual.motors import Matrices, matrices
from flexslew_control.planners.residual.prediction import Prediction, motion_warning, predicted
from flexslew_control.planners.residual.whole_bench import (
    TIP_FLOOR,
    Better,
    as_predicted,
    by_feedback,
    ignored_settings,
    is_joint_feedback,
    simulate_on_bench,
    with_bench_residual,
    with_law_residual,
    without_simulation,
)
from flexslew_control.planners.slew import ExcessTorque, Feedback, Slew, known_motors, slew_of
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import starts_in_motion

# of the way to the goal
_EXACT = 1e-5  # residual above which efforts are made exact for their hold [m/rad or -]
_EXACT_RIGID = 1e-9  # the same of a rigid body, away from its goal [-]
_END_TOLERANCE = 1e-6  # what nominal joints may lack of rest at the goal, rates per second [-]
# of the largest deflection, above which a tip that swings on is warned of [-]
RESIDUAL_SHARE = 0.05
MOST_MODES = 4  # frequencies that are tried for one that is enough
# turns tried with less torque about the eigenaxis: a try fails only where a drive needs 1 % more
# per torque about the axis than in the one before, which the modes' largest response bounds
_MAX_ATTEMPTS = 20
_ROUNDING = 1e-9  # of the share of a drive's limit

# of a flight of a plan on the bench
_DIVERGENCE = (
    "that flight diverges: the law does not stabilise the bench, or the period is too long for its "
    "fastest mode; use a shorter one, or fewer modes"
)


@dataclass(frozen=True)
class SlewPlanner:
    """Makes plans by a function of section and slew.

    Args:
        plan: returns the plan of a slew.
        exact: returns whether the efforts of a section shall end at rest at the goal when each is
            held over its tick.
        rings: returns why the flight of a section may leave the tips vibrating, for a warning;
            empty: its plan has that warning already, or is not meant to leave them still.
        one_axis: whether a spacecraft with many joints is planned about the one that moves.
        open_loop: whether a section without `feedback` is for a slew without one, instead of
            one with the gains of the active controller.
        whole: returns whether a section plans a craft that turns in three axes as a whole,
            instead of about the eigenaxis.
        late_motors: whether the plan includes lag and delay of the motors.
        with_feedback: whether a plan as a whole depends on kp and kd of the joints that fly it.
        has_prediction: whether the summary of a plan has the residual under the active law.
        effort_share: returns the share of each drive's limit that a section leaves to the plan [-].
    """

    plan: PlanFunction
    exact: Callable[[Any], bool] = lambda settings: False
    rings: Callable[[Any], str] = lambda settings: ""
    one_axis: bool = True
    open_loop: bool = False
    whole: Callable[[Any], bool] = lambda settings: False
    late_motors: bool = False
    with_feedback: bool = False
    has_prediction: bool = True
    effort_share: Callable[[Any], float] = lambda settings: 1.0

    def __call__(self, task: PlanTask) -> Plan:
        """Return the plan of a section; see make_plan.

        Raises:
            PlanFailed: no such slew; the message carries the numbers.
            BadInput: the testbed is not moved by one effort per joint, or lacks what is named.
        """
        settings, plant, feedback, progress, law = task
        if self._uses_full_attitude(settings, plant):
            return self._full_plan(task)
        if self.is_single_axis(settings, plant):
            return self._single_axis_plan(task)
        slew = slew_of(settings, plant, feedback, self.late_motors)
        limit = plant.effort_limit
        if limit.size != slew.goal.size:
            raise BadInput(
                f"{slew.goal.size} numbers, one for each of {', '.join(slew.model.joint_names)}",
                key="effort_limit",
                value=limit.tolist(),
            )
        try:
            plan = self.plan(settings, slew, progress)
        except (PlanFailed, LinAlgError) as error:
            if self._counts_with_feedback(settings):
                require_stable_loop(slew)
            if isinstance(error, ExcessTorque):
                raise PlanFailed(
                    f"{error}; {suggest_duration(self.plan, settings, slew)}"
                ) from None
            raise PlanFailed(str(error)) from None
        if has_single_axis(
            plant
        ):  # a step has no prediction, and the slew's model is not the bench's
            return replace(plan, request=self._complete(settings, slew))
        on_model = predicted(plan, slew)
        rigid = not slew.model.modes
        left = on_model.attitude_error.max() if rigid else on_model.tip_deflection
        small, close = (_EXACT_RIGID if rigid else _EXACT) * slew.way, _END_TOLERANCE * slew.way
        if self.exact(settings) and (left > small or end_error(plan, slew) > close):
            allowed = self.effort_share(settings) * slew.effort_limit
            plan = exact_on_ticks(plan, slew, allowed)
            if end_error(plan, slew) > close:
                plan = joints_at_rest(plan, slew, allowed)
            on_model = predicted(plan, slew)
        from_rest = on_model
        if starts_in_motion(slew.testbed):
            on_model = predicted(plan, slew, in_motion=True)
        figures = {
            **self._residual_warning(settings, from_rest, motion_warning(from_rest, on_model)),
            "believes": slew.beliefs,
            "predicted_residual_tip_deflection": on_model.tip_deflection,
            "predicted_residual_attitude_error": slew.named(on_model.attitude_error),
        }
        plan = replace(
            plan, request=self._complete(settings, slew), summary={**plan.summary, **figures}
        )
        if law is None or not self.has_prediction:
            return plan
        return self._predict_with_law(law, plan, settings, slew, plant)

    def _motors(self, plant: PlantDescription) -> Matrices | None:
        """Return the dynamics from commands to efforts of a bench, if the planner includes it."""
        if not self.late_motors:
            return None
        path = PlantPath(plant.period, *known_motors(plant))
        return matrices(motors(path, tuple(map(str, range(plant.effort_limit.size)))))

    def _left(
        self, plan: Plan, plant: PlantDescription, active_law: ActiveLaw | None
    ) -> Prediction | None:
        """Return the residuals of a plan on the whole bench; None: no law, or it cannot fly it."""
        if active_law is None:
            return None
        return simulate_on_bench(plan, plant, active_law, motors=self._motors(plant))

    def _residual_warning(self, settings: Any, found: Prediction, more: str = "") -> dict[str, Any]:
        """Return a warning of tips that vibrate on, where the plan has none already."""
        reason, left = self.rings(settings), found.tip_deflection
        words = f"the tip vibrates by {left:.3g} m after the end: {reason}"
        parts = ([words] if reason and left > RESIDUAL_SHARE * found.peak else []) + [more] * bool(
            more
        )
        return {"warning": "; ".join(parts)} if parts else {}

    def _predict_with_law(
        self, law: ActiveLaw, plan: Plan, settings: Any, slew: Slew, plant: PlantDescription
    ) -> Plan:
        """Return the plan with what it leaves where the law in charge flies it.

        The model is that which the planner believes in; where it plans a spacecraft as a whole,
        the bench's.
        """
        if is_joint_feedback(law, slew) and not has_single_axis(plant):
            return plan
        model = None if has_single_axis(plant) else slew.testbed
        given = self._motors(plant)
        found = simulate_on_bench(plan, plant, law, model, given)
        if found is None:
            return plan
        hint = ""
        if not as_predicted(plan, found) and getattr(settings, "track", "planned") != "planned":
            alternative = self.plan(replace(settings, track="planned"), slew, ignore)
            other = simulate_on_bench(alternative, plant, law, model, given)
            if other is not None and other.tip_deflection < 0.5 * found.tip_deflection:
                hint = f"; track: planned leaves {other.tip_deflection:.3g} m"
        return with_law_residual(plan, plant, found, law, hint)

    def _counts_with_feedback(self, settings: Any) -> bool:
        """Return whether the slew of a section depends on the feedback that flies it."""
        given = getattr(settings, "feedback", None) is not None
        return given or (hasattr(settings, "feedback") and not self.open_loop)

    def is_single_axis(self, settings: Any, plant: PlantDescription) -> bool:
        """Return whether a section is planned about one axis: one_axis.counted reads its model."""
        # a plan of one's own that is there already has no goal, and is of all joints
        has_goal = getattr(settings, "goal", {}) is not None
        single_axis = self.one_axis and has_goal and has_single_axis(plant)
        return single_axis and not self._uses_full_attitude(settings, plant)

    def _uses_full_attitude(self, settings: Any, plant: PlantDescription) -> bool:
        return self.whole(settings) and in_three_axes(plant)

    def _full_plan(self, task: PlanTask) -> Plan:
        """Return the plan of a slew in three axes, with what it leaves on the bench.

        Raises:
            BadInput: a drive is a thruster or a gyro: every one is counted both ways, along one
                direction.
        """
        settings, plant, feedback, progress, _ = task
        for k in plant.testbed.model().gyros[:1]:
            name = plant.joint_names[k]
            words = f"{name} is a control moment gyro, whose torque turns; take moving"
            raise BadInput(words, "plan", "drives", "all")
        for k in plant.testbed.model().one_way[:1]:
            words = f"{plant.joint_names[k]} is a thruster, which pushes one way; take moving"
            raise BadInput(words, "plan", "drives", "all")
        slew = slew_of(settings, plant, feedback, self.late_motors)
        try:
            plan = self.plan(settings, slew, progress)
        except PlanFailed:
            if self._counts_with_feedback(settings):
                require_stable_loop(slew)
            raise
        active_law = _active_law(task)
        ignored = ignored_settings(active_law) if self.with_feedback and active_law else ""
        summary = {**plan.summary, "believes": ", ".join(filter(None, (slew.beliefs, ignored)))}
        plan = replace(plan, request=self._complete(settings, slew), summary=summary)
        if not self.has_prediction:
            return plan
        prediction = self._left(plan, plant, active_law)
        if prediction is None:
            return without_simulation(plan)
        return with_bench_residual(
            plan, plant, prediction, hint="give the law more room, by a reserve"
        )

    def _single_axis_plan(self, task: PlanTask) -> Plan:
        """Return the plan of a turn about one axis, with what it leaves on the whole bench.

        `model: {modes: relevant}` adds modes, those that the turn drives most first, until the
        plan leaves nothing on the whole bench, or no more than with more of them.
        """
        settings, plant = task.settings, task.plant
        active_law = _active_law(task)
        if (getattr(settings, "model", None) or {}).get("modes") == RELEVANT:
            active_law = active_law or by_feedback(Feedback())
            found = self._relevant(task, active_law, None)
            assert found is not None
            return with_bench_residual(found[0], plant, found[1].prediction)
        plan = self._embedded(task)
        if not self.has_prediction:
            return plan
        prediction = self._left(plan, plant, active_law)
        if active_law is None or prediction is None:
            return without_simulation(plan)
        plan = replace(
            plan, summary={**plan.summary, **self._residual_warning(settings, prediction)}
        )
        if as_predicted(plan, prediction):
            return with_bench_residual(plan, plant, prediction)
        if not np.isfinite(prediction.peak):
            return with_bench_residual(plan, plant, prediction, hint=_DIVERGENCE)
        better = self._relevant(task, active_law, prediction)
        return with_bench_residual(plan, plant, prediction, better and better[1])

    def _embedded(self, task: PlanTask) -> Plan:
        """Return the plan for all joints of a turn about one axis.

        The drives also hold the other axes: against products of inertia, gyroscopic torques and
        modes that turn the craft across the axis. A planner of the turn bounds the torque about the
        axis alone. This torque is reduced until every drive keeps to its usable share.

        Raises:
            BadInput: see shared_out.
            ExcessTorque: a drive has not what another axis needs, however slow the turn.
        """
        settings, plant, feedback, progress, law = task
        share, limit_share, needs = 1.0, self.effort_share(settings), ""
        # the flight on the whole bench shows whether it rings
        modified = replace(self, rings=lambda settings: "")
        for _ in range(_MAX_ATTEMPTS):
            turn = reduced(settings, plant, feedback, share)
            try:
                axis_plan = modified(PlanTask(turn.settings, turn.plant, turn.feedback, progress))
            except PlanFailed as error:
                if not needs:
                    raise
                raise ExcessTorque(f"{needs}; with less torque about the axis: {error}") from None
            plan, used = shared_out(turn.embedded(axis_plan), plant, law)
            if used <= limit_share * (1.0 + _ROUNDING):
                return plan
            ratios = abs(plan.effort).max(axis=0) / plant.effort_limit
            needs = (
                f"{plant.joint_names[int(ratios.argmax())]} needs {used:.3g} times its limit, "
                f"{limit_share:.3g} is allowed"
            )
            share *= 0.99 * limit_share / used
        raise ExcessTorque(f"{needs}; use a longer duration")

    def _relevant(
        self, task: PlanTask, law: ActiveLaw, than: Prediction | None
    ) -> tuple[Plan, Better] | None:
        """Return the plan on the modes that matter; None: none is better than what there is.

        Raises:
            PlanFailed: there is no plan on the first of the modes, or the law flies none.
        """
        settings, plant = task.settings, task.plant
        best: tuple[Plan, Better] | None = None
        least = np.inf if than is None else 0.5 * than.tip_deflection
        requested = getattr(settings, "model", None)
        for count in range(1, MOST_MODES + 1):
            if than is not None and count == (requested or {"modes": 1}).get("modes"):
                continue  # that is what there is
            modified = replace(settings, model={**(requested or {}), "modes": count})
            try:
                plan = self._embedded(task._replace(settings=modified, law=law))
            except PlanFailed:
                if best is None and than is None:
                    raise
                break
            prediction = self._left(plan, plant, law)
            if prediction is None:
                if than is None:
                    raise PlanFailed(
                        f"model: modes: relevant: {law.law} cannot fly the plan, so nothing says "
                        "which modes matter; give a number of modes"
                    )
                break
            if prediction.tip_deflection < least:
                best, least = (plan, Better(count, prediction)), prediction.tip_deflection
            if least <= TIP_FLOOR or not more_modes(settings, plant, count):
                break
        return best

    def _complete(self, settings: Any, slew: Slew) -> dict[str, Any]:
        """Return the section with everything that it took from the bench written out."""
        requested: dict[str, Any] = plain(settings)
        resolved = {
            "model": plain(slew.testbed),
            "initial": slew.named(slew.start),
            "goal": slew.named(slew.goal),
            "feedback": {"kp": slew.kp.tolist(), "kd": slew.kd.tolist()},
        }
        if requested.get("feedback") is None and self.open_loop:
            del resolved["feedback"]
        return requested | {key: value for key, value in resolved.items() if key in requested}


def _active_law(task: PlanTask) -> ActiveLaw | None:
    """Return the law that flies the plan; without one, joint feedback with the gains if any."""
    gains = getattr(task.settings, "feedback", None) or task.feedback
    return task.law or (by_feedback(gains) if gains else None)
