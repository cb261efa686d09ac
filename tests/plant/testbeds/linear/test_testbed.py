"""The section: from every kind of file, with as many modes as asked for; hostile files."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix
from tests.linear_plants import drawn_plant, modal_plant

from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE, Untrusted
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed, with_changes

PLANT = modal_plant([0.0, 2.0], [[0.1], [-0.2]], read=[[0.1, 0.0], [-0.2, 1.0]])
MATRICES = {"A": PLANT.a, "B": PLANT.b, "C": PLANT.c, "D": np.zeros((2, 1)), "Ts": 0.0}
NAMES = {"inputs": ["effort.hub"], "outputs": ["position.hub", "tip.boom"]}


def written(path: Path, values: dict[str, Any]) -> str:
    if path.suffix == ".mat":
        cells = {k: np.array(v, dtype=object) for k, v in values.items() if isinstance(v, list)}
        savemat(path, {**values, **cells})
    elif path.suffix == ".npz":
        np.savez(path, **values)
    else:
        path.write_text(json.dumps({k: np.asarray(v).tolist() for k, v in values.items()}))
    return str(path)


def section(file: str, **more: Any) -> Any:
    return read_testbed({"kind": "linear", "file": file, **more}, "trial.yaml")


@pytest.mark.parametrize("ending", [".mat", ".npz", ".json"])
def test_every_kind_of_file_is_the_same_plant_and_is_not_read_again(
    ending: str, tmp_path: Path
) -> None:
    file = written(tmp_path / f"plant{ending}", MATRICES | NAMES)
    testbed = section(file)
    assert testbed.model().joint_names == ("hub",)
    assert testbed.model().appendages.names == ("boom",)
    assert testbed.typical_goal == {"hub": 0.1}
    Path(file).unlink()
    assert read_testbed(plain(testbed), "log", NO_CODE) == testbed


def test_a_sparse_matrix_of_matlab_is_read_and_names_stand_in_the_trial(tmp_path: Path) -> None:
    file = written(tmp_path / "iss.mat", {**MATRICES, "A": csc_matrix(PLANT.a)})
    with pytest.raises(BadInput, match=r"system\.c: give 1 rows of 4"):
        section(file, system={"outputs": ["position.joint_1"]})
    testbed = section(file, system=NAMES, joint_units=["m"])
    assert testbed.model().units_by_joint == {"hub": "m"}
    assert testbed == section(file, system=NAMES, joint_units=["m"])


def test_the_lowest_modes_alone_are_kept_where_a_model_asks_for_them() -> None:
    plant = drawn_plant(6, 2, (1.0, 9.0), rigid=2)
    whole = read_testbed(plant.keys(2), "here")
    fewer: Any = with_changes(whole, {"kept_modes": 2}, "plan")
    assert (whole.modes, fewer.modes) == (4, 2)
    linear, cut = (t.model().linearise(t.model().rest({})) for t in (whole, fewer))
    for part, other in ((linear.mass, cut.mass), (linear.stiffness, cut.stiffness)):
        np.testing.assert_array_equal(part[:4, :4], other)
    held = np.sqrt(np.diag(linear.stiffness)[2:])
    assert (np.diff(held) > 0.0).all()
    with pytest.raises(BadInput, match="kept_modes: 5 is not allowed: the plant has 4"):
        with_changes(whole, {"kept_modes": 5}, "plan")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"A": None}, r"system\.a: a plant has states; give A, B and C"),
        ({"A": np.full((4, 4), np.nan)}, r"A: give finite numbers|finite"),
        ({"A": 1j * PLANT.a}, r"real numbers|complex"),
        ({"A": PLANT.a[:3]}, r"system\.a: give 4 rows of 4|system\.a: give 3 rows of 3"),
        ({"extra": 1.0}, r"extra: is not allowed|unknown key|extra"),
        ({"Ts": -1.0}, "Ts: give one number of seconds"),
        ({"Ts": np.array([0.1, 0.2])}, "Ts: give one number of seconds"),
        ({"dt": 0.1}, "dt: call the period Ts"),
    ],
)
@pytest.mark.parametrize("ending", [".mat", ".npz"])
def test_a_file_that_is_no_plant_is_refused_in_one_line(
    ending: str, values: Any, words: str, tmp_path: Path
) -> None:
    given = {k: v for k, v in (MATRICES | NAMES | values).items() if v is not None}
    file = written(tmp_path / f"plant{ending}", given)
    with pytest.raises(BadInput, match=words) as caught:
        section(file)
    assert "\n" not in str(caught.value)
    assert "trial.yaml" in str(caught.value)


def test_objects_in_a_file_are_not_loaded_and_damaged_files_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "plant.npz", A=np.array([{}, 1], dtype=object), B=PLANT.b, C=PLANT.c)
    with pytest.raises(BadInput, match=r"plant\.npz.*(plain numbers|claims|allow_pickle)"):
        section(str(tmp_path / "plant.npz"))
    rng = np.random.default_rng(7)
    for ending, count in ((".mat", 3), (".npz", 30)):  # a process each
        path = tmp_path / f"whole{ending}"
        whole = Path(written(path, MATRICES | NAMES)).read_bytes()
        for _ in range(count):
            content = bytearray(whole[: int(rng.integers(1, len(whole)))])
            content[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
            path.write_bytes(content)
            with pytest.raises(BadInput) as caught:
                section(str(path))
            assert "\n" not in str(caught.value)


def test_a_log_reads_no_file_unless_it_may(tmp_path: Path) -> None:
    file = written(tmp_path / "plant.npz", MATRICES | NAMES)
    with pytest.raises(Untrusted, match=r"plant\.npz"):
        read_testbed({"kind": "linear", "file": file}, "log", NO_CODE.for_log())
    with pytest.raises(BadInput, match="file: give the path of a file"):
        read_testbed({"kind": "linear", "file": 3}, "here")


def test_limits_and_units_are_one_for_each_input() -> None:
    keys = drawn_plant(4, 2, (1.0, 9.0)).keys(2)
    for wrong, key in (
        ({"effort_limit": [1.0]}, "effort_limit"),
        ({"joint_units": ["m"]}, "joint_"),
    ):
        with pytest.raises(BadInput, match=rf"{key}.*: 1 entries for 2 inputs; give one for each"):
            read_testbed(keys | wrong, "here")
