"""Files that a person names: regular ones of limited size, and nothing else is opened."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from flexslew_control.plans.plan_file import load_plan
from flexslew_lab.identification.files.csv_file import read_csv
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.studies.sampling.methods import list_of
from flexslew_lab.studies.study import load_study
from flexslew_lab.trial.trial import load_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_bytes, given_text, open_given
from flexslew_plant.system_file import system_from_file
from flexslew_plant.testbeds.model_file import with_model_file
from flexslew_plant.testbeds.spacecraft.finite_elements.readers import contents_of
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape

READERS: dict[str, Callable[[Path], object]] = {
    "law.mat": lambda path: system_from_file(str(path), "law"),
    "law.npz": lambda path: system_from_file(str(path), "law"),
    "law.yaml": lambda path: system_from_file(str(path), "law"),
    "model.yaml": lambda path: with_model_file({"file": str(path)}, "model"),
    "modal.npz": modal_shape,
    "modal.yaml": modal_shape,
    "modal.csv": modal_shape,
    "model.npz": contents_of,
    "model.mat": contents_of,
    "model.op4": contents_of,
    "model.inp": contents_of,
    "trial.yaml": load_trial,
    "study.yaml": load_study,
    "plan.yaml": load_plan,
    "samples.csv": lambda path: list_of(path, "study"),
    "record.csv": lambda path: read_csv(path, lambda names: ("u",)),
    "bag.mcap": BagReader,
}


def as_pipe(path: Path) -> None:
    os.mkfifo(path)


def as_endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def as_folder(path: Path) -> None:
    path.mkdir()


def as_missing(path: Path) -> None:
    path.unlink(missing_ok=True)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("make", [as_pipe, as_endless, as_folder, as_missing])
def test_a_reader_refuses_what_is_no_regular_file(
    name: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    make(tmp_path / name)
    with pytest.raises(BadInput) as caught:
        READERS[name](tmp_path / name)
    assert name in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_file_above_the_limit_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    for name in READERS:
        if name in {"record.csv", "bag.mcap"}:  # read in parts
            continue
        large = tmp_path / name
        large.symlink_to(path)
        with pytest.raises(BadInput, match=r"the limit is (64|256)"):
            READERS[name](large)


def test_a_file_without_a_size_is_read_up_to_the_limit() -> None:
    assert given_bytes("/proc/self/stat")
    with pytest.raises(BadInput, match="the limit is"):
        given_bytes("/proc/self/stat", 3)


def test_a_name_that_no_file_can_have_is_refused() -> None:
    for name in ("a\0b", "x" * 10_000):
        with pytest.raises(BadInput, match="cannot be read"):
            open_given(name)


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path: Path) -> None:
    (tmp_path / "text").write_bytes(b"\xef\xbb\xbfa: 1\r\nb: 2")
    assert given_text(tmp_path / "text") == "a: 1\nb: 2"
