"""FMUs of a plant in C: accepted by FMPy, equal to the exact solution, the same every time."""

import importlib
import importlib.util
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest
from tests.oscillating_module import PERIOD, cart_module, exact_step

from flexslew_lab.export.fmu.archive import fmu_of
from flexslew_lab.export.fmu.binaries import compiler_for
from flexslew_lab.export.fmu.description import Version
from flexslew_plant.errors import BadInput

fmpy: Any = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc here")
VERSIONS: list[Version] = [2, 3]


@pytest.fixture(scope="module", params=VERSIONS)
def fmu(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / f"cart{request.param}.fmu"
    path.write_bytes(fmu_of(cart_module(), request.param))
    return path


@dataclass
class Opened:
    """An instance of FMPy, by names."""

    unit: Any
    references: dict[str, int]
    version: int

    def get(self, *names: str) -> list[float]:
        read = self.unit.getReal if self.version == 2 else self.unit.getFloat64
        return list(read([self.references[name] for name in names]))

    def set(self, name: str, value: float) -> None:
        write = self.unit.setReal if self.version == 2 else self.unit.setFloat64
        write([self.references[name]], [value])


@contextmanager
def opened(path: Path, start: float = 0.0) -> Iterator[Opened]:
    description = fmpy.read_model_description(str(path))
    folder = fmpy.extract(str(path))
    unit = fmpy.instantiate_fmu(folder, description, "CoSimulation")
    version = int(description.fmiVersion[0])
    if version == 2:
        unit.setupExperiment(startTime=start)
        unit.enterInitializationMode()
    else:
        unit.enterInitializationMode(startTime=start)
    unit.exitInitializationMode()
    names = {v.name: v.valueReference for v in description.modelVariables}
    yield Opened(unit, names, version)
    unit.terminate()
    unit.freeInstance()
    shutil.rmtree(folder)


def test_fmpy_finds_no_problem(fmu: Path) -> None:
    assert importlib.import_module("fmpy.validation").validate_fmu(str(fmu)) == []


def test_steps_are_the_exact_solution(fmu: Path) -> None:
    step, state = exact_step(), np.array([0.25, 0.0])
    with opened(fmu, start=1.0) as cart:
        assert cart.get("time", "position", "velocity") == [1.0, 0.25, 0.0]
        for k in range(200):
            cart.set("force", np.sin(0.3 * k))
            cart.unit.doStep(1.0 + k * PERIOD, PERIOD)
            state = step @ np.append(state, np.sin(0.3 * k))
            np.testing.assert_allclose(cart.get("position", "velocity"), state, atol=1e-14)
            assert cart.get("pull[1]", "pull[2]") == [np.sin(0.3 * k), 1.0 + k * PERIOD]


def test_simulated_by_fmpy(fmu: Path) -> None:
    found = fmpy.simulate_fmu(str(fmu), stop_time=1.0, step_size=PERIOD, output_interval=PERIOD,
                              output=["position"])  # fmt: skip
    state, step = np.array([0.25, 0.0]), exact_step()
    for k, position in enumerate(found["position"]):
        assert position == pytest.approx(state[0], abs=1e-14), k
        state = step @ np.append(state, 0.0)


def test_a_step_of_many_ticks_holds_the_input(fmu: Path) -> None:
    with opened(fmu) as cart:
        cart.set("force", 3.0)
        start = cart.unit.getFMUState() if cart.version == 3 else cart.unit.getFMUstate()
        for k in range(5):
            cart.unit.doStep(k * PERIOD, PERIOD)
        one_by_one = cart.get("time", "position", "velocity")
        (cart.unit.setFMUState if cart.version == 3 else cart.unit.setFMUstate)(start)
        cart.unit.doStep(0.0, 5 * PERIOD)
        assert cart.get("time", "position", "velocity") == one_by_one


@pytest.mark.parametrize("step", [0.5 * PERIOD, 1.3 * PERIOD, 0.0, -PERIOD])
def test_a_step_between_two_ticks_is_refused(fmu: Path, step: float) -> None:
    with opened(fmu) as cart:
        with pytest.raises(Exception, match=r"[dD]oStep"):
            cart.unit.doStep(0.0, step)
        assert cart.get("time", "position") == [0.0, 0.25]


def test_an_output_is_not_set_and_an_input_is_finite(fmu: Path) -> None:
    with opened(fmu) as cart:
        for name, value in (("position", 1.0), ("time", 1.0), ("force", np.nan)):
            with pytest.raises(Exception, match="Set"):
                cart.set(name, value)
        assert cart.get("time", "position", "force") == [0.0, 0.25, 0.0]


def test_reset_returns_to_the_start(fmu: Path) -> None:
    with opened(fmu) as cart:
        cart.set("force", 5.0)
        cart.unit.doStep(0.0, PERIOD)
        cart.unit.reset()
        assert cart.get("time", "position", "force") == [0.0, 0.25, 0.0]


@pytest.mark.parametrize("version", VERSIONS)
def test_the_same_module_is_the_same_file(version: Version) -> None:
    assert fmu_of(cart_module(), version) == fmu_of(cart_module(), version)


def test_sources_compile_again_from_the_archive(fmu: Path, tmp_path: Path) -> None:
    with ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    text = (tmp_path / "modelDescription.xml").read_text()
    build = tmp_path / "sources" / "buildDescription.xml"
    named = (build if build.exists() else tmp_path / "modelDescription.xml").read_text()
    for source in (tmp_path / "sources").glob("*.c"):
        assert f'name="{source.name}"' in named
    token = text.partition("{")[2].partition("}")[0]
    assert token in (tmp_path / "sources" / "model.h").read_text()


def test_an_unknown_unit_is_refused() -> None:
    module = cart_module()
    wrong = module._replace(outputs=(module.outputs[0]._replace(unit="ell"), *module.outputs[1:]))
    with pytest.raises(BadInput, match="unit 'ell' has the factor 'ell'; known: rad, s, m"):
        fmu_of(wrong)


def test_a_signal_of_other_numbers_is_refused_by_the_compiler() -> None:
    module = cart_module()
    with pytest.raises(BadInput, match="refuses the sources for linux64"):
        fmu_of(module._replace(outputs=module.outputs[:-1]))


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="no ziglang here")
@pytest.mark.parametrize("version", VERSIONS)
def test_a_library_of_windows_is_inside(version: Version, tmp_path: Path) -> None:
    assert compiler_for("win64") is not None
    first, again = (fmu_of(cart_module(), version, ("linux64", "win64")) for _ in range(2))
    (tmp_path / "cart.fmu").write_bytes(first)
    assert first == again
    with ZipFile(tmp_path / "cart.fmu") as archive:
        place = "win64" if version == 2 else "x86_64-windows"
        assert archive.read(f"binaries/{place}/cart.dll")[:2] == b"MZ"
