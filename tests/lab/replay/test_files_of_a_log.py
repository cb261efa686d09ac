"""A log opens no files that it names, unless they are shipped or trusted by name."""

from pathlib import Path
from typing import Any

import pytest

from flexslew_control.law import plant_description
from flexslew_lab.log.bag_layout import with_checksum
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.files.mcap_file import McapFile
from flexslew_lab.replay.logged_controllers import trial_of
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, NO_CODE, Trust, Untrusted
from flexslew_plant.yaml_data import yaml_text

APPENDAGE: dict[str, Any] = {"hinge": {"place": [1.0, 0.0, 0.0]}, "shape": {"kind": "modal_data"}}
PLATFORM = {"mass": 100.0, "inertia": {"xx": 50.0, "yy": 50.0, "zz": 50.0}}


def with_law(path: str) -> dict[str, Any]:
    return {"controllers": {"a": {"law": "linear", "file": path}}, "active": "a"}


def with_model(path: str) -> dict[str, Any]:
    return {"controllers": {"lqr": {"model": {"file": path}}}, "active": "lqr"}


def with_plan(path: str) -> dict[str, Any]:
    return {"plan": {"method": "input_shaping", "model": {"file": path}}}


def with_shape(path: str) -> dict[str, Any]:
    shape = {**APPENDAGE["shape"], "file": path}
    appendage = {**APPENDAGE, "shape": shape}
    return {
        "testbed": {"kind": "spacecraft", "platform": PLATFORM, "appendages": {"wing": appendage}}
    }


def with_finite_elements(path: str) -> dict[str, Any]:
    appendage = {**APPENDAGE, "shape": {"kind": "finite_elements", "file": path}}
    return {
        "testbed": {"kind": "spacecraft", "platform": PLATFORM, "appendages": {"wing": appendage}}
    }


PLACES = [with_law, with_model, with_plan, with_shape, with_finite_elements]


def bag_of(trial: dict[str, Any], folder: Path) -> Path:
    """Return an MCAP file whose metadata hold a trial."""
    file = McapFile(folder / "log.mcap")
    file.add_metadata("flexslew", with_checksum({"trial": yaml_text({"name": "foreign", **trial})}))
    file.close()
    return folder / "log.mcap"


@pytest.mark.parametrize("place", PLACES)
def test_a_file_that_a_log_names_is_not_opened(place: Any, tmp_path: Path) -> None:
    path = str(tmp_path / "its; touch x.npz")  # it does not exist: opening it is another error
    bag = bag_of(place(path), tmp_path)
    with pytest.raises(Untrusted, match="refused to read") as caught:
        trial_of(BagReader(bag))
    assert f"--trust '{path}'" in str(caught.value)
    for trust in (Trust.of([path]), ANY_CODE):
        with pytest.raises(BadInput, match="cannot be read: No such file"):
            built(trial_of(BagReader(bag, trust=trust)))
    with pytest.raises(BadInput, match="cannot be read: No such file"):
        built(parse_trial(yaml_text({"name": "own", **place(path)}), "trial"))


def built(trial: Any) -> None:
    """Build the testbed, which reads the files of its shapes."""
    trial.testbed.model()


def test_a_shipped_file_that_a_log_names_is_read_and_none_of_its_name_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import flexslew_plant.testbeds.spacecraft as spacecraft

    shipped = sorted((Path(spacecraft.__file__).parent / "data").glob("*.yaml"))[0]
    (tmp_path / shipped.name).write_text("not this one")
    monkeypatch.chdir(tmp_path)
    trial = trial_of(BagReader(bag_of(with_shape(shipped.name), tmp_path)))
    trial.testbed.model()
    with pytest.raises(BadInput, match="modal data must be a mapping"):
        parse_trial(yaml_text({"name": "own", **with_shape(shipped.name)}), "t").testbed.model()
    (tmp_path / "b").mkdir()
    with pytest.raises(Untrusted):
        trial_of(BagReader(bag_of(with_shape(f"../../{shipped.name}"), tmp_path / "b")))


def test_the_testbed_record_of_a_log_opens_no_file(tmp_path: Path) -> None:
    settings = yaml_text({**with_shape(str(tmp_path / "x.yaml")), "period": 0.01})
    with pytest.raises(Untrusted):
        plant_description(settings, "log", NO_CODE.for_log())
