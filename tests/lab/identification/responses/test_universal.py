"""Frequency responses and modes of universal files: intervals, both ways, modal data."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.identification.gappy import BAND as GAPPY_BAND
from tests.lab.identification.gappy import OUTPUTS, Loss, lossy_record

from flexslew_lab.cli.main import main
from flexslew_lab.identification.modal.modes import identify_modes
from flexslew_lab.identification.responses.frequency_response import FrequencyResponse
from flexslew_lab.identification.responses.frf_fit import MeasuredResponses, identify_responses
from flexslew_lab.identification.responses.universal import (
    read_modal_data,
    read_responses,
    write_model,
    write_response_model,
)
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape
from flexslew_plant.yaml_data import load_yaml, yaml_text

MODES = ((5.0, 0.01), (12.0, 0.02), (12.6, 0.015), (30.0, 0.005))  # [rad/s], [-]
RESIDUES = np.array([[1.0, 0.5], [0.8, -0.6], [0.5, 0.9], [2.0, 1.0]])
INERTIA = 2.0  # kg m^2
W = 2.0 * np.pi * 0.01 * np.arange(1.0, 701.0, dtype=np.float64)  # [rad/s]


def responses(seed: int, order: int = 2, noise: float = 0.02) -> MeasuredResponses:
    """Return two responses of a free body with four modes, with complex noise."""
    rng = np.random.default_rng((seed, 3))
    s = 1j * W[:, None]
    h = -1.0 / (INERTIA * W[:, None] ** 2) + 0j
    for (w, zeta), row in zip(MODES, RESIDUES, strict=True):
        h = h + row / (w**2 - W[:, None] ** 2 + 2.0 * zeta * w * s)
    h = h * s**order
    scatter = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
    values = h + noise * h.std(axis=0) * scatter / np.sqrt(2.0)
    return MeasuredResponses(W, values, (order, order), ("1+Z", "2+Z"), ("1+Z", "1+Z"), "here")


@pytest.mark.parametrize("order", [0, 1, 2])
def test_modes_of_displacements_velocities_and_accelerations_are_found(order: int) -> None:
    model = identify_responses(responses(0, order, 1e-4), (2.0, 40.0))
    found = [(mode.frequency.value, mode.damping_ratio.value) for mode in model.modes]
    assert np.array(found) == pytest.approx(np.array(MODES), rel=2e-2)
    assert model.residues == pytest.approx(RESIDUES, rel=2e-2)


@pytest.mark.campaign
def test_intervals_of_responses_hold_the_truth(case: np.random.Generator) -> None:
    model = identify_responses(responses(int(case.integers(2**31))), (1.0, 40.0))
    assert len(model.modes) == len(MODES)
    for mode, truth in zip(model.modes, MODES, strict=True):
        for one, value in zip((mode.frequency, mode.damping_ratio), truth, strict=True):
            assert abs(one.value - value) < one.high - one.low  # twice the interval


def test_too_few_lines_are_refused() -> None:
    with pytest.raises(BadInput, match="here: 9 lines in the band are not enough; at least 20"):
        identify_responses(responses(0), (10.0, 10.6))


def test_responses_are_written_and_read_back(tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    model = identify_responses(responses(0), (1.0, 40.0))
    write_response_model(tmp_path / "a.uff", model)
    again = read_responses(tmp_path / "a.uff")
    assert again.frequency == pytest.approx(model.responses.frequency)
    assert again.values == pytest.approx(model.fitted, rel=1e-6)
    assert again.orders == (2, 2)
    assert (again.outputs, again.inputs) == (("1", "2"), ("1", "1"))


def test_modes_and_responses_of_a_record_are_written(tmp_path: Path) -> None:
    pyuff: Any = pytest.importorskip("pyuff")
    found = identify_modes(lossy_record(Loss(), 3), GAPPY_BAND)
    w = np.linspace(1.0, 9.0, 50)
    values = np.ones((50, 3, 1)) * np.exp(1j * w)[:, None, None]
    size = np.zeros(values.shape)
    response = FrequencyResponse(w, ("hub",), OUTPUTS, values, size, size, size[..., 0], 3)
    write_model(tmp_path / "a.uff", found, response)
    again = read_responses(tmp_path / "a.uff")
    assert (again.orders, again.outputs, again.inputs) == ((0, 1, 0), ("1", "2", "3"), ("1",) * 3)
    assert again.values == pytest.approx(values[:, :, 0])
    modes = pyuff.UFF(str(tmp_path / "a.uff")).read_sets([3, 4])
    for one, mode in zip(modes, found.modes, strict=True):
        assert 2.0 * np.pi * one["freq"] == pytest.approx(mode.frequency.value, rel=1e-5)
        assert one["modal_damp_vis"] == pytest.approx(mode.damping_ratio.value, rel=1e-5)
        assert one["node_nums"].tolist() == [1, 3]


def run(monkeypatch: pytest.MonkeyPatch, *words: object) -> object:
    monkeypatch.setattr("sys.argv", ["flexslew", "identify", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def test_the_command_fits_responses_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pyuff: Any = pytest.importorskip("pyuff")
    one = responses(1)
    sets = [
        pyuff.prepare_58(
            binary=0, func_type=4, id1="lab", rsp_node=k + 1, rsp_dir=3, ref_node=1, ref_dir=3,
            x=W / (2.0 * np.pi), data=one.values[:, k], abscissa_spacing=1, abscissa_min=0.01,
            abscissa_inc=0.01, abscissa_spec_data_type=18, ordinate_spec_data_type=12,
            orddenom_spec_data_type=13,
        )
        for k in range(2)
    ]  # fmt: skip
    path, out = tmp_path / "lab.unv", tmp_path / "out"
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    assert not run(monkeypatch, path, "--out", out, "--band", "1,40", "--uff", tmp_path / "b.uff")
    content = load_yaml((out / "identified.yaml").read_text(), "file")
    found = [mode["frequency"]["value"] for mode in content["modes"]]
    assert found == pytest.approx([w for w, _ in MODES], rel=1e-3)
    assert list(content["noise"]) == ["1+Z per 1+Z", "2+Z per 1+Z"]
    assert (out / "identification.html").stat().st_size > 1000
    types = pyuff.UFF(str(tmp_path / "b.uff")).get_set_types()
    assert types.tolist() == [58, 58, 55, 55, 55, 55]
    capfd.readouterr()
    assert run(monkeypatch, path, "--fit", "x") == 2
    assert "--fit needs a record in time" in capfd.readouterr().err


def beam(path: Path, tip: float = 1.0) -> None:
    """Write two modes of a row of three nodes."""
    pyuff: Any = pytest.importorskip("pyuff")
    zero = np.zeros(3)
    nodes = pyuff.prepare_2411(
        node_nums=[1, 2, 5], def_cs=[0] * 3, disp_cs=[0] * 3, color=[0] * 3, x=[1.0, 2.0, 3.0],
        y=zero, z=zero,
    )  # fmt: skip
    shapes = np.array([[0.2, 0.6, tip], [1.0, 1.0, -0.8]])
    modes = [
        pyuff.prepare_55(
            model_type=1, analysis_type=2, data_ch=2, spec_data_type=8, data_type=2,
            n_data_per_node=3, r1=zero, r2=zero, r3=row, load_case=1, mode_n=k, freq=0.5 * k,
            modal_m=1.0, modal_damp_vis=0.01, modal_damp_his=0.0, node_nums=[1, 2, 5], id1="m",
            id2="NONE", id3="NONE", id4="NONE", id5="NONE",
        )
        for k, row in enumerate(shapes, 1)
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets([nodes, *modes], "overwrite")


def test_modes_of_a_test_are_an_appendage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    beam(tmp_path / "panel.unv")
    assert not run(monkeypatch, tmp_path / "panel.unv", "--mass", 3.0, "--out", tmp_path)
    data = load_yaml((tmp_path / "appendage.yaml").read_text(), "file")
    assert data["frequencies_hz"] == pytest.approx([0.5, 1.0])
    assert data["points"] == [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]
    assert (sum(data["masses"]), data["tip"]) == (pytest.approx(3.0), 2)
    shape = modal_shape(tmp_path / "appendage.yaml")
    assert np.sqrt(shape.stiffness / shape.mass) == pytest.approx([np.pi, 2.0 * np.pi])


def test_modes_that_are_not_orthogonal_are_refused_by_the_reader(tmp_path: Path) -> None:
    beam(tmp_path / "panel.unv", 3.0)
    path = tmp_path / "appendage.yaml"
    path.write_text(yaml_text(read_modal_data(tmp_path / "panel.unv", 3.0)))
    with pytest.raises(BadInput, match="orthogonal"):
        modal_shape(path)


@pytest.mark.parametrize(
    ("mass", "words"), [(0.0, "--mass: 0.0 is not allowed"), (1.0, "holds no dataset 55")]
)
def test_files_without_modes_or_a_mass_are_refused(mass: float, words: str, tmp_path: Path) -> None:
    pyuff: Any = pytest.importorskip("pyuff")
    path = tmp_path / "a.unv"
    nodes = pyuff.prepare_2411(
        node_nums=[1], def_cs=[0], disp_cs=[0], color=[0], x=[1.0], y=[0.0], z=[0.0]
    )
    pyuff.UFF(str(path)).write_sets([nodes], "overwrite")
    with pytest.raises(BadInput, match=words):
        read_modal_data(path, mass)
