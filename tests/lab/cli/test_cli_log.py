"""The subcommands about logs: what they print, their JSON and their exit codes."""

import json
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial

TRIAL = """
name: logged
duration: 2.0
plan: {method: reference_only, goal: {base_yaw: 0.1, hub_pitch: 0.05}, duration: 1.5}
controllers: {pd_feedforward: {kp: [460.0, 460.0]}}
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("logged") / "run"
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return folder


def test_info_says_what_is_in_the_bag(call: Any, flown: Any) -> None:
    code, out, _ = call("log", "info", flown)
    assert code == 0
    assert "/truth" in out
    code, out, _ = call("log", "info", flown, "--json")
    found = json.loads(out)
    assert {t["name"]: t["messages"] for t in found["topics"]}["/truth"] == 201
    assert found["plans"][0]["method"] == "reference_only"


def test_a_sound_bag_passes_and_a_cut_one_gives_exit_code_1(
    call: Any, flown: Any, tmp_path: Path
) -> None:
    assert call("log", "check", flown)[0] == 0
    whole = next((flown / "bag").glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    code, out, _ = call("log", "check", cut, "--json")
    assert code == 1
    assert not all(finding["ok"] for finding in json.loads(out))


def test_recover_makes_a_cut_bag_whole(call: Any, flown: Any, tmp_path: Path) -> None:
    whole = next((flown / "bag").glob("*.mcap")).read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    code, out, _ = call("recover", cut, "--out", tmp_path / "mended", "--json")
    assert code == 0
    assert "messages kept" in json.loads(out)["statement"]
    code, _, err = call("resim", tmp_path / "mended")
    assert code == 1
    assert "partial: ticks 0 to " in err
    assert "the log does not hold the end of the run" in err
    assert call("resim", tmp_path / "mended", "--partial")[0] == 0


def test_export_writes_one_table_per_topic(call: Any, flown: Any, tmp_path: Path) -> None:
    words = ("log", "export", flown, "--out", tmp_path, "--format", "csv", "--topic", "/truth")
    code, out, _ = call(*words, "--json")
    assert code == 0
    assert json.loads(out)["rows"] == {"/truth": 201}
    assert (tmp_path / "truth.csv").is_file()
    assert call("log", "export", flown, "--format", "xls")[0] == 2


def test_every_run_is_exported_into_a_folder_of_its_own(
    call: Any, flown: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for place in (flown, flown / "bag", next((flown / "bag").glob("*.mcap"))):
        code, out, _ = call("log", "export", place, "--topic", "/truth", "--json")
        assert code == 0
        assert json.loads(out)["files"] == {"/truth": f"export/{flown.name}/truth.parquet"}


def test_resim_tells_the_same_hash(call: Any, flown: Any) -> None:
    code, out, _ = call("resim", flown, "--json")
    found = json.loads(out)
    metrics = json.loads((flown / "metrics.json").read_text())
    assert code == 0
    assert found["identical"]
    assert found["hash"] == found["recorded_hash"] == metrics["trajectory_hash"]
    code, out, _ = call("resim", flown)
    assert "bit-identical" in out
    assert found["hash"] in out


def test_resim_refuses_another_plan_as_it_plans_nothing_again(call: Any, flown: Any) -> None:
    for change in ("plan.goal.base_yaw=0.2", "plan=null"):
        code, out, err = call("resim", flown, "--set", change)
        assert (code, out) == (2, "")
        assert (
            f"{change.partition('=')[0]}: a log is flown again with the plan that it holds" in err
        )
    assert call("resim", flown, "--set", "controllers.pd_feedforward.kp=400")[0] == 1


def test_check_passes_the_recorded_controller(call: Any, flown: Any) -> None:
    code, out, _ = call("check", flown, "--json")
    assert code == 0
    assert json.loads(out)["first_divergence"] is None


def test_check_of_another_gain_is_exit_code_1_with_tick_field_and_values(
    call: Any, flown: Any, tmp_path: Path
) -> None:
    drawn = tmp_path / "differences.html"
    words = ("check", flown, "pd_feedforward", "--set", "kp=[460.001, 460.0]", "--figure", drawn)
    code, out, _ = call(*words)
    assert code == 1
    assert "first divergence: tick 1 of epoch 0, terms.proportional[0]: recorded " in out
    assert drawn.stat().st_size > 1000
    code, out, _ = call(*words, "--json")
    assert code == 1
    assert json.loads(out)["first_divergence"]["tick"] == 1


@pytest.mark.parametrize(
    "words",
    [
        ("log", "info"), ("log", "check"), ("log", "export"), ("log", "recover"), ("recover",),
        ("resim",), ("check",),
    ],
    ids=" ".join,
)  # fmt: skip
def test_no_bag_is_bad_input_in_one_line(call: Any, words: Any, tmp_path: Path) -> None:
    code, _, err = call(*words, tmp_path / "nothing")
    assert code == 2
    assert err.strip().startswith("error: ")
    assert len(err.strip().splitlines()) == 1


def test_a_setting_that_is_none_is_told(call: Any, flown: Any) -> None:
    code, _, err = call("check", flown, "--set", "kp")
    assert code == 2
    assert "not of the form key=value" in err
