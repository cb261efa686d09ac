"""Which controllers there are. A new one is a file with settings and build, and a line here."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np

from flexslew_control.controllers import (
    collocated_pid,
    lqr,
    output_feedback,
    pd_feedforward,
    proportional_integral,
)
from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.retargeting import (
    disturbance_accommodating,
    disturbance_minimisation,
    modal_space,
    planned_gains,
)
from flexslew_control.controllers.user_law import build_user_law, find_law
from flexslew_control.estimators.monitor import Monitor, Monitored, MonitorSettings
from flexslew_control.law import Estimator, Law, PlantDescription
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import code_hash
from flexslew_plant.settings import NonNegative, plain, section, validated, yaml_text
from flexslew_plant.testbeds.model import Model

LAW_HASH = "law_sha256"  # in a settings_text: of the file of a law that is not built in
DERIVED = ("computed", LAW_HASH)  # keys of a settings_text that are no settings


@section
class CommonSettings:
    """What may stand beside the settings of any law."""

    handover_time: NonNegative = 1.0  # over which a predecessor's effort is blended out [s]
    monitor: MonitorSettings | None = None  # of the innovations; null: off


class _Kind(NamedTuple):
    settings: type[Any]  # its section
    build: Callable[[Any, PlantDescription], tuple[Estimator, Law]]


CONTROLLERS: dict[str, _Kind] = {
    "pd_feedforward": _Kind(pd_feedforward.PdFeedforwardSettings, pd_feedforward.build),
    "output_feedback": _Kind(output_feedback.OutputFeedback, output_feedback.build),
    "proportional_integral": _Kind(
        proportional_integral.ProportionalIntegral, proportional_integral.build
    ),
    "lqr": _Kind(lqr.Lqr, lqr.build),
    "collocated_pid": _Kind(collocated_pid.CollocatedPid, collocated_pid.build),
    "disturbance_minimisation": _Kind(
        disturbance_minimisation.DisturbanceMinimisation, disturbance_minimisation.build
    ),
    "disturbance_accommodating": _Kind(
        disturbance_accommodating.DisturbanceAccommodating, disturbance_accommodating.build
    ),
    "planned_gains": _Kind(planned_gains.PlannedGains, planned_gains.build),
    "modal_space": _Kind(modal_space.ModalSpace, modal_space.build),
}


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
    common, own = _common_settings(values, source), law_values(values)
    estimator: Estimator
    built: Law
    if law in CONTROLLERS:
        kind = CONTROLLERS[law]
        settings = validated(kind.settings, own, source)
        try:
            estimator, built = kind.build(settings, plant)
        except BadInput as error:
            raise BadInput(f"{source}: {error}") from None
    else:
        found = find_law(law, source, tuple(CONTROLLERS))
        estimator, built = build_user_law(found, law, own, plant, source)
    monitor = None
    if common.monitor is not None:
        if not isinstance(estimator, Monitored):
            raise BadInput(
                f"{source}: monitor: {law} has no innovations to look at; the drive can compare "
                "its sensors: set plausibility"
            )
        monitor = Monitor(common.monitor, plant.period)
    return Controller(
        name,
        estimator,
        built,
        plant.joint_names,
        plant.period,
        common.handover_time,
        requires_plan,
        monitor,
    )


def settings_text(controller: Controller, law: str, values: dict[str, Any]) -> str:
    """Return the settings of a controller and what was computed from them, as YAML for the log.

    Args:
        controller: as built.
        law: what it runs.
        values: its section of a trial file; defaults are filled in where they are known.
    """
    common, own = _common_settings(values, law), law_values(values)
    known = law in CONTROLLERS
    settings = plain(validated(CONTROLLERS[law].settings, own, law)) if known else own
    derived: dict[str, Any] = {"computed": _arrays(controller.law)}
    if not known:
        derived[LAW_HASH] = code_hash(law)
    if common.monitor is not None:
        settings["monitor"] = plain(common.monitor)
    return yaml_text({**settings, "handover_time": common.handover_time, **derived})


def law_values(values: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of the law itself."""
    return {
        key: value for key, value in values.items() if key not in CommonSettings.__annotations__
    }


def _common_settings(values: dict[str, Any], source: str) -> CommonSettings:
    """Return the settings of a controller that are not those of its law."""
    own = {key: value for key, value in values.items() if key in CommonSettings.__annotations__}
    return cast(CommonSettings, validated(CommonSettings, own, source))


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
