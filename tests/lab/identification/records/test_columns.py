"""Columns of files that laboratories have: separators, marks, clocks, bags of older releases."""

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from flexslew_lab.identification.files.bag import read_bag
from flexslew_lab.identification.files.columns import FileClock
from flexslew_lab.identification.files.csv_file import column_names, read_csv
from flexslew_lab.identification.files.table import table_columns
from flexslew_lab.identification.records.foreign import external_record
from flexslew_lab.identification.records.rate_check import rate_notes
from flexslew_plant.errors import BadInput

TIMES, U, X = (0.0, 0.1, 0.2, 0.3), (1.0, 0.0, -1.0, 1.0), (0.0, 0.01, 0.02, 0.03)
STORE = get_typestore(Stores.ROS2_HUMBLE)
EFFORT = "std_msgs/msg/Float64"
STAMPED = "geometry_msgs/msg/PointStamped"


def table(delimiter: str, point: str, name: str = "u") -> str:
    rows = (map(str, row) for row in zip(TIMES, U, X, strict=True))
    lines = [delimiter.join(("time", name, "x"))]
    lines += [delimiter.join(entry.replace(".", point) for entry in row) for row in rows]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("delimiter", "point", "name", "column"),
    [
        (",", ".", "u", "u"),
        (";", ".", "u", "u"),
        (";", ",", "u", "u"),
        ("\t", ",", "u", "u"),
        (",", ".", '"Torque, Request"', "Torque, Request"),
        (";", ",", "Torque, Request", "Torque, Request"),
    ],
)
def test_a_table_is_read_however_its_columns_are_separated(
    mark: str, end: str, delimiter: str, point: str, name: str, column: str, tmp_path: Path
) -> None:
    path = tmp_path / "lab.csv"
    path.write_bytes((mark + table(delimiter, point, name).replace("\n", end)).encode())
    series = table_columns(read_csv, path, [column, "x"], FileClock()).series
    for key, values in ((column, U), ("x", X)):
        np.testing.assert_array_equal(series[key], (TIMES, values))


def test_a_name_with_a_comma_stands_in_quotes() -> None:
    assert column_names('"Torque, Request"=hub, u2=w') == ("Torque, Request=hub", "u2=w")
    assert column_names("u, ,x") == ("u", "x")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no rows"),
        ("time,u,x\n", "holds no rows"),
        ("clock,u,x\n0,1,2\n", "no column of times; .*the header is: clock; u; x"),
        ("time,speed,x\n0,1,2\n", "no column u; .*the header is: time; speed; x"),
        ("time,u,x\n0,1,2\n1,2", "x: line 3: '' is no number; the row has 2 of 3"),
        ("time,u,x\n0,1,2\n1,1,5,2\n", "the row has 4 of 3 columns"),
        ("time,u,x\n0,1,2\n1,\x00,2\n", "is no number"),
    ],
)
def test_what_is_no_table_is_refused_with_its_header(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    path.write_text(text)
    with pytest.raises(BadInput, match=words):
        table_columns(read_csv, path, ["u", "x"], FileClock())


@pytest.mark.parametrize(
    ("times", "words"),
    [
        ((0.0,) * 6, "u: the time stands still at 0 s in all 6 samples"),
        ((2.5,) * 6, "u: the time stands still at 2.5 s"),
        ((0.0, 0.0, 0.0, 0.0, 0.1, 0.2), "u: the time steps not at 0 s"),
        ((0.0, 0.1, 0.2, 0.1, 0.2, 0.3), "u: the time steps back at 0.2 s"),
        ((0.0, 0.1, np.nan, 0.3, 0.4, 0.5), "at finite times"),
    ],
)
@pytest.mark.parametrize("period", [None, 0.1])
def test_a_clock_that_does_not_run_is_refused(
    times: tuple[float, ...], words: str, period: float | None, tmp_path: Path
) -> None:
    path = tmp_path / "lab.csv"
    rows = (f"{t},{k % 3},{0.01 * k}" for k, t in enumerate(times))
    path.write_text("\n".join(("time,u,x", *rows)))
    with pytest.raises(BadInput, match=words):
        external_record(path, ("u",), ("x",), period)


def bag(path: Path, plugin: StoragePlugin, stamps: tuple[float, ...] = TIMES) -> Path:
    """Write a bag with efforts, stamped points, and a message of a type that nobody knows."""
    types = STORE.types
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        efforts = writer.add_connection("/effort", EFFORT, typestore=STORE)
        points = writer.add_connection("/point", STAMPED, typestore=STORE)
        other = writer.add_connection(
            "/other", "lab_msgs/msg/Secret", msgdef="lab_msgs/Nothing[<=] x\n", rihs01="RIHS01_0"
        )
        for recorded, stamp, u, x in zip(TIMES, stamps, U, X, strict=True):
            header = types["std_msgs/msg/Header"](
                types["builtin_interfaces/msg/Time"](int(stamp), round(stamp % 1 * 1e9)), ""
            )
            point = types["geometry_msgs/msg/Point"](x, 0.0, 0.0)
            send(writer, efforts, recorded, types[EFFORT](u))
            send(writer, points, recorded, types[STAMPED](header, point))
            writer.write(other, round(recorded * 1e9), b"\x00\x01\x00\x00")
    return path


def send(writer: Writer, connection: Connection, time: float, message: Any) -> None:
    raw = STORE.serialize_cdr(message, connection.msgtype)
    writer.write(connection, round(time * 1e9), raw)


def without_definitions(path: Path) -> None:
    """Take away from an SQLite bag what releases before Iron do not write."""
    with sqlite3.connect(next(path.glob("*.db3"))) as base:
        base.executescript(
            "DROP TABLE schema; DROP TABLE message_definitions; DROP TABLE metadata;"
        )


NAMES = ["/effort.data", "/point.point.x"]


@pytest.mark.parametrize("plugin", StoragePlugin)
def test_a_type_that_cannot_be_read_spoils_no_other_topic(
    plugin: StoragePlugin, tmp_path: Path
) -> None:
    path = bag(tmp_path / "bag", plugin)
    series = read_bag(path, NAMES).series
    for name, values in zip(NAMES, (U, X), strict=True):
        np.testing.assert_allclose(series[name], (TIMES, values), atol=1e-9)
    with pytest.raises(BadInput, match="/other: the definition of lab_msgs/msg/Secret cannot be"):
        read_bag(path, ["/other.x"])


def test_a_bag_without_definitions_is_read(tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    without_definitions(path)
    series = read_bag(path, NAMES).series
    np.testing.assert_allclose(series["/point.point.x"], (TIMES, X), atol=1e-9)
    with pytest.raises(BadInput, match="/other: the type lab_msgs/msg/Secret is unknown"):
        read_bag(path, ["/other.x"])


@pytest.mark.parametrize("stamp", [0.0, 3.0])
def test_stamps_that_stand_still_give_way_to_the_time_of_recording(
    stamp: float, tmp_path: Path
) -> None:
    columns = read_bag(bag(tmp_path / "bag", StoragePlugin.MCAP, (stamp,) * 4), NAMES)
    np.testing.assert_allclose(columns.series["/point.point.x"][0], TIMES, atol=1e-9)
    assert columns.notes == (
        "/point.point.x: the stamps stand still; the times of recording count",
    )


def test_times_of_recording_count_where_they_are_requested(tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", StoragePlugin.MCAP, (7.0, 8.0, 9.0, 10.0))
    for recorded, times in ((False, (7.0, 8.0, 9.0, 10.0)), (True, TIMES)):
        columns = read_bag(path, NAMES, FileClock(recorded=recorded))
        np.testing.assert_allclose(columns.series["/point.point.x"][0], times, atol=1e-9)
        assert columns.notes == ()


def read(path: Path, names: list[str], clock: FileClock = FileClock()) -> Any:  # noqa: B008
    return table_columns(read_csv, path, names, clock).series


@pytest.mark.parametrize(
    ("content", "names"),
    [
        (b"0 1 0\n1 0 .5\n2 -1 1\n", ("2", "3")),  # no header
        (b"  0.0\t 1.0 \t0\n  1.0\t 0 \t.5\n  2\t-1\t1\n", ("2", "3")),
        (b"# made in a lab\n# time u x\n0 1 0\n1 0 .5\n2 -1 1\n", ("u", "x")),
        (b"% comment\ntime,u,x\n0,1,0\n# pause\n1,0,.5\n\n2,-1,1\n\n\n", ("u", "x")),
        (b'"time","u","x"\n"0,0","1,0","0,0"\n"1,0","0,0","0,5"\n"2,0","-1","1"\n', ("u", "x")),
        ("time;Moment [N\xb7m];x\n0;1;0\n1;0;,5\n2;-1;1\n".encode("latin-1"),
         ("Moment [N\xb7m]", "x")),
        ("time\tu\tx\n0\t1\t0\n1\t0\t.5\n2\t-1\t1\n".encode("utf-16"), ("u", "x")),
        (b"state,time,u,x\nrun,0,1,0\nrun,1,0,.5\nend,2,-1,1\n", ("u", "x")),
    ],
)  # fmt: skip
def test_tables_of_other_programs_are_read(
    content: bytes, names: tuple[str, str], tmp_path: Path
) -> None:
    path = tmp_path / "lab.csv"
    path.write_bytes(content)
    clock = FileClock(column="1" if names[0] == "2" else None)
    found = read(path, list(names), clock)
    np.testing.assert_array_equal(found[names[0]], ([0.0, 1.0, 2.0], [1.0, 0.0, -1.0]))
    np.testing.assert_array_equal(found[names[1]], ([0.0, 1.0, 2.0], [0.0, 0.5, 1.0]))


@pytest.mark.parametrize(
    ("name", "unit", "step"),
    [
        ("time", None, 1.0), ("t", "ms", 1e-3), ("Time [ms]", None, 1e-3), ("t_ns", None, 1e-9),
        ("timestamp", "us", 1e-6), ("time (s)", None, 1.0), ("time_ms", "s", 1.0),
    ],
)  # fmt: skip
def test_times_have_the_unit_of_the_option_or_of_their_name(
    name: str, unit: str | None, step: float, tmp_path: Path
) -> None:
    path = tmp_path / "lab.csv"
    path.write_text(f"{name},u\n0,1\n1,2\n2,3\n")
    t, _ = read(path, ["u"], FileClock(unit=unit))["u"]
    np.testing.assert_allclose(t, step * np.arange(3.0))


def test_a_file_without_times_has_the_period(tmp_path: Path) -> None:
    path = tmp_path / "lab.txt"
    path.write_text("1 2\n3 4\n5 6\n")
    np.testing.assert_allclose(
        read(path, ["2"], FileClock(period=0.5))["2"], ([0, 0.5, 1], [2, 4, 6])
    )
    with pytest.raises(BadInput, match=r"no column of times; .* or give --period; .*: 1; 2"):
        read(path, ["2"])
    with pytest.raises(BadInput, match="--time: 'clock' is not allowed: no such column"):
        read(path, ["2"], FileClock(column="clock"))


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.0, None), (1e-3, "--time-unit ms"), (1e-6, "--time-unit us"), (1e-9, "--time-unit ns"),
        (57.29578, "position in degrees"), (0.0174533, "rate in degrees"), (-1.0, "other sign"),
        (3.0, "check the units"),
    ],
)  # fmt: skip
def test_position_and_rate_that_disagree_are_named_with_the_factor(
    factor: float, words: str | None
) -> None:
    t = np.linspace(0.0, 10.0, 2001)
    position = factor * (np.sin(3.0 * t) + 0.2 * t)
    series = {"position.hub": (t, position), "rate.hub": (t, 3.0 * np.cos(3.0 * t) + 0.2)}
    notes = rate_notes(series)
    assert len(notes) == (words is not None)
    if words is not None:
        assert notes[0].startswith(f"position.hub is {factor:.3g} times the integral of rate.hub")
        assert words in notes[0]


def test_a_number_that_no_sensor_gives_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "lab.csv"
    path.write_text("time,u\n0,1\n1,1e101\n2,3\n")
    with pytest.raises(BadInput, match=r"u: has a number above 1e\+100; is the file damaged"):
        external_record(path, ("u",), ("u",))
