"""What differs between runs, in a few words: the legend of a figure."""

from collections.abc import Mapping, Sequence
from typing import Any

from flexslew_lab.short_values import short

_MOST = 3  # keys of a label
_KINDS = ("kind", "method")  # of a section: where these differ, its other keys are not compared
_NAME = "name"


def labels_of(trials: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[str]:
    """Return a label for each run: the keys of its trial that differ, with their values.

    Runs with equal labels have their names in them.

    Args:
        trials: the keys of the trials with every default.
        names: names of the runs.
    """
    keys = [key for key in _differing(trials, "") if key != _NAME]
    shown = keys[:_MOST]
    last = [key.rpartition(".")[2] for key in shown]
    titles = [key if last.count(end) > 1 else end for key, end in zip(shown, last, strict=True)]
    labels = [
        ", ".join(f"{title} {short(_value(trial, key), 4)}"
                  for title, key in zip(titles, shown, strict=True))
        for trial in trials
    ]  # fmt: skip
    if len(set(labels)) == len(labels) and labels[0]:
        return labels
    labels = [", ".join(filter(None, pair)) for pair in zip(names, labels, strict=True)]
    return [
        label if labels.count(label) == 1 else f"{label} ({number})"
        for number, label in enumerate(labels, start=1)
    ]


def _differing(sections: Sequence[Mapping[str, Any]], path: str) -> list[str]:
    """Return the paths of the keys with more than one value, in the order of the sections."""
    found: list[str] = []
    keys = list(dict.fromkeys(key for section in sections for key in section))
    for kind in _KINDS:
        if kind in keys and not _same([section.get(kind) for section in sections]):
            return [f"{path}{kind}"]
    if not path and not _same([section.get("active") for section in sections]):
        found.append("active")  # of other controllers the gains are no difference
        keys = [key for key in keys if key not in ("active", "controllers")]
    for key in keys:
        values = [section.get(key) for section in sections]
        if _same(values):
            continue
        if all(isinstance(value, Mapping) for value in values):
            found += _differing(values, f"{path}{key}.")  # type: ignore[arg-type]  # all are
        else:
            found.append(f"{path}{key}")
    return found


def _same(values: Sequence[Any]) -> bool:
    return all(value == values[0] for value in values)


def _value(trial: Mapping[str, Any], path: str) -> Any:
    """Return the value of a key; None where a section lacks it."""
    value: Any = trial
    for key in path.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return value
