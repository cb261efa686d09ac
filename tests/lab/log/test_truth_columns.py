"""Columns of the truth are called after the coordinates that they hold, not after joints."""

from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from flexslew_lab.log.export import export_log
from flexslew_lab.notebook import fly, trial
from flexslew_plant.testbeds import read_testbed

GYRO = {"axis": [1.0, 0.0, 0.0], "rotor": [0.0, 1.0, 0.0], "momentum": 1.0}
PANEL = {"kind": "beam", "length": 2.0, "linear_density": 0.5, "bending_stiffness": 9.0, "modes": 1}


def test_a_spacecraft_s_truth_says_what_is_a_turn_and_what_a_place(tmp_path: Path) -> None:
    """`position.roll` was the first coordinate of the place, in metres, called rad."""
    changes = {"duration": 2.0, "testbed.initial.roll": 0.3, "plan": None}
    flight = fly(trial("own_spacecraft", changes), tmp_path / "run")
    half = 0.15
    assert flight["coordinate.quaternion_x"][0] == pytest.approx(np.sin(half), abs=1e-12)
    assert flight["coordinate.quaternion_w"][0] == pytest.approx(np.cos(half), abs=1e-12)
    np.testing.assert_array_equal(flight["coordinate.place_x"][0], 0.0)
    assert flight["position.roll"][0] == pytest.approx(0.3, abs=1e-12)
    assert flight.units["position.roll"] == "rad"
    assert flight.units["coordinate.place_x"] == "m"
    assert flight.units["coordinate.quaternion_x"] == ""
    assert flight.units["coordinate_rate.roll_wheel"] == "rad/s"
    assert flight.units["coordinate_rate.body_rate_x"] == "rad/s"
    assert [n for n in flight.signals if n.startswith("position.mode_")][-1] == "position.mode_6"
    exported = export_log(tmp_path / "run/bag", tmp_path / "tables", topics=["/truth"])
    table = pyarrow.parquet.read_table(exported.files["/truth"])
    for name, signal in (("position", "coordinate"), ("velocity", "coordinate_rate")):
        for column in [c for c in table.column_names if c.startswith(f"{name}.")]:
            own = column.replace(name, signal)
            np.testing.assert_array_equal(table[column].to_numpy(), flight[own])
            unit = table.schema.field(column).metadata.get(b"unit", b"").decode()
            assert unit == flight.units[own]


def test_every_sensor_of_a_spacecraft_has_its_own_unit(tmp_path: Path) -> None:
    """A rate, an acceleration and a quaternion were in metres: all are readings of tips."""
    on = {"appendage": "left"}
    sensors = {
        "swung": {"kind": "rate", **on, "direction": [0.0, 0.0, 1.0]},
        "shaken": {"kind": "accelerometer", **on, "direction": [0.0, 0.0, 1.0]},
        "gyro": {"kind": "gyro"},
        "tracker": {"kind": "star_tracker", "boresight": [0.0, 0.0, 1.0]},
        "spun": {"kind": "tachometer"},
    }
    changes = {"duration": 0.02, "plan": None, "testbed.sensors": sensors}
    flight = fly(trial("own_spacecraft", changes), tmp_path / "run")
    units = {"left_z": "m", "left_rate_z": "m/s", "swung": "m/s", "shaken": "m/s^2"}
    units |= {"gyro_x": "rad/s", "tracker_qw": "", "spun_roll": "rad/s"}
    assert {name: flight.units.get(f"tip.{name}") for name in units} == {
        name: "m" if name == "left_z" else None  # of the others the truth holds nothing
        for name in units
    }
    exported = export_log(tmp_path / "run/bag", tmp_path / "tables", topics=["/measurement"])
    schema = pyarrow.parquet.read_schema(exported.files["/measurement"])
    said = {name: schema.field(f"tip_deflection.{name}").metadata for name in units}
    assert {name: (m or {}).get(b"unit", b"").decode() for name, m in said.items()} == units


@pytest.mark.parametrize("motion", ["free", "pivot", "held"])
def test_every_coordinate_has_a_name_of_its_own(motion: str) -> None:
    craft = {
        "kind": "spacecraft",
        "platform": {"motion": motion},
        "appendages": {
            "arm": {"hinge": {"kind": "driven"}, "shape": PANEL},
            "tank": {"hinge": {"kind": "passive"}, "shape": PANEL},
        },
        "actuators": {},
        "wheels": {}
        if motion == "held"
        else {"arm": {"axis": [1, 0, 0], "inertia": 0.1, "limit": 1}},
        "control_moment_gyros": {"arm_": GYRO} if motion == "free" else {},
    }
    model = read_testbed(craft, "here").model()
    q, v = model.state_columns
    assert (len(q), len(v)) == (model.positions, model.coordinates)
    for columns in (q, v):
        assert len({name for name, _ in columns}) == len(columns)
