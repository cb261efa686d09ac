"""The archive of a run: RO-Crate 1.1, whole, with hashes, and flown again to the same bits."""

import json
import subprocess
import zipfile
from pathlib import Path
from typing import Any

import pytest
from tests.lab.conftest import Call

import flexslew as fs
from flexslew_control.plans.plan_file import load_plan
from flexslew_lab.publication.archive import Statement, write_archive
from flexslew_lab.report.run_notes import read_notes, set_note
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.errors import BadInput

LAW = """
class Still:
    def __init__(self, options, period, limit):
        pass

    def reset(self, measurement, effort):
        pass

    def update(self, measurement, reference):
        return 0.0 * measurement.joint_position
"""


def entities(crate: Path) -> dict[str, dict[str, Any]]:
    """Return the graph of a crate by identifier, after checking what RO-Crate 1.1 requires."""
    content = json.loads((crate / "ro-crate-metadata.json").read_text())
    assert content["@context"][0] == "https://w3id.org/ro/crate/1.1/context"
    graph = {entity["@id"]: entity for entity in content["@graph"]}
    assert len(graph) == len(content["@graph"])  # flat: every entity once
    head, root = graph["ro-crate-metadata.json"], graph["./"]
    assert head["about"] == {"@id": "./"}
    assert head["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.1"}
    assert {"name", "description", "datePublished", "license"} <= set(root)
    for entity in graph.values():
        assert "@type" in entity
        for value in entity.values():
            for one in value if isinstance(value, list) else [value]:
                if isinstance(one, dict) and entity is not head:
                    assert one["@id"] in graph, one
    files = {p.relative_to(crate).as_posix() for p in crate.rglob("*") if p.is_file()}
    listed = {part["@id"] for part in root["hasPart"]} - {"bag/"}
    assert listed == files - {"ro-crate-metadata.json"}
    return graph


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    keys = {
        "name": "slew",
        "duration": 1.0,
        "testbed": {"kind": "floating_oscillator"},
        "plan": {"method": "reference_only", "goal": {"mass": 0.05}, "duration": 0.5},
        "controllers": {"pd_feedforward": {"kp": [2.0], "kd": [2.0]}},
    }
    folder = tmp_path_factory.mktemp("runs") / "slew"
    return run_trial(fs.trial(keys), "slew.yaml", folder, in_process=True, report=False).folder


def test_an_archive_holds_what_the_run_is_made_of(run: Path, tmp_path: Path) -> None:
    stated = Statement(["A. Law <https://orcid.org/0000-0002-1825-0097>", "B"], "CC-BY-4.0", "Why.")
    messages: list[str] = []
    set_note(run, "the first")
    crate = write_archive(run, tmp_path / "crate", stated, messages.append)
    graph = entities(crate)
    assert messages == []
    root = graph["./"]
    assert root["description"] == "Why."
    assert root["license"] == {"@id": "https://spdx.org/licenses/CC-BY-4.0"}
    people = [graph[author["@id"]]["name"] for author in root["author"]]
    assert people == ["A. Law", "B"]
    assert root["author"][0] == {"@id": "https://orcid.org/0000-0002-1825-0097"}
    assert read_notes(crate).note == "the first"
    assert (crate / "metrics.json").read_bytes() == (run / "metrics.json").read_bytes()
    assert load_plan(crate / "plan.yaml").method == "reference_only"
    metrics = json.loads((run / "metrics.json").read_text())
    assert graph["#trajectory_hash"]["value"] == metrics["trajectory_hash"]
    assert graph["#residual_tip_deflection"]["unitText"] == "m"
    assert graph["#software-flexslew"]["version"] == fs.__version__
    assert "#software-numpy" in graph
    tools = {tool["@id"] for tool in graph["#flight"]["instrument"]}
    assert tools == {name for name in graph if name.startswith("#software-")}
    words = ["sha256sum", "-c", "manifest-sha256.txt"]
    subprocess.run(words, cwd=crate, check=True, capture_output=True)
    digest = graph["manifest-sha256.txt"]["sha256"]
    assert (
        digest
        in subprocess.run(
            ["sha256sum", "manifest-sha256.txt"],
            cwd=crate,
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    )


def test_the_trial_of_an_archive_flies_to_the_same_bits(run: Path, tmp_path: Path) -> None:
    crate = write_archive(run, tmp_path / "crate")
    flown = fs.fly(fs.trial(crate / "trial.yaml"))
    assert flown.metrics["trajectory_hash"] == fs.read(crate).metrics["trajectory_hash"]


def test_a_zip_has_the_files_of_the_folder(run: Path, tmp_path: Path) -> None:
    packed = write_archive(run, tmp_path / "slew.zip")
    with zipfile.ZipFile(packed) as content:
        content.extractall(tmp_path / "unpacked")
    assert entities(tmp_path / "unpacked").keys() == (
        entities(write_archive(run, tmp_path / "folder")).keys()
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "slew.zip", "unpacked"]


def test_code_of_the_user_s_own_is_packed_if_it_is_what_flew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("still.py").write_text(LAW)
    keys = {
        "duration": 0.1,
        "testbed": {"kind": "floating_oscillator"},
        "controllers": {"still": {"law": "still.py:Still"}},
        "active": "still",
    }
    fs.fly(fs.trial(keys), "run")
    messages: list[str] = []
    crate = write_archive(Path("run"), Path("crate"), notify=messages.append)
    assert (crate / "still.py").read_text() == LAW
    assert "still.py" in entities(crate)
    Path("still.py").write_text(LAW + "\n")
    crate = write_archive(Path("run"), Path("later"), notify=messages.append)
    assert not (crate / "still.py").exists()
    assert messages[-1].startswith("still.py:Still: its file has changed since the run")


def test_the_command_states_what_a_repository_requires(
    run: Path, tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = call("archive", run)
    assert code == 0
    assert "no licence is stated; repositories require one: --licence CC-BY-4.0" in err
    assert "no author is stated: --author" in err
    assert entities(tmp_path / "archive" / "slew")["./"]["license"] == "not stated"
    code, _, err = call("archive", run)  # again, into the same folder
    assert code == 2
    assert "--to: archive/slew is not empty; choose another folder" in err


def test_what_is_no_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput):
        write_archive(tmp_path / "nothing", tmp_path / "crate")
    assert not (tmp_path / "crate").exists()
