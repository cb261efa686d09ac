"""A bench as an experiment has found it: the inertia that its joints feel and its free modes.

With J that inertia, w_i and zeta_i the free modes and Phi how far the joints move per unit of each
mode of unit modal mass, the free bench is theta = Phi_r eta + Phi q with Phi_r Phi_r^T = J^-1. In
(theta, q) instead of (eta, q) the kinetic energy is that of
    M = [ J, -J Phi; -Phi^T J, 1 + Phi^T J Phi ],
and with the joints held, q = V p, V^T (1 + Phi^T J Phi) V = 1, it has the clamped modes p:
    J theta'' - J Phi V p'' = u,    p'' - V^T Phi^T J theta'' + D p' + W^2 p = 0,
with W the clamped frequencies and D = V^T diag(2 zeta w) V.
"""

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator
from scipy.linalg import eigh

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, section
from flexslew_plant.testbeds.contract import RigidTurn, require_no_payload
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Appendages, Model
from flexslew_plant.testbeds.scene import Scene, schematic


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M and h. p holds how many joints there are, J, L = -J Phi V, W^2 and D, row by row."""
    m, k = coupling.shape
    stiffness_start = 1 + m * m + m * k
    for i in range(m):
        for j in range(m):
            joints[i, j] = p[1 + i * m + j]
        for j in range(k):
            coupling[i, j] = p[1 + m * m + i * k + j]
        bias[i] = 0.0
    for i in range(k):
        modal[i] = 1.0
        force = p[stiffness_start + i] * x[m + i]
        for j in range(k):
            force += p[stiffness_start + k + i * k + j] * x[2 * m + k + j]
        bias[m + i] = force


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write the partial derivatives of M a + h at fixed a."""
    m = int(p[0])
    k = dq.shape[0] - m
    stiffness_start = 1 + m * m + m * k
    dq[:] = 0.0
    dv[:] = 0.0
    for i in range(k):
        dq[m + i, m + i] = p[stiffness_start + i]
        for j in range(k):
            dv[m + i, m + j] = p[stiffness_start + k + i * k + j]


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the strain energy [J]."""
    m = int(p[0])
    k = q.size - m
    energy = 0.0
    for i in range(k):
        energy += 0.5 * p[1 + m * m + m * k + i] * q[m + i] ** 2
    return energy


KERNELS = Kernels(terms, residual_jacobian, potential)


@section
class FreeMode:
    """A mode of the bench with all joints free, scaled to a modal mass of 1 kg."""

    frequency: Positive  # [rad/s]
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0  # [-]
    joints: tuple[float, ...]  # how far each moves per unit of the mode [rad/m or -]
    tips: tuple[float, ...] = ()  # deflection of each appendage [-]


@section
class IdentifiedTestbed:
    """A model that `flexslew identify` has found: rigid inertia and free modes."""

    kind: Literal["identified"] = "identified"
    joints: tuple[str, ...] = ("hub",)  # names of the joints, each with a drive
    joint_units: tuple[Literal["rad", "m"], ...] = ("rad",)  # of each joint: rad or m
    # that the joints feel, symmetric [kg m^2 or kg]
    inertia: tuple[tuple[float, ...], ...] = ((100.0,),)
    # the modes, at least one; the modal mass is 1 kg
    free_modes: tuple[FreeMode, ...] = (FreeMode(frequency=1.0, joints=(0.05,), tips=(0.5,)),)
    appendages: tuple[str, ...] = ("boom",)  # names, one per entry of `tips`
    modes: Annotated[int, Field(ge=0, le=64)] = 1  # how many of the modes count, the lowest
    # of every mode instead of its own [-]; null: its own
    damping_ratio: Annotated[float, Field(ge=0.0, lt=1.0)] | None = None
    # joint positions at the start, by name [rad or m]; others 0
    initial: dict[str, float] = Field(default_factory=dict)
    initial_motion: InitialMotion | None = None  # rates and deflections at the start; null: at rest
    effort_limit: tuple[Positive, ...] = (10.0,)  # of each drive [N m or N]

    operating_point: ClassVar[dict[str, float]] = {}
    simplified: ClassVar[dict[str, Any]] = {}

    @model_validator(mode="after")
    def _consistent(self) -> "IdentifiedTestbed":
        n = len(self.joints)
        sizes = {
            "joint_units": len(self.joint_units),
            "inertia": len(self.inertia),
            "effort_limit": len(self.effort_limit),
            **{f"inertia.{k}": len(row) for k, row in enumerate(self.inertia)},
            **{f"free_modes.{k}.joints": len(m.joints) for k, m in enumerate(self.free_modes)},
        }
        wrong = next((key for key, size in sizes.items() if size != n), None)
        if wrong is not None:
            raise ValueError(f"{wrong}: {sizes[wrong]} entries for {n} joints; give one for each")
        for k, mode in enumerate(self.free_modes):
            if len(mode.tips) != len(self.appendages):
                raise ValueError(
                    f"free_modes.{k}.tips: {len(mode.tips)} entries for {len(self.appendages)} "
                    "appendages; give one for each"
                )
        if self.modes > len(self.free_modes):
            raise ValueError(
                f"modes: {self.modes} is not allowed: {len(self.free_modes)} are given"
            )
        unknown = sorted(set(self.initial) - set(self.joints))
        if unknown:
            raise ValueError(f"initial.{unknown[0]}: is not one of {', '.join(self.joints)}")
        inertia = np.array(self.inertia)
        if (inertia != inertia.T).any() or np.linalg.eigvalsh(inertia).min() <= 0.0:
            raise ValueError("inertia: must be symmetric and positive definite")
        return self

    @property
    def typical_goal(self) -> dict[str, float]:
        """A tenth of a unit by each joint [rad or m]."""
        return dict.fromkeys(self.joints, 0.1)

    def _used_modes(self) -> tuple[FreeMode, ...]:
        sorted_modes = tuple(sorted(self.free_modes, key=lambda mode: mode.frequency))
        kept = sorted_modes[: self.modes]
        if self.damping_ratio is None:
            return kept
        return tuple(replace(mode, damping_ratio=self.damping_ratio) for mode in kept)

    def model(self) -> Model:
        """Return the equations of motion, with joints held the clamped modes."""
        kept, m = self._used_modes(), len(self.joints)
        inertia = np.array(self.inertia)
        phi = np.array([mode.joints for mode in kept]).reshape(len(kept), m).T
        w = np.array([mode.frequency for mode in kept])
        zeta = np.array([mode.damping_ratio for mode in kept])
        squares, v = np.zeros(0), np.zeros((0, 0))
        if len(kept):
            squares, v = eigh(np.diag(w**2), np.eye(len(kept)) + phi.T @ inertia @ phi)
        damping = v.T @ np.diag(2.0 * zeta * w) @ v
        packed = np.concatenate(
            ([m], inertia.ravel(), (-inertia @ phi @ v).ravel(), squares, damping.ravel())
        )
        tips = np.array([mode.tips for mode in kept]).reshape(len(kept), len(self.appendages)).T
        tip = np.ascontiguousarray(tips @ v)
        return Model(
            KERNELS,
            packed,
            self.joints,
            self.joint_units,
            len(kept),
            Appendages(self.appendages, tip, np.zeros_like(tip)),
            scale_stiffness=scale_stiffness,
        )

    def scaled(self, stiffness: float = 1.0, payload: float = 1.0) -> "IdentifiedTestbed":
        """Return it with another stiffness of all modes, as a factor [-].

        Raises:
            BadInput: if another payload is requested: an experiment gives none.
        """
        require_no_payload(self.kind, payload)
        root = float(np.sqrt(stiffness))
        modes = tuple(replace(mode, frequency=mode.frequency * root) for mode in self.free_modes)
        return replace(self, free_modes=modes)

    def turning(self, joint: str, modes: int | None = None) -> "IdentifiedTestbed":
        """Return it with this joint alone, the others held: its own free modes; see Turning.

        With the others held, J theta'' + l^T p'' = u and p'' + l theta'' + D p' + W^2 p = 0 keep
        the clamped modes p; damping between two of the new modes is left out.

        Args:
            joint: that moves.
            modes: how many, those with the largest share of the joint's motion; None: all.

        Raises:
            BadInput: it has no such joint.
        """
        k, model = self._place(joint), self.model()
        linear = model.linearise(model.rest({}))
        rows = [k, *range(len(self.joints), len(linear.mass))]
        mass, stiffness, damping = (
            part[np.ix_(rows, rows)] for part in (linear.mass, linear.stiffness, linear.damping)
        )
        squares, shapes = eigh(stiffness, mass)
        free = [
            FreeMode(
                frequency=float(np.sqrt(squares[i])),
                damping_ratio=float(
                    shapes[:, i] @ damping @ shapes[:, i] / (2.0 * np.sqrt(squares[i]))
                ),
                joints=(float(shapes[0, i]),),
                tips=tuple((model.appendages.tip @ shapes[1:, i]).tolist()),
            )
            for i in range(1, len(squares))  # the first is the rigid one
        ]
        # what a joint at rest has of a mode after a push: (phi / w)^2
        free.sort(key=lambda mode: -abs(mode.joints[0]) / mode.frequency)
        kept = sorted(free[:modes], key=lambda mode: mode.frequency)
        return replace(
            self,
            joints=(joint,),
            joint_units=(self.joint_units[k],),
            inertia=((self.inertia[k][k],),),
            free_modes=tuple(kept),
            modes=len(kept),
            damping_ratio=None,
            initial={name: value for name, value in self.initial.items() if name == joint},
            initial_motion=None,
            effort_limit=(self.effort_limit[k],),
        )

    def rigid_turn(self, joint: str) -> RigidTurn:
        """Return what all joints must do for the turn, u = J_k rate'; see Turning."""
        column = np.array(self.inertia)[:, self._place(joint)]
        zeros = np.zeros_like(column)
        return RigidTurn(float(column[self._place(joint)]), column, zeros, zeros)

    def _place(self, joint: str) -> int:
        if joint not in self.joints:
            raise BadInput(f"plan: model: has no joint {joint}; it has {', '.join(self.joints)}")
        return self.joints.index(joint)

    def scene(self) -> Scene:
        """Return how it is drawn."""
        tip = self.model().appendages.tip
        inertias = tuple(row[k] for k, row in enumerate(self.inertia))
        return schematic(self.kind, self.joints, self.appendages, tip, self.joint_units, inertias)


def scale_stiffness(p: Vector, factor: float) -> Vector:
    """Return p with the stiffness of every mode times factor [-], damping ratios kept."""
    m, out = int(p[0]), p.copy()
    # size = 1 + m^2 + m k + k + k^2
    k = round(0.5 * (np.sqrt((m + 1) ** 2 + 4.0 * (p.size - 1 - m * m)) - (m + 1)))
    stiffness_start = 1 + m * m + m * k
    out[stiffness_start : stiffness_start + k] *= factor
    out[stiffness_start + k :] *= np.sqrt(factor)
    return out


IDENTIFIED = TestbedEntry(IdentifiedTestbed)
