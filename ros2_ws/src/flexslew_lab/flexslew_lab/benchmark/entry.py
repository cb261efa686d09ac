"""An entry: the controller and the plan that fly a task in place of the baseline's."""

import os
from typing import Any, NamedTuple

from flexslew_control.controllers import POLICY
from flexslew_lab.benchmark.task import ENTRY_SECTIONS, Task
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.sources import changed_values, changes_of
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust
from flexslew_plant.processes.command_words import command_words
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import load_yaml

BASELINE = "baseline"
_NAME = "entry"  # of its controller
_EXTERNAL = "flexslew_control.external_controller.ExternalController"


class BenchmarkEntry(NamedTuple):
    """What competes in a task.

    Args:
        name: in tables.
        sections: of the trial, of ENTRY_SECTIONS, in place of the task's own.
        trust: classes of the user's own that it may name.
    """

    name: str
    sections: dict[str, Any]
    trust: Trust = NO_CODE


def read_entry(
    task: Task,
    law: str | None = None,
    plan: str | None = None,
    file: str | None = None,
    sets: list[str] | None = None,
    name: str | None = None,
    command: str | None = None,
) -> BenchmarkEntry:
    """Return the entry that a user gives; each part replaces that of the part before.

    Args:
        task: the benchmark problem; what is not given is its baseline's.
        law: a built-in law, a class (`file.py:Law`), or the file of a linear controller or policy.
        plan: a method, or a class of the user's own; it plans the manoeuvre of the task.
        file: YAML with the sections `controllers`, `active` and `plan`.
        sets: `key.path=value` below these sections.
        name: for tables; None: made of what is given.
        command: of a program that is the controller, as a shell reads it, in place of a law.

    Raises:
        BadInput: the file cannot be read, a section is set that the task fixes, or there are both a
            law and a command.
    """
    base = plain(task.trial)
    sections = _file_sections(task, file) if file is not None else {}
    if (controller := _controller(law, command)) is not None:
        sections |= {"controllers": {_NAME: controller}, "active": _NAME}
    if plan is not None:
        label = f"{task.name}: --plan"
        sections["plan"] = changed_values(base | sections, {"plan": plan}, label, ANY_CODE)["plan"]
    for path, value in changes_of(sets).items():
        key = path.split(".")[0]
        require_entry_section(key, task, f"--set {path}")
        sections[key] = override_values(base | sections, {path: value})[key]
    label = ", ".join(part for part in (law, command, plan, file) if part is not None) or BASELINE
    changed = f"{label} with changes" if sets else label
    return BenchmarkEntry(name or changed, sections, ANY_CODE)


def _controller(law: str | None, command: str | None) -> dict[str, Any] | None:
    """Return the settings of the controller that a law or a command stands for; None: neither.

    Raises:
        BadInput: both are given, or the command is none.
    """
    if command is not None:
        if law is not None:
            raise BadInput("give either a law or a program", key="--command", value=command)
        return {"law": _EXTERNAL, "command": command_words(command, "--command")}
    if law is None:
        return None
    if os.path.isfile(law):
        return {"law": POLICY.name if law.endswith(".onnx") else "linear", "file": law}
    return {"law": law}


def require_entry_section(key: str, task: Task, source: str) -> None:
    """Check that an entry may set a section.

    Raises:
        BadInput: the task fixes it.
    """
    if key not in ENTRY_SECTIONS:
        words = f"{key} is fixed by {task.name}; an entry sets {', '.join(ENTRY_SECTIONS)}"
        raise BadInput(words, source)


def _file_sections(task: Task, file: str) -> dict[str, Any]:
    """Return the sections of an entry's file.

    Raises:
        BadInput: it cannot be read, or holds another key.
    """
    values = load_yaml(given_text(file), file)
    if not isinstance(values, dict):
        raise BadInput(f"holds no keys; an entry sets {', '.join(ENTRY_SECTIONS)}", file)
    for key in values:
        require_entry_section(str(key), task, file)
    return values
