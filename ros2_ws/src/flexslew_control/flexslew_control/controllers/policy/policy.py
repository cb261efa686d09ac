"""A policy: the efforts are those of a base law plus what a network makes of an observation."""

from typing import Annotated

import numpy as np
from pydantic import Field

from flexslew_control.controllers.by_joint.pd_feedforward import (
    PdFeedforwardSettings,
)
from flexslew_control.controllers.by_joint.pd_feedforward import build as build_base
from flexslew_control.controllers.by_joint.pd_feedforward import linear as base_form
from flexslew_control.controllers.by_joint.three_axes import OF_TESTBED
from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.linear_form import (
    LinearForm,
    collocated_form,
    no_integral,
    no_observer,
)
from flexslew_control.controllers.policy.network import Network, network_from_file
from flexslew_control.controllers.policy.observation import observation, observed_signals
from flexslew_control.law import (
    Estimate,
    Estimator,
    Law,
    LawFailed,
    MeasuredJoints,
    PlantDescription,
    Reference,
)
from flexslew_plant.arrays import Vector
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import section


@section
class PolicySettings:
    """A base law plus a network: u = u_base + authority * limit * clip(action, -1, 1)."""

    # ONNX model, base64 (`file: policy.onnx` reads it); null: the base law alone
    network: str | None = None
    base: PdFeedforwardSettings | None = None  # the base law; null: none, zero effort
    # effort of an action of one [-], as a share of the limit of the drive
    authority: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class Policy:
    """u = u_base + authority * limit * clip(action, -1, 1).

    Args:
        base: law of the base effort; None: zero.
        network: gives the actions; None: zero.
        span: authority * limit, shape (joints,) [N m or N].
        limit: of the drives, shape (joints,) [N m or N].
        signals: names of the entries of an observation.
    """

    def __init__(
        self,
        base: Law | None,
        network: Network | None,
        span: Vector,
        limit: Vector,
        signals: tuple[str, ...],
    ) -> None:
        self.base, self.network, self.span, self.limit = base, network, span, limit
        self.signals, self.tips = signals, len(signals) - 4 * limit.size
        self.action = np.zeros(limit.size)  # of the next tick where there is no network
        self.terms: dict[str, Vector] = {}

    def reset(
        self, measurement: Measurement, estimate: Estimate, reference: Reference, effort: Vector
    ) -> None:
        """Nothing to choose: the law has no free state."""

    def observe(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the observation of a tick, shape (signals,); see observation."""
        return observation(measurement, estimate, reference, self.limit, self.tips)

    def update(self, measurement: Measurement, estimate: Estimate, reference: Reference) -> Vector:
        """Return the joint efforts, shape (joints,) [N m or N].

        Raises:
            LawFailed: the network raises, or its action is not finite or has another shape.
        """
        action = self.action
        if self.network is not None:
            action = self.network.action(self.observe(measurement, estimate, reference))
        if not np.isfinite(action).all():
            raise LawFailed(f"the policy's action {action.tolist()} is not finite")
        effort = self.span * np.clip(action, -1.0, 1.0)
        self.terms = {"policy": effort}
        if self.base is None:
            return effort
        base = self.base.update(measurement, estimate, reference)
        self.terms |= self.base.terms
        return base + effort


def build(settings: PolicySettings, plant: PlantDescription) -> tuple[Estimator, Law]:
    """Return the estimator, that of the base law, and the law.

    Raises:
        BadInput: the base law does not fit the testbed, or the network the observation.
        ModuleNotFoundError: there is a network, and onnxruntime is not installed.
    """
    estimator: Estimator = MeasuredJoints()
    base = None
    if settings.base is not None:
        estimator, base = build_base(settings.base, plant)
    limit, signals = plant.effort_limit, observed_signals(plant.testbed.model())
    network = None
    if settings.network is not None:
        network = Network(settings.network, len(signals), limit.size)
    return estimator, Policy(base, network, settings.authority * limit, limit, signals)


def linear(estimator: Estimator, law: Policy, references: list[Reference]) -> LinearForm | None:
    """Return the base law as matrices, see LawEntry; None: there is a network.

    It reads the observed tips, with gains of zero.
    """
    if law.network is not None:
        return None
    m = law.limit.size
    if law.base is not None:
        form = base_form(estimator, law.base, references)
    else:
        zero = np.zeros(m)
        form = collocated_form(zero, zero, zero, np.zeros((len(references), m)), no_integral(m))
    if form is None or not law.tips:
        return form
    read = 2 * m + law.tips
    law_form = form.law._replace(from_output=np.zeros((m, read)))
    return form._replace(law=law_form, observer=no_observer(read, m))


POLICY = LawEntry(
    "policy",
    PolicySettings,
    build,
    linear=linear,
    of_testbed=tuple(f"base.{key}" for key in OF_TESTBED),
    any_testbed=True,
    from_file=network_from_file,
)
