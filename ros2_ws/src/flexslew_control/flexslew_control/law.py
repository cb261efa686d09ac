"""The contract of a control law, its estimator and the reference that it follows."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from flexslew_plant.arrays import EMPTY, Matrix, Vector, read_only, read_only_view
from flexslew_plant.bench.retarget import with_schedule
from flexslew_plant.bench.schedule import Schedule, command_delay_ticks
from flexslew_plant.errors import BadInput, FlexslewError
from flexslew_plant.hardware.actuator import IDEAL, ActuatorSettings
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import Model, Testbed, design_testbed, read_testbed
from flexslew_plant.yaml_data import load_yaml


def per_joint(name: str, given: tuple[float, ...], joints: tuple[str, ...]) -> Vector:
    """Return one number per joint, shape (joints,).

    Args:
        name: the key, for the error.
        given: one per joint, or one for all.
        joints: their names.

    Raises:
        BadInput: another number of them.
    """
    if len(given) not in (1, len(joints)):
        raise BadInput(
            f"give 1 or {len(joints)} numbers ({', '.join(joints)})", key=name, value=list(given)
        )
    return np.array(given, dtype=np.float64) * np.ones(len(joints))


class LawFailed(FlexslewError):
    """A law or its estimator cannot go on; its controller is not ready from then on."""


class WrongShape(LawFailed):
    """A law has returned efforts of a shape that no drive takes: its code needs a change."""


@dataclass(frozen=True)
class PlantDescription:
    """What a law is designed for.

    Args:
        testbed: that stands on the bench.
        period: one tick [s].
        effort_limit: of the drives, shape (actuators,) [N m or N].
        trust: which classes of the user's own may be loaded for it.
        actuator: the motors.
        delay: of what reaches each motor from the start on, shape (actuators,) [ticks]; empty:
            none.
        schedule: of the bench.
    """

    testbed: Testbed
    period: float
    effort_limit: Vector
    trust: Trust = NO_CODE
    actuator: ActuatorSettings = IDEAL
    delay: Vector = field(default_factory=lambda: EMPTY)
    schedule: Schedule = ()

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """In the order of the measurements."""
        return self.testbed.model().joint_names

    def with_design_model(self, changes: dict[str, Any] | None) -> "PlantDescription":
        """Return the plant that a law believes to be there; see believed."""
        return replace(self, testbed=design_testbed(self.testbed, changes, "model", self.trust))

    def design_model(self, changes: dict[str, Any] | None) -> Model:
        """Return the model that a law believes in; see testbeds.believed.

        Args:
            changes: the law's `model` section: keys of the testbed that it believes otherwise.

        Raises:
            BadInput: an unknown key or a value that is not allowed.
        """
        return self.with_design_model(changes).testbed.model()


def plant_description(settings: str, source: str, trust: Trust = NO_CODE) -> PlantDescription:
    """Return the plant that a /testbed record describes.

    Args:
        settings: its settings, YAML: those of the bench, or of the plant node with the bench's.
        source: of the record, for an error.
        trust: which kinds of the user's own may be loaded.

    Raises:
        BadInput: it holds no testbed, or one that cannot be built.
    """
    values = load_yaml(settings, source)
    bench = values.get("bench", values) if isinstance(values, dict) else {}
    if not isinstance(bench, dict) or "testbed" not in bench:
        raise BadInput("does not name its testbed (no testbed)", source)
    period = bench.get("period")
    if not isinstance(period, int | float) or not 0.0 < period < np.inf:
        raise BadInput("give seconds above 0", source, "period", period)
    testbed = read_testbed(bench["testbed"], f"{source}: testbed", trust)
    schedule = validated(Schedule, bench.get("schedule") or (), f"{source}: schedule")
    testbed = with_schedule(testbed, schedule)  # what turns when is known beforehand
    limit = np.array(testbed.effort_limit, dtype=np.float64)
    actuator = validated(ActuatorSettings, bench.get("actuator") or {}, f"{source}: actuator")
    delay = command_delay_ticks(schedule, testbed.model().joint_names, 0.0)
    return PlantDescription(testbed, float(period), limit, trust, actuator, delay, schedule)


class ActiveLaw(NamedTuple):
    """The law of the controller that will fly a plan."""

    law: str  # see controllers.build_controller
    settings: Mapping[str, Any]  # of the controller, as a trial's


class Reference(NamedTuple):
    """The plan's reference at this tick."""

    position: Vector  # joints, (joints,) [rad or m]
    velocity: Vector  # joints, (joints,) [rad/s or m/s]
    effort: Vector  # feedforward, mean over the coming tick, (joints,) [N m or N]
    state: Vector  # nominal state [q, v] of the planner's model, (2 n,); empty where there is none
    next_state: Vector = EMPTY  # the same one tick later; empty where there is none
    gains: Vector = EMPTY  # of a law that takes them from the plan; empty where there is none


class Estimate(NamedTuple):
    """What an estimator believes at this tick: the joints first, then its modes."""

    position: Vector  # (joints + modes,)
    velocity: Vector  # (joints + modes,)
    disturbance: Vector  # effort on each joint, (joints,) [N m or N]; empty if not estimated
    covariance: Matrix  # of the estimator's own state; (0, 0) where it has none
    innovation: Vector  # measured minus predicted outputs; empty where there is none
    nis: float = 0.0  # normalised innovation squared


def read_only_estimate(estimate: Estimate) -> Estimate:
    """Return a read-only view of an estimate, which protects the data of its estimator."""
    position, velocity, disturbance, covariance, innovation, nis = estimate
    if not (
        position.flags.writeable
        or velocity.flags.writeable
        or disturbance.flags.writeable
        or covariance.flags.writeable
        or innovation.flags.writeable
    ):
        return estimate
    return Estimate(
        read_only_view(position),
        read_only_view(velocity),
        read_only_view(disturbance),
        read_only_view(covariance),
        read_only_view(innovation),
        nis,
    )


class Estimator(Protocol):
    """Turns every measurement into an estimate, whether its controller is in charge or not."""

    def reset(self, measurement: Measurement) -> None:
        """Start from this measurement (at rest, straight appendages where not measured)."""

    def update(self, measurement: Measurement) -> Estimate:
        """Return the estimate at this tick, predicted with the effort that was applied."""


class Law(Protocol):
    """Turns an estimate and a reference into efforts. Called only while in charge."""

    terms: dict[str, Vector]  # the summands of the last effort by name, for the log

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Take charge: choose the free states such that the next effort equals `effort`.

        A law without a free state ignores `effort`; its controller blends it in.
        """

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the efforts for the coming tick, shape (joints,) [N m or N]."""


def nominal_state(state: Vector, reference: Reference, joints: int, modes: int) -> Vector:
    """Return a nominal state as a law with `modes` modes sees it, shape (..., 2 (joints + modes)).

    Modes that the planner lacks are straight and at rest, modes that the law lacks are left out.
    Without a nominal state the joint references stand for it.

    Args:
        state: reference.state or reference.next_state, shape (..., size).
        reference: of this tick, or of many in rows.
        joints: how many joints.
        modes: how many modes the law has.
    """
    n = joints + modes
    if state.shape[-1] == 2 * n:
        return state
    nominal = np.zeros((*reference.position.shape[:-1], 2 * n))
    if state.shape[-1] == 0:
        nominal[..., :joints] = reference.position
        nominal[..., n : n + joints] = reference.velocity
        return nominal
    given = state.shape[-1] // 2
    kept = min(n, given)
    nominal[..., :kept], nominal[..., n : n + kept] = (
        state[..., :kept],
        state[..., given : given + kept],
    )
    return nominal


class MeasuredJoints:
    """The estimator of a collocated law: the joints as measured, nothing else."""

    _no_matrix = read_only(np.zeros((0, 0)))

    def reset(self, measurement: Measurement) -> None:
        """Nothing to start."""

    def update(self, measurement: Measurement) -> Estimate:
        """Return the measured joint positions and velocities."""
        return Estimate(
            measurement.joint_position,
            measurement.joint_velocity,
            EMPTY,
            self._no_matrix,
            EMPTY,
        )
