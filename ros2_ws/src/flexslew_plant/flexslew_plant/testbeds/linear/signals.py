"""A linear plant of a file as continuous equations with the signals of the bench."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, logm

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.state_space import StateSpace, matrices
from flexslew_plant.testbeds.linear.blocks import balanced

OUTPUTS = ("position", "rate", "tip", "curvature")  # kinds of outputs, before a dot and a name
_LARGEST = 600  # states
_SAME = 1e-8  # of its size: what rounding leaves of a zero
_LOGARITHM = 1e-8  # of a sampled system, by which its continuous one may miss it at a sample


class PlantMatrices(NamedTuple):
    """x' = A x + B u with balanced states of an even number."""

    a: Matrix
    b: Matrix  # (states, joints)
    joints: tuple[str, ...]
    position: Matrix  # rows of the joints' positions, (joints, states)
    appendages: tuple[str, ...]
    tip: Matrix  # rows of the readings, (appendages, states)
    curvature: Matrix  # (appendages, states)


def plant_of(system: StateSpace) -> PlantMatrices:
    """Return the plant that a system describes.

    Raises:
        BadInput: a shape, a name or an output does not fit; see docs/linear_plant.md.
    """
    if not system.a:
        raise BadInput("system.a: a plant has states; give A, B and C")
    joints, outputs, signs = _names(system)
    if len(system.a) > _LARGEST:
        words = f"system.a: {len(system.a)} states; at most {_LARGEST} fly: reduce the model"
        raise BadInput(words)
    a, b, c, d = matrices(system, len(joints), len(outputs))
    b = b * signs
    if d.any():
        k = int(np.abs(d).max(axis=1).argmax())
        raise BadInput(
            f"system.d: {'.'.join(outputs[k])} is set by an effort at once; a bench measures before"
            " it answers: give D = 0, or leave this output out"
        )
    if system.period:
        a, b = _continuous(a, b, system.period)
    a, scale = balanced(a)
    b, c = b / scale[:, None], c * scale
    rows = dict(zip(outputs, c, strict=True))
    a, b, rows = _with_positions(a, b, rows, joints)
    if len(a) % 2:  # one more state, which nothing moves or reads
        speed = float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)) or 1.0
        a = np.block([[a, np.zeros((len(a), 1))], [np.zeros((1, len(a))), -np.full((1, 1), speed)]])
        b = np.vstack((b, np.zeros((1, len(joints)))))
        rows = {name: np.append(row, 0.0) for name, row in rows.items()}
    appendages = tuple(dict.fromkeys(name for kind, name in outputs if kind in OUTPUTS[2:]))
    none = np.zeros(len(a))
    tip, curvature = (
        np.array([rows.get((kind, name), none) for name in appendages]).reshape(-1, len(a))
        for kind in OUTPUTS[2:]
    )
    position = np.array([rows["position", joint] for joint in joints])
    return PlantMatrices(a, b, joints, position, appendages, tip, curvature)


def _names(system: StateSpace) -> tuple[tuple[str, ...], list[tuple[str, str]], Vector]:
    """Return the joints, in the order of the inputs, kind and name of outputs, signs of inputs.

    An input `-effort.JOINT` pushes its joint back.

    Raises:
        BadInput: a name is none of a signal, or there twice, or a joint has no output.
    """
    count = len(system.b[0]) if system.b else 0
    inputs = system.inputs or tuple(f"effort.joint_{k + 1}" for k in range(count))
    joints = tuple(name.removeprefix("-").removeprefix("effort.") for name in inputs)
    signs = np.array([-1.0 if name.startswith("-") else 1.0 for name in inputs])
    for name, joint in zip(inputs, joints, strict=True):
        if not joint or "." in joint:
            raise BadInput(f"system.inputs: {name} is not allowed: effort.JOINT, JOINT by any name")
    given = system.outputs or _default_outputs(joints, len(system.c))
    outputs = []
    for name in given:
        kind, _, of = name.partition(".")
        allowed = joints if kind in OUTPUTS[:2] else None
        if kind not in OUTPUTS or not of or (allowed is not None and of not in allowed):
            known = ", ".join(f"{one}.{joint}" for one in OUTPUTS[:2] for joint in joints)
            hint = spelling_hint(name, [f"{one}.{of}" for one in OUTPUTS])
            raise BadInput(
                f"system.outputs: {name} is not allowed; {hint}allowed: {known}, tip.APPENDAGE, "
                "curvature.APPENDAGE"
            )
        outputs.append((kind, of))
    dotted = [".".join(output) for output in outputs]
    for names, key in ((list(joints), "inputs"), (dotted, "outputs")):
        if twice := [one for one in names if names.count(one) > 1]:
            raise BadInput(f"system.{key}: {twice[0]} is there twice; give each signal one name")
    unseen = [one for one in joints if not {("position", one), ("rate", one)} & set(outputs)]
    if unseen or not joints:
        name = unseen[0] if unseen else "JOINT"
        raise BadInput(
            f"system.outputs: no position.{name} and no rate.{name}; a joint is measured"
        )
    return joints, outputs, signs


def _default_outputs(joints: tuple[str, ...], count: int) -> tuple[str, ...]:
    """Return the outputs of a system that names none: positions, then rates.

    Raises:
        BadInput: it has another number of outputs.
    """
    if count not in (len(joints), 2 * len(joints)):
        raise BadInput(
            f"system.outputs: {count} without names for {len(joints)} inputs; name them: "
            "position.JOINT, rate.JOINT, tip.APPENDAGE or curvature.APPENDAGE"
        )
    return tuple(f"{kind}.{joint}" for kind in OUTPUTS[:2] for joint in joints)[:count]


def _continuous(a: Matrix, b: Matrix, period: float) -> tuple[Matrix, Matrix]:
    """Return A and B of the continuous system with the samples of a sampled one, efforts held.

    Raises:
        BadInput: there is none.
    """
    states, m = b.shape
    held = np.eye(states + m)
    held[:states, :states], held[:states, states:] = a, b
    values = np.linalg.eigvals(a)
    negative = (values.real <= 0.0) & (abs(values.imag) <= _SAME * abs(values.real))
    found = logm(held) if not negative.any() else np.full(held.shape, np.nan)
    missed = np.abs(expm(found.real) - held).max() if np.isfinite(found).all() else np.inf
    if not missed <= _LOGARITHM * max(1.0, np.abs(held).max()):
        pole = float(values[negative].real.min(initial=0.0)) + 0.0  # no -0
        why = f"its pole z = {pole:.3g}" if negative.any() else "its poles are too close"
        raise BadInput(
            f"system.period: no continuous plant has these samples: {why}; give a continuous system"
            " (Ts: 0), without delays"
        )
    rates = found.real / period
    return rates[:states, :states], rates[:states, states:]


def _with_positions(
    a: Matrix, b: Matrix, rows: dict[tuple[str, str], Matrix], joints: tuple[str, ...]
) -> tuple[Matrix, Matrix, dict[tuple[str, str], Matrix]]:
    """Return the equations with a position of every joint: of a rate alone its integral.

    Raises:
        BadInput: an effort moves a position or a rate at once, or a rate is not that of its
            position.
    """
    for joint in joints:
        row = rows.get(("position", joint))
        if row is None:
            continue
        if not _is_small(row @ b, row, b):
            raise BadInput(
                f"system.c: position.{joint} has a rate that an effort sets at once (C B is not 0)"
                "; a joint has an inertia: name it rate." + joint
            )
        rate = rows.get(("rate", joint))
        if rate is not None and not _is_small(rate - row @ a, row, a):
            raise BadInput(f"system.c: rate.{joint} is not the derivative of position.{joint}, C A;"
                           " leave one of them out")  # fmt: skip
    for joint in (one for one in joints if ("position", one) not in rows):
        rate = rows["rate", joint]
        target = np.append(rate, np.zeros(b.shape[1]))
        integral = np.asarray(np.linalg.lstsq(np.hstack((a, b)).T, target)[0], np.float64)
        if _is_small(integral @ np.hstack((a, b)) - target, rate, np.eye(1)):
            rows["position", joint] = integral
            continue
        n = len(a)  # no state is its integral: one more
        a = np.block([[a, np.zeros((n, 1))], [rate, np.zeros((1, 1))]])
        b = np.vstack((b, np.zeros((1, b.shape[1]))))
        rows = {name: np.append(one, 0.0) for name, one in rows.items()}
        rows["position", joint] = np.eye(n + 1)[n]
    return a, b, rows


def _is_small(value: Matrix, row: Matrix, of: Matrix) -> bool:
    """Return whether a product of a row and a matrix is what rounding leaves of zero."""
    size = float(np.linalg.norm(row) * np.linalg.norm(of, 2))
    return bool(np.abs(value).max(initial=0.0) <= _SAME * size)
