"""Runs in, a model with its bounds out."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_control.law import plant_description
from flexslew_control.message_fields import plan_of
from flexslew_control.plan import Plan
from flexslew_control.planners.excitation.excitation import EXCITATION
from flexslew_lab.identification.modal.modal_fit import prediction_error, refined
from flexslew_lab.identification.modal.modes import ModalModel, identify_modes
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.model_file import testbed_of
from flexslew_lab.identification.physical_fit import PhysicalFit, fit_parameters
from flexslew_lab.identification.records.from_bag import bag_of, record_of
from flexslew_lab.identification.records.record import Record
from flexslew_lab.identification.responses.frequency_response import (
    FrequencyResponse,
    frequency_response,
)
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.short_values import short
from flexslew_lab.trial.overrides import override_values
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import Testbed, initial_positions, read_testbed, with_changes

_BELOW, _ABOVE = 0.4, 2.5  # band of a slew, in parts of the modes that its plan believed

ProgressCallback = Callable[[str], None]


@dataclass(frozen=True)
class Validation:
    """How the model explains a run that it was not made from.

    Args:
        source: the run.
        outputs: names.
        explained: part of each output's variance, 1 is all of it, (outputs,) [-].
        over_noise: residual relative to the noise that was identified, (outputs,) [-].
    """

    source: str
    outputs: tuple[str, ...]
    explained: Vector
    over_noise: Vector


@dataclass(frozen=True, repr=False)
class Identification:
    """All results of the identification from some runs.

    Args:
        model: modes and inertias of the first run.
        response: frequency responses of all runs with the same multisine; None: see
            `without_response`.
        without_response: why there are no frequency responses.
        physical: parameters that were fitted; None: none were requested.
        validation: validation on every further run.
    """

    model: ModalModel
    response: FrequencyResponse | None
    without_response: str
    physical: PhysicalFit | None
    validation: tuple[Validation, ...]

    def __repr__(self) -> str:
        """Return one line: how many modes, where."""
        modes = ", ".join(f"{mode.frequency.value:.4g}" for mode in self.model.modes)
        return f"<Identification of {self.model.record.source}: modes at {modes or 'none'} rad/s>"

    def _repr_html_(self) -> str:
        """Return what was found and its 95 % interval, for notebooks."""
        found = [
            (f"mode {k}, {name}", interval)
            for k, mode in enumerate(self.model.modes, 1)
            for name, interval in (
                ("frequency [rad/s]", mode.frequency),
                ("damping ratio", mode.damping_ratio),
            )
        ]
        if self.physical is not None:
            found += [(p.key, p.value) for p in self.physical.parameters]
        rows = ((name, short(i.value), f"{short(i.low)} to {short(i.high)}") for name, i in found)
        return in_notebook(repr(self), ("", "estimate", "interval"), rows)

    @property
    def model_section(self) -> dict[str, Any]:
        """What `plan.model` and a law's `model` believe: the keys of a testbed.

        Raises:
            BadInput: see testbed_of.
        """
        return plain(testbed_of(self.model)) if self.physical is None else self.physical.changes

    def plain(self) -> dict[str, Any]:
        """Return the numbers as JSON holds them."""
        model = self.model
        physical = self.physical
        return {
            "source": model.record.source,
            "duration": model.record.duration,
            "band": list(model.band),
            "modes": [
                {
                    "frequency": asdict(mode.frequency),
                    "damping_ratio": asdict(mode.damping_ratio),
                    "periods": mode.periods,
                    "participation": dict(
                        zip(model.record.inputs, mode.participation.tolist(), strict=True)
                    ),
                    "shape": mode.shape.tolist(),
                }
                for mode in model.modes
            ],
            "inertia": [[asdict(entry) for entry in row] for row in model.inertia],
            "noise": dict(
                zip((o.name for o in model.record.outputs), model.fit.noise.tolist(), strict=True)
            ),
            "white": {w.output: w.white for w in model.whiteness},
            "frequency_response": None
            if self.response is None
            else {
                "lines": len(self.response.frequency),
                "periods": self.response.periods,
                "least_coherence": float(self.response.coherence.min()),
            },
            "parameters": None
            if physical is None
            else {p.key: asdict(p.value) for p in physical.parameters},
            "warnings": [*model.doubts, *(() if physical is None else physical.warnings)],
            "validation": [
                {
                    "source": v.source,
                    "explained": dict(zip(v.outputs, v.explained.tolist(), strict=True)),
                    "over_noise": dict(zip(v.outputs, v.over_noise.tolist(), strict=True)),
                }
                for v in self.validation
            ],
        }


@dataclass(frozen=True)
class Experiment:
    """A run, as far as identification needs it."""

    record: Record
    plan: Plan | None  # that shook it
    testbed: Testbed | None  # that stood on the bench, from its log
    flown: Plan | None = None  # the last plan of any method


def experiment_of(run: Path, trust: Trust = NO_CODE) -> Experiment:
    """Return what a run of this bench holds: measurements, plan and the testbed believed.

    Args:
        run: its folder, or a bag.
        trust: which class of the user's own its testbed may be.

    Raises:
        BadInput: there is no bag, or it is damaged.
    """
    bag = bag_of(run)
    testbed = _testbed(bag, trust)
    record = record_of(bag, testbed.model().appendages if testbed is not None else None)
    plans = [plan_of(message, f"{bag.path}: plan") for message in bag.overview.plans]
    test_inputs = [plan for plan in plans if plan.method == EXCITATION.name]
    last = plans[-1] if plans else None
    return Experiment(record, test_inputs[-1] if test_inputs else None, testbed, last)


def _testbed(bag: BagReader, trust: Trust) -> Testbed | None:
    message = bag.overview.testbed
    if message is None:
        return None
    try:
        return plant_description(message.settings, f"{bag.path}: /testbed", trust).testbed
    except BadInput:  # one's own class that this reader does not trust: modes need none
        return None


def identify(
    experiments: list[Experiment],
    band: tuple[float, float] | None = None,
    fit: tuple[str, ...] = (),
    start: dict[str, float] | None = None,
    progress: ProgressCallback | None = None,
) -> Identification:
    """Return the responses of all runs and a model of the first, validated on the others.

    Args:
        experiments: at least one.
        band: band that was shaken [rad/s]; None: the plan's, or where the efforts have their power;
            of a slew, around the modes of its plan's model.
        fit: paths of numbers in the testbed's section to fit.
        start: first values of some of them.
        progress: called with words on each step of the work.

    Raises:
        BadInput: if an experiment cannot be used; the message gives the reason and the numbers.
    """
    first = experiments[0]
    if band is None:
        band = band_of(first.plan or first.flown, first.record.source)
    model = identify_modes(first.record, band, progress)
    response, why = _response(experiments)
    return Identification(
        model,
        response,
        why,
        _physical(first, model, fit, start or {}, progress) if fit else None,
        tuple(validated_on(model, other.record) for other in experiments[1:]),
    )


def band_of(plan: Plan | None, source: str) -> tuple[float, float] | None:
    """Return the band that a plan shook, or around the modes of its model; None: not known."""
    if plan is not None and plan.method == EXCITATION.name:
        low, high = plan.summary["band"]
        return float(low), float(high)
    model_section = plan.request.get("model") if plan is not None else None
    if not isinstance(model_section, dict) or "kind" not in model_section:
        return None
    testbed = read_testbed(model_section, f"{source}: plan")
    model = testbed.model()
    frequencies = model.linearise(model.rest(initial_positions(testbed))).frequencies
    if not frequencies.size:
        return None
    return _BELOW * float(frequencies[0]), _ABOVE * float(frequencies[-1])


def _response(experiments: list[Experiment]) -> tuple[FrequencyResponse | None, str]:
    plans = [e.plan for e in experiments if e.plan is not None]
    if len(plans) < len(experiments):
        return None, "no plan of method excitation in the log contains what was added"
    try:
        return frequency_response([e.record for e in experiments], plans), ""
    except BadInput as error:
        return None, str(error)


def _physical(
    first: Experiment,
    model: ModalModel,
    fit: tuple[str, ...],
    start: dict[str, float],
    progress: ProgressCallback | None,
) -> PhysicalFit:
    if first.testbed is None:
        raise BadInput(f"{first.record.source}: --fit needs the testbed, which this log lacks")
    testbed = (
        with_changes(first.testbed, override_values({}, start), "--start")
        if start
        else first.testbed
    )
    return fit_parameters(model, testbed, fit, progress)


def validated_on(model: ModalModel, record: Record) -> Validation:
    """Return how the modes of one record explain another.

    Frequencies, damping ratios and residues stay; bias and the motion before the record are the new
    record's own.

    Raises:
        BadInput: it has other inputs or outputs.
    """
    model_record = model.record
    if (record.inputs, record.outputs) != (model_record.inputs, model_record.outputs):
        raise BadInput(f"{record.source}: has not the inputs and outputs of {model_record.source}")
    if record.pieces is not None:  # its unknown efforts are its own, too
        solution, _ = refined(RegressorSignals(record, None), model.fit.modes, model.fit.noise)
        record = solution.problem.record
    spread = record.deviation(record.measured)
    size = record.deviation(prediction_error(record, model.fit))
    return Validation(
        record.source,
        tuple(o.name for o in record.outputs),
        1.0 - (size / np.where(spread > 0.0, spread, 1.0)) ** 2,
        size / model.fit.noise,
    )
