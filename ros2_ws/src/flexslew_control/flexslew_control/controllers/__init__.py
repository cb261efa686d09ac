"""Which controllers there are. A new one is a file that ends in its entry, and a line here.

Offers: by_joint.integral_action, by_joint.pd_feedforward, by_joint.three_axes, controller, host,
linear_form, lqr, probing.probed_controller, probing.running_law, proportional_integral,
retargeting.disturbance_accommodating, retargeting.modal_space, sampled_loop,
sliding.output_feedback, user_law.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from flexslew_control.controllers.controller import Activation, Controller
from flexslew_control.controllers.entry import LawEntry as LawEntry
from flexslew_control.controllers.entry import PlanVariant as PlanVariant
from flexslew_control.controllers.user_law import build_user_law, find_law
from flexslew_control.estimators.monitor import Monitor, Monitored, MonitorSettings
from flexslew_control.law import Estimator, Law, PlantDescription, per_joint
from flexslew_plant.entries import table
from flexslew_plant.errors import BadInput
from flexslew_plant.joint_quantities import require_units_of_joints
from flexslew_plant.known_joints import require_joints_of
from flexslew_plant.own_code import NO_CODE, Trust, code_hash, require_file
from flexslew_plant.settings import NonNegative, plain, section, validated
from flexslew_plant.testbeds import design_testbed
from flexslew_plant.testbeds.model import Model
from flexslew_plant.yaml_data import yaml_text

# isort: split
# the laws, a line each
from flexslew_control.controllers.by_joint.collocated_pid import COLLOCATED_PID as COLLOCATED_PID
from flexslew_control.controllers.by_joint.pd_feedforward import PD_FEEDFORWARD as PD_FEEDFORWARD
from flexslew_control.controllers.linear.linear_law import LINEAR as LINEAR
from flexslew_control.controllers.lqr import LQR as LQR
from flexslew_control.controllers.model_predictive.model_predictive import (
    MODEL_PREDICTIVE as MODEL_PREDICTIVE,
)
from flexslew_control.controllers.policy.policy import POLICY as POLICY
from flexslew_control.controllers.proportional_integral import (
    PROPORTIONAL_INTEGRAL as PROPORTIONAL_INTEGRAL,
)
from flexslew_control.controllers.retargeting.disturbance_accommodating import (
    DISTURBANCE_ACCOMMODATING as DISTURBANCE_ACCOMMODATING,
)
from flexslew_control.controllers.retargeting.disturbance_minimisation import (
    DISTURBANCE_MINIMISATION as DISTURBANCE_MINIMISATION,
)
from flexslew_control.controllers.retargeting.modal_space import MODAL_SPACE as MODAL_SPACE
from flexslew_control.controllers.retargeting.planned_gains import PLANNED_GAINS as PLANNED_GAINS
from flexslew_control.controllers.sliding.output_feedback import OUTPUT_FEEDBACK as OUTPUT_FEEDBACK

CONTROLLERS: dict[str, LawEntry] = table(globals(), LawEntry)
DEFAULT = PD_FEEDFORWARD.name  # of a trial that names none

LAW_HASH = "law_sha256"  # in a settings_text: of the file of a law that is not built in
_BY_JOINT = ("kp", "ki", "kd")  # gains, one for each joint or one for all
PENDING = "due"  # in a settings_text: changes that were granted for a later tick
COMPUTED_KEYS = ("computed", LAW_HASH, PENDING)  # keys of a settings_text that are no settings


@section
class CommonSettings:
    """Settings that any law may have in addition to its own."""

    handover_time: NonNegative = 1.0  # over which a predecessor's effort is blended out [s]
    monitor: MonitorSettings | None = None  # the tests; null: off


def build_controller(
    name: str,
    law: str,
    values: dict[str, Any],
    plant: PlantDescription,
    source: str,
    requires_plan: bool = False,
) -> Controller:
    """Return the controller `name` that runs `law`.

    Args:
        name: unique on the bench.
        law: a key of CONTROLLERS, or one of the user's own, see user_law.find_law.
        values: its section of a trial file as plain data; `handover_time` [s] and `monitor` may
            stand there too.
        plant: what it is for.
        source: file or node to name in an error.
        requires_plan: it is not ready without a plan.

    Raises:
        BadInput: unknown law, wrong settings, or a design that does not exist.
    """
    common, entries = (
        _common_settings(values, source),
        law_values(with_file(law, values, source, plant.trust)),
    )
    estimator: Estimator
    built: Law
    if law in CONTROLLERS:
        settings = _settings(law, entries, plant, source)
        try:
            _require_allocation(law, settings, plant)
            estimator, built = CONTROLLERS[law].build(settings, plant)
        except BadInput as error:
            raise BadInput(str(error), source) from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            words = f"{law}: its numbers are out of range ({error}); take weights nearer to 1"
            raise BadInput(words, source) from error
    else:
        found = find_law(law, source, tuple(CONTROLLERS), plant.trust)
        estimator, built = build_user_law(found, law, entries, plant, source)
    monitor = None
    if common.monitor is not None:
        if not isinstance(estimator, Monitored):
            raise BadInput(
                f"monitor: {law} has no innovations to look at; the drive can compare its "
                "sensors: set plausibility",
                source,
            )
        monitor = Monitor(common.monitor, plant.period)
    return Controller(
        name,
        estimator,
        built,
        plant.joint_names,
        plant.period,
        Activation(common.handover_time, requires_plan),
        monitor,
        plant.testbed.model().attitude,
    )


def require_law(law: str, source: str, trust: Trust) -> None:
    """Check that a plain name is one of a law; a file or a module that is named is not loaded.

    Args:
        law: key of CONTROLLERS, entry point of an installed package, file or class.
        source: file and key to name in an error.
        trust: which classes of the user's own may be loaded.

    Raises:
        BadInput: it is no name of a law; names the nearest one.
    """
    if law not in CONTROLLERS and "." not in law:
        find_law(law, source, tuple(CONTROLLERS), trust)


def require_settings(
    law: str, values: dict[str, Any], plant: PlantDescription, source: str
) -> None:
    """Check the settings of a law that is built in, before anything is designed from them.

    Gains by joint are counted, too; further requirements of a design are reported when it is built.

    Args:
        law: a key of CONTROLLERS; another one is not checked, since that may run its code.
        values: its section of a trial file as plain data.
        plant: what it is for.
        source: file and key to name in an error.

    Raises:
        BadInput: for wrong settings.
    """
    _common_settings(values, source)
    if law not in CONTROLLERS:
        return
    settings = _settings(law, law_values(values), plant, source)
    require_joints_of(settings, plant.joint_names, source=source)
    if getattr(settings, "model", None):
        design_testbed(plant.testbed, settings.model, f"{source}: model", plant.trust)
    model = plant.testbed.model()
    if model.attitude is None and getattr(settings, "allocation", None) is None:
        for key in _BY_JOINT:
            if hasattr(settings, key):
                per_joint(f"{source}: {key}", getattr(settings, key), model.joint_names)


def _settings(law: str, entries: dict[str, Any], plant: PlantDescription, source: str) -> Any:
    """Return the settings of a law that is built in, for this plant."""
    kind = CONTROLLERS[law].settings
    settings = validated(kind, entries, source)
    require_units_of_joints(kind, entries, plant.testbed, source)
    try:
        _require_tracking_time(settings, plant.period)
    except BadInput as error:
        raise BadInput(str(error), source) from None
    return settings


def _require_tracking_time(settings: Any, period: float) -> None:
    """Check that an anti-windup settles: at its ticks an integral goes by (1 - h / T_t) s.

    Raises:
        BadInput: the time constant is half a tick or less.
    """
    time = getattr(settings, "tracking_time", None)
    if time is not None and time <= 0.5 * period:
        raise BadInput(
            f"above half a tick of {period:g} s, or null", key="tracking_time", value=time
        )


def _require_allocation(law: str, settings: Any, plant: PlantDescription) -> None:
    """Check that a law without support for thrusters and gyros has none to command.

    Raises:
        BadInput: if it has; a negative push would be cut, a gyro's torque turns with its gimbal.
    """
    model = plant.testbed.model()
    if not (model.one_way or model.gyros) or getattr(settings, "allocation", None) is not None:
        return
    supported = [
        name for name, entry in CONTROLLERS.items() if hasattr(entry.settings, "allocation")
    ]
    hint = (
        "give it an `allocation`" if law in supported else f"take {' or '.join(sorted(supported))}"
    )
    if model.gyros:
        raise BadInput(
            f"{plant.joint_names[model.gyros[0]]} is a control moment gyro, whose torque turns "
            f"with its gimbal, and {law} assumes a fixed direction; {hint}, such as allocation: "
            "{kind: control_moment_gyros}",
        )
    raise BadInput(
        f"{plant.joint_names[model.one_way[0]]} is a thruster, which pushes one way, and {law} "
        f"commands both directions; {hint}, such as allocation: {{kind: thrusters}}",
    )


def settings_text(
    controller: Controller,
    law: str,
    values: dict[str, Any],
    pending: Sequence[tuple[int, Mapping[str, Any]]] = (),
) -> str:
    """Return the settings of a controller and what was computed from them, as YAML for the log.

    Args:
        controller: as built.
        law: what it runs.
        values: its section of a trial file; defaults are filled in where they are known.
        pending: changes of settings that were granted for a tick to come, with that tick.
    """
    common, entries = _common_settings(values, law), law_values(values)
    known = law in CONTROLLERS
    settings = plain(validated(CONTROLLERS[law].settings, entries, law)) if known else entries
    computed: dict[str, Any] = {"computed": _arrays(controller.law)}
    if not known:
        computed[LAW_HASH] = code_hash(law)
    if common.monitor is not None:
        settings["monitor"] = plain(common.monitor)
    if pending:
        computed[PENDING] = [{"tick": tick, "changes": dict(changes)} for tick, changes in pending]
    return yaml_text({**settings, "handover_time": common.handover_time, **computed})


def with_file(
    law: str, values: dict[str, Any], source: str, trust: Trust = NO_CODE
) -> dict[str, Any]:
    """Return the settings of a law with what its `file` holds in place of the file's name.

    So a log holds all that the law was, and is flown again without the file.

    Raises:
        Untrusted: a log names the file.
        BadInput: the file cannot be read.
    """
    entry = CONTROLLERS.get(law)
    if entry is None or entry.from_file is None or "file" not in values:
        return values
    require_file(trust, str(values["file"]), f"{source}: file")
    entries = {key: value for key, value in values.items() if key != "file"}
    return {**entries, **entry.from_file(str(values["file"]), source)}


def law_values(values: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of the law itself."""
    return {
        key: value for key, value in values.items() if key not in CommonSettings.__annotations__
    }


def _common_settings(values: dict[str, Any], source: str) -> CommonSettings:
    """Return the settings of a controller that are not those of its law."""
    entries = {key: value for key, value in values.items() if key in CommonSettings.__annotations__}
    return cast(CommonSettings, validated(CommonSettings, entries, source))


def _arrays(design: Any) -> dict[str, Any]:
    """Return the matrices of a law's design (gains, hypersurfaces, ...) by field."""
    found: dict[str, Any] = {}
    fields = dataclasses.fields(design) if dataclasses.is_dataclass(design) else ()
    for item in fields:
        value = None if item.name.startswith("_") else getattr(design, item.name)
        if isinstance(value, np.ndarray) and not np.iscomplexobj(value):
            found[item.name] = value.tolist()
        elif dataclasses.is_dataclass(value) and not isinstance(value, Model):
            inner = _arrays(value)
            found |= {item.name: inner} if inner else {}
    return found
