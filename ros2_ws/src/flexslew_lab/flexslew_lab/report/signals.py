"""Every signal of a run as an array over the ticks of its truth, with name and unit."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.log.joints_flown import estimated_joints, joints_and_modes
from flexslew_lab.log.recorded_testbed import recorded_model
from flexslew_lab.log.truth_columns import coordinate_of
from flexslew_lab.metrics.from_bag import joint_names_of
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.model import Model

_Q, _V = "coordinate", "coordinate_rate"  # no fields: the state, where joints are read from it
_STATE = {_Q: "position", _V: "velocity"}  # as the truth has it
_TERM = "term."  # begins the names of the terms of the efforts
_RATES = ("velocity", "measured_rate", "reference_rate", "estimate_rate")
# name of a signal: its topic, the field of the message, what its columns are named after
_FIELDS = {
    "position": ("/truth", "position", "coordinates"),
    "velocity": ("/truth", "velocity", "coordinates"),
    "effort": ("/truth", "applied_effort", "efforts"),
    "disturbance": ("/truth", "disturbance", "efforts"),
    "tip": ("/truth", "tip_deflection", "appendages"),
    "energy": ("/truth", "energy", "J"),
    _Q: ("/truth", _Q, "numbers"),
    _V: ("/truth", _V, "numbers"),
    "measured": ("/measurement", "joint_position", "coordinates"),
    "measured_rate": ("/measurement", "joint_velocity", "coordinates"),
    "sensor": ("/measurement", "tip_deflection", "sensors"),
    "curvature": ("/measurement", "root_curvature", "bends"),
    "reference": ("/controller_state", "reference_position", "coordinates"),
    "reference_rate": ("/controller_state", "reference_velocity", "coordinates"),
    "feedforward": ("/controller_state", "feedforward", "efforts"),
    "demand": ("/controller_state", "effort", "efforts"),
    "estimate": ("/controller_state", "estimate_position", "coordinates"),
    "estimate_rate": ("/controller_state", "estimate_velocity", "coordinates"),
    "estimated_disturbance": ("/controller_state", "estimate_disturbance", "efforts"),
    "innovation": ("/controller_state", "innovation", "numbers"),
    "nis": ("/controller_state", "nis", "-"),
    "covariance": ("/controller_state", "covariance_diagonal", "numbers"),
    "reference_orientation": ("/controller_state", "reference_orientation", "quaternion"),
    "estimate_orientation": ("/controller_state", "estimate_orientation", "quaternion"),
}
# other names of signals, those of the fields in the log among them, of which the truth comes first
SYNONYMS = {field: name for name, (_, field, _) in reversed(_FIELDS.items())} | {
    "tips": "tip",
    "estimate minus truth": "estimate_error",
    "terms": "term",
}


class Signals(NamedTuple):
    """Arrays of one length; NaN where a signal has no value at a tick."""

    time: Vector  # simulated, of every tick, (ticks,) [s]
    values: dict[str, Vector]  # by name, each (ticks,)
    units: dict[str, str]  # by name


def read_signals(bag: BagReader) -> Signals:
    """Return all signals of the last epoch of a bag, whole in memory: of what metrics measure.

    Raises:
        BadInput: the bag is damaged, or holds no truth.
    """
    columns = _columns(bag)
    truth = columns.get("/truth", {})
    if not truth:
        raise BadInput("holds no truth", bag.path)
    last = truth["epoch"] == truth["epoch"].max()
    truth |= {field: column[last] for field, column in truth.items()}
    model = recorded_model(bag.overview, bag.trust)
    if (
        model is not None
        and model.reading is not None
        and truth["position"].shape[1] == model.positions
    ):
        _read(model, columns)
    ticks = _keys_of_ticks(truth)
    labels = _labels(bag.overview, truth["applied_effort"].shape[1], model)
    values: dict[str, Vector] = {}
    units: dict[str, str] = {}
    for signal_name, (topic, field, kind) in _FIELDS.items():
        if field not in columns.get(topic, {}):
            continue
        found = columns[topic][field]
        rows = _at(ticks, _keys_of_ticks(columns[topic]), found.reshape(len(found), -1))
        for k, column in enumerate(rows.T):
            name, unit = labels[kind](k)
            if not (name or unit):
                continue
            if signal_name in _STATE:
                known = coordinate_of(bag.overview, _STATE[signal_name], k, bag.trust)
                name, unit = known or (name, unit)
            full = f"{signal_name}.{name}" if name else signal_name
            values[full] = np.ascontiguousarray(column)
            units[full] = f"{unit}/s" if signal_name in _RATES else unit
    joints = joint_names_of(bag.overview, truth["applied_effort"].shape[1])
    for topic in (topic for topic in columns if topic.startswith(_TERM)):
        rows = _at(ticks, _keys_of_ticks(columns[topic]), columns[topic]["term"])
        for k, column in enumerate(rows.T):
            name, unit = labels["efforts"](k)
            values[f"{topic}.{name}"], units[f"{topic}.{name}"] = np.ascontiguousarray(column), unit
    _add_errors(values, units, model, joints)
    time = truth["header.stamp.sec"] + truth["header.stamp.nanosec"] * 1e-9
    return Signals(time, values, units)


def _add_errors(
    values: dict[str, Vector], units: dict[str, str], model: Model | None, joints: tuple[str, ...]
) -> None:
    """Add reference - position and estimate - position of the joints, where both are there."""
    known = model is not None and model.joints == len(joints)
    for error, end in (("error", "reference"), ("estimate_error", "estimate")):
        pair = [[f"{name}.{joint}" for joint in joints] for name in ("position", end)]
        if not joints or not all(name in values for names in pair for name in names):
            continue
        at, to = (np.column_stack([values[name] for name in names]) for names in pair)
        columns = model.joint_error(at, to) if model is not None and known else to - at
        for joint, column in zip(joints, columns.T, strict=True):
            values[f"{error}.{joint}"] = np.ascontiguousarray(column)
            units[f"{error}.{joint}"] = units[f"position.{joint}"]


def _columns(bag: BagReader) -> dict[str, dict[str, Any]]:
    """Return the fields of the topics as arrays, (messages, entries), by topic."""
    fields: dict[str, set[str]] = {}
    for topic, field, _ in _FIELDS.values():
        fields.setdefault(topic, {"tick", "epoch"}).update({field} - _STATE.keys())
    fields["/truth"] |= {"header.stamp.sec", "header.stamp.nanosec"}
    parts: dict[str, dict[str, list[Any]]] = {}
    for block in bag.blocks(list(fields)):
        found = parts.setdefault(block.topic, {})
        for field in fields[block.topic] & block.columns.keys():
            found.setdefault(field, []).append(np.asarray(block.columns[field]))
        if block.topic == "/controller_state":
            for name, term in _terms_of(block.columns):
                found = parts.setdefault(f"{_TERM}{name}", {})
                for field, column in {**block.columns, "term": term}.items():
                    if field in ("tick", "epoch", "term"):
                        found.setdefault(field, []).append(np.asarray(column))
    return {
        topic: {field: _stack_blocks(pieces) for field, pieces in found.items()}
        for topic, found in parts.items()
    }


def _terms_of(columns: dict[str, Any]) -> Iterator[tuple[str, Matrix]]:
    """Yield the terms of the efforts by name, each of shape (messages, joints) [N m or N]."""
    names, joints = columns["term_names"][0], columns["effort"].shape[1]
    if columns["terms"].shape[1] == joints * len(names):
        for k, name in enumerate(names):
            yield str(name), columns["terms"][:, k * joints : (k + 1) * joints]


def _read(model: Model, columns: dict[str, dict[str, Any]]) -> None:
    """Put joints and modes where the log has the state, and estimates where joints read them."""
    truth, states = columns["/truth"], columns.get("/controller_state")
    truth |= {_Q: truth["position"], _V: truth["velocity"]}
    truth["position"], truth["velocity"] = joints_and_modes(model, truth[_Q], truth[_V])
    if states is not None:
        pair = states["estimate_position"], states["reference_position"]
        states["estimate_position"] = estimated_joints(model, *pair)


def _stack_blocks(pieces: list[Any]) -> Any:
    """Return blocks one below the other; narrower ones are filled up with NaN."""
    if pieces[0].ndim == 1:
        return np.concatenate(pieces)
    width = max(piece.shape[1] for piece in pieces)
    padded = [np.full((len(piece), width), np.nan) for piece in pieces]
    for target, piece in zip(padded, pieces, strict=True):
        target[:, : piece.shape[1]] = piece
    return np.concatenate(padded)


def _keys_of_ticks(columns: dict[str, Any]) -> Any:
    """Return one rising number per epoch and tick."""
    return columns["epoch"].astype(np.int64) << 40 | columns["tick"].astype(np.int64)


def _at(ticks: Any, value_ticks: Any, values: Matrix) -> Matrix:
    """Return the rows of `values` at the ticks of the truth, NaN where there is none."""
    rows = np.full((len(ticks), values.shape[1]), np.nan)
    place = np.minimum(np.searchsorted(ticks, value_ticks), len(ticks) - 1)
    matched = ticks[place] == value_ticks
    rows[place[matched]] = values[matched]
    return rows


def _labels(overview: Overview, efforts: int, model: Model | None) -> dict[str, Any]:
    """Return for each kind of column a function from its number to its name and unit.

    Both are empty where a column of the truth has no known meaning.
    """
    joints = joint_names_of(overview, efforts)
    known = overview.testbed is not None and len(overview.testbed.joint_units) == len(joints)
    units = tuple(overview.testbed.joint_units) if known else ("rad",) * len(joints)
    appendages = tuple(overview.testbed.appendage_names) if overview.testbed is not None else ()
    sensors = tips = [(k, name, "m") for k, name in enumerate(appendages)]
    if model is not None and model.appendages.names == appendages:
        sensors, tips = model.appendages.sensors, model.appendages.deflections
    tip_labels, sensor_labels = (
        {k: (name, unit) for k, name, unit in each} for each in (tips, sensors)
    )

    def coordinate(k: int) -> tuple[str, str]:
        return (joints[k], units[k]) if k < len(joints) else (f"mode_{k - len(joints) + 1}", "m")

    def effort(k: int) -> tuple[str, str]:
        return joints[k], "N" if units[k] == "m" else "N m"

    def sensor(k: int) -> tuple[str, str]:
        return sensor_labels.get(k, (f"appendage_{k + 1}", "m"))

    def appendage(k: int) -> tuple[str, str]:
        return tip_labels.get(k, ("", "") if k < len(appendages) else (f"appendage_{k + 1}", "m"))

    return {
        "coordinates": coordinate,
        "efforts": effort,
        "appendages": appendage,
        "sensors": sensor,
        "J": lambda k: ("", "J"),
        "-": lambda k: ("", "-"),
        "quaternion": lambda k: ("xyzw"[k] if k < 4 else str(k), "-"),
        "bends": lambda k: (appendages[k] if k < len(appendages) else f"appendage_{k + 1}", "1/m"),
        "numbers": lambda k: (str(k + 1), ""),
    }
