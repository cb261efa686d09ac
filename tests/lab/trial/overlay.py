"""Flies a trial and its studies with files and lines added to the bench.

`python overlay.py FOLDER TRIAL [STUDY]`: FOLDER/<package>/ holds the new files of a family, and
FOLDER/<package>.line the line for the family's table. The kernels stay where they are compiled.
STUDY holds the keys of a study of the trial, whose cases fly as a batch and on the bench.
"""

import importlib.abc
import importlib.machinery
import json
import re
import sys
from pathlib import Path
from types import CodeType
from typing import Any

_TABLE = re.compile(r"^\w+: dict\[str, \w+Entry\] = table\(", re.MULTILINE)


class _WithLine(importlib.machinery.SourceFileLoader):
    """Loads a family's `__init__` with one line more."""

    def __init__(self, name: str, path: str, line: str) -> None:
        super().__init__(name, path)
        self._line = line

    def get_code(self, fullname: str) -> CodeType:
        text = Path(self.path).read_text()
        found = _TABLE.search(text)
        assert found is not None
        text = f"{text[: found.start()]}{self._line}\n{text[found.start() :]}"
        return compile(text, self.path, "exec")


class _Overlay(importlib.abc.MetaPathFinder):
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        line = self._folder / f"{fullname}.line"
        spec = importlib.machinery.PathFinder.find_spec(fullname, path)
        if spec is None or spec.origin is None or not line.exists():
            return None
        spec.loader = _WithLine(fullname, spec.origin, line.read_text())
        assert spec.submodule_search_locations is not None
        spec.submodule_search_locations.append(str(self._folder / fullname))
        return spec


def both_ways(trial: Any, path: Path) -> list[dict[str, Any]]:
    """Return for each case how the batch flew it, its metrics, and those of the bench."""
    from flexslew_lab.studies.batch.fleet import BatchRunner
    from flexslew_lab.studies.cases import case_of
    from flexslew_lab.studies.flight import simulate_case
    from flexslew_lab.studies.run import prepare
    from flexslew_lab.studies.study import study_of_values
    from flexslew_plant.yaml_data import load_yaml

    values = load_yaml(path.read_text(), str(path))
    ready = prepare(study_of_values(values, str(path), path.parent, trial=trial))
    count = len(ready.samples) * len(ready.study.variants)
    found = []
    for results, others in BatchRunner(ready.study, ready.plans).fly(
        [case_of(ready.study, ready.samples, k) for k in range(count)]
    ):
        pairs: list[tuple[int, Any, Any]] = [(one.number, one.way, one.metrics) for one in results]
        pairs += [(one.case.number, one.way, None) for one in others]
        for number, way, metrics in pairs:
            bench = simulate_case(
                ready.study, case_of(ready.study, ready.samples, number), ready.plans
            )
            case = {"number": number, "way": way, "batch": metrics, "bench": bench.metrics}
            found.append({**case, "reason": bench.reason})
    return sorted(found, key=lambda case: case["number"])


def main() -> None:
    """Print metrics and events of the trial, and the cases of the study, as JSON."""
    folder, trial = Path(sys.argv[1]), Path(sys.argv[2])
    sys.meta_path.insert(0, _Overlay(folder))
    from flexslew_lab.notebook import fly
    from flexslew_lab.notebook import trial as read

    flight = fly(read(trial))
    found: dict[str, Any] = {"metrics": flight.metrics, "events": [e.kind for e in flight.events]}
    if len(sys.argv) > 3:
        found["cases"] = both_ways(read(trial), Path(sys.argv[3]))
    print(json.dumps(found))


if __name__ == "__main__":
    main()
