"""Flies a trial of the bench with files and lines added, which stand beside this process's input.

`python overlay.py FOLDER TRIAL`: FOLDER/<package>/ holds the new files of a family, and
FOLDER/<package>.line the line for the family's table. The kernels stay where they are compiled.
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


def main() -> None:
    """Print metrics and events of the trial as JSON."""
    folder, trial = Path(sys.argv[1]), Path(sys.argv[2])
    sys.meta_path.insert(0, _Overlay(folder))
    from flexslew_lab.notebook import fly
    from flexslew_lab.notebook import trial as read

    flight = fly(read(trial))
    print(json.dumps({"metrics": flight.metrics, "events": [e.kind for e in flight.events]}))


if __name__ == "__main__":
    main()
