"""The run again from nothing but its log: trial, logged plan, operator's requests, missed ticks."""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.planners.slew import software_versions
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.logged_text import logged_json
from flexslew_lab.metrics.trajectory import TrajectoryHash
from flexslew_lab.replay.coverage import missing_part
from flexslew_lab.replay.logged_code import changed_code, reading
from flexslew_lab.replay.logged_controllers import trial_of
from flexslew_lab.replay.program import (
    ProgramController,
    StartProgram,
    program_controller,
    replaced_controller,
)
from flexslew_lab.replay.resimulator import Resimulator
from flexslew_lab.trial.trial import Trial, bench_settings
from flexslew_plant.arrays import Matrix
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.message_fields import testbed_fields
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.testbeds.contract import has_own_clock

# Another processor or another build rounds differently. Of the largest magnitude of a field.
TOLERANCE = 1e-9
FIELDS = ("applied_effort", "disturbance", "position", "velocity")  # cause before effect


class Difference(NamedTuple):
    """Where the resimulation departs from the log."""

    epoch: int
    tick: int
    field: str
    recorded: float
    ours: float


class Resimulation(NamedTuple):
    """The log compared with the run again."""

    recorded_hash: str  # of the last epoch, as in metrics.json
    hash: str
    identical: bool  # every number of every epoch, to the last bit
    ticks: int  # compared, all epochs
    first_difference: Difference | None
    largest: dict[str, float]  # |difference| by field, of the field's largest magnitude [-]
    replayed: dict[str, int]  # how many requests and missed ticks were taken from the log
    other_versions: dict[str, tuple[str, str]]  # software: version of the log, version here
    missing: str  # which part of the run was compared, and why not all of it; empty: all of it
    changed_code: dict[str, tuple[str, str]]  # class: SHA-256 of its file there, here

    @property
    def within_tolerance(self) -> bool:
        """The same run but for rounding."""
        return all(value <= TOLERANCE for value in self.largest.values())


def resim(
    bag: Path,
    progress: Callable[[int, int], None] = lambda tick, last: None,
    changes: Mapping[str, Any] | None = None,
    trust: Trust = NO_CODE,
    program: StartProgram | None = None,
    controller: str = "",
) -> Resimulation:
    """Return the comparison of a log with its run flown again, in process.

    Nothing is planned again, and no wall clock decides: a tick that was missed is missed again.

    Args:
        bag: the bag's folder or file.
        progress: called with the tick and the last tick of the trial.
        changes: of the trial, by path: what would have been otherwise?
        trust: which classes the log may run.
        program: starts a program that flies in place of a controller of the log.
        controller: name of that one; empty: see program.replaced_controller.

    Raises:
        Untrusted: the log names code that is not trusted.
        BadInput: the log does not hold what determines the run.
        FlexslewError: the program has ended, or gives no answer that a bench accepts.
        RunFault: the state becomes non-finite.
    """
    reader = BagReader(bag, trust=trust)
    with reading(reader), ExitStack() as stack:
        trial = trial_of(reader, changes or {})
        if has_own_clock(trial.testbed):
            words = "its plant has a clock of its own, and a rig moves only for a trial"
            raise BadInput(f"{words}; `play` and `check` read its log", bag)
        bench, programs = Bench(bench_settings(trial)), dict[str, ProgramController]()
        stack.callback(bench.close)
        if program is not None:
            name = replaced_controller(reader, controller)
            fields = testbed_fields(bench, {"bench": bench.settings})
            programs[name] = stack.enter_context(program_controller(reader, name, program, fields))
        simulator = Resimulator(reader, trial, bench, programs)
        return _simulate_and_compare(reader, trial, simulator, progress)


def _simulate_and_compare(
    reader: BagReader,
    trial: Trial,
    simulator: Resimulator,
    progress: Callable[[int, int], None],
) -> Resimulation:
    same = _Comparison()
    recorded, computed, epoch = TrajectoryHash(), TrajectoryHash(), 0
    for block in reader.blocks(["/truth"]):
        columns = block.columns
        keys = zip(columns["epoch"].tolist(), columns["tick"].tolist(), strict=True)
        rows = [simulator.truth(key) for key in keys]
        for number in np.unique(columns["epoch"]):
            part = columns["epoch"] == number
            if number > epoch:  # metrics.json is about the last epoch
                recorded, computed, epoch = TrajectoryHash(), TrajectoryHash(), int(number)
            tick = columns["tick"][part]
            logged = {name: columns[name][part] for name in FIELDS}
            simulated = {
                name: np.array([row[name] for row, here in zip(rows, part, strict=True) if here])
                for name in FIELDS
            }
            if any(logged[name].shape != simulated[name].shape for name in FIELDS):
                raise BadInput("the truth is not of the testbed of its trial", reader.path)
            recorded.update_many(tick, logged["position"], logged["velocity"])
            computed.update_many(tick, simulated["position"], simulated["velocity"])
            same.add(int(number), tick, logged, simulated)
        progress(simulator.bench.tick, simulator.bench.last_tick or 0)
    if not same.ticks:
        raise BadInput("holds no truth, so there is nothing to compare with", reader.path)
    return Resimulation(
        recorded.hexdigest(),
        computed.hexdigest(),
        same.first is None,
        same.ticks,
        same.first,
        same.relative(),
        simulator.replayed,
        _other_versions(reader),
        missing_part(reader, trial, same.began, same.last[1], same.gaps),
        changed_code(reader),
    )


class _Comparison:
    """Differences, block after block."""

    def __init__(self) -> None:
        self.ticks, self.gaps = 0, 0
        self.began, self.last = 0, (-1, -1)  # tick; epoch and tick
        self.first: Difference | None = None
        self._largest = dict.fromkeys(FIELDS, 0.0)
        self._magnitude = dict.fromkeys(FIELDS, 0.0)

    def add(
        self, epoch: int, tick: np.ndarray, recorded: dict[str, Matrix], computed: dict[str, Matrix]
    ) -> None:
        """Take the next ticks."""
        self.ticks += len(tick)
        before = self.last[1] if epoch == self.last[0] else int(tick[0]) - 1
        if epoch > self.last[0]:
            self.began = int(tick[0])
        self.gaps += int(tick[-1]) - before - len(tick)  # truth comes once and in order
        self.last = epoch, int(tick[-1])
        found = []
        for number, name in enumerate(FIELDS):
            logged, simulated = recorded[name], computed[name]
            magnitude, difference = np.abs(logged).max(initial=0.0), np.abs(logged - simulated)
            self._magnitude[name] = max(self._magnitude[name], float(magnitude))
            self._largest[name] = max(self._largest[name], float(difference.max(initial=0.0)))
            wrong = np.argwhere(logged != simulated)
            if len(wrong):
                row, column = map(int, wrong[0])
                place = Difference(
                    epoch,
                    int(tick[row]),
                    f"{name}[{column}]",
                    float(logged[row, column]),
                    float(simulated[row, column]),
                )
                found.append((place.tick, number, place))
        if found and self.first is None:
            self.first = min(found)[2]

    def relative(self) -> dict[str, float]:
        """Return the largest differences, each of the largest magnitude of its field."""
        return {
            name: value / (self._magnitude[name] or 1.0) for name, value in self._largest.items()
        }


def _other_versions(bag: BagReader) -> dict[str, tuple[str, str]]:
    recorded = logged_json(bag.metadata.get("versions", ""), f"{bag.path}: versions")
    here = software_versions()
    names = sorted({*recorded, *here})
    return {
        name: (str(recorded.get(name, "-")), here.get(name, "-"))
        for name in names
        if recorded and recorded.get(name) != here.get(name)
    }
