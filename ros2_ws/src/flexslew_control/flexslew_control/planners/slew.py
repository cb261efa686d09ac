"""What every plan of a CSA slew is asked with: model, goal, feedback and ticks."""

import importlib.metadata
import platform
from functools import lru_cache
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from flexslew_control.planners.feedforward.manoeuvre import Manoeuvre
from flexslew_control.planners.trajectories import Profile
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds import build_model
from flexslew_plant.testbeds.csa import CsaInitial, CsaParameters, CsaTestbed

_Gain = tuple[NonNegative, NonNegative]


@section
class CsaModel:
    """The `model` of a plan: what the planner believes; it may differ from the testbed."""

    variant: Literal["printed", "complete"] = "complete"
    modes: Annotated[int, Field(ge=1, le=12)] = 1
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0  # of every beam mode [-]
    parameters: CsaParameters = CsaParameters()


@section
class CsaGoal:
    """Where the joints shall rest in the end; M1 of papers/000 unless said otherwise."""

    base_yaw: float = 1.0  # theta(T) [rad]
    hub_pitch: float = 0.5  # psi(T) [rad]


@section
class Feedback:
    """The gains (17) of the feedback that flies the plan, which the planner takes into account."""

    kp: _Gain = (460.0, 460.0)  # [N m/rad]
    kd: _Gain = (920.0, 920.0)  # [N m s/rad]


class TooMuchTorque(PlanFailed):
    """The slew needs more than the drives have; a longer one may not."""


class CsaSlew(Protocol):
    """What the `plan` sections of all methods that plan under the feedback have."""

    @property
    def model(self) -> CsaModel:
        """What the planner believes."""

    @property
    def initial(self) -> CsaInitial:
        """Where the joints rest at the start."""

    @property
    def goal(self) -> CsaGoal:
        """Where they shall rest at the end."""

    @property
    def duration(self) -> float:
        """Of the manoeuvre [s]."""

    @property
    def reference(self) -> Profile:
        """Profile of the reference."""

    @property
    def feedback(self) -> Feedback:
        """The gains that the planner counts with."""


def csa_manoeuvre(section: CsaSlew) -> Manoeuvre:
    """Return the slew that a `plan` section describes."""
    model, initial, goal = section.model, section.initial, section.goal
    testbed = CsaTestbed(
        variant=model.variant,
        modes=model.modes,
        damping_ratio=model.damping_ratio,
        parameters=model.parameters,
    )
    return Manoeuvre(
        model=build_model(testbed),
        kp=np.array(section.feedback.kp),
        kd=np.array(section.feedback.kd),
        start=np.array([initial.base_yaw, initial.hub_pitch]),
        goal=np.array([goal.base_yaw, goal.hub_pitch]),
        duration=section.duration,
        reference=section.reference,
    )


def tick_times(start: float, duration: float, period: float) -> Vector:
    """Return the ticks of a manoeuvre, counted from its start, shape (ticks + 1,) [s].

    Raises:
        BadInput: the start is not on a tick.
    """
    if abs(start / period - round(start / period)) > 1e-6:
        raise BadInput(f"plan: start: {start!r} is not allowed: not a multiple of {period!r} s")
    return np.asarray(
        period * np.arange(int(np.ceil(duration / period - 1e-9)) + 1, dtype=np.float64)
    )


@lru_cache
def _versions() -> dict[str, str]:
    names = ("flexslew_control", "flexslew_plant", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {name: _version(name) for name in names}


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "source"


def software_versions() -> dict[str, str]:
    """Return the versions of what makes a plan."""
    return dict(_versions())
