"""Where a trial comes from: a file, or the name of a shipped one, with single values changed."""

import os
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_control.planners import PLANNERS, other_method, plan_settings
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.trial import Trial, checked_trial, text_of, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import ANY_CODE, Trust
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import load_yaml

FOLDER = Path(str(resources.files("flexslew_lab"))) / "trials"
DEFAULT = "m1"
_CHOICES = ("method", "kind", "law")  # they determine the other keys of a section


class ExampleTrial(NamedTuple):
    """A trial that comes with the bench."""

    name: str
    path: Path
    about: str  # its first comment, one line


def example_trials() -> list[ExampleTrial]:
    """Return the shipped trials by name."""
    found = []
    for path in sorted(FOLDER.glob("*.yaml")):
        comments = []
        for line in path.read_text(encoding="utf-8").splitlines():
            if not line.startswith("#"):
                break
            comments.append(line.lstrip("# ").rstrip())
        found.append(ExampleTrial(path.stem, path, " ".join(comments)))
    return found


def trial_path(name: str | Path | None) -> Path:
    """Return the file of a trial.

    Args:
        name: a file, or the name of a shipped trial; None: the default one.

    Raises:
        BadInput: neither; the shipped ones are named.
    """
    given = DEFAULT if name is None else str(name)
    path = Path(given)
    if os.path.isfile(path):  # also of a name that is too long for one
        return path
    if os.path.isdir(path):
        run = os.path.isfile(path / "trial.yaml")
        hint = "; give the trial.yaml in it" if run else ""
        raise BadInput(f"{given}: cannot be read: it is a folder{hint}")
    known = {trial.name: trial.path for trial in example_trials()}
    if given in known:
        return known[given]
    hint = spelling_hint(given, known)
    raise BadInput(
        f"{given}: is neither a file nor a shipped trial; {hint}shipped: {', '.join(known)}"
    )


def label_of(path: Path) -> str:
    """Return what messages call the file of a trial: a shipped one by its name."""
    return path.stem if path.parent == FOLDER else str(path)


def changes_of(assignments: list[str] | None) -> dict[str, Any]:
    """Return `key.path=value` assignments as changes, the values read as YAML.

    Raises:
        BadInput: there is no `=`, or the value is not YAML.
    """
    changes = {}
    for assignment in assignments or []:
        key, sign, value = assignment.partition("=")
        if not sign or not key.strip():
            raise BadInput(f"--set: {assignment}: give key.path=value, for example testbed.modes=5")
        changes[key.strip()] = load_yaml(value, f"--set: {key.strip()}")
    return changes


def changed_values(
    values: dict[str, Any], changes: Mapping[str, Any], label: str, trust: Trust
) -> dict[str, Any]:
    """Return the keys of a trial with changes by path, see overrides; applied in order.

    The name of a method in place of the section `plan` keeps the manoeuvre, see with_method.
    """
    for path, value in changes.items():
        if path == "plan" and isinstance(value, str):
            values = with_method(values, value, label, trust)
        else:
            values = override_values(values, {path: value})
    return values


def with_method(values: dict[str, Any], method: str, label: str, trust: Trust) -> dict[str, Any]:
    """Return the keys of a trial whose manoeuvre another method plans, as other_method does.

    Args:
        values: keys of a trial.
        method: name of a planner, or where a class of the user's own stands.
        label: of the trial, for an error.
        trust: planners that the trial may name.

    Raises:
        BadInput: if there is no such method, or it cannot plan this manoeuvre.
    """
    before = values.get("plan") or {}
    if (
        isinstance(before, dict)
        and method in PLANNERS
        and before.get("method") not in (None, method)
    ):
        place = f"{label}: plan"
        before = plain(other_method(plan_settings(before, place, trust), method, place))
    return {**values, "plan": {**before, "method": method}}


def read_trial(name: str | Path | None, assignments: list[str] | None = None) -> tuple[Trial, str]:
    """Return a trial that the user gives, and its origin for messages and for the log.

    As the user gives it, it may name any class of the user's own.

    Args:
        name: as in trial_path.
        assignments: `key.path=value`, instead of the values in the file.

    Raises:
        BadInput: if the file cannot be read, or one of its values is not allowed.
    """
    path, changes = trial_path(name), changes_of(assignments)
    label = label_of(path)
    values = load_yaml(text_of(path), str(path))
    if changes and isinstance(values, dict):
        try:
            values = changed_values(values, changes, label, ANY_CODE)
        except BadInput as error:
            raise BadInput(f"--set: {error}") from None
    source = label + "".join(f" --set {assignment}" for assignment in assignments or [])
    try:
        return checked_trial(trial_of_values(values, label, ANY_CODE), label), source
    except BadInput as error:
        refusal = error.refusal
        if _is_set(refusal.key, changes):
            raise BadInput(replace(refusal, source="--set")) from None
        choice = _choice_of(refusal.key, changes)
        if not choice:
            raise
        section, _, name = choice.rpartition(".")
        whole = f"--set '{section}={{{name}: {changes[choice]}, ...}}'"
        short = f", or --set plan={changes[choice]} to keep its manoeuvre" * (section == "plan")
        words = (
            f"{refusal.why}; the file's {section} is for another {name}: give all of it, {whole}"
            f"{short}"
        )
        raise BadInput(replace(refusal, why=words)) from None


def _is_set(key: str, changes: Mapping[str, Any]) -> bool:
    """Return whether a key was set on the command line, is part of what was, or holds it."""
    pairs = [(f"{key}.", f"{path}.") for path in changes if key]
    return any(one.startswith(other) or other.startswith(one) for one, other in pairs)


def _choice_of(key: str, changes: Mapping[str, Any]) -> str:
    """Return the path of a choice that was set in the section of a key: empty without one."""
    for path in changes:
        section, _, name = path.rpartition(".")
        if name in _CHOICES and section and key.startswith(f"{section}."):
            return path
    return ""
