"""What every record of a log must look like, checked when it is read: a bag may be crafted."""

from functools import lru_cache
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, section, validated

JOINTS, MODES = 64, 256  # at most, on any testbed

Count = Annotated[int, Field(ge=0, lt=1 << 63)]
Seconds = Annotated[float, Field(ge=0.0, le=1e12)]
Period = Annotated[float, Field(ge=1e-6, le=1e6)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=1 << 16)]
Sizes = dict[str, tuple[int, ...]]  # of the arrays of a message, by field
Names = Annotated[tuple[Text, ...], Field(max_length=JOINTS)]


@lru_cache(maxsize=64)  # a controller repeats itself
def _yaml(text: str) -> str:
    try:
        logged_yaml(text, "the text")
    except BadInput as error:
        raise ValueError(str(error)) from None  # the schema adds the source of the text
    return text


@section
class TestbedRecord:
    """flexslew_msgs/Testbed."""

    kind: Text
    joint_names: Names
    joint_units: Names
    appendage_names: Names
    modes: Annotated[int, Field(ge=0, le=MODES)]
    period: Period
    effort_limit: Annotated[tuple[NonNegative, ...], Field(max_length=JOINTS)]


@section
class StatusRecord:
    """flexslew_msgs/ControllerStatus."""

    controller: Text
    law: Text
    last_tick: Count
    settings: Annotated[str, AfterValidator(_yaml)]


@section
class PlanRecord:
    """flexslew_msgs/Plan but for its arrays."""

    method: Text
    joint_names: Names
    start: Annotated[float, Field(ge=-1e12, le=1e12)]
    duration: Seconds
    period: Period
    request: Annotated[str, AfterValidator(_yaml)]
    summary: Annotated[str, AfterValidator(_yaml)]
    versions: Annotated[str, AfterValidator(_yaml)]


@section
class RunRecord:
    """The metadata record of a run's end, as far as a number is read from it."""

    wall_time: Seconds | None = None


RECORDS: dict[str, type[Any]] = {
    "/testbed": TestbedRecord,
    "/controller_status": StatusRecord,
    "/plan": PlanRecord,
}
_PLAN_ARRAYS = ("position", "velocity", "effort", "state")


def check_record(topic: str, message: Any, source: str) -> None:
    """Check a decoded message of a latched topic.

    Raises:
        BadInput: if a field is not as the bench publishes it.
    """
    kind = RECORDS[topic]
    where = f"{source}: {topic}"
    given = {name: _plain(getattr(message, name)) for name in kind.__dataclass_fields__}
    record = validated(kind, given, where)
    if topic == "/testbed":
        joints = len(record.joint_names)
        if not joints == len(record.joint_units) == len(record.effort_limit) > 0:
            raise BadInput("names, units and effort limits are not one per joint", where)
    elif topic == "/plan":
        for name in _PLAN_ARRAYS:
            if not np.isfinite(getattr(message, name)).all():
                raise BadInput(f"{name}: a number is not finite", where)


def new_yaml(message: Any, before: Any = None) -> list[str]:
    """Return the YAML texts of a message of a latched topic that the one before had not."""
    names = ("settings",) if hasattr(message, "controller") else ("request", "summary", "versions")
    values = [getattr(message, name, "") for name in names]
    return [
        text for name, text in zip(names, values, strict=True) if text != getattr(before, name, "")
    ]


def check_truth(columns: dict[str, Any], source: str, before: Sizes) -> Sizes:
    """Check ticks of the truth, which is finite and of one shape for all sensor readings.

    Args:
        columns: a block of /truth by field.
        source: the log, for the error.
        before: sizes of its arrays in an earlier block; empty: this is the first one.

    Returns:
        the sizes of its arrays.

    Raises:
        BadInput: a number is not finite, positions and velocities do not fit together, or the
            sizes are not those before.
    """
    position, velocity = columns["position"], columns["velocity"]
    joints = columns["applied_effort"].shape[1]
    extra = position.shape[1] - velocity.shape[1]  # one where q holds a quaternion
    shapes = len(position) == len(velocity) and columns["disturbance"].shape[1] == joints
    if not (shapes and extra in (0, 1) and joints > 0):
        raise BadInput("/truth: the lengths of its fields contradict each other", source)
    for name, column in columns.items():
        if column.dtype.kind != "f":
            continue
        bad = ~np.isfinite(column.reshape(len(column), -1)).all(axis=1)
        if bad.any():
            tick = columns["tick"][int(np.argmax(bad))]
            raise BadInput(f"/truth: {name} is not finite at tick {tick}", source)
    sizes = {name: column.shape[1:] for name, column in columns.items()}
    if before and sizes != before:
        tick = columns["tick"][0]
        raise BadInput(f"/truth: tick {tick} has arrays of other sizes than those before", source)
    return sizes


def check_one_run(columns: dict[str, Any], source: str, before: tuple[int, int]) -> tuple[int, int]:
    """Check that ticks follow those before: a recorder that outlives its plant stores the next.

    Args:
        columns: a block of /truth by field.
        source: the log, for the error.
        before: epoch and tick of the last one in an earlier block; (0, -1): this is the first one.

    Returns:
        epoch and tick of the last one.

    Raises:
        BadInput: the log goes on with another run.
    """
    epochs, ticks = columns["epoch"].astype(np.int64), columns["tick"].astype(np.int64)
    epoch, tick = np.diff(epochs, prepend=before[0]), np.diff(ticks, prepend=before[1])
    is_backward = (epoch < 0) | ((epoch == 0) & (tick < 0))
    if is_backward.any():
        k = int(np.argmax(is_backward))
        raise BadInput(multiple_runs_message(int(epochs[k]), int(ticks[k])), source)
    return int(epochs[-1]), int(ticks[-1])


def multiple_runs_message(epoch: int, tick: int) -> str:
    """Return what is wrong with a log that goes back to a tick of an epoch."""
    return (
        f"goes back to tick {tick} of epoch {epoch}: it holds more than one run; record each into "
        "a folder of its own"
    )


def check_run_record(data: dict[str, str], source: str) -> None:
    """Check the metadata record of a run's end.

    Raises:
        BadInput: a number in it is none.
    """
    given = {k: v for k, v in data.items() if k in RunRecord.__dataclass_fields__}
    validated(RunRecord, given, f"{source}: end of the run")


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value
