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
    in_three_axes,
    more_modes,
    reduced,
    turns,
)
from flexslew_control.planners.held_efforts import exact_on_ticks, joints_at_rest, missed
from flexslew_control.planners.motors import Matrices, matrices
from flexslew_control.planners.one_way import shared_out
from flexslew_control.planners.prediction import Prediction, predicted, swing
from flexslew_control.planners.progress import Progress, ignore
from flexslew_control.planners.remedies import PlanFunction, enough_time, require_holding
from flexslew_control.planners.slew import Feedback, Slew, TooMuchTorque, known_motors, slew_of
from flexslew_control.planners.whole_bench import (
    NOTHING,
    Better,
    as_predicted,
    by_feedback,
    counted_with,
    flown_on_bench,
    not_counted,
    not_flown,
    told,
    told_by_law,
)
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import starts_moving

# of the way to the goal
_EXACT = 1e-5  # residual above which efforts are made exact for their hold [m/rad or -]
_EXACT_RIGID = 1e-9  # the same of a rigid body, away from its goal [-]
_MISSED = 1e-6  # what nominal joints may lack of rest at the goal, rates per second [-]
RINGING = 0.05  # of the largest deflection, above which a tip that swings on is warned of [-]
MOST_MODES = 4  # frequencies that are tried for one that is enough
# turns tried with less torque about the eigenaxis: a try fails only where a drive needs 1 % more
# per torque about the axis than in the one before, which the modes' largest response bounds
_SLOWER = 20
_ROUNDING = 1e-9  # of the share of a drive's limit

# of a flight of a plan on the bench
_DIVERGES = (
    "that flight diverges: the law does not stabilise the bench, or the period is too long for its "
    "fastest mode; use a shorter one, or fewer modes"
)


@dataclass(frozen=True)
class Slewing:
    """Makes plans by a function of section and slew.

    Args:
        plan: returns the plan of a slew.
        exact: returns whether the efforts of a section shall end at rest at the goal when each is
            held over its tick; None: of no section.
        rings: returns why the flight of a section may leave the tips vibrating, for a warning;
            empty: its plan has that warning already. None: no section is meant to leave them still.
        one_axis: whether a spacecraft with many joints is planned about the one that moves.
        open_loop: whether a section without `feedback` is for a slew without one, instead of
            one with the gains of the active controller.
        whole: returns whether a section plans a craft that turns in three axes as a whole,
            instead of about the eigenaxis; None: no section does.
        late_motors: whether the plan includes lag and delay of the motors.
        with_feedback: whether a plan as a whole depends on kp and kd of the joints that fly it.
        predicts: whether the summary of a plan has the residual under the active law.
        usable: returns the share of each drive's limit that a section leaves to the plan [-]; None:
            all of it.
    """

    plan: PlanFunction
    exact: Callable[[Any], bool] | None = None
    rings: Callable[[Any], str] | None = None
    one_axis: bool = True
    open_loop: bool = False
    whole: Callable[[Any], bool] | None = None
    late_motors: bool = False
    with_feedback: bool = False
    predicts: bool = True
    usable: Callable[[Any], float] | None = None

    def __call__(
        self,
        settings: Any,
        plant: PlantDescription,
        feedback: Feedback | None,
        progress: Progress,
        law: ActiveLaw | None = None,
    ) -> Plan:
        """Return the plan of a section; see make_plan.

        Raises:
            PlanFailed: no such slew; the message carries the numbers.
            BadInput: the testbed is not moved by one effort per joint, or lacks what is named.
        """
        if self._of_whole(settings, plant):
            return self._as_whole(settings, plant, feedback, progress, law)
        if self.about_one_axis(settings, plant):
            return self._turned(settings, plant, feedback, progress, law)
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
                require_holding(slew)
            if isinstance(error, TooMuchTorque):
                raise PlanFailed(f"{error}; {enough_time(self.plan, settings, slew)}") from None
            raise PlanFailed(str(error)) from None
        if turns(plant):  # a step has no prediction, and the slew's model is not the bench's
            return replace(plan, request=self._complete(settings, slew))
        on_model = predicted(plan, slew)
        exact = self.exact is not None and self.exact(settings)
        rigid = not slew.model.modes
        left = on_model.attitude_error.max() if rigid else on_model.tip_deflection
        small, close = (_EXACT_RIGID if rigid else _EXACT) * slew.way, _MISSED * slew.way
        if exact and (left > small or missed(plan, slew) > close):
            allowed = self._usable(settings) * slew.effort_limit
            plan = exact_on_ticks(plan, slew, allowed)
            if missed(plan, slew) > close:
                plan = joints_at_rest(plan, slew, allowed)
            on_model = predicted(plan, slew)
        from_rest = on_model
        if starts_moving(slew.testbed):
            on_model = predicted(plan, slew, moving=True)
        figures = {
            **self._ringing(settings, from_rest, swing(from_rest, on_model)),
            "believes": slew.beliefs,
            "predicted_residual_tip_deflection": on_model.tip_deflection,
            "predicted_residual_attitude_error": slew.named(on_model.attitude_error),
        }
        plan = replace(
            plan, request=self._complete(settings, slew), summary={**plan.summary, **figures}
        )
        if law is None or not self.predicts:
            return plan
        return self._flown_by(law, plan, settings, slew, plant)

    def _usable(self, settings: Any) -> float:
        """Return the share of each drive's limit that the plan of a section may use [-]."""
        return 1.0 if self.usable is None else self.usable(settings)

    def _motors(self, plant: PlantDescription) -> Matrices | None:
        """Return the dynamics from commands to efforts of a bench, if the planner includes it."""
        if not self.late_motors:
            return None
        path = PlantPath(plant.period, *known_motors(plant))
        return matrices(motors(path, tuple(map(str, range(plant.effort_limit.size)))))

    def _left(
        self, plan: Plan, plant: PlantDescription, flies: ActiveLaw | None
    ) -> Prediction | None:
        """Return the residuals of a plan on the whole bench; None: no law, or it cannot fly it."""
        if flies is None:
            return None
        return flown_on_bench(plan, plant, flies, motors=self._motors(plant))

    def _ringing(self, settings: Any, found: Prediction, more: str = "") -> dict[str, Any]:
        """Return a warning of tips that vibrate on, where the plan has none already.

        Args:
            settings: the section.
            found: the prediction from rest.
            more: another warning; empty: none.
        """
        rings, left = self.rings(settings) if self.rings is not None else "", found.tip_deflection
        words = f"the tip vibrates by {left:.3g} m after the end: {rings}"
        parts = ([words] if rings and left > RINGING * found.peak else []) + [more] * bool(more)
        return {"warning": "; ".join(parts)} if parts else {}

    def _flown_by(
        self, law: ActiveLaw, plan: Plan, settings: Any, slew: Slew, plant: PlantDescription
    ) -> Plan:
        """Return the plan with what it leaves where the law in charge flies it.

        The model is that which the planner believes in; where it plans a spacecraft as a whole,
        the bench's.
        """
        if counted_with(law, slew) and not turns(plant):
            return plan
        model = None if turns(plant) else slew.testbed
        given = self._motors(plant)
        found = flown_on_bench(plan, plant, law, model, given)
        if found is None:
            return plan
        remedy = ""
        if not as_predicted(plan, found) and getattr(settings, "track", "planned") != "planned":
            about = self.plan(replace(settings, track="planned"), slew, ignore)
            other = flown_on_bench(about, plant, law, model, given)
            if other is not None and other.tip_deflection < 0.5 * found.tip_deflection:
                remedy = f"; track: planned leaves {other.tip_deflection:.3g} m"
        return told_by_law(plan, plant, found, law, remedy)

    def _counts_with_feedback(self, settings: Any) -> bool:
        """Return whether the slew of a section depends on the feedback that flies it."""
        given = getattr(settings, "feedback", None) is not None
        return given or (hasattr(settings, "feedback") and not self.open_loop)

    def about_one_axis(self, settings: Any, plant: PlantDescription) -> bool:
        """Return whether a section is planned about one axis: one_axis.counted reads its model."""
        # a plan of one's own that is there already has no goal, and is of all joints
        planned = getattr(settings, "goal", {}) is not None
        alone = self.one_axis and planned and turns(plant)
        return alone and not self._of_whole(settings, plant)

    def _of_whole(self, settings: Any, plant: PlantDescription) -> bool:
        return self.whole is not None and self.whole(settings) and in_three_axes(plant)

    def _as_whole(
        self,
        settings: Any,
        plant: PlantDescription,
        feedback: Feedback | None,
        progress: Progress,
        law: ActiveLaw | None,
    ) -> Plan:
        """Return the plan of a slew in three axes, with what it leaves on the bench.

        Raises:
            BadInput: a drive is a thruster or a gyro: every one is counted both ways, along one
                direction.
        """
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
                require_holding(slew)
            raise
        plan = replace(
            plan,
            request=self._complete(settings, slew),
            summary={**plan.summary, "believes": slew.beliefs},
        )
        gains = getattr(settings, "feedback", None) or feedback
        flies = law or (by_feedback(gains) if gains else None)
        if self.with_feedback and flies is not None:
            words = ", ".join(filter(None, (slew.beliefs, not_counted(flies))))
            plan = replace(plan, summary={**plan.summary, "believes": words})
        if not self.predicts:
            return plan
        prediction = self._left(plan, plant, flies)
        if prediction is None:
            return not_flown(plan)
        return told(plan, plant, prediction, remedy="give the law more room, by a reserve")

    def _turned(
        self,
        settings: Any,
        plant: PlantDescription,
        feedback: Feedback | None,
        progress: Progress,
        law: ActiveLaw | None,
    ) -> Plan:
        """Return the plan of a turn about one axis, with what it leaves on the whole bench.

        `model: {modes: relevant}` adds modes, those that the turn drives most first, until the
        plan leaves nothing on the whole bench, or no more than with more of them.
        """
        asked = (getattr(settings, "model", None) or {}).get("modes") == RELEVANT
        gains = getattr(settings, "feedback", None) or feedback
        flies = law or (by_feedback(gains) if gains else None)
        if asked:
            flies = flies or by_feedback(Feedback())
            found = self._relevant(settings, plant, feedback, flies, progress, None)
            assert found is not None
            return told(found[0], plant, found[1].prediction)
        plan = self._embedded(settings, plant, feedback, progress, law)
        if not self.predicts:
            return plan
        prediction = self._left(plan, plant, flies)
        if flies is None or prediction is None:
            return not_flown(plan)
        plan = replace(plan, summary={**plan.summary, **self._ringing(settings, prediction)})
        if as_predicted(plan, prediction):
            return told(plan, plant, prediction)
        if not np.isfinite(prediction.peak):
            return told(plan, plant, prediction, remedy=_DIVERGES)
        better = self._relevant(settings, plant, feedback, flies, progress, prediction)
        return told(plan, plant, prediction, better and better[1])

    def _embedded(
        self,
        settings: Any,
        plant: PlantDescription,
        feedback: Feedback | None,
        progress: Progress,
        law: ActiveLaw | None,
    ) -> Plan:
        """Return the plan for all joints of a turn about one axis.

        The drives also hold the other axes: against products of inertia, gyroscopic torques and
        modes that turn the craft across the axis. A planner of the turn bounds the torque about the
        axis alone. This torque is reduced until every drive keeps to its usable share.

        Raises:
            BadInput: see shared_out.
            TooMuchTorque: a drive has not what another axis needs, however slow the turn.
        """
        share, usable, needs = 1.0, self._usable(settings), ""
        own = replace(self, rings=None)  # the flight on the whole bench shows whether it rings
        for _ in range(_SLOWER):
            turn = reduced(settings, plant, feedback, share)
            try:
                about_axis = own(turn.settings, turn.plant, turn.feedback, progress)
            except PlanFailed as error:
                if not needs:
                    raise
                raise TooMuchTorque(f"{needs}; with less torque about the axis: {error}") from None
            plan, used = shared_out(turn.embedded(about_axis), plant, law)
            if used <= usable * (1.0 + _ROUNDING):
                return plan
            shares = abs(plan.effort).max(axis=0) / plant.effort_limit
            needs = (
                f"{plant.joint_names[int(shares.argmax())]} needs {used:.3g} times its limit, "
                f"{usable:.3g} is allowed"
            )
            share *= 0.99 * usable / used
        raise TooMuchTorque(f"{needs}; use a longer duration")

    def _relevant(
        self,
        settings: Any,
        plant: PlantDescription,
        feedback: Feedback | None,
        flies: ActiveLaw,
        progress: Progress,
        than: Prediction | None,
    ) -> tuple[Plan, Better] | None:
        """Return the plan on the modes that matter; None: none is better than what there is.

        Raises:
            PlanFailed: there is no plan on the first of the modes, or the law flies none.
        """
        best: tuple[Plan, Better] | None = None
        least = np.inf if than is None else 0.5 * than.tip_deflection
        keys = {k: v for k, v in (getattr(settings, "model", None) or {}).items() if k != "modes"}
        asked = getattr(settings, "model", None)
        for count in range(1, MOST_MODES + 1):
            if than is not None and count == (asked or {"modes": 1}).get("modes"):
                continue  # that is what there is
            model = {**keys, "modes": count}
            try:
                own = replace(settings, model=model)
                plan = self._embedded(own, plant, feedback, progress, flies)
            except PlanFailed:
                if best is None and than is None:
                    raise
                break
            prediction = self._left(plan, plant, flies)
            if prediction is None:
                if than is None:
                    raise PlanFailed(
                        f"model: modes: relevant: {flies.law} cannot fly the plan, so nothing says "
                        "which modes matter; give a number of modes"
                    )
                break
            if prediction.tip_deflection < least:
                best, least = (plan, Better(count, prediction)), prediction.tip_deflection
            if least <= NOTHING or not more_modes(settings, plant, count):
                break
        return best

    def _complete(self, settings: Any, slew: Slew) -> dict[str, Any]:
        """Return the section with everything that it took from the bench written out."""
        asked: dict[str, Any] = plain(settings)
        resolved = {
            "model": plain(slew.testbed),
            "initial": slew.named(slew.start),
            "goal": slew.named(slew.goal),
            "feedback": {"kp": slew.kp.tolist(), "kd": slew.kd.tolist()},
        }
        if asked.get("feedback") is None and self.open_loop:
            del resolved["feedback"]
        return asked | {key: value for key, value in resolved.items() if key in asked}
