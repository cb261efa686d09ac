"""Metrics of a run, from its bag alone. Streaming: a day costs no more memory than a minute."""

from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from flexslew_lab.log.bag_layout import RUN_RECORD
from flexslew_lab.log.bag_reader import BagReader, Overview
from flexslew_lab.log.messages.logged_text import logged_yaml
from flexslew_lab.log.recorded_testbed import recorded_testbed
from flexslew_lab.metrics.epoch import Epoch
from flexslew_lab.metrics.metric import Ending, Key, Metric, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.own import keys_of, load_user_metrics
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.testbeds import Testbed

_AT_REST = 1e-4  # of the largest rate: what switch times between ticks leave of a rest, and more


def metrics_of(path: Path, trust: Trust = NO_CODE) -> dict[str, Any]:
    """Return the content of metrics.json, keys as in metrics.KEYS, from a bag.

    Metrics of the trial's own are run if they are trusted; others are left out, with a line in
    `warnings`.

    Args:
        path: the bag's folder or file.
        trust: which classes that the log names may be loaded.

    Raises:
        BadInput: if there is no bag, it is damaged or foreign, or it contains no truth.
    """
    return metrics_from(BagReader(path, trust=trust))


def metrics_from(bag: BagReader) -> dict[str, Any]:
    """Return the content of metrics.json from an open bag. See `metrics_of`.

    An open bag is measured once.
    """
    if bag not in _MEASURED:
        _MEASURED[bag] = _measured(bag)
    return dict(_MEASURED[bag])


_MEASURED: WeakKeyDictionary[BagReader, dict[str, Any]] = WeakKeyDictionary()


def _measured(bag: BagReader) -> dict[str, Any]:
    overview = bag.overview
    user_metrics, reasons = _user_metrics(bag)
    epoch: Epoch | None = None
    for block in bag.blocks(["/truth"]):
        epochs = block.columns["epoch"]
        for number in np.unique(epochs):
            part = epochs == number
            columns = {k: c[part] for k, c in block.columns.items()}
            if epoch is None or number > epoch.number:
                joints = columns["applied_effort"].shape[1]
                epoch = Epoch(int(number), _run_setup(bag, joints, int(number)), user_metrics)
            epoch.add(columns)
    if epoch is None:
        raise BadInput("holds no truth, so there is nothing to measure", bag.path)
    wall = overview.metadata.get(RUN_RECORD, {}).get("wall_time")
    checksum_warnings = (f"changes go undetected: {part}" for part in overview.without_checksum)
    ending = Ending(
        overview.events,
        [float(wall)] if wall else [],
        overview.cut is None,
        (*checksum_warnings, *reasons),
    )
    return epoch.result(ending)


def user_keys_of(bag: BagReader) -> dict[str, Key]:
    """Return what the keys of the trial's own metrics hold, of those that are trusted."""
    return keys_of(_user_metrics(bag)[0])


def joint_names_of(overview: Overview, joints: int) -> tuple[str, ...]:
    """Return the names of the joints as the bag gives them, else joint_1, joint_2, ..."""
    for source in (overview.testbed, *reversed(overview.plans)):
        if source is not None and len(source.joint_names) == joints:
            return tuple(source.joint_names)
    return tuple(f"joint_{k + 1}" for k in range(joints))


def manoeuvre_of(
    position: Matrix,
    velocity: Matrix,
    start: float,
    duration: float,
    testbed: Testbed | None = None,
) -> ReferenceManoeuvre:
    """Return what a plan's joint references, shapes (ticks + 1, joints), are measured against.

    The displacement of an attitude is its rotation, if the joints of the testbed read one.
    """
    attitude = None if testbed is None else testbed.model().attitude
    first, last = position[0], position[-1]
    displacement = last - first if attitude is None else attitude.displacement(first, last)
    has_end_rate = np.abs(velocity[-1]).max() > _AT_REST * np.abs(velocity).max()
    return ReferenceManoeuvre(
        start, start + duration, last, displacement, velocity[-1] if has_end_rate else None
    )


def _run_setup(bag: BagReader, joints: int, epoch: int) -> RunSetup:
    overview = bag.overview
    limit = np.zeros(0) if overview.testbed is None else overview.testbed.effort_limit
    testbed = recorded_testbed(overview, epoch, bag.trust)
    manoeuvre = _manoeuvre(overview, joints, testbed)
    return RunSetup(joint_names_of(overview, joints), manoeuvre, limit, testbed)


def _manoeuvre(overview: Overview, joints: int, testbed: Testbed | None) -> ReferenceManoeuvre:
    if not overview.plans:
        return ReferenceManoeuvre(0.0, 0.0, None, np.zeros(joints))
    plan = overview.plans[-1]
    position = np.asarray(plan.position, dtype=float)
    plan_joints = len(plan.joint_names)
    if plan_joints != joints or not len(position) or len(position) % joints:
        raise BadInput(
            f"the plan has {len(position)} positions for {plan_joints} joints, the truth has "
            f"{joints} joints: not one run"
        )
    velocity = np.asarray(plan.velocity, dtype=float)
    if len(velocity) != len(position):
        raise BadInput(
            f"the plan has {len(velocity)} velocities for {len(position)} positions: it is damaged"
        )
    position, velocity = position.reshape(-1, joints), velocity.reshape(-1, joints)
    return manoeuvre_of(position, velocity, plan.start, plan.duration, testbed)


def _user_metrics(bag: BagReader) -> tuple[list[type[Metric]], list[str]]:
    """Return the metrics of the trial's own, and for each that may not run the reason."""
    trial = logged_yaml(bag.metadata.get("trial", ""), f"{bag.path}: trial")
    names = trial.get("metrics") or []
    found, reasons = [], []
    for name in map(str, names if isinstance(names, list) else []):
        try:
            found += load_user_metrics([name], f"{bag.path}: trial: metrics", bag.trust)
        except BadInput as error:
            reasons.append(f"{name} is left out: {error}")
    return found, reasons
