"""The commands and trials of docs/own_spacecraft.md and docs/spacecraft are valid trials."""

import re
import shlex
from pathlib import Path

import pytest
import yaml

from flexslew_lab.trial.sources import example_trials, read_trial
from flexslew_lab.trial.trial import Trial, parse_trial
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape

DOCS = Path(__file__).parents[3] / "docs"
TUTORIAL = (DOCS / "own_spacecraft.md").read_text()
GUIDES = [page.read_text() for page in sorted((DOCS / "spacecraft").glob("*.md"))]
COMMANDS = [
    command
    for text in GUIDES
    for command in re.findall(r"^\./flexslew trial (.*)$", text, re.MULTILINE)
    if shlex.split(command)[0] in {trial.name for trial in example_trials()}
]


def blocks(text: str) -> list[str]:
    """Return the YAML blocks of a page."""
    return re.findall(r"^```yaml\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def trial_of_command(command: str) -> Trial:
    """Return the trial that a command runs."""
    name, *words = shlex.split(command)
    assert set(words[::2]) <= {"--set"}
    return read_trial(name, words[1::2])[0]


def test_the_guides_have_commands() -> None:
    assert len(COMMANDS) >= 12


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_a_guide_is_a_trial(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel = blocks((DOCS / "spacecraft/modal_data.md").read_text())[0]
    (tmp_path / "panel.yaml").write_text(panel)
    monkeypatch.chdir(tmp_path)
    assert trial_of_command(command).testbed.kind == "spacecraft"


def test_the_modal_data_of_the_guide_are_an_appendage(tmp_path: Path) -> None:
    file = tmp_path / "panel.yaml"
    file.write_text(blocks((DOCS / "spacecraft/modal_data.md").read_text())[0])
    assert modal_shape(file).modes == 2


@pytest.mark.parametrize("text", GUIDES, ids=lambda text: text.partition("\n")[0])
def test_a_block_of_a_guide_is_yaml(text: str) -> None:
    assert all(isinstance(yaml.safe_load(block), dict) for block in blocks(text))


def test_each_step_of_the_tutorial_is_a_trial() -> None:
    rigid, panels, axes = blocks(TUTORIAL)
    flexible = rigid.replace("plan:", f"{panels}plan:")
    head, _, tail = flexible.partition("  appendages:")
    wheels, _, plan = axes.partition("plan:")
    laws = tail[tail.index("controllers:") :]
    appendages = f"  appendages:{tail.partition('plan:')[0]}"
    turned = f"{head}{wheels}{appendages}plan:{plan}{laws}"
    for text in (rigid, flexible, turned):
        assert parse_trial(text, "docs/own_spacecraft.md").name == "my_spacecraft"
