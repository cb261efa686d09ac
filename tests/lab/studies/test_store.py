import sys
from pathlib import Path

import pytest

from flexslew_lab.studies.flight import FlightResult, failed
from flexslew_lab.studies.parts import read_written
from flexslew_lab.studies.run import PreparedStudy
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.ways import Way
from flexslew_plant.errors import BadInput, RunFault


def result(number: int, value: float) -> FlightResult:
    return FlightResult(number, {"peak_tip_deflection": value}, "ab" * 32, "ok", "", Way.BENCH)


@pytest.fixture
def store(ready: PreparedStudy, tmp_path: Path) -> Store:
    store = Store(tmp_path / "store")
    store.create(ready.identity, ready.samples)
    return store


def test_no_other_thread_holds_the_bytes_of_a_part_that_was_read(store: Store) -> None:
    """One that lets them go when Python has ended aborts the process."""
    store.add([result(k, 0.1 * k) for k in range(12)])
    (part,) = (store.folder / "parts").iterdir()
    content = part.read_bytes()
    held = sys.getrefcount(content)
    for _ in range(100):
        assert read_written(content).num_rows == 12
        assert sys.getrefcount(content) == held


def test_the_table_is_sorted_and_the_last_result_of_a_trial_counts(store: Store) -> None:
    store.add([result(3, 0.3), failed(1, "no reason")])
    store.add([result(1, 0.1), result(0, 0.0)])
    store.write_table()
    rows = store.table(["index", "status", "peak_tip_deflection", "sample"]).to_pydict()
    assert rows["index"] == rows["sample"] == [0, 1, 3]
    assert rows["peak_tip_deflection"] == [0.0, 0.1, 0.3]
    assert store.statuses(5).tolist() == [1, 1, 0, 1, 0]


def test_the_table_does_not_depend_on_parts_and_their_order(
    ready: PreparedStudy, tmp_path: Path
) -> None:
    written = []
    for k, batches in enumerate(([[0, 1, 2, 3]], [[3], [1, 2], [0]])):
        store = Store(tmp_path / str(k))
        store.create(ready.identity, ready.samples)
        for batch in batches:
            store.add([result(number, 0.1 * number) for number in batch])
        written.append(store.write_table().read_bytes())
    assert written[0] == written[1]


def test_what_a_kill_left_half_written_is_taken_away(store: Store) -> None:
    store.add([result(0, 0.0)])
    half = store.folder / "parts" / "part-000001.parquet.half"
    half.write_bytes(b"PAR1 half")
    assert store.statuses(2).tolist() == [1, 0]
    store.clean()
    assert not half.exists()


def test_a_full_disk_is_said_and_loses_nothing(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    store.add([result(0, 0.0)])

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("flexslew_lab.studies.disk.os.fsync", full)
        with pytest.raises(RunFault, match="no space left"):
            store.add([result(1, 0.1)])
    assert store.statuses(2).tolist() == [1, 0]
    assert not list((store.folder / "parts").glob("*.half"))
    store.add([result(1, 0.1)])
    assert store.statuses(2).tolist() == [1, 1]


def test_one_folder_is_written_by_one_run(store: Store) -> None:
    with (
        store.locked(),
        pytest.raises(BadInput, match="another run of a study writes here"),
        Store(store.folder).locked(),
    ):
        raise AssertionError
    with Store(store.folder).locked():
        pass


def test_a_folder_without_a_study_is_said(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="holds no study"):
        _ = Store(tmp_path).identity
    (tmp_path / "letter.txt").write_text("not yours")
    assert Store(tmp_path).unknown_items == ["letter.txt"]
