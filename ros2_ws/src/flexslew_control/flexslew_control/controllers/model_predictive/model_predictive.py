"""Model predictive control: the efforts of a horizon are optimised at every tick.

The prediction is that of the believed model's small motions about the operating point, of a craft
that turns in three axes about its plan (about_plan); its state and the disturbance of each effort
come from the Kalman filter. Limits of efforts and of their rates hold always; those of joints and
tips are softened where they cannot, with an event.
"""

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.lqr import ScaledWeights, scaled_problem
from flexslew_control.controllers.model_predictive.about_plan import PlanPrediction
from flexslew_control.controllers.model_predictive.ahead import (
    HorizonLimits,
    HorizonPrediction,
    HorizonProblem,
    HorizonQuestion,
    RestPrediction,
    Steps,
)
from flexslew_control.controllers.model_predictive.prediction import Costs, costs
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter, discrete_model
from flexslew_control.estimators.rotation_filter import RotationFilter, rotation_filter
from flexslew_control.law import Estimate, PlantDescription, Reference
from flexslew_control.linear.design_checks import (
    LinearDesignModel,
    OperatingPoint,
    operating_point_of,
    require_controllable,
    state_names,
)
from flexslew_control.linear.free_platform import joints_first
from flexslew_control.linear.rate_dependent_platform import (
    RateDependentPlatform,
    rate_dependent_platform,
)
from flexslew_control.shared_keys import DesignModel
from flexslew_plant.arrays import Matrix, Vector, read_only
from flexslew_plant.errors import BadInput
from flexslew_plant.events import AnswerRepeated, LimitViolation
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import Positive, section

_RESOLVED = 2.0  # of the fastest motion in a substep of the integration [rad]
_ITERATIONS, _SLEW_ITERATIONS = 200, 2000  # of the solver, unless they are given
_DISTINCT = 1e-9  # of two tips that are one, or mirrored


@section
class ModelPredictive:
    """Model predictive control with limits of efforts, their rates, joints and tips."""

    model: DesignModel = None
    operating_point: OperatingPoint = None
    steps: Annotated[int, Field(ge=1, le=200)] = 40  # steps of the horizon
    step: Positive = 0.25  # one of them, rounded to whole ticks, at least one [s]
    # weights of the quadratic criterion, as of `lqr`; what follows the horizon is weighed by the
    # regulator's cost
    weights: ScaledWeights = ScaledWeights()
    # factor of the weights of joints and modes while the reference moves [-]
    on_the_way: Positive = 1.0
    filter: FilterSettings = FilterSettings()  # the Kalman filter
    effort_rate: Positive | None = None  # largest rate of every effort [N m/s or N/s]; null: any
    # least and largest position by joint, as `{JOINT: [-0.1, 1.1]}` [rad or m]; null: any
    joint_range: dict[str, tuple[float, float]] | None = None
    # largest deflection of every tip [m], not of a craft that turns in three axes; null: any
    tip_limit: Positive | None = None
    # of the solver in a tick, at most; where they do not suffice, the last answer is applied again.
    # null: 200, of a craft that turns in three axes 2000
    iterations: Annotated[int, Field(ge=1)] | None = None


class ModelPredictiveLaw:
    """u = v(0) - d_hat, V the efforts that cost least over the horizon.

    While the reference moves its steps may be weighed less (`on_the_way`): with a small share
    the plan gives only where the motion ends, and when; the way there is the law's own. It is then
    optimised once a step, at ticks from which whole steps lead to that end: were the steps counted
    from every tick, the end would slip by up to one of them, and come back at once near it. Between
    these ticks only the estimated disturbance is compensated. A law with limited rates is optimised
    at every tick.

    Args:
        prediction: prediction by the design model.
    """

    def __init__(self, prediction: HorizonPrediction) -> None:
        self._prediction, self._steps, self._limits = (
            prediction,
            prediction.steps,
            prediction.limits,
        )
        limits, steps = self._limits, self._steps
        n, m = steps.count, limits.effort.size
        rates = 0 if limits.rate is None else (n - 1) * m
        rate_bounds = np.full(rates, (limits.rate or 0.0) * steps.ticks * steps.period)
        self._limit_sizes = np.concatenate((np.tile(limits.effort, n), rate_bounds))
        self._soft = np.tile(limits.lower, n), np.tile(limits.upper, n)
        # an effort with a limited rate must be free to go on at every tick
        self._by_steps = steps.on_the_way != 1.0 and limits.rate is None
        self._references: list[Reference] = []  # of the coming answer; none: the reference stays
        self._on_step = True  # whole steps lead from this tick to the end, or it is far
        self._is_new = True  # no answer yet
        self._active = np.zeros(n * m + rates + n * len(limits.names))
        self._last = read_only(np.zeros((n, m)))
        self._soft_active = self._repeats = False
        self.remarks: list[Any] = []  # of the last answer, for the log
        self.terms: dict[str, Vector] = {}

    def foresee(self, reference: Callable[[int], Reference], tick: int) -> None:
        """Look up the references at the ends of the steps from this tick on."""
        steps = self._steps
        self._references = [reference(tick + (i + 1) * steps.ticks) for i in range(steps.count)]
        steps_left = _steps_left(self._references)
        last = reference(tick + (steps_left + 1) * steps.ticks - 1)
        self._on_step = steps_left == steps.count or bool(last.velocity.any())

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Begin without an answer before."""
        self._active, self._soft_active, self._repeats = np.zeros_like(self._active), False, False
        self._last, self._is_new = read_only(np.zeros_like(self._last)), True
        self._prediction.restart()

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts, shape (joints,) [N m or N].

        Where the iterations do not suffice, the first effort of the answer before is applied again.
        """
        d, self.remarks = estimate.disturbance, []
        by_steps = self._by_steps and bool(reference.velocity.any())
        if self._on_step or self._is_new or not by_steps:
            self._solve(measurement, estimate, reference, by_steps)
        limit = self._limits.effort
        effort: Vector = np.clip(self._last[0] - d, -limit, limit)
        feedback = effort - reference.effort + d
        self.terms = {"feedforward": reference.effort, "regulator": feedback, "disturbance": -d}
        return effort

    def _solve(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, by_steps: bool
    ) -> None:
        """Optimise the efforts of the horizon, starting from the last ones; see update."""
        d, n = estimate.disturbance, self._steps.count
        references, self._references = self._references or [reference] * n, []
        steps_left = _steps_left(references)
        if by_steps and not self._is_new and steps_left < n:  # a step has gone by
            self._last = read_only(np.vstack((self._last[1:], self._last[-1:])))
        self._is_new = False
        requested = np.array([reference.effort, *(one.effort for one in references[:-1])])
        known = self._prediction.predict(
            HorizonQuestion(
                measurement.tick,
                measurement.time,
                estimate,
                [reference, *references],
                steps_left,
                self._last,
            )
        )
        lower, upper = self._bounds(measurement.applied_effort, d, known.outputs.ravel())
        solved, active = known.program.solve(known.off, requested, lower, upper, self._active)
        if not solved.optimal and not self._repeats:
            self.remarks = [AnswerRepeated(self._steps.iterations)]
        self._repeats = not solved.optimal
        if solved.optimal:
            self._active, self._last = active, read_only(solved.efforts)
            if solved.softened and not self._soft_active:
                self.remarks = [self._passed(known, solved.efforts)]
            self._soft_active = solved.softened

    def _bounds(self, applied: Vector, d: Vector, free: Vector) -> tuple[Vector, Vector]:
        """Return the limits of V, of its differences, and of the soft rows less their free part."""
        limits, m, steps = self._limits, len(d), self._steps
        lower, upper = -self._limit_sizes, self._limit_sizes.copy()
        for bound in (lower, upper):
            bound[: steps.count * m].reshape(-1, m)[:] += d
        if limits.rate is not None:
            # the next effort is one tick away, for any length of a step
            near = limits.rate * steps.period
            now = np.clip(applied, -limits.effort, limits.effort) + d
            lower[:m] = np.maximum(lower[:m], now - near)
            upper[:m] = np.minimum(upper[:m], now + near)
        return (
            np.concatenate((lower, self._soft[0] - free)),
            np.concatenate((upper, self._soft[1] - free)),
        )

    def _passed(self, known: HorizonProblem, efforts: Matrix) -> LimitViolation:
        """Return which limit the prediction passes, and by how much."""
        forced = (known.program.soft @ efforts.ravel()).reshape(known.outputs.shape)
        seen = known.outputs + forced
        excess = np.maximum(seen - self._limits.upper, self._limits.lower - seen)
        largest = int(excess.max(axis=0).argmax())
        return LimitViolation(self._limits.names[largest], float(excess[:, largest].max()))


def _steps_left(references: list[Reference]) -> int:
    """Return after how many steps the reference has come to its end."""
    velocities = np.array([one.velocity for one in references])
    return int(np.flatnonzero(velocities.any(axis=1)).max(initial=-1)) + 1


def build(
    settings: ModelPredictive, plant: PlantDescription
) -> tuple[KalmanFilter | RotationFilter, ModelPredictiveLaw]:
    """Return the filter and the law.

    Raises:
        BadInput: a mode is not controllable or not observable, the weights give no regulator,
            or a limit names what the testbed has not.
    """
    ticks = max(1, round(settings.step / plant.period))
    design_model = plant.design_model(settings.model)
    at = operating_point_of(plant, design_model, settings.operating_point)
    platform = rate_dependent_platform(design_model, at)
    most = settings.iterations or (_ITERATIONS if platform is None else _SLEW_ITERATIONS)
    steps = Steps(settings.steps, ticks, plant.period, settings.on_the_way, most)
    model = joints_first(design_model, at) if platform is None else platform.small
    rest = operating_point_of(plant, model, settings.operating_point)
    linear = model.linearise(rest)
    a, b = linear.state_matrix, linear.state_input_matrix
    require_controllable(a, b, state_names(model))
    problem = scaled_problem(linear, settings.weights)
    f, g, _ = discrete_model(a, b, np.zeros_like(a), steps.length)
    cost = costs(f, g, problem.q, problem.effort_weight)
    if platform is not None:
        return _plan_controller(settings, plant, platform, cost, steps)
    prediction = RestPrediction(
        model,
        np.concatenate((rest, np.zeros_like(rest))),
        (f, g),
        cost,
        _limits(settings, model, rest, plant.effort_limit),
        steps,
        max(1, int(np.ceil(steps.length * np.abs(np.linalg.eigvals(a)).max() / _RESOLVED))),
    )
    estimator = KalmanFilter(model, rest, settings.filter, plant.period)
    return estimator, ModelPredictiveLaw(prediction)


def _plan_controller(
    settings: ModelPredictive,
    plant: PlantDescription,
    platform: RateDependentPlatform,
    cost: Costs,
    steps: Steps,
) -> tuple[RotationFilter, ModelPredictiveLaw]:
    """Return filter and law of a craft that turns in three axes; see about_plan."""
    if settings.tip_limit is not None:
        raise BadInput(
            "a craft that turns in three axes is predicted about its plan, which does not tell "
            "how far it bends; leave it out",
            key="tip_limit",
            value=settings.tip_limit,
        )
    attitude = plant.testbed.model().attitude
    assert attitude is not None
    limits = _limits(settings, platform.small, platform.small.rest({}), plant.effort_limit)
    law = ModelPredictiveLaw(PlanPrediction(platform, attitude, cost, limits, steps))
    return rotation_filter(platform, settings.filter, plant), law


def _limits(
    s: ModelPredictive, model: LinearDesignModel, rest: Vector, effort: Vector
) -> HorizonLimits:
    """Return what the prediction keeps to, as rows of x about the rest.

    Raises:
        BadInput: a limit names what the testbed has not, or is none.
    """
    n, m = model.coordinates, model.joints
    rows, lower, upper, names = [], [], [], []
    for joint, (low, high) in (s.joint_range or {}).items():
        if joint not in model.joint_names:
            why = f"no such joint; there are {', '.join(model.joint_names)}"
            raise BadInput(why, key="joint_range", value=joint)
        if not low < high:
            raise BadInput("the first must be the smaller", key=f"joint_range.{joint}", value=low)
        k = model.joint_names.index(joint)
        rows.append(np.eye(2 * n)[k])
        lower.append(low - rest[k])
        upper.append(high - rest[k])
        names.append(joint)
    if s.tip_limit is not None:
        tips = model.appendages
        if not len(tips.tip):
            raise BadInput("the testbed has no tip", key="tip_limit", value=s.tip_limit)
        for name, tip in _distinct(tips.names, tips.tip):
            rows.append(np.concatenate((np.zeros(m), tip, np.zeros(n))))
            lower.append(-s.tip_limit)
            upper.append(s.tip_limit)
            names.append(f"tip {name}")
    matrix = np.array(rows).reshape(len(rows), 2 * n)
    return HorizonLimits(
        effort, s.effort_rate, matrix, np.array(lower), np.array(upper), tuple(names)
    )


def _distinct(names: tuple[str, ...], tips: Matrix) -> list[tuple[str, Vector]]:
    """Return the tips without those that mirror another one or do the same."""
    kept: list[tuple[str, Vector]] = []
    for name, tip in zip(names, tips, strict=True):
        size = _DISTINCT * np.abs(tip).max(initial=0.0)
        if all(min(abs(tip - of).max(), abs(tip + of).max()) > size for _, of in kept):
            kept.append((name, tip))
    return kept


MODEL_PREDICTIVE = LawEntry("model_predictive", ModelPredictive, build)
