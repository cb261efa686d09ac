from dataclasses import replace
from pathlib import Path

import pytest

from flexslew_control.plan import Plan
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_lab.trial.trial import (
    Trial,
    bench_settings,
    build_controllers,
    plan_of_trial,
    trial_of_values,
)
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.events import Event


class _Both(MetricsObserver):
    """Measures and writes a bag of the same run."""

    def __init__(self, bench: Bench, plan: Plan | None, bag: BagObserver) -> None:
        super().__init__(bench, plan)
        self._bag = bag

    def truth(self, truth: Truth) -> None:
        super().truth(truth)
        self._bag.truth(truth)

    def event(self, event: Event) -> None:
        super().event(event)
        self._bag.event(event)


PLAN = {"method": "none", "goal": {"base_yaw": 0.2, "hub_pitch": 0.1}, "start": 1.0}
SWITCH = {
    "controllers": {"pd_feedforward": {}, "collocated_pid": {}},
    "schedule": [{"at": 7.0, "switch": "collocated_pid"}],
}


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"plan": PLAN | {"duration": 5.0}, "duration": 30.0},
        {"plan": PLAN | {"duration": 5.0}, "duration": 4.0},
        {"plan": PLAN, **SWITCH, "sensors": {"joint_velocity": {"noise": 0.01}}},
        {"plan": PLAN, "testbed": {"effort_limit": [5.0, 5.0]}, "period": 0.04},
    ],
)
def test_metrics_in_flight_are_those_of_the_bag(tmp_path: Path, values: dict[str, object]) -> None:
    trial: Trial = trial_of_values({"duration": 12.0} | values, "test")
    bench = Bench(bench_settings(trial))
    controllers = build_controllers(trial, "test")
    plan = plan_of_trial(trial)
    for controller in controllers.values():
        if plan is not None:
            assert not controller.adopt(plan)
    with BagWriter(tmp_path / "bag", {}) as writer:
        bag = BagObserver(writer)
        bag.notify(replace(trial), bench, plan, controllers)
        observer = _Both(bench, plan, bag)
        run_bench(bench, controllers, observer)
        writer.close({})
    ours, from_bag = observer.result(), metrics_of(tmp_path / "bag")
    for summed in ("rms_effort", "control_effort"):  # in blocks of another length
        assert ours.pop(summed) == pytest.approx(from_bag.pop(summed), rel=1e-12)
    assert ours == from_bag
