"""What an experiment has found, as a file that plans and laws believe."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_control.analysis.linear_plant import continuous_plant
from flexslew_control.analysis.model_file import save_model
from flexslew_control.analysis.rest import rest_of
from flexslew_lab.identification.modal.modes import CONFIDENCE, ModalModel
from flexslew_lab.identification.records.record import Quantity
from flexslew_lab.json_text import nan_as_null
from flexslew_lab.log.files.whole_file import write_whole
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.identified import FreeMode, IdentifiedTestbed
from flexslew_plant.yaml_data import yaml_text

_AXES = "xyz"
_LIGHT = 1e-6  # mass of an appendage with modes that push nothing along [kg]


def testbed_of(found: ModalModel) -> IdentifiedTestbed:
    """Return the bench that was found, as a testbed of kind identified.

    Joints and efforts sit at the same places, so the residues of a mode among them are phi phi^T:
    phi is their best approximation of rank one, and the tips follow from it.

    Raises:
        BadInput: the joints measured are not those that were shaken, or a mode's residues are no
            phi phi^T, which no passive bench can have.
    """
    record, fit = found.record, found.fit
    if not found.inertia:
        raise BadInput(
            f"{record.source}: shaken were {', '.join(record.inputs)}, measured "
            f"{', '.join(record.joints) or 'no joints'}: a model needs both of every joint"
        )
    rows, tips = list(record.actuation), record.columns(Quantity.DEFLECTION)
    inverse = fit.inverse_inertia[rows]
    inverse = 0.5 * (inverse + inverse.T)
    if np.linalg.eigvalsh(inverse).min() <= 0.0:
        raise BadInput(f"{record.source}: the rigid inertia that was found is not positive")
    inertia = np.linalg.inv(inverse)
    inertia = 0.5 * (inertia + inertia.T)
    modes = []
    for mode, residues in zip(fit.modes, fit.residues, strict=True):
        phi = _mode_shape(residues[rows])
        if phi is None:
            raise BadInput(
                f"{record.source}: the mode at {mode.frequency:.4g} rad/s answers its own drives "
                "with the wrong sign: the sensors are not at the drives, or it is no mode"
            )
        first = len(record.joints)
        deflection = residues[first : first + len(tips)] @ phi / (phi @ phi)
        modes.append(
            FreeMode(
                frequency=mode.frequency,
                damping_ratio=max(mode.damping_ratio, 0.0),
                joints=tuple(phi.tolist()),
                tips=tuple(deflection.tolist()),
            )
        )
    places = record.columns(Quantity.JOINT_POSITION)
    units = [record.outputs[places[row]].unit for row in rows]
    limits = np.where(np.isfinite(record.limits), record.limits, 1e6)
    return IdentifiedTestbed(
        joints=record.inputs,
        joint_units=tuple("m" if unit == "m" else "rad" for unit in units),
        inertia=tuple(tuple(row) for row in inertia.tolist()),
        free_modes=tuple(modes),
        modes=len(modes),
        appendages=tuple(record.outputs[k].name.removeprefix("tip.") for k in tips),
        effort_limit=tuple(limits.tolist()),
    )


def _mode_shape(residues: Matrix) -> Vector | None:
    """Return phi of the nearest phi phi^T to square residues; None: there is none."""
    values, vectors = np.linalg.eigh(0.5 * (residues + residues.T))
    if values[-1] <= 0.0 or values[-1] < abs(values[0]):
        return None
    phi = np.asarray(np.sqrt(values[-1]) * vectors[:, -1])
    return phi if phi[int(np.argmax(np.abs(phi)))] > 0.0 else -phi


def file_text(found: ModalModel, fitted: dict[str, Any] | None = None) -> tuple[str, str]:
    """Return `identified.yaml`, and why it holds no model to believe; empty: it does.

    Args:
        found: modes and inertias.
        fitted: keys of the bench's own testbed that were fitted, nested; they are the model then.
    """
    content: dict[str, Any] = {
        "source": found.record.source,
        "band": list(found.band),
        "confidence": CONFIDENCE,
        "modes": [
            {
                "frequency": asdict(mode.frequency),
                "damping_ratio": asdict(mode.damping_ratio),
                "periods": round(mode.periods, 1),
            }
            for mode in found.modes
        ],
        "inertia": [[asdict(entry) for entry in row] for row in found.inertia],
    }
    why = ""
    try:
        testbed = testbed_of(found)
        content |= {"model": plain(testbed), "appendage": modal_data(testbed)}
    except BadInput as error:
        why = str(error)
    if fitted is not None:
        content["model"], why = fitted, ""
    return yaml_text(nan_as_null(content)), why


def save_system(found: ModalModel, path: Path) -> None:
    """Write the bench that was found as a linear system with named signals.

    Args:
        found: modes and inertias.
        path: ends in .mat, .npz, .json or .yaml.

    Raises:
        BadInput: see testbed_of and save_model.
    """
    testbed: Any = testbed_of(found)
    save_model(continuous_plant(rest_of(testbed)), path)


def modal_data(testbed: IdentifiedTestbed) -> dict[str, Any]:
    """Return the appendage's modes with the joints held: frequencies, coupling to the joints, tips.

    Modal masses are 1 kg; `coupling` is the momentum about each joint per unit of a mode's rate.
    """
    model = testbed.model()
    m, k = model.joints, model.modes
    coupling = model.packed[1 + m * m : 1 + m * m + m * k].reshape(m, k)
    first = 1 + m * m + m * k
    frequencies = np.sqrt(model.packed[first : first + k])
    damping = model.packed[first + k :].reshape(k, k)
    return {
        "frequencies": frequencies.tolist(),
        "damping_ratios": (np.diag(damping) / (2.0 * frequencies)).tolist(),
        "coupling": {name: coupling[j].tolist() for j, name in enumerate(testbed.joints)},
        "tips": {
            name: model.appendages.tip[j].tolist() for j, name in enumerate(testbed.appendages)
        },
    }


def appendage_file_text(found: ModalModel, axes: dict[str, str]) -> str:
    """Return the modes with the joints held as modal data of a `spacecraft`'s appendage, as YAML.

    Its rigid sums are the least that the modes need; the rest of what was found is the platform's.

    Args:
        found: modes and inertias.
        axes: x, y or z of the appendage about or along which each joint moves, by joint.

    Raises:
        BadInput: a joint without an axis, or see testbed_of.
    """
    testbed = testbed_of(found)
    if set(axes) != set(testbed.joints) or not set(axes.values()) <= set(_AXES):
        words = f"an axis x, y or z of each of {', '.join(testbed.joints)}, as in hub=z"
        raise BadInput(words, key="--appendage", value=axes)
    data = modal_data(testbed)
    modes = len(data["frequencies"])
    translation, rotation = np.zeros((2, 3, modes))
    for name, unit in zip(testbed.joints, testbed.joint_units, strict=True):
        part = translation if unit == "m" else rotation
        part[_AXES.index(axes[name])] += data["coupling"][name]
    mass = max(float(np.linalg.eigvalsh(translation @ translation.T)[-1]), _LIGHT)
    content = {
        "frequencies_hz": (np.array(data["frequencies"]) / (2.0 * np.pi)).tolist(),
        "damping_ratios": data["damping_ratios"],
        "translation": translation.tolist(),
        "rotation": rotation.tolist(),
        "rigid": {
            "mass": mass,
            "first_moment": [0.0, 0.0, 0.0],
            "inertia": (rotation @ rotation.T).tolist(),
        },
    }
    return yaml_text(nan_as_null(content))


def write_model(path: Path, text: str) -> None:
    """Write the file whole or not at all.

    Raises:
        BadInput: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from None
