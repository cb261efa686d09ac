"""A wrong name, unit or shape anywhere in a trial is refused in one line, before it flies."""

from typing import Any

import pytest
from tests.wrong_inputs import Wrong, fault_of, wrong_inputs

from flexslew_lab.trial.sources import example_trials
from flexslew_lab.trial.trial import (
    checked_trial,
    load_trial,
    plan_of_trial,
    set_up,
    trial_of_values,
)
from flexslew_plant.errors import FlexslewError
from flexslew_plant.settings import plain

FILE = "wrong.yaml"
SHIPPED = {trial.name: trial.path for trial in example_trials()}


def refusal(values: Any) -> FlexslewError | None:
    """Return why a trial does not fly; None if it does."""
    try:
        trial = checked_trial(trial_of_values(values, FILE), FILE)
        set_up(trial, FILE)
        plan_of_trial(trial, predict=False)
    except FlexslewError as error:
        return error
    return None


def own_name(path: tuple[str | int, ...], kind: str) -> bool:
    """Return whether a key is a name of the user's own, or chooses which other keys there are.

    Parts of a spacecraft and controllers have names of the user's own.
    """
    return kind == "spacecraft" or path[:-1] == ("controllers",) or path[-1] in ("kind", "law")


def faults(values: Any, known: set[tuple[str, ...]], every: bool) -> dict[str, str]:
    """Return the wrong inputs that are not refused as they should be, by place.

    Args:
        values: of a trial.
        known: what was tried in other trials and is not tried again; those of this one are added.
        every: see wrong_inputs.
    """
    found, tried = {}, set()
    section = {key: str(values[key].get(name)) for key, name in (("testbed", "kind"),)}
    section["plan"] = str((values.get("plan") or {}).get("method"))
    for wrong in wrong_inputs(values, every):
        if wrong.kind == "misspelt" and own_name(wrong.path, values["testbed"]["kind"]):
            continue
        pattern = (*wrong.pattern, section.get(str(wrong.path[0]), "") if wrong.path else "")
        if pattern in known:
            continue
        tried.add(pattern)
        fault = fault_of_trial(wrong)
        if fault:
            found[" ".join((wrong.kind, *map(str, wrong.path)))] = fault
    known |= tried
    return found


def fault_of_trial(wrong: Wrong) -> str:
    error = refusal(wrong.values)
    return "flies" if error is None else fault_of(error, wrong, "")


def test_wrong_names_units_and_shapes_are_refused() -> None:
    known: set[tuple[str, ...]] = set()
    for name in ("m1", "three_axes"):
        values = plain(load_trial(SHIPPED[name]))
        assert faults(values, known, every=False) == {}, name
    assert len(known) > 250


@pytest.mark.matrix
def test_every_wrong_input_of_the_shipped_trials_is_refused() -> None:
    """Each once: what stands alike in several trials is tried in the first of them."""
    known: set[tuple[str, ...]] = set()
    for name, path in SHIPPED.items():
        assert faults(plain(load_trial(path)), known, every=True) == {}, name
    assert len(known) > 1000


JOINTS = {"roll": 0.1, "rol": 0.1}
CRAFT = {
    "kind": "spacecraft",
    "platform": {"mass": 100.0, "inertia": {"xx": 10.0, "yy": 10.0, "zz": 10.0}},
}
ABOUT_AN_AXIS = {"method": "time_optimal", "goal": {"axis": [0.0, 0.0, 1.0], "angle": 0.5}}
ABOUT_A_JOINT = {"method": "minimax_feedforward", "goal": {"roll": 0.1}}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"testbed": {**CRAFT, "initial": JOINTS}}, "initial"),
        ({"plan": {**ABOUT_AN_AXIS, "initial": JOINTS}}, "plan.initial"),
        ({"plan": {**ABOUT_AN_AXIS, "drives": "all", "initial": JOINTS}}, "plan.initial"),
        ({"plan": {**ABOUT_A_JOINT, "initial": JOINTS}}, "plan.initial"),
        ({"plan": {**ABOUT_A_JOINT, "joint_range": {"rol": [-1.0, 1.0]}}}, "plan.joint_range"),
        ({"plan": {**ABOUT_A_JOINT, "rate_limit": JOINTS}}, "plan.rate_limit"),
        (
            {"plan": {"method": "joint_trajectory", "points": [{"at": 1.0, "position": JOINTS}]}},
            "plan.points.0.position",
        ),
        ({"controllers": {"lqr": {"operating_point": JOINTS}}}, "operating_point"),
        ({"controllers": {"lqr": {"model": {"platfrom": {}}}}}, "model"),
        ({"actuator": {"coulomb_friction": JOINTS}}, "actuator.coulomb_friction"),
        ({"actuator": {"shortest_pulse": JOINTS}}, "actuator.shortest_pulse"),
        ({"schedule": [{"at": 1.0, "disturbance": JOINTS}]}, "schedule.0.disturbance"),
    ],
)
def test_a_name_of_no_joint_is_refused_when_the_trial_is_read(
    changes: dict[str, Any], key: str
) -> None:
    values = {"testbed": CRAFT, "controllers": {"pd_feedforward": {}}, **changes}
    values["active"] = next(iter(values["controllers"]))
    with pytest.raises(FlexslewError, match=rf"^{FILE}.*{key.replace('.', '[.]')}") as caught:
        checked_trial(trial_of_values(values, FILE), FILE)
    assert "\n" not in str(caught.value)
