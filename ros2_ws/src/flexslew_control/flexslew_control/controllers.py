"""Which controllers there are. A new one is a file with settings and build, and a line here."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexslew_control import pd_feedforward
from flexslew_control.controller import Controller
from flexslew_control.law import Estimator, Law
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, plain, validated, yaml_text


class _Kind(NamedTuple):
    settings: type[Any]  # its section
    build: Callable[[Any, float, Vector], tuple[Estimator, Law]]


CONTROLLERS: dict[str, _Kind] = {
    "pd_feedforward": _Kind(pd_feedforward.PdFeedforwardSettings, pd_feedforward.build),
}


def build_controller(
    name: str,
    law: str,
    values: dict[str, Any],
    joint_names: tuple[str, ...],
    period: float,
    effort_limit: tuple[float, ...],
    source: str,
    requires_plan: bool = False,
) -> Controller:
    """Return the controller `name` that runs `law`.

    Args:
        name: unique on the bench.
        law: a key of CONTROLLERS.
        values: its section of a trial file as plain data; `handover_time` [s] may stand there too.
        joint_names: of the bench, in the order of the effort.
        period: one tick [s].
        effort_limit: of the drives, one a joint [N m or N].
        source: file or node to name in an error.
        requires_plan: it is not ready without a plan.

    Raises:
        BadInput: unknown law, wrong settings, or a design that does not exist.
    """
    if law not in CONTROLLERS:
        raise BadInput(f"{source}: {law} is not a law; allowed: {', '.join(CONTROLLERS)}")
    kind = CONTROLLERS[law]
    handover_time = validated(NonNegative, values.get("handover_time", 1.0), source)
    own = {key: value for key, value in values.items() if key != "handover_time"}
    settings = validated(kind.settings, own, source)
    estimator, built = kind.build(settings, period, np.array(effort_limit, dtype=float))
    return Controller(name, estimator, built, joint_names, period, handover_time, requires_plan)


def settings_text(law: str, values: dict[str, Any]) -> str:
    """Return the settings of a law, defaults included, as YAML for the log."""
    own = {key: value for key, value in values.items() if key != "handover_time"}
    settings = plain(validated(CONTROLLERS[law].settings, own, law))
    return yaml_text(settings)
