"""Experiments in files of other benches, whose columns are chosen by name."""

from pathlib import Path
from typing import Literal

from flexslew_lab.identification.files.columns import FileClock
from flexslew_lab.identification.identification import Experiment
from flexslew_lab.identification.records.foreign import external_record
from flexslew_lab.identification.records.hold import Hold, acts_as_held, as_band_limited
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, section


@section
class FileColumns:
    """Which columns of a file are read, and how; the options of `flexslew identify`."""

    inputs: tuple[str, ...]  # of efforts, each `column` or `column=joint`
    outputs: tuple[str, ...]  # of sensors, each `column` or `column=name`, see external_record
    period: Positive | None = None  # of the ticks [s]; null: the median of the first input's
    past: bool = False  # whether an effort is stamped when it ends, not when it begins
    # efforts between samples: held, or those of a band-limited signal; null: as the record shows
    hold: Hold | None = None
    time: str | None = None  # column of times; null: time, t or stamp
    time_unit: Literal["s", "ms", "us", "ns"] | None = None  # null: the one in its name, or seconds
    stamps: Literal["header", "recorded"] = "header"  # which times of a bag's messages count

    @property
    def clock(self) -> FileClock:
        """How times are read."""
        return FileClock(self.time, self.time_unit, None, self.stamps == "recorded")


def experiment_of_file(path: Path, columns: FileColumns) -> tuple[Experiment, tuple[str, ...]]:
    """Return what a file of measurements holds, and notes about its gaps, clocks and units.

    Args:
        path: of the file, see `files.READERS`, or the folder of a bag.
        columns: which are read.

    Raises:
        BadInput: see external_record and as_band_limited.
    """
    found = external_record(
        path, columns.inputs, columns.outputs, columns.period, columns.past, columns.clock
    )
    record, notes = found
    if columns.past and columns.hold == "band-limited":
        raise BadInput("efforts that end at their stamps are held", path, "hold", columns.hold)
    if columns.hold == "band-limited":
        return Experiment(as_band_limited(record), None, None), notes
    if columns.hold is None and not columns.past and not acts_as_held(record):
        words = (
            "efforts are read as samples of a band-limited signal, since readings depend on the "
            "effort of their own tick (hold: held reads them as held)"
        )
        return Experiment(as_band_limited(record), None, None), (*notes, words)
    return Experiment(record, None, None), notes
