"""What a plant describes of itself: the keys of a testbed section, its clock and its brake."""

from typing import Any

import numpy as np

from flexslew_plant.external.messages import PROTOCOL, PlantFault

_KEYS = ("protocol", "name", "joints", "tips", "tip_rates", "clock", "period", "brake")
_JOINT, _TIP = ("name", "unit", "limit", "initial"), ("name", "unit")
_UNITS = ("rad", "m")
CLOCKS = ("bench", "own")


def section_of(description: dict[str, Any]) -> dict[str, Any]:
    """Return the keys of a testbed section that a description gives.

    Raises:
        PlantFault: it lacks something, or has what is not allowed.
    """
    _require_keys(description, _KEYS, "")
    if description.get("protocol") != PROTOCOL:
        raise PlantFault(f"protocol {description.get('protocol')!r}; {PROTOCOL} is supported")
    joints = _entries(description, "joints", _JOINT)
    tips = _entries(description, "tips", _TIP)
    if not joints:
        raise PlantFault("joints: give at least one")
    for k, joint in enumerate(joints):
        if joint.get("unit") not in _UNITS:
            raise PlantFault(f"joints.{k}.unit: {joint.get('unit')!r}; allowed: rad, m")
        for key, least in (("limit", 0.0), ("initial", -np.inf)):
            value = joint.get(key, 0.0 if key == "initial" else None)
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > least:
                raise PlantFault(f"joints.{k}.{key}: {value!r}; give a number above {least:g}")
    for key in ("tip_rates", "brake"):
        if not isinstance(value := description.get(key, False), bool):
            raise PlantFault(f"{key}: {value!r}; give true or false")
    clock = description.get("clock", CLOCKS[0])
    if clock not in CLOCKS:
        raise PlantFault(f"clock: {clock!r}; allowed: {', '.join(CLOCKS)}")
    if clock == "own":
        _require_rig(description)
    return {
        "joints": tuple(joint["name"] for joint in joints),
        "joint_units": tuple(joint["unit"] for joint in joints),
        "effort_limit": tuple(float(joint["limit"]) for joint in joints),
        "tips": tuple(tip["name"] for tip in tips),
        "tip_units": tuple(str(tip.get("unit", "m")) for tip in tips),
        "tip_rates": description.get("tip_rates", False),
        "clock": clock,
        "initial": {j["name"]: float(j["initial"]) for j in joints if j.get("initial")},
    }


def _require_rig(description: dict[str, Any]) -> None:
    """Check that a plant with a clock of its own has a period and a brake."""
    period = description.get("period")
    if isinstance(period, bool) or not isinstance(period, int | float) or not period > 0.0:
        raise PlantFault(f"period: {period!r}; give the period of its clock, above 0 [s]")
    if not description.get("brake"):
        raise PlantFault("brake: false; a plant with a clock of its own needs a brake")


def _entries(description: dict[str, Any], key: str, allowed: tuple[str, ...]) -> list[Any]:
    """Return a list of objects with different names."""
    entries = description.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(one, dict) for one in entries):
        raise PlantFault(f"{key}: give a list of objects")
    for k, entry in enumerate(entries):
        _require_keys(entry, allowed, f"{key}.{k}.")
        if not isinstance(entry.get("name"), str) or not entry["name"]:
            raise PlantFault(f"{key}.{k}.name: {entry.get('name')!r}; give a name")
    if len({entry["name"] for entry in entries}) < len(entries):
        raise PlantFault(f"{key}: two have one name")
    return entries


def _require_keys(values: dict[str, Any], allowed: tuple[str, ...], place: str) -> None:
    """Check that an object has no unknown key."""
    for key in values:
        if key not in allowed:
            raise PlantFault(f"{place}{key}: unknown key; allowed: {', '.join(allowed)}")
