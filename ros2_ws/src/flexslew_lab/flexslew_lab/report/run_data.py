"""What a report shows of one run, thinned for the eye; a day costs no more memory than a minute."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.log.joints_flown import estimate_errors, estimated_joints, joints_and_modes
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.log.recorded_testbed import recorded_testbed
from flexslew_lab.metrics import Key
from flexslew_lab.metrics.from_bag import joint_names_of, metrics_from, user_keys_of
from flexslew_lab.report.matching import Waiting, keys_of
from flexslew_lab.report.spans import Span, spans_of
from flexslew_lab.report.thinning import MinMaxSampler, Trace
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Model, Testbed, read_testbed
from flexslew_plant.testbeds.contract import Pointing

INTERVALS = 800  # of which each keeps its smallest and its largest value
FRAMES = 500  # of the animation


class Phase(NamedTuple):
    """The active controller and the times of its phase."""

    start: float  # [s]
    end: float  # [s]
    controller: str  # empty: the drive's brake


class RunData(NamedTuple):
    """One run as figures need it."""

    label: str
    path: Path
    trial: dict[str, Any]
    overview: Overview
    metrics: dict[str, Any]
    user_keys: dict[str, Key]  # what those of the trial's own metrics hold
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    appendage_names: tuple[str, ...]
    goal: dict[str, float]  # by joint [rad or m]; empty without a plan
    spans: tuple[Span, ...]  # faults and disturbances
    traces: dict[str, Trace]  # position, tip, effort, disturbance, reference, feedforward, ...
    terms: dict[str, Trace]  # summands of the effort by name
    phases: tuple[Phase, ...]
    frame_time: Vector  # of the animation, (frames,) [s]
    frame_position: Matrix  # joints and modes, (frames, n)
    frame_reference: Matrix  # of the joints, as thinly, (answers, joints)
    testbed: Testbed | None  # with all its turns; None: it cannot be read

    @property
    def units(self) -> dict[str, str]:
        """Those of the joints by name, rad or m."""
        return dict(zip(self.joint_names, self.joint_units, strict=True))


def read_run(path: Path | BagReader) -> RunData:
    """Return what a report shows of the bag at `path`.

    Args:
        path: the bag's folder or file, or the open bag.

    Raises:
        BadInput: the bag cannot be read, or holds no truth.

    """
    bag = path if isinstance(path, BagReader) else BagReader(path)
    overview = bag.overview
    metrics = metrics_from(bag)
    trial = logged_yaml(bag.trial_text, f"{bag.path}: trial")
    testbed = overview.testbed
    last_testbed = _testbed(trial, bag)
    collector = _Collector(
        overview.counts,
        len(testbed.joint_names) if testbed is not None else None,
        _model(last_testbed),
        last_testbed if isinstance(last_testbed, Pointing) else None,
    )
    for block in bag.blocks(["/truth", "/controller_state", "/measurement"]):
        collector.take(block.topic, block.columns)
    traces = {name: sampler.trace() for name, sampler in collector.sampler_by_name.items()}
    joints = collector.joints or 0
    names = joint_names_of(overview, joints)
    known = testbed is not None and len(testbed.joint_units) == joints
    tips = traces["tip"].value.shape[1] if "tip" in traces else 0
    end = float(np.nanmax(traces["effort"].time, initial=0.0))
    return RunData(
        str(trial.get("name", "")) or bag.path.parent.name,
        bag.path,
        trial,
        overview,
        metrics,
        user_keys_of(bag),
        names,
        tuple(testbed.joint_units) if known else ("rad",) * joints,
        appendage_names_of(overview, tips),
        _goal(overview),
        tuple(spans_of(overview, end)),
        traces,
        {name: sampler.trace() for name, sampler in collector.terms.items()},
        tuple(collector.phases),
        np.array(collector.frame_time),
        np.array(collector.frame_position),
        np.array([one for one in collector.frame_reference if len(one) == joints]),
        last_testbed,
    )


def appendage_names_of(overview: Overview, count: int) -> tuple[str, ...]:
    """Return the names of the appendages as the bag gives them, else appendage_1, ..."""
    testbed = overview.testbed
    if testbed is not None and len(testbed.appendage_names) == count:
        return tuple(testbed.appendage_names)
    return tuple(f"appendage_{k + 1}" for k in range(count))


def _testbed(trial: Mapping[str, Any], bag: BagReader) -> Testbed | None:
    """Return the last testbed of the flight, with the turns that operators requested."""
    epoch = max((e.epoch for e in bag.overview.events), default=0)
    known = recorded_testbed(bag.overview, epoch, bag.trust)
    if known is not None or "testbed" not in trial:
        return known
    try:
        return read_testbed(trial["testbed"], str(bag.path), bag.trust)
    except BadInput:
        return None


def _model(last_testbed: Testbed | None) -> Model | None:
    try:
        return None if last_testbed is None else last_testbed.model()
    except BadInput:
        return None


def _goal(overview: Overview) -> dict[str, float]:
    """Return where the last plan ends, by joint."""
    if not overview.plans:
        return {}
    plan = overview.plans[-1]
    position = np.asarray(plan.position, dtype=float).reshape(-1, max(len(plan.joint_names), 1))
    return dict(zip(plan.joint_names, position[-1].tolist(), strict=True))


class _Collector:
    """Takes blocks in the order of the bag; joins estimate and truth by epoch and tick."""

    def __init__(
        self,
        counts: Mapping[str, int],
        joints: int | None,
        model: Model | None = None,
        pointing: Pointing | None = None,
    ) -> None:
        self._pointing = pointing  # testbed with the wheels to show
        self.joints = joints  # None: as many as efforts
        self._model = model  # None: the joints are the first entries of the state
        ticks = counts.get("/truth", 0)
        self._size = -(-ticks // INTERVALS) if ticks > 2 * INTERVALS else 1
        self._frame_step = max(-(-ticks // FRAMES), 1)
        self._seen = self._state_count = 0
        self.sampler_by_name: dict[str, MinMaxSampler] = {}
        self.terms: dict[str, MinMaxSampler] = {}
        self._term_names: tuple[str, ...] = ()
        self.phases: list[Phase] = []
        self.frame_time: list[float] = []
        self.frame_position: list[Vector] = []
        self.frame_reference: list[Vector] = []
        self._truth, self._estimate = Waiting(), Waiting()

    def take(self, topic: str, columns: Mapping[str, Any]) -> None:
        time = columns["header.stamp.sec"] + columns["header.stamp.nanosec"] * 1e-9
        if topic == "/truth":
            self._take_truth(time, columns)
        elif topic == "/measurement":
            self._take_measurement(time, columns["controller"])
        else:
            self._take_state(time, columns)

    def _put(self, name: str, time: Vector, value: Matrix) -> None:
        if value.shape[1]:
            self.sampler_by_name.setdefault(name, MinMaxSampler(self._size)).add(time, value)

    def _take_truth(self, time: Vector, columns: Mapping[str, Any]) -> None:
        efforts = columns["applied_effort"].shape[1]
        position, _ = joints_and_modes(self._model, columns["position"], columns["velocity"])
        if self.joints is None or self.joints > position.shape[1]:
            self.joints = efforts
        joints = self.joints
        self._put("position", time, position[:, :joints])
        self._put("modes", time, position[:, joints:])
        self._put("tip", time, columns["tip_deflection"])
        self._put("effort", time, columns["applied_effort"])
        self._put("disturbance", time, columns["disturbance"])
        self._put("energy", time, columns["energy"][:, None])
        rates = columns["velocity"]
        model = self._model
        if self._pointing is not None and model and rates.shape[1] == model.coordinates:
            wheel_state = self._pointing.spins(rates)
            for name, found in (
                ("wheel_speed", wheel_state.speeds),
                ("gimbal_angle", wheel_state.gimbals),
            ):
                if found:
                    self._put(name, time, np.column_stack([*found.values()]))
            if wheel_state.speeds or wheel_state.gimbals:
                self._put("stored_momentum", time, wheel_state.stored)
        self._truth.add(keys_of(columns), position)
        self._join()
        rows = np.arange(-self._seen % self._frame_step, len(time), self._frame_step)
        self._seen += len(time)
        self.frame_time.extend(time[rows].tolist())
        self.frame_position.extend(columns["position"][rows])

    def _take_measurement(self, time: Vector, names: NDArray[np.str_]) -> None:
        name, start, end = str(names[0]), float(time[0]), float(time[-1])
        if self.phases and self.phases[-1].controller == name:
            self.phases[-1] = self.phases[-1]._replace(end=end)
            return
        if self.phases:
            self.phases[-1] = self.phases[-1]._replace(end=start)
        self.phases.append(Phase(start, end, name))

    def _take_state(self, time: Vector, columns: Mapping[str, Any]) -> None:
        self._put("reference", time, columns["reference_position"])
        self._put("feedforward", time, columns["feedforward"])
        self._put("demand", time, columns["effort"])
        rows = np.arange(-self._state_count % self._frame_step, len(time), self._frame_step)
        self._state_count += len(time)
        self.frame_reference.extend(columns["reference_position"][rows])
        pair = columns["estimate_position"], columns["reference_position"]
        estimate = estimated_joints(self._model, *pair)
        self._estimate.add(keys_of(columns), np.column_stack((time, estimate)))
        self._join()
        names = tuple(columns["term_names"][0])
        if names != self._term_names:
            for name in self._term_names:
                self.terms[name].gap()
            self._term_names = names
        joints = columns["effort"].shape[1]
        values = columns["terms"]
        if values.shape[1] == joints * len(names):
            for k, name in enumerate(names):
                part = values[:, k * joints : (k + 1) * joints]
                self.terms.setdefault(name, MinMaxSampler(self._size)).add(time, part)

    def _join(self) -> None:
        """Put estimate minus truth where both are known; the rest waits for its counterpart."""
        for estimate, truth in self._estimate.matched(self._truth):
            error = estimate_errors(self._model, estimate[:, 1:], truth)
            self._put("estimate_error", estimate[:, 0], error)
