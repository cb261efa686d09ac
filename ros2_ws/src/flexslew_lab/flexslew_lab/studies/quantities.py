"""Quantities with a unit in the distributions of a study, `uniform: [1 deg, 2 deg]`."""

from typing import Any

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.trial.overrides import keys_to, put
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.errors import BadInput
from flexslew_plant.joint_quantities import require_units_of_joints
from flexslew_plant.keys.units import in_si, is_quantity, units_at


def with_numbers(distribution: Any, keys: list[str], trial: Trial, base: Any, place: str) -> Any:
    """Return `{family: [numbers]}` with quantities as numbers in the unit of the keys.

    Args:
        distribution: content of the YAML; of another form it is returned as it is.
        keys: of the trial, that follow the draw; none: the numbers are factors.
        trial: the trial.
        base: the same as plain data.
        place: file and key, for messages.

    Raises:
        BadInput: a quantity is of another kind than a key.
    """
    if not isinstance(distribution, dict):
        return distribution
    found = {}
    for family, numbers in distribution.items():
        if isinstance(numbers, list) and any(map(is_quantity, numbers)):
            where = f"{place}.{family}"
            try:
                results = [_at_key(numbers, key, trial, base, where) for key in keys]
                results = results or [in_si(numbers, ("-",))]
            except BadInput as error:
                why = error.refusal
                raise BadInput(why.why, key=where, value=why.value) from None
            numbers = results[0]
        found[family] = numbers
    return found


def _at_key(numbers: list[Any], key: str, trial: Trial, base: Any, place: str) -> Any:
    """Return numbers of a distribution in the unit of one key of the trial."""
    path = keys_to(base, key)
    kind, values = Trial, dict(base)
    if path[0] == "controllers" and len(path) > 2:
        law, settings = law_of(str(path[1]), base["controllers"][path[1]] or {})
        if law not in CONTROLLERS:
            raise BadInput("give numbers: the units of another law are unknown", value=numbers)
        kind, values, path = CONTROLLERS[law].settings, dict(settings), path[2:]
    put(values, path, numbers)
    units = units_at(kind, tuple(map(str, path)), values)
    require_units_of_joints(kind, values, trial.testbed, place)
    return in_si(numbers, units) if units else numbers
