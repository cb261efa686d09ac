"""Names of what goes into the bench and comes out, in the order of its arrays."""

from flexslew_plant.testbeds.model import Model

CHANNELS = ("position", "rate", "tip", "curvature")  # of a measurement, in this order
POSITION = "position."  # before the name of a joint
APPLIED = "applied"  # effort that was applied during the last tick


def inputs_of(model: Model) -> tuple[str, ...]:
    """Return `effort.JOINT` for every effort [N m or N]."""
    return tuple(f"effort.{name}" for name in model.joint_names)


def outputs_of(model: Model) -> tuple[str, ...]:
    """Return the sensors' channels.

    `position.JOINT` [rad or m], `rate.JOINT` [rad/s or m/s], then `tip.APPENDAGE` [m] and
    `curvature.APPENDAGE` [1/m].
    """
    joints, appendages = model.joint_names, model.appendages.names
    of = {"position": joints, "rate": joints, "tip": appendages, "curvature": appendages}
    return tuple(f"{channel}.{name}" for channel in CHANNELS for name in of[channel])


def states_of(model: Model) -> tuple[str, ...]:
    """Return a name for each entry of [displacement along v, v].

    `position.JOINT` and `rate.JOINT` where the joints are the first coordinates, else
    `displacement.K` and `velocity.K` of the platform and its hinges; `mode.K` [m],
    `mode_rate.K` [m/s].
    """
    modes = range(1, model.modes + 1)
    if model.leading is None:
        first = tuple(f"position.{name}" for name in model.joint_names)
        rates = tuple(f"rate.{name}" for name in model.joint_names)
    else:
        first = tuple(f"displacement.{k + 1}" for k in range(model.leading))
        rates = tuple(f"velocity.{k + 1}" for k in range(model.leading))
    return (*first, *(f"mode.{k}" for k in modes), *rates, *(f"mode_rate.{k}" for k in modes))


def applied_of(model: Model) -> tuple[str, ...]:
    """Return `applied.JOINT` for every effort."""
    return tuple(f"{APPLIED}.{name}" for name in model.joint_names)


def in_control(names: tuple[str, ...] | list[str]) -> list[str]:
    """Return names as python-control takes them: a dot stands there between system and signal."""
    return [name.replace(".", ":") for name in names]


def on_bench(names: list[str]) -> tuple[str, ...]:
    """Return names of python-control as they are on the bench."""
    return tuple(name.replace(":", ".") for name in names)
