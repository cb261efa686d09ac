"""A log that is damaged or cut says so: no number of it is silently another one."""

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexslew_lab.identification.records.foreign import external_record
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.log.export import export_log
from flexslew_lab.log.info import log_info
from flexslew_lab.log.recover import recover
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.player import Player, PlaySettings
from flexslew_lab.report.run_data import read_run
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import FlexslewError

TRIAL = """
duration: 3.0
plan: {method: none, goal: {base_yaw: 0.01}, duration: 1.0}
controllers: {pd_feedforward: {}}
"""
READERS: tuple[Callable[[Path], Any], ...] = (
    log_info, check_log, read_run, metrics_of, lambda bag: export_log(bag, bag / "tables"),
    lambda bag: recover(bag, bag.parent / "whole"), lambda bag: Player(PlaySettings(bag=str(bag))),
)  # fmt: skip


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("honest")
    run_trial(parse_trial(TRIAL, "test"), "test", folder / "run", True, False)
    return folder / "run" / "bag"


def damage(bag: Path, case: np.random.Generator) -> None:
    """Flip, clear, double or drop bytes in one of the two files."""
    path = sorted(bag.iterdir())[case.integers(2)]
    content = bytearray(path.read_bytes())
    at, size = int(case.integers(len(content))), int(case.integers(1, 200))
    how = case.choice(["flip", "zero", "double", "drop", "noise"])
    if how == "flip":
        content[at] ^= 1 << int(case.integers(8))
    elif how == "zero":
        content[at : at + size] = bytes(len(content[at : at + size]))
    elif how == "noise":
        content[at : at + size] = case.bytes(len(content[at : at + size]))
    else:
        content[at : at + size] = content[at : at + size] * (2 * (how == "double"))
    path.write_bytes(content)


def test_damage_is_said_or_changes_nothing(
    honest: Path, tmp_path: Path, case: np.random.Generator
) -> None:
    """Bits that flip, bytes that are zero, double or missing, in any file of the bag."""
    bag = shutil.copytree(honest, tmp_path / "bag")
    damage(bag, case)
    known = metrics_of(honest)
    for read in READERS:
        try:
            found = read(bag)
        except FlexslewError as error:
            assert str(error).isprintable()  # noqa: PT017
            continue
        if read is metrics_of and found["log_complete"]:
            assert found == known
    sound = False
    try:
        sound = all(finding.ok for finding in check_log(bag))
    except FlexslewError:
        return
    if sound:
        assert list(BagReader(bag).messages()) == list(BagReader(honest).messages())


def test_damage_of_a_bag_of_another_bench_is_said_or_changes_nothing(
    honest: Path, tmp_path: Path, case: np.random.Generator
) -> None:
    """Its reader is another one, and no record of this project vouches for its content."""
    columns = ("/measurement.applied_effort[0]",), ("/measurement.joint_position[0]",)
    bag = shutil.copytree(honest, tmp_path / "bag")
    damage(bag, case)
    try:
        found = external_record(bag, *columns).record
    except FlexslewError as error:
        assert str(error).isprintable()  # noqa: PT017
        return
    known = external_record(honest, *columns).record
    assert np.array_equal(found.effort, known.effort)
    assert np.array_equal(found.measured, known.measured)


def test_what_a_kill_leaves_is_recovered_without_a_hole(
    honest: Path, tmp_path: Path, case: np.random.Generator
) -> None:
    """A recorder that is killed leaves the beginning of its file."""
    bag = tmp_path / "bag"
    bag.mkdir()
    name = next(honest.glob("*.mcap")).name
    content = (honest / name).read_bytes()
    (bag / name).write_bytes(content[: int(case.integers(len(content)))])
    try:
        done = recover(bag, tmp_path / "whole")
    except FlexslewError as error:
        assert "nothing to recover" in str(error) or "flexslew bag" in str(error)  # noqa: PT017
        return
    kept = list(BagReader(done.out).messages())
    assert kept == list(BagReader(honest).messages())[: len(kept)]
    assert done.missing_ticks == 0
