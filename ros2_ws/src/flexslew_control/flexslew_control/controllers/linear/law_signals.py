"""The signals of a linear law by name, and its matrices from all of them to all its efforts."""

from typing import NamedTuple

import numpy as np

from flexslew_control.allocation import Allocator
from flexslew_control.analysis.lti import Lti
from flexslew_control.controllers.by_joint.three_axes import ControlAxes
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.state_space import StateSpace, matrices
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

# of joints or body axes, then of appendages; error is the reference minus what is measured
SIGNALS = ("error", "error_rate", "position", "rate", "reference", "reference_rate", "applied",
           "tip", "curvature")  # fmt: skip
_OF_APPENDAGES = ("tip", "curvature")
_OF_AXES = ("position", "rate", "reference", "reference_rate")


class LawSignals(NamedTuple):
    """What a linear law reads and commands at a tick.

    Args:
        axes: names of the joints, or of the body axes where its torque is allocated.
        joints: names of the joints.
        appendages: names of the sensors of appendages.
        torque: torque about the body axes by a unit effort of each joint, shape (3, joints); None:
            the axes are the joints.
    """

    axes: tuple[str, ...]
    joints: tuple[str, ...]
    appendages: tuple[str, ...]
    torque: Matrix | None = None

    @classmethod
    def of(cls, what: ControlAxes, appendages: tuple[str, ...]) -> "LawSignals":
        """Return those of a law with these axes."""
        torque = None if what.allocator is None else what.allocator.torque
        return cls(what.names, what.plant.joint_names, appendages, torque)

    @property
    def raw(self) -> tuple[str, ...]:
        """Names of what is read at a tick, in its order; applied efforts are those of joints."""
        of = {"position": self.axes, "rate": self.axes, "tip": self.appendages,
              "curvature": self.appendages, "applied": self.joints, "reference": self.axes,
              "reference_rate": self.axes}  # fmt: skip
        return tuple(f"{kind}.{name}" for kind, names in of.items() for name in names)

    @property
    def outputs(self) -> tuple[str, ...]:
        """`effort.JOINT` [N m or N], or `torque.x`, `torque.y`, `torque.z` [N m]."""
        kind = "effort" if self.torque is None else "torque"
        return tuple(f"{kind}.{name}" for name in self.axes)

    def row(self, name: str) -> Vector:
        """Return an input as a row over the raw signals.

        Raises:
            BadInput: if there is no such signal.
        """
        kind, _, of = name.partition(".")
        if kind not in SIGNALS or of not in self._names_of(kind):
            allowed = ", ".join(f"{k}.{n}" for k in SIGNALS for n in self._names_of(k))
            raise BadInput(f"system.inputs: {name} is not allowed: {allowed}")
        raw = self.raw
        row = np.zeros(len(raw))
        if kind in ("error", "error_rate"):
            rate = "_rate" if kind == "error_rate" else ""
            row[raw.index(f"reference{rate}.{of}")] = 1.0
            row[raw.index(f"{'rate' if rate else 'position'}.{of}")] = -1.0
        elif kind == "applied" and self.torque is not None:
            first = raw.index(f"applied.{self.joints[0]}")
            row[first : first + len(self.joints)] = self.torque[self.axes.index(of)]
        else:
            row[raw.index(name)] = 1.0
        return row

    def _names_of(self, kind: str) -> tuple[str, ...]:
        return self.appendages if kind in _OF_APPENDAGES else self.axes

    def inputs_of(self, given: StateSpace) -> tuple[str, ...]:
        """Return the inputs of a system; one that names none has errors, then their rates."""
        rows = given.b or given.d or ()
        errors = tuple(f"error.{name}" for name in self.axes)
        rates = tuple(f"error_rate.{name}" for name in self.axes)
        count, axes = len(rows[0]) if rows else 0, len(self.axes)
        default = (errors + rates)[:count] if count in (0, axes, 2 * axes) else errors
        return given.inputs or default

    def placed(self, outputs: tuple[str, ...]) -> Matrix:
        """Return where the outputs of a system act, shape (axes, outputs).

        Raises:
            BadInput: if there is no such output, or one is there twice.
        """
        place, kind = np.zeros((len(self.axes), len(outputs))), self.outputs[0].partition(".")[0]
        for k, name in enumerate(outputs):
            axis = name.removeprefix(f"{kind}.")
            if axis not in self.axes:
                allowed = ", ".join(self.outputs)
                raise BadInput(f"system.outputs: {name} is not allowed: {allowed}")
            if place[self.axes.index(axis)].any():
                one = "joint" if self.torque is None else "axis"
                raise BadInput(f"system.outputs: {name} is there twice; give each {one} one output")
            place[self.axes.index(axis), k] = 1.0
        return place

    def matrices_of(self, given: StateSpace) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """Return A, B, C and D as given, from the inputs to the outputs that a system names.

        Raises:
            BadInput: if their shapes do not fit.
        """
        return matrices(given, len(self.inputs_of(given)), len(given.outputs or self.outputs))

    def connected(
        self, given: StateSpace, parts: tuple[Matrix, Matrix, Matrix, Matrix], period: float
    ) -> Lti:
        """Return the sampled matrices of a system from all raw signals to all outputs.

        Raises:
            BadInput: if a name is unknown, or an output is there twice.
        """
        (a, b, c, d), inputs = parts, self.inputs_of(given)
        pick = np.array([self.row(name) for name in inputs]).reshape(len(inputs), len(self.raw))
        place = self.placed(given.outputs or self.outputs)
        states = tuple(f"x.{k + 1}" for k in range(len(a)))
        return Lti(a, b @ pick, place @ c, place @ d @ pick, self.raw, self.outputs, states, period)


def on_joints(
    system: Lti, signals: LawSignals, allocator: Allocator, attitude: AttitudeJoints
) -> Lti:
    """Return a law on the body axes as small motions see it: from joints to efforts of joints."""
    joints = LawSignals(signals.joints, signals.joints, signals.appendages)
    turn, spread = body_axes_of(signals, attitude), allocator.spread
    return Lti(system.a, system.b @ turn, spread @ system.c, spread @ system.d @ turn, joints.raw,
               joints.outputs, system.states, system.period)  # fmt: skip


def body_axes_of(signals: LawSignals, attitude: AttitudeJoints) -> Matrix:
    """Return the map from the raw signals of joints to those of the body axes."""
    joints = LawSignals(signals.joints, signals.joints, signals.appendages).raw
    count, found = len(signals.joints), np.zeros((len(signals.raw), len(joints)))
    turn = attitude.rotation_vector_of(np.eye(count)).T
    for k, name in enumerate(signals.raw):
        kind, _, of = name.partition(".")
        if kind in _OF_AXES:
            first = joints.index(f"{kind}.{signals.joints[0]}")
            found[k, first : first + count] = turn[signals.axes.index(of)]
        else:
            found[k, joints.index(name)] = 1.0
    return found
