from pathlib import Path

import pytest

from flexslew_lab.trial.outputs import check_output_file, check_output_folder, new_folder
from flexslew_plant.errors import BadInput


def content(folder: Path) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def test_what_can_be_written_is_returned_and_nothing_is_left_behind(tmp_path: Path) -> None:
    file, folder = tmp_path / "a" / "b" / "c.html", tmp_path / "d" / "e"
    assert check_output_file(file, "--out") == file
    assert check_output_folder(folder, "--out") == folder
    assert content(tmp_path) == []


@pytest.mark.parametrize(
    "place", ["/proc/nothing/x", "/dev/null/x", "file/x", "a\0b", "x" * 300], ids=repr
)
def test_an_impossible_place_is_refused_in_one_line(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").touch()
    for check in (check_output_file, check_output_folder):
        with pytest.raises(BadInput, match=r"--out: .*cannot be written: ") as caught:
            check(tmp_path / place, "--out")
        assert "\n" not in str(caught.value)
    assert content(tmp_path) == ["file"]


def test_a_file_is_no_folder_and_a_folder_no_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match="is a file"):
        check_output_folder(tmp_path / "file", "--out")
    with pytest.raises(BadInput, match="is a folder"):
        check_output_file(tmp_path, "--figure")


def test_neither_a_log_nor_the_trial_that_is_read_is_overwritten(tmp_path: Path) -> None:
    trial, log, other = tmp_path / "t.yaml", tmp_path / "bag_0.mcap", tmp_path / "old.html"
    trial.write_text("duration: 1.0")
    log.touch()
    other.touch()
    (tmp_path / "link.yaml").symlink_to(trial)
    for path in (trial, tmp_path / "link.yaml"):
        with pytest.raises(BadInput, match=r"--to: .* is the trial itself"):
            check_output_file(path, "--to", str(trial))
    with pytest.raises(BadInput, match=r"--figure: .* is a log"):
        check_output_file(log, "--figure")
    assert check_output_file(other, "--out", str(trial)) == other
    assert check_output_file(tmp_path / "m1", "--out", "m1") == tmp_path / "m1"


def test_a_run_gets_a_new_folder_and_no_used_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first = new_folder("m1", None)
    assert first.parts[0] == "runs"
    first.mkdir(parents=True)
    assert new_folder("m1", None) != first
    assert new_folder("m1", first) == first
    (first / "bag").mkdir()
    with pytest.raises(BadInput, match="is not empty"):
        new_folder("m1", first)
