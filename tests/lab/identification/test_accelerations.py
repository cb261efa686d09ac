"""Outputs that are accelerations: efforts reach them at once, before or after the tick."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
from tests.lab.conftest import Call

from flexslew_lab.identification.modal.modes import ModalModel, identify_modes
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.records.foreign import external_record
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

H, TICKS = 0.05, 4000  # [s]
MODES = (Oscillator(2.0, 0.01), Oscillator(6.0, 0.02))
RESIDUES, INERTIA = (0.4, -0.2), 2.0
OUTPUT = Output("acc.tip", "m/s^2", Quantity.ACCELERATION)


def effort() -> Vector:
    t = H * np.arange(TICKS)
    rng = np.random.default_rng(3)
    lines = np.arange(0.5, 9.0, 2.0 * np.pi / t[-1])
    return np.asarray(np.sin(np.outer(t, lines) + rng.uniform(0.0, 6.28, lines.size)).sum(axis=1))


def acceleration(u: Vector, after: bool) -> Vector:
    """Return q'' of rigid motion and modes at the ticks, with the effort after or before them."""
    held = np.append(u, u[-1]) if after else np.append(u[0], u)
    found = held / INERTIA
    for mode, residue in zip(MODES, RESIDUES, strict=True):
        q, v = (x[:, 0] / mode.frequency**2 for x in mode.responses(u[:, None], H))
        drag = 2.0 * mode.damping_ratio * mode.frequency
        found = found + residue * (held - drag * v - mode.frequency**2 * q)
    return np.asarray(found)


def record(after: bool = True, noise: float = 0.05, seed: int = 0) -> Record:
    u = effort()
    clean = acceleration(u, after)
    noisy = clean + noise * clean.std() * np.random.default_rng(seed).standard_normal(len(clean))
    return Record(H, u[:, None], noisy[:, None], ("hub",), (OUTPUT,), "here", np.array([np.inf]))


def near_truth(model: ModalModel) -> bool:
    """Return whether both modes are found within twice their intervals."""
    pairs = [
        (interval, value)
        for mode, truth in zip(model.modes, MODES, strict=True)
        for interval, value in (
            (mode.frequency, truth.frequency),
            (mode.damping_ratio, truth.damping_ratio),
        )
    ]
    return all(abs(i.value - value) < i.high - i.low for i, value in pairs)


@pytest.mark.parametrize("after", [True, False])
def test_the_modes_of_an_acceleration_are_found(after: bool) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = identify_modes(record(after), (0.5, 9.0))
    assert near_truth(model)
    assert model.doubts == ()
    (rigid,) = model.fit.rigid
    assert rigid.sum() == pytest.approx(1.0 / INERTIA + sum(RESIDUES), rel=0.01)
    assert rigid[int(after)] == pytest.approx(1.0 / INERTIA + sum(RESIDUES), rel=0.05)
    assert model.fit.residues[:, 0, 0] == pytest.approx(RESIDUES, rel=0.05)


@pytest.mark.slow
@pytest.mark.campaign
def test_the_intervals_of_an_acceleration_hold_the_truth(case: np.random.Generator) -> None:
    assert near_truth(identify_modes(record(True, 0.1, int(case.integers(2**31))), (0.5, 9.0)))


def test_an_acceleration_where_the_effort_is_unknown_is_refused(tmp_path: Path) -> None:
    one = record()
    rows = np.column_stack((one.times, np.append(one.effort, 0.0), one.measured))
    path = tmp_path / "lab.csv"
    np.savetxt(path, np.delete(rows, 700, axis=0), delimiter=",", header="t,u,a", comments="")
    gappy = external_record(path, ("u=hub",), ("a=acc.tip",)).record
    assert gappy.outputs == (OUTPUT,)
    with pytest.raises(BadInput, match="accelerations follow it at once: give a part"):
        identify_modes(gappy)


def test_the_command_writes_numbers_and_no_nan(tmp_path: Path, call: Call) -> None:
    one = record()
    rows = np.column_stack((one.times, np.append(one.effort, 0.0), one.measured))
    np.savetxt(tmp_path / "lab.txt", rows, header="t u a")
    words = f"identify {tmp_path}/lab.txt --out {tmp_path}/out --json --inputs u=hub"
    code, printed, _ = call(*words.split(), "--outputs", "a=acc.tip", "--band", "0.5,9")
    assert not code
    text = printed[printed.index("{\n") : printed.rindex("}") + 1]
    assert len(json.loads(text)["modes"]) == 2
    assert "NaN" not in text
    assert "nan" not in (tmp_path / "out" / "identified.yaml").read_text()
