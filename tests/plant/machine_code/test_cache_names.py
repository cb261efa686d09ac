"""Machine code of one process is found by the next one, and is never that of another function."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
import json
import sys
import numpy as np
from flexslew_plant.arrays import compiled, inline, merged, vectorised

def made(decorated, factor):
    @decorated
    def inner(x):
        return factor * x

    @compiled
    def outer(x):
        return inner(x) + 1.0

    return outer

kinds = (compiled, vectorised, inline, merged())
factors = [json.loads(text) for text in sys.argv[1:]]
factors = [np.array(each) if isinstance(each, list) else each for each in factors]
found = [made(kind, factor) for kind in kinds for factor in factors]
print([np.asarray(outer(1.0)).tolist() for outer in found])
print([sum(outer.stats.cache_hits.values()) for outer in found])
"""


def _lines(folder: Path, *factors: str) -> list[str]:
    """Return what a process prints that makes the functions with these factors."""
    module = folder / "closures.py"
    if not module.exists():  # a file written anew counts as changed
        module.write_text(MODULE)
    return subprocess.run(
        [sys.executable, str(module), *factors],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache")},
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines()


@pytest.mark.slow
def test_a_function_that_closes_over_others_is_compiled_once_for_all_processes(
    tmp_path: Path,
) -> None:
    # none takes another's code for its own, and each is found in the second process
    assert _lines(tmp_path, "2", "3") == [str([3.0, 4.0] * 4), str([0] * 8)]
    assert _lines(tmp_path, "2", "3") == [str([3.0, 4.0] * 4), str([1] * 8)]


@pytest.mark.slow
def test_what_two_processes_compiled_runs_side_by_side_in_a_third(tmp_path: Path) -> None:
    # the results are of different kinds: an array needs what a number has not
    assert _lines(tmp_path, "2") == [str([3.0] * 4), str([0] * 4)]
    assert _lines(tmp_path, "[3.0]") == [str([[4.0]] * 4), str([0] * 4)]
    assert _lines(tmp_path, "2", "[3.0]") == [str([3.0, [4.0]] * 4), str([1] * 8)]
