from pathlib import Path

import pytest

from flexslew_lab.benchmark.entry import read_entry
from flexslew_lab.benchmark.task import entry_study, load_task
from flexslew_plant.errors import BadInput


def test_parts_of_an_entry_replace_those_of_the_baseline() -> None:
    task = load_task("csa-slew")
    entry = read_entry(task, law="lqr", plan="input_shaping", sets=["plan.duration=24"])
    assert entry.name == "lqr, input_shaping with changes"
    base = entry_study(task, entry.sections, entry.trust).base
    assert base["controllers"] == {"entry": {"law": "lqr"}}
    assert base["plan"]["method"] == "input_shaping"
    assert base["plan"]["goal"] == {"base_yaw": 1.0, "hub_pitch": 0.5}
    assert base["plan"]["duration"] == 24.0
    assert base["testbed"] == task.study.base["testbed"]


@pytest.mark.parametrize(("name", "law"), [("lqg.npz", "linear"), ("net.onnx", "policy")])
def test_a_file_as_the_law_is_one_of_a_linear_controller_or_a_policy(
    name: str, law: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    file.touch()
    entry = read_entry(load_task("acc"), law=str(file))
    assert entry.sections["controllers"] == {"entry": {"law": law, "file": str(file)}}


def test_without_parts_the_baseline_is_entered() -> None:
    assert read_entry(load_task("acc"))[:2] == ("baseline", {})


def test_a_file_gives_the_sections_of_an_entry(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("controllers: {mine: {law: lqr}}\nactive: mine\n")
    entry = read_entry(load_task("acc"), file=str(file), name="Mine")
    assert entry.name == "Mine"
    assert entry.sections == {"controllers": {"mine": {"law": "lqr"}}, "active": "mine"}


@pytest.mark.parametrize("text", ["seed: 3\n", "fallback: [mine]\n"])
def test_a_file_with_what_the_task_fixes_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    with pytest.raises(BadInput, match=r"mine\.yaml: .* is fixed by acc"):
        read_entry(load_task("acc"), file=str(file))


def test_a_value_outside_of_an_entry_is_refused() -> None:
    with pytest.raises(BadInput, match=r"--set testbed\.modes: testbed is fixed by acc"):
        read_entry(load_task("acc"), sets=["testbed.modes=3"])


def test_a_program_is_entered_by_its_command() -> None:
    entry = read_entry(load_task("csa-slew"), command="python3 'my law.py'")
    assert entry.name == "python3 'my law.py'"
    (controller,) = entry.sections["controllers"].values()
    assert controller["command"] == ["python3", "my law.py"]


@pytest.mark.parametrize(
    ("law", "command", "words"),
    [("lqr", "a", "either a law"), (None, "a 'b", "No closing"), (None, " ", "give the command")],
)
def test_a_command_that_is_none_is_refused(law: str | None, command: str, words: str) -> None:
    with pytest.raises(BadInput, match=f"--command.*{words}"):
        read_entry(load_task("acc"), law=law, command=command)
