"""The record of a run: what its sensors said and the efforts applied, never its truth."""

from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.identification.record import Output, Quantity, Record
from flexslew_lab.log.bag_reader import BagReader
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Appendages

_TOPIC = "/measurement"
_FIELDS = ("joint_position", "joint_velocity", "tip_deflection", "applied_effort")


def bag_of(run: Path) -> BagReader:
    """Return the bag of a run's folder, of a bag's folder, or of an .mcap file.

    Raises:
        BadInput: there is none.
    """
    return BagReader(run / "bag" if (run / "bag").is_dir() else run)


def record_of(bag: BagReader, sensors: Appendages | None = None) -> Record:
    """Return the measurements of a bag's last epoch with the efforts between them.

    The effort that was applied during a tick stands in the measurement at its end.

    Args:
        bag: of a bench of this project.
        sensors: what those of the appendages measure; None: deflections.

    Raises:
        BadInput: the bag is damaged, holds no measurements, or a tick is missing.
    """
    parts: dict[str, list[Any]] = {name: [] for name in ("tick", "epoch", *_FIELDS)}
    for block in bag.blocks([_TOPIC]):
        for name, found in parts.items():
            found.append(np.asarray(block.columns[name]))
    if not parts["tick"]:
        raise BadInput(f"{bag.path}: holds no measurements")
    testbed = bag.overview.testbed
    if testbed is None:
        raise BadInput(f"{bag.path}: does not say what stands on the bench (/testbed)")
    columns = {name: np.concatenate(found) for name, found in parts.items()}
    last = columns["epoch"] == columns["epoch"][-1]
    ticks, first = np.unique(columns["tick"][last].astype(np.int64), return_index=True)
    gaps = np.flatnonzero(np.diff(ticks) != 1)
    if gaps.size:
        raise BadInput(
            f"{bag.path}: no measurement of tick {ticks[gaps[0]] + 1}: an experiment needs all"
        )
    values = {name: np.asarray(columns[name][last][first], dtype=np.float64) for name in _FIELDS}
    joints, units = tuple(testbed.joint_names), tuple(testbed.joint_units)
    kept, outputs = _outputs(values, joints, units, tuple(testbed.appendage_names), sensors)
    return Record(
        float(testbed.period),
        values["applied_effort"][1:],
        np.hstack(kept),
        joints,
        outputs,
        str(bag.path),
        np.asarray(testbed.effort_limit, dtype=np.float64),
    ).moved()


def _outputs(
    values: dict[str, Matrix],
    joints: tuple[str, ...],
    units: tuple[str, ...],
    appendages: tuple[str, ...],
    sensors: Appendages | None,
) -> tuple[list[Matrix], tuple[Output, ...]]:
    """Return the columns of what was measured, and what each of them is."""
    outputs: list[Output] = []
    for k, joint in enumerate(joints):
        outputs.append(Output(f"position.{joint}", units[k], Quantity.JOINT_POSITION, joint))
    for k, joint in enumerate(joints):
        outputs.append(Output(f"rate.{joint}", f"{units[k]}/s", Quantity.JOINT_RATE, joint))
    tips, kept = values["tip_deflection"], []
    for k in range(tips.shape[1]):
        quantity = _quantity(sensors, k)
        if quantity is None:  # an accelerometer, or a mixture
            continue
        name = appendages[k] if k < len(appendages) else f"appendage_{k + 1}"
        unit = "m/s" if quantity is Quantity.DEFLECTION_RATE else "m"
        outputs.append(Output(f"tip.{name}", unit, quantity))
        kept.append(tips[:, k])
    columns = [values["joint_position"], values["joint_velocity"]]
    return columns + [np.column_stack(kept)] * bool(kept), tuple(outputs)


def _quantity(sensors: Appendages | None, k: int) -> Quantity | None:
    """Return what a sensor of an appendage measures; None: neither deflection nor its rate."""
    if sensors is None or sensors.rate is None:
        return Quantity.DEFLECTION
    bends, moves = sensors.tip[k].any(), sensors.rate[k].any()
    if bends and moves:
        return None
    return Quantity.DEFLECTION_RATE if moves else Quantity.DEFLECTION
