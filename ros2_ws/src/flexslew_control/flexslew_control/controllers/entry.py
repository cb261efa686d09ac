"""The entry of a law in the table of controllers, which the law's file defines."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from flexslew_control.controllers.linear_form import LinearForm
from flexslew_control.law import Estimator, Law, PlantDescription, Reference


class PlanVariant(NamedTuple):
    """A plan that a law is compared with, where a plan is made for its law."""

    name: str  # behind that of the law; empty: none
    keys: Mapping[str, Any]  # of the plan's section


@dataclass(frozen=True)
class LawEntry:
    """A law and its properties for the rest of the bench.

    Args:
        name: value of `controllers.<name>.law`; its node's executable too.
        settings: its section.
        build: returns estimator and law for a testbed that it fits.
        follows_reference: whether it follows a reference that moves; else it holds the rest, and
            refuses such a plan (see Law.objection).
        linear: returns estimator and law as matrices for these references, tick by tick, where
            they are linear (None: these settings are not); None: it never is.
        batch_gains: keys of its section in which the members of a batch may differ; the law has
            nothing else of its testbed, unless a key of `of_testbed` is set.
        of_testbed: keys of its section that make it depend on the testbed; `base.attitude` is one
            of its section `base`.
        any_testbed: whether it has nothing of its testbed but for these, though it has no
            batch_gains.
        checked: whether these gains are checked against its design model; on a free platform all
            are.
        takes_over: whether its linear form holds where it takes over in flight: z is the state of
            its estimator, and the integral starts such that the effort stays.
        compared: its settings in a comparison, where the trial has none.
        from_file: returns the keys of a file, from its path and the source for errors; the key
            `file` of its section then stands for them (see controllers.with_file).
        plans: plan variants of a comparison, where a plan is made for its law.
    """

    name: str
    settings: type[Any]
    build: Callable[[Any, PlantDescription], tuple[Estimator, Law]]
    follows_reference: bool = True
    linear: Callable[[Any, Any, list[Reference]], LinearForm | None] | None = None
    batch_gains: tuple[str, ...] = ()
    of_testbed: tuple[str, ...] = ()
    any_testbed: bool = False
    checked: bool = False
    takes_over: bool = False
    compared: Mapping[str, Any] = field(default_factory=dict)
    from_file: Callable[[str, str], dict[str, Any]] | None = None
    plans: tuple[PlanVariant, ...] = (PlanVariant("", {}),)

    def reads_testbed(self, values: Mapping[str, Any]) -> bool:
        """Return whether a key of `of_testbed` is set in a section."""
        return any(_value(values, key) not in (None, False) for key in self.of_testbed)


def _value(values: Any, path: str) -> Any:
    """Return what stands at a path of keys; None: nothing."""
    for key in path.split("."):
        values = values.get(key) if isinstance(values, Mapping) else None
    return values
