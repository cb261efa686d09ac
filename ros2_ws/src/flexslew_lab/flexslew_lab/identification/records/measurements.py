"""The record of a bench of this project: its measurements, tick by tick, and their outputs."""

from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import Appendages

FIELDS = ("joint_position", "joint_velocity", "tip_deflection", "applied_effort")


class Channels(NamedTuple):
    """What the columns of measurements are of.

    Args:
        joints: names.
        units: of their positions.
        appendages: names.
        effort_limit: of the drives, (joints,) [N m or N].
        sensors: what those of the appendages measure; None: deflections.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    appendages: tuple[str, ...]
    effort_limit: Vector
    sensors: Appendages | None


def ticks_record(
    values: dict[str, Matrix], channels: Channels, period: float, source: str
) -> Record:
    """Return the record of consecutive ticks.

    The effort that was applied during a tick stands in the measurement at its end.

    Args:
        values: by field, each (ticks + 1, columns).
        channels: what the columns are of.
        period: one tick [s].
        source: for messages.

    Raises:
        BadInput: no effort moves, or the record is too short.
    """
    kept, outputs = _outputs(values, channels)
    return Record(
        period,
        values["applied_effort"][1:],
        np.hstack(kept),
        channels.joints,
        outputs,
        source,
        channels.effort_limit,
    ).active_channels()


class Listener:
    """Implements trial.in_process.Observer: keeps the measurements of a flight."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._measurements: list[Measurement] = []

    def truth(self, truth: Truth) -> None:
        """Ignore it: a lab has none."""

    def question(self, question: Measurement) -> None:
        """Keep a measurement, once."""
        if not self._measurements or question.tick != self._measurements[-1].tick:
            self._measurements.append(question)

    def answer(self, answer: Any) -> None:
        """Ignore it: the effort really applied is measured."""

    def event(self, event: Any) -> None:
        """Ignore it."""

    def record(self, source: str) -> Record:
        """Return the record of the measurements received.

        Raises:
            BadInput: if there are none, or see ticks_record.
        """
        if not self._measurements:
            raise BadInput(f"{source}: no measurements")
        model = self._bench.model
        values = {
            name: np.array([getattr(one, name) for one in self._measurements], dtype=np.float64)
            for name in FIELDS
        }
        known = Channels(
            model.joint_names,
            model.joint_units,
            model.appendages.names,
            np.asarray(self._bench.settings.testbed.effort_limit, dtype=np.float64),
            model.appendages,
        )
        return ticks_record(values, known, self._bench.settings.period, source)


def _outputs(
    values: dict[str, Matrix], channels: Channels
) -> tuple[list[Matrix], tuple[Output, ...]]:
    """Return the columns of what was measured, and what each of them is."""
    joints, units, appendages, _, sensors = channels
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
    has_deflection, has_rate = sensors.tip[k].any(), sensors.rate[k].any()
    if has_deflection and has_rate:
        return None
    return Quantity.DEFLECTION_RATE if has_rate else Quantity.DEFLECTION
