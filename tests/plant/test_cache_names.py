"""Machine code of one process is found by the next one, and is never that of another function."""

import os
import subprocess
import sys
from pathlib import Path

MODULE = """
from flexslew_plant.arrays import compiled, inlined, vectorised

def made(decorated, factor):
    @decorated
    def inner(x):
        return factor * x

    @compiled
    def outer(x):
        return inner(x) + 1.0

    return outer

kinds = (compiled, vectorised, inlined)
found = [made(kind, factor) for kind in kinds for factor in (2.0, 3.0)]
print([outer(1.0) for outer in found])
print([sum(outer.stats.cache_hits.values()) for outer in found])
"""


def test_a_function_that_closes_over_others_is_compiled_once_for_all_processes(
    tmp_path: Path,
) -> None:
    module = tmp_path / "closures.py"
    module.write_text(MODULE)
    said = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, str(module)],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            check=True,
            capture_output=True,
            text=True,
        )
        said.append(done.stdout.splitlines())
    assert [values for values, _ in said] == [str([3.0, 4.0] * 3)] * 2
    # none takes another's code for its own, and each is found in the second process
    assert [hits for _, hits in said] == [str([0] * 6), str([1] * 6)]
