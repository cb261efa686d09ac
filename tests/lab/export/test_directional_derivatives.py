"""Derivatives along a direction in C code are exact: those of the bench's own linearisation."""

import operator
from collections.abc import Callable
from math import cos, exp, sin, sqrt, tan, tanh
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.export.fmu.test_model_exchange import exchanged, write_plant

from flexslew_lab.export.c_code.c_expression import Call, Constant, Expression, Lvalue, parse
from flexslew_lab.export.c_code.program import CLine, CLoop
from flexslew_lab.export.c_code.tangent import tangent
from flexslew_lab.export.compiled import compilers
from flexslew_lab.export.fmu.description import Version
from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.model import Model

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")
VERSIONS: list[Version] = [2, 3]


def matrix(plant: Any, unknowns: list[str], knowns: list[str]) -> Matrix:
    """Return the derivatives of unknowns by knowns, one direction each."""
    rows, take = [plant.references[name] for name in unknowns], plant.unit.getDirectionalDerivative
    return np.array([take(rows, [plant.references[name]], [1.0]) for name in knowns]).T


@needs_compiler
@pytest.mark.parametrize("version", VERSIONS)
def test_m1_has_the_jacobian_of_its_model(version: Version, tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    path, trial = write_plant(tmp_path, version, "m1", "testbed.damping_ratio=0.01")
    model, rng = trial.testbed.model(), np.random.default_rng(4)
    with exchanged(path) as plant:
        text = (Path(plant.folder) / "modelDescription.xml").read_text()
        end = "s" if version == 3 else ""
        assert text.count(f'providesDirectionalDerivative{end}="true"') == 1  # not in co-simulation
        plant.begin()
        states, slopes = [v.name for v in plant.states], [v.name for v in plant.slopes]
        efforts = [f"effort.{name}" for name in model.joint_names]
        x, u = rng.normal(size=len(states)), rng.normal(size=2)
        plant.slopes_at(0.0, x, dict(zip(efforts, u, strict=True)))
        a, b = model.jacobian(x, u)
        for found, right in (
            (matrix(plant, slopes, states), a),
            (matrix(plant, slopes, efforts), b),
        ):
            assert np.abs(found - right).max() < 1e-14 * np.abs(right).max()
        both = [*states, *efforts]
        seed = rng.normal(size=len(both))
        along = plant.unit.getDirectionalDerivative(
            [plant.references[name] for name in slopes],
            [plant.references[name] for name in both],
            seed.tolist(),
        )
        np.testing.assert_allclose(along, np.hstack((a, b)) @ seed, rtol=1e-12)
        tips = [f"tip_deflection.{name}" for name in model.appendages.names]
        modes = [f"q.mode_{k + 1}" for k in range(3)]
        np.testing.assert_array_equal(matrix(plant, tips, modes), model.appendages.tip)
        applied = [f"applied_effort.{name}" for name in model.joint_names]
        np.testing.assert_array_equal(matrix(plant, applied, efforts), np.eye(2))


def differences(model: Model, x: Any, u: Any) -> Matrix:
    """Return df/dx by central differences, whose error is about 1e-9 of the largest entry."""
    step = 1e-5 * np.eye(x.size)
    return np.array(
        [(model.derivative(x + e, u) - model.derivative(x - e, u)) / 2e-5 for e in step]
    ).T


@needs_compiler
@pytest.mark.parametrize("name", ["acc_benchmark", "scole_s_open"])
def test_other_testbeds_have_the_slopes_of_their_derivatives(name: str, tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    path, trial = write_plant(tmp_path, 3, name)
    model, rng = trial.testbed.model(), np.random.default_rng(5)
    with exchanged(path) as plant:
        plant.begin()
        states, slopes = [v.name for v in plant.states], [v.name for v in plant.slopes]
        x = rng.normal(size=len(states))
        plant.slopes_at(0.0, x, {})
        right = differences(model, x, np.zeros(model.joints))
        found = matrix(plant, slopes, states)
        assert np.abs(found - right).max() < 1e-8 * np.abs(right).max()
        with pytest.raises(Exception, match="DirectionalDerivative"):
            matrix(plant, states, states)


OPERATORS: dict[str, Callable[..., float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "<": operator.lt, ">": operator.gt,
}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., float]] = {
    "sin": sin, "cos": cos, "tan": tan, "exp": exp, "tanh": tanh, "sqrt": sqrt,
    "atan2": np.arctan2, "hypot": np.hypot, "pow": pow, "log": np.log, "log2": np.log2,
    "asin": np.arcsin, "acos": np.arccos, "atan": np.arctan, "expm1": np.expm1, "fabs": abs,
    "copysign": np.copysign, "floor": np.floor,
}  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "((x * x) - (3.0 / x))", "(-(2.0 - x))", "sqrt((1.0 + (x * x)))", "(sin(x) * cos(x))",
        "tan(x)", "exp((-x))", "expm1(x)", "log(x)", "log2(x)", "acos((0.5 * x))", "asin(x)",
        "atan(x)", "atan2(x, (2.0 + x))", "hypot(x, 3.0)", "pow(x, 2.5)", "tanh(x)", "fabs((-x))",
        "copysign(x, (-x))", "(x - floor(x))", "(1.0 / (x / (x + 1.0)))",
    ],
)  # fmt: skip
def test_functions_have_their_derivatives(text: str) -> None:
    block = tangent([CLine(f"y = {text};", "y", text)], {"x", "y"})
    line = block[0]
    assert isinstance(line, CLine)
    slope, h = line.text.removeprefix("y_d = ").rstrip(";"), 1e-6
    high, low = (evaluated(parse(text), {"x": 0.7 + e}) for e in (h, -h))
    found = evaluated(parse(slope), {"x": 0.7, "x_d": 1.0})
    assert found == pytest.approx((high - low) / (2.0 * h), rel=1e-8)


def evaluated(tree: Expression, values: dict[str, float]) -> float:
    """Return the number that an expression stands for."""
    if isinstance(tree, Constant):
        return float(tree.text)
    if isinstance(tree, Lvalue):
        return values[tree.text]
    terms = [evaluated(one, values) for one in tree.terms]
    if isinstance(tree, Call):
        return float(FUNCTIONS[tree.function](*terms))
    if tree.operator == "?":
        return terms[1] if terms[0] else terms[2]
    if len(terms) == 1:
        return -terms[0]
    return float(OPERATORS[tree.operator](*terms))


def test_what_a_loop_writes_and_reads_again_is_differentiated() -> None:
    body = CLoop("for (int i = 0; i < 3; i++)", [CLine("s = (s * a[i]);", "s", "(s * a[i])"),
                                                 CLine("a[i + 1] = x;", "a", "x")])  # fmt: skip
    block = tangent([CLine("real a[4] = {0};", "a"), CLine("real s = 1.0;", "s"), body], {"x"})
    texts = [line.text for line in block if isinstance(line, CLine)]
    assert texts == ["real a_d[4] = {0};", "real a[4] = {0};", "real s_d = 0.0;", "real s = 1.0;"]
    inner = [line.text for line in block[-1].body]  # type: ignore[union-attr]
    assert inner == ["s_d = (s_d * a[i] + s * a_d[i]);", "s = (s * a[i]);",
                     "a_d[i + 1] = x_d;", "a[i + 1] = x;"]  # fmt: skip


def test_expressions_are_read_as_c_reads_them() -> None:
    text = "a + b * c->d[i + 1] < 2.0e-3 && !e ? (real)f(x, -y) : z"
    assert parse(text).text == (
        "((((a + (b * c->d[i + 1])) < 2.0e-3) && (!e)) ? ((real)f(x, (-y))) : z)"
    )
    with pytest.raises(ValueError, match="no C expression"):
        parse("a + ")
