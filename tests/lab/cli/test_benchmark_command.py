import json
from pathlib import Path

from tests.lab.conftest import Call

from flexslew_lab.benchmark.result import read_result
from flexslew_lab.benchmark.task import load_task, task_hash, task_names
from flexslew_lab.studies.seals import json_with_digest


def test_the_tasks_are_listed_with_their_hashes(call: Call) -> None:
    code, out, _ = call("benchmark", "list", "--json")
    assert code == 0
    expected = {name: task_hash(load_task(name)) for name in task_names()}
    assert {row["task"]: row["hash"] for row in json.loads(out)} == expected


def test_a_task_is_shown_with_what_its_controllers_receive(call: Call) -> None:
    code, out, _ = call("benchmark", "list", "csa-slew")
    assert code == 0
    for words in ("base_yaw [rad], hub_pitch [rad]", "beam_positive", "150, 150", "0.01"):
        assert words in out


def test_an_entry_is_flown_confirmed_and_compared(call: Call, tmp_path: Path) -> None:
    path, other = tmp_path / "result.json", tmp_path / "other.json"
    code, out, _ = call(
        "benchmark",
        *("run", "acc", "--set", "controllers.robust.feedforward=true"),
        *("--members", 2, "--workers", 1, "--name", "mine", "--out", path),
    )
    assert code == 0
    assert out.startswith("acc: score ")
    assert "mine" in out
    assert "baseline" in out  # beside the shipped results
    assert call("benchmark", "verify", path, "--workers", 1)[0] == 0
    result = read_result(path)
    result["members"][1]["metrics"]["control_effort"] += 1e-6
    result["score"]["mean"] += 1.0
    result["entry"]["name"] = "other"
    other.write_text(json_with_digest(result))
    code, _, err = call("benchmark", "verify", other, "--workers", 1)
    assert code == 1
    assert "seed 2: control_effort" in err
    code, out, _ = call("benchmark", "score", path, other)
    assert code == 0
    assert out.index("other") < out.index("mine")  # the best first
