"""Damage and links in the folder of a study: named, never trusted, never followed."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from flexslew_lab.cli.main import app
from flexslew_lab.run.pool import InThisProcess
from flexslew_lab.studies.finish import finished, keep_worst
from flexslew_lab.studies.run import PreparedStudy, prepare, run_study
from flexslew_lab.studies.seals import part_name
from flexslew_lab.studies.store import Store
from flexslew_lab.studies.study import Study
from flexslew_plant.errors import BadInput, FlexslewError

FLIPS = 200
LOST = ("report.html", ".writing")  # nothing is read from them


WHOLE = {"index": [0], "status": ["ok"], "reason": [""], "way": ["bench"], "trajectory_hash": ["0"]}


@pytest.fixture(scope="module")
def sound(
    study_in: Callable[..., Study], tmp_path_factory: pytest.TempPathFactory
) -> tuple[PreparedStudy, Path]:
    """Return a study and its folder, which nobody damages."""
    folder = tmp_path_factory.mktemp("sound")
    criteria = {"peak_tip_deflection": {"below": 1.0, "probability": 0.5}}
    ready = prepare(study_in(folder, criteria=criteria))
    store = run_study(ready, folder / "s", InThisProcess(ready.job))
    finished(ready.study, store)
    return ready, store.folder


@pytest.fixture
def flown(sound: tuple[PreparedStudy, Path], tmp_path: Path) -> tuple[PreparedStudy, Store]:
    """Return the study and a copy of its folder."""
    ready, folder = sound
    return ready, Store(Path(shutil.copytree(folder, tmp_path / "s")))


def told(command: list[str]) -> tuple[int, dict[str, Any] | None, str]:
    """Return exit code, what --json prints, and what a person reads; no traceback passes."""
    result = CliRunner().invoke(app, command)
    if isinstance(result.exception, FlexslewError):
        return 2, None, str(result.exception)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, json.loads(result.stdout or "null"), result.stderr


@pytest.mark.slow
def test_no_bit_that_flips_changes_a_result_silently(
    flown: tuple[PreparedStudy, Store], monkeypatch: pytest.MonkeyPatch
) -> None:
    """200 single bits anywhere in the folder, each under `study status` and `study report`.

    The page shows what --json prints, and would take most of the time.
    """
    monkeypatch.setattr("flexslew_lab.studies.findings.page.study_page", lambda *_: "page")
    _, store = flown
    folder = str(store.folder)
    sound = {name: told(["study", name, folder, "--json"]) for name in ("status", "report")}
    assert [code for code, _, _ in sound.values()] == [0, 0]
    files = sorted(p for p in store.folder.rglob("*") if p.is_file() and p.name not in LOST)
    sizes = np.array([path.stat().st_size for path in files])
    rng = np.random.default_rng(29)
    seen = 0
    for _ in range(FLIPS):
        path = files[int(rng.choice(len(files), p=sizes / sizes.sum()))]
        before = path.read_bytes()
        content = bytearray(before)
        content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
        path.write_bytes(bytes(content))
        for name, (_, known, _) in sound.items():
            code, found, words = told(["study", name, folder, "--json"])
            if code == 0:
                assert found == known, path
            else:
                seen += 1
                assert path.name[:11] in words, (path, words)
        path.write_bytes(before)
    assert seen > FLIPS // 4


@pytest.mark.slow
def test_a_damaged_part_is_named_and_flown_again(flown: tuple[PreparedStudy, Store]) -> None:
    ready, store = flown
    whole = store.table_path.read_bytes()
    (part,) = (store.folder / "parts").iterdir()
    content = bytearray(part.read_bytes())
    content[len(content) // 2] ^= 4
    part.write_bytes(bytes(content))
    assert Store(store.folder).damaged == [part.name]
    assert not Store(store.folder).statuses(ready.trials).any()
    again = run_study(ready, store.folder, InThisProcess(ready.job))
    assert again.damaged == []
    assert again.table_path.read_bytes() == whole
    assert (store.folder / "parts" / f"{part.name}.damaged").is_file()


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (WHOLE | {"index": [10**9]}, "trial 1000000000 is not one of 0 to 11"),
        ({"index": [-1], "status": ["ok"]}, "damaged"),
        ({"index": ["none"], "status": ["ok"]}, "damaged"),
        ({"status": ["ok"]}, "damaged"),
        ({"index": [0], "status": [1.5]}, "damaged"),
        ({"index": [0]}, "damaged"),
        (WHOLE | {"peak_tip_deflection": ["much"]}, "damaged"),
    ],
)
def test_a_crafted_part_is_said_in_one_line(
    flown: tuple[PreparedStudy, Store], rows: dict[str, Any], words: str
) -> None:
    """Also one whose digest is right."""
    _, store = flown
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(rows), sink)
    content = bytes(sink.getvalue())
    (store.folder / "parts" / part_name(7, content)).write_bytes(content)
    for command in (["study", "status", str(store.folder)], ["study", "report", str(store.folder)]):
        result = CliRunner().invoke(app, command)
        assert result.exit_code != 0
        assert words in str(result.exception) + result.stderr


@pytest.mark.parametrize("content", ["[]", "{}", "{", '{"study": 3}', "\x00", '{"sha256": 3}'])
def test_a_crafted_identity_is_said_in_one_line(
    flown: tuple[PreparedStudy, Store], content: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, store = flown
    (store.folder / "study.json").write_text(content)
    monkeypatch.setattr("flexslew_lab.trial.outputs.RUNS", store.folder.parent)
    for command in (["status", str(store.folder)], ["report", str(store.folder)], ["list"]):
        code, _, words = told(["study", *command, "--json"])
        assert code == (0 if command == ["list"] else 2)
        assert command == ["list"] or "study.json" in words


@pytest.mark.parametrize("name", ["report.html", "table.parquet", "flights.json", "study.yaml"])
def test_no_command_writes_through_a_link(
    flown: tuple[PreparedStudy, Store], tmp_path: Path, name: str
) -> None:
    ready, store = flown
    outside = tmp_path / "outside"
    outside.write_text("mine")
    place = store.folder / name
    if place.is_file():
        place.unlink()
    place.symlink_to(outside)
    told(["study", "report", str(store.folder), "--json"])
    with pytest.raises(BadInput) if name == "flights.json" else open("/dev/null"):
        run_study(ready, store.folder, InThisProcess(ready.job))
    assert outside.read_text() == "mine"


@pytest.mark.parametrize("name", ["parts", "worst"])
def test_a_folder_that_is_a_link_is_refused(
    study_of: Callable[..., Study], tmp_path: Path, name: str
) -> None:
    ready = prepare(study_of(keep={"bags": "worst 1"}))
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "mine").mkdir()
    folder = tmp_path / "s"
    folder.mkdir()
    (folder / name).symlink_to(outside)

    def whole_run() -> None:
        store = run_study(ready, folder, InThisProcess(ready.job))
        keep_worst(ready, store, print)

    with pytest.raises(BadInput, match=r"is a link|holds no study"):
        whole_run()
    assert [path.name for path in outside.iterdir()] == ["mine"]
