"""A linear plant x' = A x + B u, y = C x of another program, from a file or python-control.

Its equations are brought into the second-order form of the bench exactly, see second_order, and are
advanced by their exact solution, see motion.
"""

from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, section
from flexslew_plant.state_space import StateSpace
from flexslew_plant.system_file import system_from_file
from flexslew_plant.testbeds.contract import require_no_payload
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.linear.motion import (
    ANYWHERE,
    IN_JOINTS,
    packed,
    scale_stiffness,
    scaled,
)
from flexslew_plant.testbeds.linear.second_order import SecondOrder, second_order
from flexslew_plant.testbeds.linear.signals import plant_of
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import Scene, schematic

_SAME = 1e-7  # of a reading: what rounding leaves of the joints' part in it
_KNOWN = 16  # plants of which the form is kept

# a hub of 104 kg m^2 with a boom that swings at 2 rad/s while the hub is held
_EXAMPLE = StateSpace(
    a=((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.08, 0.0, 0.0), (0.0, -4.16, 0.0, 0.0)),
    b=((0.0,), (0.0,), (0.01,), (-0.02,)),
    c=((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)),
    inputs=("effort.hub",),
    outputs=("position.hub", "tip.boom"),
)


class _Form(NamedTuple):
    """A plant in the form of the bench."""

    joints: tuple[str, ...]
    appendages: tuple[str, ...]
    equations: SecondOrder
    tip: Matrix  # (appendages, modes)
    rate: Matrix  # of the modes' rates in the tips' readings, (appendages, modes)
    curvature: Matrix  # (appendages, modes)


@section
class LinearTestbed:
    """A linear plant A, B, C, D with named signals, from MATLAB, python-control or a file."""

    kind: Literal["linear"] = "linear"
    # .mat, .npz, .yaml or .json with A, B, C, D, Ts, inputs and outputs, which become `system`
    file: str | None = None
    # matrices and names of signals: inputs effort.JOINT; outputs position.JOINT or rate.JOINT of
    # each, tip.APPENDAGE, curvature.APPENDAGE; its keys win over those of the file
    system: StateSpace = _EXAMPLE
    joint_units: tuple[Literal["rad", "m"], ...] = ()  # of each joint; none given: all rad
    kept_modes: int | None = Field(default=None, ge=0)  # the lowest of the modes; null: all
    stiffness: Positive = 1.0  # factor of all stiffness, damping ratios kept [-]
    # joint positions at the start, by name [rad or m]; others 0
    initial: dict[str, float] = Field(default_factory=dict)
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    effort_limit: tuple[Positive, ...] = (10.0,)  # of each input [N m or N]

    operating_point: ClassVar[dict[str, float]] = {}
    simplified: ClassVar[dict[str, Any]] = {}

    @model_validator(mode="after")
    def _consistent(self) -> "LinearTestbed":
        if self.file is not None:
            raise ValueError("file: is read where a trial is read; give `system` here")
        try:
            form = _form(self.system)
        except BadInput as error:
            raise ValueError(str(error)) from None
        for key in ("effort_limit", "joint_units"):
            count = len(getattr(self, key))
            if count != len(form.joints) and (count or key == "effort_limit"):
                words = f"{key}: {count} entries for {len(form.joints)} inputs; give one for each"
                raise ValueError(words)
        available = len(form.equations.stiffness) - len(form.joints)
        if self.kept_modes is not None:
            if self.kept_modes > available:
                words = f"kept_modes: {self.kept_modes} is not allowed: the plant has {available}"
                raise ValueError(words)
            if not form.equations.decoupled and self.kept_modes < available:
                raise ValueError("kept_modes: the plant has no real modes with its joints held")
        return self

    @property
    def modes(self) -> int:
        """Number of modes."""
        form = _form(self.system)
        available = len(form.equations.stiffness) - len(form.joints)
        return available if self.kept_modes is None else self.kept_modes

    @property
    def typical_goal(self) -> dict[str, float]:
        """A tenth of a unit by each joint [rad or m]."""
        return dict.fromkeys(_form(self.system).joints, 0.1)

    def model(self) -> Model:
        """Return the equations of motion, with their exact solution."""
        form, modes = _form(self.system), self.modes
        equations = _cut(scaled(form.equations, self.stiffness), modes)
        joints = form.joints
        in_joints = np.array_equal(equations.effort, np.eye(len(equations.stiffness), len(joints)))
        rate = np.ascontiguousarray(form.rate[:, :modes])
        return Model(
            IN_JOINTS if in_joints else ANYWHERE,
            packed(equations),
            joints,
            self.joint_units or ("rad",) * len(joints),
            modes,
            Appendages(
                form.appendages,
                np.ascontiguousarray(form.tip[:, :modes]),
                np.ascontiguousarray(form.curvature[:, :modes]),
                rate if rate.any() else None,
            ),
            scale_stiffness=scale_stiffness,
        )

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "LinearTestbed":
        """Return it with another stiffness, as a factor [-].

        Raises:
            BadInput: if another payload is requested.
        """
        require_no_payload(self.kind, payload)
        return replace(self, stiffness=self.stiffness * stiffness)

    def scene(self) -> Scene:
        """Return how it is drawn."""
        model = self.model()
        inertias = tuple(model.inertias(np.zeros(2 * model.coordinates)).tolist())
        return schematic(self.kind, model.joint_names, model.appendages.names,
                         model.appendages.tip, model.joint_units, inertias)  # fmt: skip


@lru_cache(_KNOWN)
def _form(system: StateSpace) -> _Form:
    """Return a plant in the form of the bench.

    Raises:
        BadInput: it has none, see signals and second_order, or a tip reads a joint.
    """
    plant = plant_of(system)
    m = len(plant.joints)
    equations = second_order(
        plant.a, plant.b, plant.position, np.vstack((plant.tip, plant.curvature))
    )
    n = len(equations.stiffness)
    found = []
    for kind, rows in (("tip", plant.tip), ("curvature", plant.curvature)):
        maps = np.asarray(np.linalg.solve(equations.states.T, rows.T).T, dtype=np.float64)
        of_joints = maps[:, [*range(m), *range(n, n + m)]]
        read = of_joints @ equations.states[[*range(m), *range(n, n + m)]]
        for name, row, part in zip(plant.appendages, rows, read, strict=True):
            if np.linalg.norm(part) > _SAME * np.linalg.norm(row):
                raise BadInput(
                    f"system.c: {kind}.{name} reads the motion of a joint, too; give the deflection"
                    " from the shape in which the joints at rest hold it"
                )
        found.append((maps[:, m:n], maps[:, n + m :]))
    (tip, rate), (curvature, curvature_rate) = found
    for name, row, still in zip(plant.appendages, curvature_rate, curvature, strict=True):
        if np.abs(row).max(initial=0.0) > _SAME * np.abs(still).max(initial=0.0):
            raise BadInput(f"system.c: curvature.{name} reads rates; name it tip.{name}")
    rate = rate * (np.abs(rate) > _SAME * np.abs(tip).max(initial=0.0))
    return _Form(plant.joints, plant.appendages, equations, tip, rate, curvature)


def _cut(form: SecondOrder, modes: int) -> SecondOrder:
    """Return a form with its first modes alone."""
    kept = len(form.joints) + modes
    return SecondOrder(
        form.joints,
        np.ascontiguousarray(form.coupling[:, :modes]),
        form.stiffness[:kept, :kept],
        form.damping[:kept, :kept],
        form.effort[:kept],
        form.states,
        form.decoupled,
    )


_DAMPED = ((0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.08, 0.0, 0.0008),
           (0.0, -4.16, 0.0, -0.0416))  # fmt: skip
LINEAR_PLANT = TestbedEntry(
    LinearTestbed, {"system": {**vars(_EXAMPLE), "a": _DAMPED}}, from_file=system_from_file
)
