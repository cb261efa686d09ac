"""The evaluator writes loops, branches and whole numbers as C that computes what Python does."""

import ctypes
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from flexslew_control.linear.held_step import exponential_step
from flexslew_lab.export.c_code.evaluator import Evaluator
from flexslew_lab.export.c_code.linear_algebra import (
    determinant,
    inverse,
    pseudo_inverse,
)
from flexslew_lab.export.c_code.numpy_functions import METHODS, REPLACEMENTS
from flexslew_lab.export.c_code.program import live_names, printed
from flexslew_lab.export.c_code.statements import LANGUAGE
from flexslew_lab.export.c_code.values import Array, row_major
from flexslew_lab.export.compiled import compiler, compilers, run_compiler
from flexslew_plant.arrays import Matrix

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")


def _in_c(function: object, a: Matrix, folder: Path, in_place: bool = False) -> Matrix:
    e = Evaluator(LANGUAGE, REPLACEMENTS, METHODS)
    n, m = a.shape
    given = e.ops.stored(*e.ops.entries(Array("given", (n, m), (m, 1))))
    result = e.call(function, [given])
    result = given if in_place else result
    size = int(np.prod(getattr(result, "shape", ()), dtype=int))
    shape = getattr(result, "shape", ())
    e.ops.write(Array("out", shape or (1,), row_major(shape or (1,))), result)
    lines = "\n".join(printed(e.ops.block, live_names([e.ops.block], {"out"})))
    tables = "".join(
        f"static const double {name}[] = {{{', '.join(map(repr, values.ravel().tolist()))}}};\n"
        for name, values in e.ops.constants.arrays.items()
    )
    name = getattr(function, "__name__", "one")  # a library that is loaded cannot be replaced
    source, library = folder / f"{name}.c", folder / f"{name}.so"
    source.write_text(
        "#include <math.h>\ntypedef double real;\n"
        f"{tables}void one(const double *given, double *out)\n{{\n{lines}\n}}\n"
    )
    flags = ["-std=c99", "-O1", "-shared", "-fPIC"]
    run_compiler([*compiler(), *flags, str(source), "-o", str(library), "-lm"])
    out = (ctypes.c_double * size)()
    ctypes.CDLL(str(library))["one"]((ctypes.c_double * a.size)(*a.ravel()), out)
    return np.array(out).reshape(shape)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_inverse_and_determinant_are_those_of_lapack(n: int, tmp_path: Path) -> None:
    a = np.random.default_rng(n).normal(size=(n, n))
    a[0, 0] = 0.0 if n > 1 else 2.0  # so that rows are swapped
    np.testing.assert_allclose(_in_c(inverse, a, tmp_path), np.linalg.inv(a), rtol=1e-10)
    np.testing.assert_allclose(_in_c(determinant, a, tmp_path), np.linalg.det(a), rtol=1e-10)


@pytest.mark.parametrize("shape", [(1, 1), (3, 3), (2, 4), (4, 2), (3, 6)])
def test_the_pseudo_inverse_is_that_of_lapack_also_of_less_rank(
    shape: tuple[int, int], tmp_path: Path
) -> None:
    rng, rank = np.random.default_rng(sum(shape)), min(shape)
    factors = rng.normal(size=(shape[0], rank)), rng.normal(size=(rank, shape[1]))
    for number, kept in enumerate({rank, max(rank - 1, 1)}):
        a = factors[0][:, :kept] @ factors[1][:kept]
        folder = tmp_path / str(number)
        folder.mkdir()
        found = _in_c(partial(pseudo_inverse, cutoff=1e-12), a, folder)
        np.testing.assert_allclose(found, np.linalg.pinv(a, 1e-12), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("size", [0.1, 9.0])
def test_a_loop_whose_length_depends_on_its_input_is_written(size: float, tmp_path: Path) -> None:
    a = size * np.random.default_rng(2).normal(size=(3, 4))
    expected = a.copy()
    exponential_step(expected)
    found = _in_c(exponential_step, a, tmp_path, in_place=True)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
