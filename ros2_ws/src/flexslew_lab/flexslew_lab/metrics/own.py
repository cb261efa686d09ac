"""Metrics of the user's own, by name."""

from collections.abc import Sequence

from flexslew_lab.metrics import KEYS, METRICS
from flexslew_lab.metrics.metric import Key, Metric
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import METRICS as GROUP
from flexslew_plant.own_code import Trust, find_class


def load_user_metrics(names: Sequence[str], source: str, trust: Trust) -> list[type[Metric]]:
    """Return the classes of a trial's own metrics.

    Args:
        names: `file.py:Class`, `package.module.Class`, or an entry point of flexslew.metrics.
        source: where they stand, for errors.
        trust: which of them may be loaded.

    Raises:
        Untrusted: one of them is not trusted.
        BadInput: there is no such class, it is no metric, or one of its keys is taken.
    """
    found: list[type[Metric]] = []
    taken = dict.fromkeys(KEYS, "the bench")
    for name in names:
        kind = find_class(name, GROUP, "metric", source, tuple(METRICS), trust)
        keys = getattr(kind, "KEYS", None)
        if not isinstance(keys, dict) or not all(isinstance(k, Key) for k in keys.values()):
            raise BadInput(f"{name} is no metric: it needs KEYS, a dict of Key by name", source)
        missing_methods = [
            part for part in ("add", "result") if not callable(getattr(kind, part, None))
        ]
        if missing_methods:
            raise BadInput(
                f"{name} is no metric: it has no {' and no '.join(missing_methods)}", source
            )
        for key in keys:
            if key in taken:
                raise BadInput(f"{name}: the key {key} is taken by {taken[key]}", source)
        taken |= dict.fromkeys(keys, name)
        found.append(kind)
    return found


def keys_of(metrics: Sequence[type[Metric]]) -> dict[str, Key]:
    """Return what the keys of metrics hold, by name."""
    return {key: definition for metric in metrics for key, definition in metric.KEYS.items()}
