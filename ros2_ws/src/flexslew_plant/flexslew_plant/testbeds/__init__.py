"""The testbeds. A new one is a file that ends in its entry, and a line here.

One of the user's own needs no line: `kind: my_testbed.py:MyTestbed`, or an entry point of the
group flexslew.testbeds.

Offers: beam, black_box.plant_address, compiled.batch_kernel, compiled.bound, compiled.dynamics,
compiled.interface, compiled.mass, compiled.push, compiled.scalar_kernel, compiled.traced_kernel,
contract, csa, hub_with_appendages, identified, instruments, instruments.instrument,
instruments.packed_readers, integration_error, kernels, linearisation, model, orientation.attitude,
orientation.quaternions, oscillators.floating_oscillator, robot_model, scene,
spacecraft.assembly.packing, spacecraft.finite_elements.imported,
spacecraft.finite_elements.modal_content, spacecraft.finite_elements.model,
spacecraft.finite_elements.readers, spacecraft.shapes.shape, spacecraft.testbed, spacecraft.units.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    PlainValidator,
    Tag,
    ValidationInfo,
)

from flexslew_plant.entries import table, union
from flexslew_plant.errors import BadInput
from flexslew_plant.keys.refused_keys import SectionError
from flexslew_plant.known_joints import unknown_joint
from flexslew_plant.own_code import NO_CODE, Trust, find_class, require_command, require_file
from flexslew_plant.settings import plain, validated
from flexslew_plant.testbeds.contract import Testbed as Testbed
from flexslew_plant.testbeds.entry import TestbedEntry as TestbedEntry
from flexslew_plant.testbeds.initial.initial_motion import InitialMotion
from flexslew_plant.testbeds.initial.many import models_of as models_of
from flexslew_plant.testbeds.initial.start import at_rest as at_rest
from flexslew_plant.testbeds.initial.start import consistent_positions as consistent_positions
from flexslew_plant.testbeds.initial.start import initial_motion as initial_motion
from flexslew_plant.testbeds.initial.start import initial_positions as initial_positions
from flexslew_plant.testbeds.initial.start import initial_state as initial_state
from flexslew_plant.testbeds.initial.start import initial_states as initial_states
from flexslew_plant.testbeds.initial.start import starts_in_motion as starts_in_motion
from flexslew_plant.testbeds.model import Appendages as Appendages
from flexslew_plant.testbeds.model import Model as Model
from flexslew_plant.testbeds.model_file import model_of as model_of
from flexslew_plant.testbeds.model_file import with_model_file as with_model_file

# isort: split
# the testbeds, a line each
from flexslew_plant.testbeds.black_box.external import EXTERNAL as EXTERNAL
from flexslew_plant.testbeds.black_box.fmu import FMU as FMU
from flexslew_plant.testbeds.csa.testbed import CSA as CSA
from flexslew_plant.testbeds.hub_with_appendages import HUB as HUB
from flexslew_plant.testbeds.identified import IDENTIFIED as IDENTIFIED
from flexslew_plant.testbeds.linear.testbed import LINEAR_PLANT as LINEAR_PLANT
from flexslew_plant.testbeds.oscillators.floating_oscillator import OSCILLATOR as OSCILLATOR
from flexslew_plant.testbeds.oscillators.varying_oscillator import VARYING as VARYING
from flexslew_plant.testbeds.spacecraft.testbed import SPACECRAFT as SPACECRAFT

TESTBEDS: dict[str, TestbedEntry] = table(globals(), TestbedEntry)
WITH_EQUATIONS = {name: entry for name, entry in TESTBEDS.items() if entry.has_equations}
GROUP = "flexslew.testbeds"  # of the entry points of installed packages
DEFAULT = CSA.name  # where `kind` is left out


def _kind(values: Any) -> str:
    """Return the tag of a `testbed` section."""
    given = values.get("kind") if isinstance(values, dict) else getattr(values, "kind", None)
    name = DEFAULT if given is None else str(given)
    return name if name in TESTBEDS else "own"


def _limited(values: Any) -> Any:
    """Return a section of a shipped kind with one limit per drive.

    Raises:
        SectionError: `initial` has a section of `initial_motion`.
    """
    initial = values.get("initial") if isinstance(values, dict) else None
    for key, value in initial.items() if isinstance(initial, dict) else ():
        if key in vars(InitialMotion()) and isinstance(value, dict | list):
            raise SectionError(f"testbed.initial.{key}: is a key of testbed.initial_motion")
    entry = TESTBEDS.get(_kind(values))
    plain_data = isinstance(values, dict)
    return _for_all(entry.settings, values) if entry is not None and plain_data else values


def _for_all(kind: type[Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of a section with a single `effort_limit` given to every drive."""
    limit = values.get("effort_limit")
    if not isinstance(limit, int | float) or isinstance(limit, bool):
        return values
    field = getattr(kind, "__dataclass_fields__", {}).get("effort_limit")
    count = len(field.default) if field is not None and isinstance(field.default, tuple) else 1
    return {**values, "effort_limit": [limit] * count}


def _with_file(values: Any, info: ValidationInfo) -> Any:
    """Return a section with what its `file` holds in place of the file's name.

    So a log holds all that flew, and is flown again without the file.
    """
    entry = TESTBEDS.get(_kind(values))
    if entry is None or entry.from_file is None or not isinstance(values, dict):
        return values
    path = values.get("file")
    if path is None:
        return values
    if not isinstance(path, str) or not path:
        raise ValueError("file: give the path of a file")
    try:
        require_file(info.context or NO_CODE, path, "testbed: file")
        given = entry.from_file(path, "testbed")
    except BadInput as error:
        raise ValueError(str(error)) from error  # in which `validated` finds an Untrusted
    for key, part in given.items():
        beside = values.get(key, {})
        if not isinstance(beside, dict):
            raise ValueError(f"{key}: give its keys, or leave it to the file")
        given[key] = {**part, **beside}
    return {**{key: value for key, value in values.items() if key != "file"}, **given}


def _with_program(values: Any, info: ValidationInfo) -> Any:
    """Return a section with what its program describes of itself.

    A log then has all of it, and is read without the program.

    Raises:
        Untrusted: a log names the program, and is not trusted.
    """
    entry = TESTBEDS.get(_kind(values))
    if entry is None or entry.described is None or not isinstance(values, dict):
        return values
    trust = info.context or NO_CODE
    code = [values[key] for key in ("file", "serial") if key in values]
    command = values.get("command") or code
    try:
        if command and isinstance(command, list | tuple):
            require_command(trust, [str(part) for part in command], "command")
        return {**values, **entry.described(values)}
    except BadInput as error:
        raise ValueError(str(error)) from error  # in which `validated` finds an Untrusted


_NEEDED = ("effort_limit", "model", "modes", "scene")  # of contract.Testbed


def _require_testbed(found: type[Any]) -> None:
    """Check that a class has what the bench requires of a testbed.

    Raises:
        BadInput: it lacks something.
    """
    known = {*dir(found), *getattr(found, "__dataclass_fields__", ())}
    missing = sorted(name for name in _NEEDED if name not in known)
    if missing:
        words = f"{found.__name__} is no testbed: it lacks {', '.join(missing)}; see own_testbed.md"
        raise BadInput(words)


def _user_testbed(values: Any, info: ValidationInfo) -> Any:
    """Return a section of the user's own class."""
    if not isinstance(values, dict):
        return values
    name, trust = str(values["kind"]), info.context or NO_CODE
    try:
        found = find_class(name, GROUP, "testbed", "kind", tuple(TESTBEDS), trust)
        _require_testbed(found)
        return validated(found, _for_all(found, values), name, trust)
    except BadInput as error:
        raise ValueError(str(error)) from error  # in which `validated` finds an Untrusted


def _known_joints(testbed: Any) -> Any:
    """Return a testbed after checking that `initial` and `initial_motion` name what it has."""
    initial = getattr(testbed, "initial", None)
    if isinstance(initial, dict) and initial:
        joints = testbed.model().joint_names
        for name in initial:
            if name not in joints:
                raise ValueError(f"initial: {unknown_joint(name, joints)}")
    if initial_motion(testbed) is not None:
        try:
            initial_state(testbed)
        except BadInput as error:
            raise SectionError(str(error)) from None
    return testbed


if TYPE_CHECKING:
    TestbedSettings: TypeAlias = Testbed
else:
    # a `testbed` section of any kind, selected by `kind`
    TestbedSettings = Annotated[
        union(
            [
                *(Annotated[entry.settings, Tag(name)] for name, entry in TESTBEDS.items()),
                Annotated[Any, PlainValidator(_user_testbed), Tag("own")],
            ]
        ),
        Discriminator(_kind),
        BeforeValidator(_limited),
        BeforeValidator(_with_program),
        BeforeValidator(_with_file),
        AfterValidator(_known_joints),
    ]


def default_testbed() -> Testbed:
    """Return the testbed of a trial that names none."""
    testbed: Testbed = TESTBEDS[DEFAULT].settings()
    return testbed


def read_testbed(values: Any, source: str, trust: Trust = NO_CODE) -> Testbed:
    """Return a `testbed` section as its kind reads it.

    Args:
        values: what YAML holds.
        source: the file to name in an error.
        trust: which kinds of the user's own may be loaded.

    Raises:
        BadInput: the first wrong key, with its value and what is allowed.
    """
    testbed: Testbed = validated(TestbedSettings, values, source, trust)
    return testbed


def with_changes(
    testbed: Testbed, changes: Mapping[str, Any], source: str, trust: Trust = NO_CODE
) -> Testbed:
    """Return the testbed with some of its keys changed, nested sections key by key.

    A change of `kind` starts from that kind's defaults. Where the change takes a joint away, its
    position in `initial` goes with it. `initial_motion` is kept as it is.

    Raises:
        BadInput: see read_testbed.
    """
    if changes.get("kind", testbed.kind) != testbed.kind:
        return read_testbed(dict(changes), source, trust)
    loaded = {testbed.kind, getattr(testbed, "code_name", testbed.kind)}  # before
    known = replace(trust, names=trust.names | loaded)
    base, motion = plain(testbed), initial_motion(testbed)
    if motion is not None and "initial_motion" not in changes:  # a model may have fewer modes
        changed: Any = with_changes(at_rest(testbed), changes, source, trust)
        moving: Testbed = replace(changed, initial_motion=motion)
        return moving
    start = base.get("initial")
    if not isinstance(testbed.initial, dict) or not start:
        return read_testbed(_merged(base, changes), source, known)
    found: Any = read_testbed(_merged({**base, "initial": {}}, changes), source, known)
    joints = found.model().joint_names
    kept = {name: at for name, at in start.items() if name in joints}
    started: Testbed = replace(found, initial=kept | found.initial)
    return started


def design_testbed(
    testbed: Testbed, changes: Mapping[str, Any] | None, source: str, trust: Trust = NO_CODE
) -> Testbed:
    """Return what a planner or a law believes of the testbed: simplified, with these changes.

    Args:
        testbed: that stands on the bench.
        changes: the `model` section of a plan or a law, or `file`: one that an identification
            wrote; None: none.
        source: for an error.
        trust: which other kinds of the user's own may be loaded.

    Raises:
        BadInput: see read_testbed and with_model_file.
    """
    given = with_model_file(changes or {}, source, trust)
    if given.get("kind", testbed.kind) != testbed.kind:
        base = TESTBEDS[given["kind"]].settings.simplified if given["kind"] in TESTBEDS else {}
        other = read_testbed(_merged(dict(base), given), source, trust)
        return _of_same_joints(other, testbed, source)
    return with_changes(testbed, _merged(dict(testbed.simplified), given), source, trust)


def _of_same_joints(other: Testbed, testbed: Testbed, source: str) -> Testbed:
    """Check that a model of another kind has joints of the bench alone.

    Raises:
        BadInput: it has others.
    """
    here, other_joints = testbed.model().joint_names, other.model().joint_names
    if not set(other_joints) <= set(here):
        raise BadInput(
            f"a model with the joints of the bench, {', '.join(here)}; {other.kind} has "
            f"{', '.join(other_joints)}",
            source,
            "joints",
            list(other_joints),
        )
    return other


def _merged(values: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(values)
    for key, change in changes.items():
        before = out.get(key)
        nested = isinstance(before, dict) and isinstance(change, Mapping)
        out[key] = _merged(before, change) if nested and before is not None else change
    return out
