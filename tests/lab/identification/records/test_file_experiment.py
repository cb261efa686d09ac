"""Files of another bench from Python: what the command's options choose."""

from pathlib import Path

import numpy as np
import pytest
from tests.lab.identification.test_files import INERTIA, INPUTS, MODE, OUTPUTS, as_csv, table

import flexslew as fs

COLUMNS = {"inputs": INPUTS, "outputs": OUTPUTS}


def test_a_file_gives_its_mode_from_python(tmp_path: Path) -> None:
    as_csv(tmp_path / "lab.csv", table(1500))
    found = fs.identify(tmp_path / "lab.csv", columns=COLUMNS)
    (mode,) = found.model.modes
    assert mode.frequency.value == pytest.approx(MODE.frequency, rel=3e-3)
    assert found.model.inertia[0][0].value == pytest.approx(INERTIA, rel=0.02)


def test_notes_of_a_file_are_warnings_at_the_call(tmp_path: Path) -> None:
    values = table(1500)
    as_csv(tmp_path / "lab.csv", values | {"time": 1e3 * values["time"], "v": 57.3 * values["v"]})
    with pytest.warns(
        UserWarning, match=r"lab\.csv: .*is the rate in degrees per second"
    ) as caught:
        fs.identify(tmp_path / "lab.csv", columns={**COLUMNS, "time_unit": "ms"})
    assert caught[0].filename == __file__


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"inputs": ["u=hub"]}, "outputs: is missing"),
        ({**COLUMNS, "unit": "ms"}, "unit: unknown key"),
        ({**COLUMNS, "time_unit": "min"}, "time_unit"),
        ({**COLUMNS, "period": 0.0}, "period"),
        ({**COLUMNS, "inputs": ["w"]}, "w"),
    ],
)
def test_wrong_columns_are_refused(tmp_path: Path, columns: dict[str, object], words: str) -> None:
    as_csv(tmp_path / "lab.csv", {name: np.asarray(v)[:50] for name, v in table(400).items()})
    with pytest.raises(fs.BadInput) as error:
        fs.identify(tmp_path / "lab.csv", columns=columns)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
