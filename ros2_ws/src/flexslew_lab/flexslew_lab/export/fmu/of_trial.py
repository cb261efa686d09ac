"""What a trial flies as an FMU, with the names of its joints."""

from flexslew_lab.export.c_module import CModule
from flexslew_lab.export.fmu.archive import fmu_of
from flexslew_lab.export.fmu.binaries import Target
from flexslew_lab.export.fmu.description import Version
from flexslew_lab.export.fmu.variables import SignalPart, SignalParts
from flexslew_lab.trial.trial import Trial
from flexslew_plant.testbeds.model import Model

_EFFORT = {"rad": "N m", "m": "N"}  # unit by that of the joint
_GAINS = {  # the same of gains
    "kp": {"rad": "N m/rad", "m": "N/m"},
    "ki": {"rad": "N m/(rad s)", "m": "N/(m s)"},
    "kd": {"rad": "N m s/rad", "m": "N s/m"},
}


def fmu_of_trial(
    trial: Trial, module: CModule, version: Version, targets: tuple[Target, ...]
) -> bytes:
    """Return a controller or the testbed of a trial as an FMU.

    Args:
        trial: that the module is of.
        module: its C code.
        version: of FMI.
        targets: the systems for which it contains libraries.

    Raises:
        BadInput: a compiler is missing.
    """
    model = trial.testbed.model()
    elements = {**elements_of(model), **_parameters(module, model)}
    return fmu_of(module, version, targets, elements)


def _parameters(module: CModule, model: Model) -> SignalParts:
    """Return the names and units of the gains of joints; those of matrices have no unit."""
    joints = model.units_by_joint
    return {
        one.name: tuple(
            SignalPart(f".{name}", "" if "[" in name else _GAINS[one.name][joints.get(name, "rad")])
            for name in one.labels
        )
        for one in module.parameters
        if one.labels
    }


def elements_of(model: Model) -> SignalParts:
    """Return the names and units of the numbers of measurements and efforts of a testbed."""
    joints = [(f".{name}", unit) for name, unit in model.units_by_joint.items()]
    tips = [(f".{name}", unit) for _, name, unit in model.appendages.sensors]
    efforts = tuple(SignalPart(name, _EFFORT[unit]) for name, unit in joints)
    return {
        "active": (SignalPart("", ""),),
        "joint_position": tuple(SignalPart(name, unit) for name, unit in joints),
        "joint_velocity": tuple(SignalPart(name, f"{unit}/s") for name, unit in joints),
        "tip_deflection": tuple(SignalPart(name, unit) for name, unit in tips),
        "root_curvature": tuple(SignalPart(name, "1/m") for name, _ in tips),
        "applied_effort": efforts,
        "effort": efforts,
        "disturbance": efforts,
    }
