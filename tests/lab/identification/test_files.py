"""One experiment in every format: the same record, the same mode, and hostile files in one line."""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

from flexslew_lab.identification.files import READERS
from flexslew_lab.identification.files.columns import FileClock
from flexslew_lab.identification.modal.modes import identify_modes
from flexslew_lab.identification.modal.oscillators import Oscillator, double_integral
from flexslew_lab.identification.records.foreign import RecordWithNotes, external_record
from flexslew_plant.errors import BadInput

H, TICKS, INERTIA, MODE = 0.02, 3000, 2.0, Oscillator(5.0, 0.01)
NAMES = ("u", "x", "v", "s")
INPUTS, OUTPUTS = ("u=hub",), ("x=position.hub", "v=rate.hub", "s")

Table = dict[str, np.ndarray]


@lru_cache
def table(ticks: int = TICKS) -> Table:
    """Return a rigid body of 2 kg m^2 with a mode at 5 rad/s, damping .01, and 1 % of noise."""
    rng = np.random.default_rng(1)
    t = H * np.arange(ticks + 1)
    lines = np.arange(1.0, 12.0, 2.0 * np.pi / t[-1])
    u = np.sin(np.outer(t, lines) + rng.uniform(0.0, 6.28, lines.size)).sum(axis=1)
    position, rate = (x[:, 0] / INERTIA for x in double_integral(u[:-1, None], H))
    q, v = (x[:, 0] / MODE.frequency**2 for x in MODE.responses(u[:-1, None], H))
    clean = np.column_stack((position + 0.3 * q, rate + 0.3 * v, 0.5 * q))
    noisy = clean + 0.01 * clean.std(axis=0) * rng.standard_normal(clean.shape)
    return {"time": t, "u": u, **dict(zip(NAMES[1:], noisy.T, strict=True))}


def as_csv(path: Path, values: Table, delimiter: str = ",", point: str = ".") -> None:
    rows = [delimiter.join(values)]
    rows += [
        delimiter.join(repr(float(x)).replace(".", point) for x in row)
        for row in zip(*values.values(), strict=True)
    ]
    path.write_text("\n".join(rows))


def as_hdf5(path: Path, values: Table) -> None:
    """Write what MATLAB writes with -v7.3: a block of 512 bytes, then HDF5 with matrices turned."""
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, column in values.items():
            file[name] = column[None]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def as_parquet(path: Path, values: Table) -> None:
    pa: Any = pytest.importorskip("pyarrow")
    import pyarrow.parquet as parquet

    parquet.write_table(pa.table(values), path)


def as_dated_parquet(path: Path, values: Table) -> None:
    pa: Any = pytest.importorskip("pyarrow")
    import pyarrow.parquet as parquet

    begin = np.datetime64("2024-05-01T12:00:00", "ns")
    stamps = begin + np.round(values["time"] * 1e9).astype("timedelta64[ns]")
    parquet.write_table(pa.table(values | {"time": stamps}), path)


def as_uff(path: Path, values: Table) -> None:
    pyuff: Any = pytest.importorskip("pyuff")
    sets = [
        pyuff.prepare_58(
            binary=0, func_type=1, id1=name, rsp_node=k, rsp_dir=3, ref_node=0,
            ref_dir=0, x=values["time"], data=column,
            abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=H, ordinate_spec_data_type=1,
            abscissa_spec_data_type=17, orddenom_spec_data_type=0,
        )
        for k, (name, column) in enumerate(values.items())
        if name != "time"
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")


def as_bag(path: Path, values: Table, plugin: StoragePlugin = StoragePlugin.MCAP) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float64"
    with Writer(path, version=8, storage_plugin=plugin) as writer:
        topics = {n: writer.add_connection(f"/{n}", kind, typestore=store) for n in NAMES}
        for k, stamp in enumerate(values["time"]):
            for name, topic in topics.items():
                raw = store.serialize_cdr(store.types[kind](float(values[name][k])), kind)
                writer.write(topic, round(stamp * 1e9), raw)


WRITERS: dict[str, Callable[[Path, Table], None]] = {
    "lab.csv": as_csv,
    "lab.txt": lambda path, values: as_csv(path, values, " "),
    "lab.tsv": lambda path, values: as_csv(path, values, "\t", ","),
    "lab.dat": lambda path, values: as_csv(path, values, ";", ","),
    "lab.mat": lambda path, values: savemat(path, values),
    "lab7_3.mat": as_hdf5,
    "lab.npz": lambda path, values: np.savez(path, **dict[str, Any](values)),
    "lab.parquet": as_parquet,
    "dated.parquet": as_dated_parquet,
    "lab.uff": as_uff,
    "lab.unv": as_uff,
    "lab.58": as_uff,
    "bag": as_bag,
    "sqlite": lambda path, values: as_bag(path, values, StoragePlugin.SQLITE3),
}


def read(path: Path, clock: FileClock = FileClock()) -> RecordWithNotes:  # noqa: B008
    if not path.is_dir():
        return external_record(path, INPUTS, OUTPUTS, clock=clock)
    inputs, outputs = (
        tuple(f"/{one.partition('=')[0]}.data={one.partition('=')[2] or one}" for one in group)
        for group in (INPUTS, OUTPUTS)
    )
    return external_record(path, inputs, outputs, clock=clock)


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_record(name: str, tmp_path: Path) -> None:
    path, values = tmp_path / name, table(400)
    WRITERS[name](path, values)
    record, words = read(path)
    assert words == ()
    assert record.period == pytest.approx(H, rel=1e-6)
    assert record.effort[:, 0] == pytest.approx(values["u"][:-1], rel=1e-6, abs=1e-9)
    measured = np.column_stack([values[one] for one in NAMES[1:]])
    assert record.measured == pytest.approx(measured, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.slow
def test_every_format_gives_the_mode_and_the_inertia(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    WRITERS[name](path, table())
    model = identify_modes(read(path).record)
    (mode,) = model.modes
    for interval, truth in (
        (mode.frequency, MODE.frequency),
        (mode.damping_ratio, MODE.damping_ratio),
        (model.inertia[0][0], INERTIA),
    ):
        half = 0.5 * (interval.high - interval.low)
        assert interval.value == pytest.approx(truth, abs=2.0 * half)
    assert mode.frequency.value == pytest.approx(MODE.frequency, rel=1e-3)


def test_every_suffix_of_a_file_has_a_writer_here() -> None:
    suffixes = {Path(name).suffix for name in WRITERS}
    assert {*READERS} - {".mcap", ".db3"} == suffixes - {""}


def test_a_matrix_has_numbered_columns(tmp_path: Path) -> None:
    values = table(400)
    matrix = np.column_stack([values[name] for name in NAMES])
    np.savez(tmp_path / "a.npz", t=values["time"], y=matrix)
    savemat(tmp_path / "b.mat", {"t": values["time"], "y": matrix.T})
    for path in sorted(tmp_path.iterdir()):
        found = external_record(path, ("y[0]=hub",), ("y[1]=position.hub",)).record
        assert found.measured[:, 0] == pytest.approx(values["x"])
        for name, words in (("y[4]", "y has 4 columns"), ("y", r"write y\[0\] to y\[3\]"),
                            ("z", "no column z; .*the header is: ")):  # fmt: skip
            with pytest.raises(BadInput, match=words):
                external_record(path, (name,), ("y[1]",))


def hostile(path: Path) -> None:
    """Write a file that runs code, reads another one, or asks for more memory than there is."""
    np.savez(path, time=np.array([print], dtype=object), u=np.zeros(3), x=np.zeros(3))


def as_cell(path: Path) -> None:
    savemat(path, {"time": np.array(["a", 1.0], dtype=object), "u": np.zeros(3)})


def as_link(path: Path) -> None:
    h5py: Any = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name in ("time", "u"):
            file.create_dataset(name, (1, 3), "f8", external=[("/etc/passwd", 0, 24)])
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize(
    ("name", "write", "words"),
    [
        ("a.npz", hostile, "cannot be read: time.npy: .*|Object arrays"),
        ("a.mat", as_cell, "time holds no matrix of numbers"),
        ("a.mat", as_link, "time lies in another file"),
        ("a.xlsx", lambda path: path.write_text("x"), r"\.xlsx; allowed are \.csv, \.txt"),
        ("a.csv", lambda path: path.write_text("x" * (2 << 20)), "line 1 is longer than 1,048,576"),
        ("a.uff", lambda path: path.write_text("    -1\n    58\n    -1\n"), "cannot be read"),
        ("a.uff", lambda path: path.write_text("x"), "holds no dataset 58; its datasets are: none"),
    ],
)
def test_hostile_files_are_refused_in_one_line(
    name: str, write: Callable[[Path], Any], words: str, tmp_path: Path
) -> None:
    if name.endswith("uff"):
        pytest.importorskip("pyuff")
    write(tmp_path / name)
    with pytest.raises(BadInput, match=words) as caught:
        external_record(tmp_path / name, ("u",), ("u",))
    assert str(caught.value).isprintable()
