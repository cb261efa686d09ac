"""The record of a run: the readings of its sensors and the efforts applied, never its truth."""

from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.identification.records.measurements import FIELDS, Channels, ticks_record
from flexslew_lab.identification.records.record import Record
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.trial.outputs import bag_folder
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Appendages

_TOPIC = "/measurement"


def bag_of(run: Path) -> BagReader:
    """Return the bag of a run's folder, of a bag's folder, or of an .mcap file.

    Raises:
        BadInput: there is none.
    """
    return BagReader(bag_folder(run))


def record_of(bag: BagReader, sensors: Appendages | None = None) -> Record:
    """Return the measurements of a bag's last epoch with the efforts between them.

    The effort that was applied during a tick stands in the measurement at its end.

    Args:
        bag: of a bench of this project.
        sensors: what those of the appendages measure; None: deflections.

    Raises:
        BadInput: the bag is damaged, holds no measurements, or a tick is missing.
    """
    parts: dict[str, list[Any]] = {name: [] for name in ("tick", "epoch", *FIELDS)}
    for block in bag.blocks([_TOPIC]):
        for name, found in parts.items():
            found.append(np.asarray(block.columns[name]))
    if not parts["tick"]:
        raise BadInput(f"{bag.path}: holds no measurements")
    testbed = bag.overview.testbed
    if testbed is None:
        raise BadInput(f"{bag.path}: does not name its testbed (/testbed)")
    columns = {name: np.concatenate(found) for name, found in parts.items()}
    last = columns["epoch"] == columns["epoch"][-1]
    ticks, first = np.unique(columns["tick"][last].astype(np.int64), return_index=True)
    gaps = np.flatnonzero(np.diff(ticks) != 1)
    if gaps.size:
        raise BadInput(
            f"{bag.path}: no measurement of tick {ticks[gaps[0]] + 1}: an experiment needs all"
        )
    values = {name: np.asarray(columns[name][last][first], dtype=np.float64) for name in FIELDS}
    return ticks_record(
        values,
        Channels(
            tuple(testbed.joint_names),
            tuple(testbed.joint_units),
            tuple(testbed.appendage_names),
            np.asarray(testbed.effort_limit, dtype=np.float64),
            sensors,
        ),
        float(testbed.period),
        str(bag.path),
    )
