"""Every fault of the table keeps the contract: a new one cannot escape."""

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from flexslew_plant.errors import BadInput
from flexslew_plant.faults import FAULTS, FaultSettings, Names, Timed, check_fault
from flexslew_plant.faults.injection import Faults
from flexslew_plant.hardware.sensors import Readings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.settings import plain, validated

NAMES = Names(("left", "right"), ("boom",), (150.0, 20.0))
EXAMPLES = {"joint": "right", "channel": "joint_position", "of": "left", "controller": "first"}


def example(kind: Any) -> Any:
    entry = FAULTS[kind]
    keys = TypeAdapter(entry.settings).json_schema()["properties"]
    values = {**entry.example, **{key: EXAMPLES[key] for key in keys if key in EXAMPLES}}
    return validated(FaultSettings, {"kind": kind, **values}, "here")


def observed(kind: Any, ticks: int = 12, start: int = 3, end: int = 7) -> Any:
    """Return what passes a fault at every tick: readings, fate, demand, effort, late answers."""
    faults = Faults(NAMES, 1, 0, (Timed(example(kind), start, end),))
    rng, seen = np.random.default_rng(5), []
    demand = effort = np.zeros(2)
    for tick in range(ticks):
        faults.begin(tick, demand, effort)
        early = faults.late_commands(first=True)
        values = rng.standard_normal((4, 2))
        readings = Readings(values[0], values[1], values[2, :1], values[3, :1])
        command = EffortCommand(tick, 0, "first", values[0].copy())
        fate = faults.command_status(command)
        late = [*early, *faults.late_commands(first=False)]
        read, demand = faults.read(readings), faults.demand(values[1])
        effort = faults.effort(demand)
        whole = all(np.array_equal(a, b) for a, b in zip(read, readings, strict=True))
        untouched = whole and fate.value == "arrives" and np.array_equal(effort, values[1])
        assert all(a.shape == b.shape for a, b in zip(read, readings, strict=True))
        assert demand.shape == effort.shape == (2,)
        assert untouched or faults.at_work  # else the bench does not ask
        seen.append((untouched, len(late), [np.nan_to_num(part).tobytes() for part in read],
                     fate, effort.tobytes()))  # fmt: skip
    return seen


every_fault = pytest.mark.parametrize("kind", FAULTS)


@every_fault
def test_a_fault_acts_between_its_ticks_and_leaves_nothing_behind(kind: Any) -> None:
    seen = observed(kind)
    assert all(untouched for untouched, *_ in seen[:3])
    assert all(untouched for untouched, *_ in seen[7:])
    touched = any(not untouched for untouched, *_ in seen[3:7])
    assert touched or sum(late for _, late, *_ in seen) > 0


@every_fault
def test_the_same_seed_gives_the_same_fault(kind: Any) -> None:
    assert observed(kind) == observed(kind)


@every_fault
def test_a_section_survives_being_written_out_and_its_kind_is_its_name(kind: Any) -> None:
    fault = example(kind)
    assert fault.kind == kind
    assert validated(FaultSettings, plain(fault), "again") == fault
    assert FAULTS[kind].settings.__doc__


@every_fault
def test_a_name_that_the_testbed_lacks_is_refused_with_the_known_ones(kind: Any) -> None:
    fault = example(kind)
    check_fault(fault, NAMES, "schedule.0.fault")
    if fault.subject(NAMES) is not None:
        with pytest.raises(BadInput, match=r"schedule\.0\.fault\.\w+: the testbed has no \w+; all"):
            check_fault(fault, Names(("other",), (), (1.0,)), "schedule.0.fault")


def test_a_thruster_is_not_stuck_the_way_that_it_does_not_push() -> None:
    names = NAMES._replace(one_way=(1,))
    stuck = {"kind": "actuator_stuck", "joint": "right"}
    check_fault(validated(FaultSettings, {**stuck, "effort": 5.0}, "test"), names, "fault")
    with pytest.raises(BadInput, match=r"fault\.effort: -5\.0 .* right is a thruster"):
        check_fault(validated(FaultSettings, {**stuck, "effort": -5.0}, "test"), names, "fault")
    check_fault(validated(FaultSettings, {**stuck, "effort": -5.0}, "test"), NAMES, "fault")
