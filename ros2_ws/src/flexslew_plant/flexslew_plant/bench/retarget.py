"""New targets for appendages on prescribed hinges: of the schedule, and of operators in flight."""

from collections.abc import Iterable
from typing import Any

from flexslew_plant.bench.requested_yaml import requested_yaml
from flexslew_plant.bench.schedule import Schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed, with_changes
from flexslew_plant.testbeds.contract import Retargetable


def with_target(testbed: Testbed, requested: Any, at: float, place: str) -> Testbed:
    """Return a testbed with one more turn of a hinge.

    Args:
        testbed: that stands on the bench.
        requested: `appendage`, and the keys of a motion but for `at`.
        at: when it begins [s].
        place: where the request stands, for an error.

    Raises:
        BadInput: no such appendage, a target outside of the hinge's range, or a turn before the
            last one has ended.
    """
    if not isinstance(testbed, Retargetable):
        raise BadInput(f"{testbed.kind} has no appendages that turn", place)
    if not isinstance(requested, dict):
        raise BadInput(
            "give YAML keys, for example {appendage: left, to: 0.3, duration: 2.0}", place
        )
    try:
        changes = testbed.retargeted(requested, at)
    except BadInput as error:
        raise BadInput(f"{place}.{error}") from None
    return with_changes(testbed, changes, place)


def with_schedule(testbed: Testbed, schedule: Schedule) -> Testbed:
    """Return a testbed with all turns of a schedule, which are known in advance.

    Raises:
        BadInput: see retargeted.
    """
    for i, entry in enumerate(schedule):
        if entry.retarget is not None:
            testbed = with_target(testbed, entry.retarget, entry.at, f"schedule.{i}.retarget")
    return testbed


def with_requests(testbed: Testbed, requests: Iterable[tuple[str, float]]) -> Testbed:
    """Return a testbed with the turns that operators have requested in flight.

    Args:
        testbed: testbed with the turns of its schedule.
        requests: the texts, YAML, and when each begins [s], in the order of the requests.

    Raises:
        BadInput: see retargeted.
    """
    for text, at in requests:
        testbed = with_target(testbed, requested_target(text), at, "target")
    return testbed


def requested_target(text: str) -> Any:
    """Return the request of an operator; BadInput: see requested_yaml."""
    return requested_yaml(text, "target")
