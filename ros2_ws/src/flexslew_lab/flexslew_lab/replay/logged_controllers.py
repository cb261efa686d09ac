"""The controllers of a log, built again, and the plans that they followed from which tick on."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_control.plan import Plan
from flexslew_control.plan_file import plan_hash
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.cdr import decode
from flexslew_lab.trial.overrides import overridden
from flexslew_lab.trial.trial import Trial, law_of, plant_of, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import load_yaml

Key = tuple[int, int]  # epoch and tick


class Adoption(NamedTuple):
    """A controller took a plan."""

    controller: str
    seen: Key  # the last tick that it had seen by then; (0, -1): none
    plan: Plan


def trial_of(bag: BagReader, changes: Mapping[str, Any] | None = None) -> Trial:
    """Return the trial that a bag was recorded from.

    Args:
        bag: to read.
        changes: by path, instead of what the trial says.

    Raises:
        BadInput: the bag holds none, or none that this version reads.
    """
    if not bag.trial_text:
        raise BadInput(f"{bag.path}: holds no trial")
    source = f"{bag.path}: trial"
    values = load_yaml(bag.trial_text, source)
    if changes and isinstance(values, dict):
        values = overridden(values, dict(changes))
    return trial_of_values(values, source)


def plan_of_log(message: Any, source: str) -> Plan:
    """Return a decoded flexslew_msgs/msg/Plan as a plan.

    Raises:
        BadInput: its content does not have its hash.
    """
    joints = len(message.joint_names)
    ticks = len(message.effort) // max(joints, 1)

    def rows(name: str, count: int) -> Any:
        return np.asarray(getattr(message, name)).reshape(count, -1)

    def text(name: str) -> Any:
        return load_yaml(getattr(message, name), f"{source}: the plan is damaged: {name}") or {}

    try:
        plan = Plan(
            method=message.method,
            joint_names=tuple(message.joint_names),
            start=float(message.start),
            period=float(message.period),
            position=rows("position", ticks + 1),
            velocity=rows("velocity", ticks + 1),
            effort=rows("effort", ticks),
            state=rows("state", ticks + 1),
            duration=float(message.duration),
            request=text("request"),
            summary=text("summary"),
            versions=text("versions"),
        )
    except ValueError as error:
        raise BadInput(f"{source}: the plan is damaged: {error}") from None
    if plan_hash(plan) != message.hash:
        raise BadInput(f"{source}: the plan is damaged: its content does not have its hash")
    return plan


class Crew:
    """Controllers as a log names them, each at its state before tick 0.

    Args:
        bag: to take them from.
        only: the names that are needed; none: all of the trial and of the log.
        replaced: laws and settings by name that stand in for those of the log.
        trial: that stands in for the log's.

    Raises:
        BadInput: the log does not say what is needed, or a law cannot be built.
    """

    def __init__(
        self,
        bag: BagReader,
        only: str | None = None,
        replaced: Mapping[str, tuple[str, dict[str, Any]]] | None = None,
        trial: Trial | None = None,
    ) -> None:
        overview = bag.overview
        testbed = overview.testbed
        if testbed is None:
            raise BadInput(f"{bag.path}: does not say what stood on the bench (no /testbed)")
        laws = logged_laws(bag) | dict(replaced or {})
        plant = plant_of(trial or trial_of(bag))
        self.controllers: dict[str, Controller] = {}
        for name, (law, values) in laws.items():
            if only is not None and name != only:
                continue
            # wall time decides nothing here
            own = {k: v for k, v in values.items() if law in CONTROLLERS or k != "time_limit"}
            self.controllers[name] = build_controller(
                name,
                law,
                own,
                plant,
                f"{bag.path}: controllers.{name}",
            )
        self._due = [a for a in adoptions(bag) if a.controller in self.controllers]

    def adopt_until(self, key: Key) -> None:
        """Give the controllers the plans that they had when they were asked at `key`."""
        while self._due and self._due[0].seen < key:
            adoption = self._due.pop(0)
            self.controllers[adoption.controller].adopt(adoption.plan)


def logged_laws(bag: BagReader) -> dict[str, tuple[str, dict[str, Any]]]:
    """Return law and settings of every controller by name: of the trial, and of guests."""
    laws = {n: law_of(n, values or {}) for n, values in trial_of(bag).controllers.items()}
    for name, status in bag.overview.statuses.items():
        if name not in laws or laws[name][0] in CONTROLLERS:  # with its defaults of that day
            values = load_yaml(status.settings, f"{bag.path}: controllers.{name}") or {}
            values.pop("computed", None)  # is said there, too, and follows from the others
            laws[name] = status.law, values
    return laws


def adoptions(bag: BagReader) -> list[Adoption]:
    """Return who took which plan after which tick, in that order.

    Raises:
        BadInput: a controller says that it follows a plan that is not in the log.
    """
    plans = {p.hash: plan_of_log(p, str(bag.path)) for p in bag.overview.plans}
    following: dict[str, str] = {}
    found = []
    for _, kind, _, _, data in bag.messages(("/controller_status",)):
        status = decode(kind, data)
        name, wanted = status.controller, status.plan_hash
        if not wanted or following.get(name) == wanted:
            continue
        if wanted not in plans:
            raise BadInput(
                f"{bag.path}: {name} follows plan {wanted[:12]}, which is not in the log"
            )
        following[name] = wanted
        seen = int(status.epoch), int(status.last_tick)
        if seen == (0, 0):  # said by one that has seen none, too; nobody plans within tick 0
            seen = 0, -1
        found.append(Adoption(name, seen, plans[wanted]))
    return sorted(found, key=lambda adoption: adoption.seen)
