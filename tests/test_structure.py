"""The rules of the tree that no type checker holds: imports, names of one spacecraft, cycles."""

import ast
import re
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from typing import Any

import pytest

from flexslew_lab.cli.suite import OVER_ROS
from flexslew_plant.events import EVENTS

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "ros2_ws" / "src"
ORDER = ("flexslew_plant", "flexslew_control", "flexslew_lab")
FILES = sorted(path for name in ORDER for path in (SOURCE / name / name).rglob("*.py"))
ROS = re.compile(r"^(rclpy|rosidl|launch|ament|[a-z_]+_msgs|std_srvs|builtin_interfaces)\b")


def module_of(path: Any) -> Any:
    parts = path.relative_to(SOURCE).with_suffix("").parts[1:]
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {path: module_of(path) for path in FILES}
KNOWN = set(MODULES.values())
PACKAGES = {module_of(path) for path in FILES if path.name == "__init__.py"}


@pytest.fixture(scope="module")
def trees() -> dict[Path, ast.Module]:
    """Return the syntax tree of every file."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}


def test_only_tests_over_ros_are_marked_alone() -> None:
    over_ros = [ROOT / part for part in OVER_ROS]
    marked = [path for path in (ROOT / "tests").rglob("*.py") if "mark.alone" in path.read_text()]
    outside = {p for p in marked if not any(p.is_relative_to(part) for part in over_ros)}
    assert outside == {ROOT / "tests/lab/cli/test_suite.py", Path(__file__)}  # which quote it


@pytest.fixture(scope="module")
def imports(trees: dict[Path, ast.Module]) -> dict[str, set[str]]:
    """Return the modules of the tree that each imports anywhere, for the type checker too."""
    return {MODULES[path]: imports_of(MODULES[path], tree) for path, tree in trees.items()}


def imports_of(own: str, tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inner & KNOWN or {node.module}
    return (found & KNOWN) - {own}


def imported(tree: ast.Module) -> Iterator[Any]:
    """Yield the names of the modules that a file imports, at its top or within."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.slow
def test_ros_is_imported_only_below_ros(trees: dict[Path, ast.Module]) -> None:
    wrong = [
        f"{path.relative_to(SOURCE)}: {name}"
        for path, tree in trees.items()
        if "ros" not in path.relative_to(SOURCE).parts[:-1]
        for name in imported(tree)
        if ROS.match(name)
    ]
    assert not wrong


@pytest.mark.slow
def test_signatures_name_generic_classes_of_ros_in_quotes(trees: dict[Path, ast.Module]) -> None:
    """`Publisher[Any]` is an error where it is evaluated with the rclpy of Jazzy."""
    wrong = []
    for path, tree in trees.items():
        of_ros = {
            alias.asname or alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rclpy")
            for alias in node.names
        }
        signatures = [
            part
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
            for part in (node.args, node.returns)
            if part is not None
        ]
        wrong += [
            f"{path.relative_to(SOURCE)}:{node.lineno}: {node.value.id}"
            for part in signatures
            for node in ast.walk(part)
            if isinstance(node, ast.Subscript)
            and isinstance(node.value, ast.Name)
            and node.value.id in of_ros
        ]
    assert not wrong


@pytest.mark.parametrize("package", ORDER)
def test_imports_go_one_way(package: Any, trees: dict[Path, ast.Module]) -> None:
    later = ORDER[ORDER.index(package) + 1 :]
    wrong = [
        f"{path.relative_to(SOURCE)}: {name}"
        for path, tree in trees.items()
        if path.is_relative_to(SOURCE / package)
        for name in imported(tree)
        if name.split(".")[0] in later
    ]
    assert not wrong


def test_no_file_imports_itself_in_a_circle(imports: dict[str, set[str]]) -> None:
    """Not even where a name is imported late, or for the type checker alone."""
    # a package stands for its __init__, which imports its members: that is no circle of files
    graph = {
        module: {name for name in needs if not module.startswith(f"{name}.")}
        for module, needs in imports.items()
    }
    list(TopologicalSorter(graph).static_order())


def family(module: str) -> str:
    """Return the family of a module: the first folder in its package, or the file beside them."""
    return ".".join(module.split(".")[:2])


def test_no_two_families_import_each_other(imports: dict[str, set[str]]) -> None:
    needs: dict[str, set[str]] = {}
    for module, names in imports.items():
        for name in names:
            if family(module) in PACKAGES and family(name) in PACKAGES:
                needs.setdefault(family(module), set()).add(family(name))
    mutual = {
        tuple(sorted((one, other)))
        for one, others in needs.items()
        for other in others - {one}
        if one in needs.get(other, ()) and "." in one and "." in other
    }
    assert not mutual


def test_the_name_of_a_public_class_has_one_meaning(trees: dict[Path, ast.Module]) -> None:
    homes: dict[str, list[str]] = {}
    for path, tree in trees.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(MODULES[path])
    assert not {name: places for name, places in homes.items() if len(places) > 1}


MOST_PARAMETERS = 8  # of a function; a ninth is a sign of a record without a name


def parameters_of(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> list[str]:
    """Return the names of all parameters, without the object or class of a method."""
    a = node.args
    given = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, [a.vararg, a.kwarg])]
    return [one.arg for one in given if one.arg not in ("self", "cls")]


def test_no_function_has_more_than_eight_parameters(trees: dict[Path, ast.Module]) -> None:
    wrong = [
        f"{path.relative_to(SOURCE)}:{node.lineno}: {len(parameters_of(node))}"
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        and len(parameters_of(node)) > MOST_PARAMETERS
    ]
    assert not wrong, "\n".join(wrong)


STEPS = {"compiled", "compiled_once", "vectorised", "called", "inline", "merged"}  # decorators


def decorators(node: ast.FunctionDef) -> set[str]:
    """Return the names of a function's decorators."""
    plain = (one.func if isinstance(one, ast.Call) else one for one in node.decorator_list)
    return {one.id for one in plain if isinstance(one, ast.Name)}


def test_no_step_takes_what_may_be_anything(trees: dict[Path, ast.Module]) -> None:
    wrong = [
        f"{path.relative_to(SOURCE)}:{node.lineno}: {argument.arg}"
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and decorators(node) & STEPS
        for argument in node.args.args
        if argument.annotation is not None and "Any" in ast.unparse(argument.annotation)
    ]
    assert not wrong, "\n".join(wrong)


# what only one spacecraft has; allowed where that spacecraft is, and where a paper is reproduced
NAMES = re.compile(
    r"base_yaw|hub_pitch|Csa[A-Z]|OscillatorTestbed|HubTestbed|hub_with_appendages|beam_positive"
    r"|floating_oscillator|testbed\.kind == |Spacecraft[A-Z]\w*\("
)


def test_nothing_outside_of_the_testbeds_names_a_kind_a_joint_or_an_appendage() -> None:
    wrong = []
    for path in [*FILES, *(SOURCE / "flexslew_lab").rglob("*.j2")]:
        parts = path.relative_to(SOURCE).parts
        if "testbeds" in parts or "reproduce" in parts or "shipped" in parts:
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if NAMES.search(line):
                wrong.append(f"{path.relative_to(SOURCE)}:{number}: {line.strip()}")
    assert not wrong, "\n".join(wrong)


def test_every_family_says_what_it_offers() -> None:
    folders = {path.parent for path in FILES if path.parent.name not in ORDER}
    for folder in sorted(folders):
        text = (folder / "__init__.py").read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text)), folder


def offered(name: str) -> set[str]:
    """Return the modules of a family that its front offers to others."""
    front = SOURCE / name.split(".")[0] / name.replace(".", "/") / "__init__.py"
    words = ast.get_docstring(ast.parse(front.read_text(encoding="utf-8"))) or ""
    found = re.search(r"^Offers: (.*?)\.$", words, re.MULTILINE | re.DOTALL)
    return set(found[1].replace("\n", " ").split(", ")) if found else set()


def test_families_use_of_each_other_what_their_fronts_offer(imports: dict[str, set[str]]) -> None:
    used: dict[str, set[str]] = {name: set() for name in PACKAGES if name.count(".") == 1}
    for module, names in imports.items():
        for name in names:
            home = family(name)
            if home in used and home not in (family(module), name):
                used[home].add(name.removeprefix(f"{home}."))
    assert {name: offered(name) for name in used} == used


def test_a_node_is_under_150_lines() -> None:
    nodes = [path for path in FILES if path.name.endswith("_node.py")]
    assert len(nodes) >= 6
    for path in nodes:
        assert len(path.read_text().splitlines()) < 150, path


def test_no_kind_of_event_stands_as_a_text_outside_of_its_file(
    trees: dict[Path, ast.Module],
) -> None:
    words = {"started", "resumed", "paused", "step", "rate", "note", "late", "fault", "brake"}
    words |= {"disturbance", "finished", "recording", "reset", "ready", "missed", "planned"}
    words |= {"interrupted", "fallback"}
    kinds = set(EVENTS) - words  # these mean other things as well: states, keys, services
    wrong = [
        f"{path.relative_to(SOURCE)}:{node.lineno}: {node.value}"
        for path, tree in trees.items()
        if "events" not in path.relative_to(SOURCE).parts and path.name != "refusal.py"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and node.value in kinds
    ]
    assert not wrong, "\n".join(wrong)


# a key of a table that other files may write as a string: where, and why
STATED = {
    ("flexslew_plant/bench/records.py", "pd_feedforward"): "the default of who is in charge",
    ("flexslew_control/planners/retargeting.py", "disturbance_minimisation"): "an option of a plan",
    ("flexslew_plant/extras.py", "fmu"): "an extra of the same name",
    ("flexslew_plant/graph/topics.py", "joint_trajectory"): "a topic of the same name",
    ("flexslew_control/ros/trajectories.py", "joint_trajectory"): "what a message asks for: its "
    "node leaves the import of all planners to the process that plans",
}
WORDS = {"none", "linear"}  # of English: they stand for other things too


def test_no_key_of_a_table_stands_as_a_string_outside_of_its_file(
    trees: dict[Path, ast.Module],
) -> None:
    from flexslew_control.controllers import CONTROLLERS
    from flexslew_control.planners import PLANNERS
    from flexslew_plant.faults import FAULTS
    from flexslew_plant.testbeds import TESTBEDS

    tables: list[Any] = [CONTROLLERS, PLANNERS, FAULTS, TESTBEDS]
    homes = {
        name: entry.settings.__module__.replace(".", "/").removesuffix("/testbed")
        for table in tables
        for name, entry in table.items()
        if name not in WORDS
    }
    assert len(homes) > 25
    wrong, stated = [], set()
    for path, tree in trees.items():
        place = "/".join(path.relative_to(SOURCE).parts[1:])
        if "reproduce/" in place:  # names the trials of papers
            continue
        for node in ast.walk(tree):
            key = node.value if isinstance(node, ast.Constant) else None
            if not isinstance(key, str) or key not in homes or place.startswith(homes[key]):
                continue
            if (place, key) in STATED:
                stated.add((place, key))
            else:
                wrong.append(f"{place}: {key}")
    assert not wrong, "\n".join(wrong)
    assert stated == set(STATED)


def compared_kinds(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield where the kind of an event is compared with a text."""
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Compare)
            and ast.unparse(node.left) in ("event.kind", "e.kind")
            and any(isinstance(c, ast.Constant | ast.Tuple | ast.Set) for c in node.comparators)
        ):
            yield node


SENTENCES = {"message", "reason", "words", "why"}  # names of what people read


def read_sentences(tree: ast.AST) -> Iterator[ast.expr]:
    """Yield where code reading into a sentence: a part of it, its beginning or its end."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.In | ast.NotIn):
            part = isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)
            if part and sentence(node.comparators[0]):
                yield node
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            reading = (
                "startswith",
                "endswith",
                "removeprefix",
                "removesuffix",
                "partition",
                "find",
            )
            if node.func.attr in reading and sentence(node.func.value):
                yield node


def sentence(node: ast.AST) -> bool:
    """Return whether an expression is what somebody reads: a message, a reason, an error's text."""
    if isinstance(node, ast.Attribute):
        return node.attr in SENTENCES
    if isinstance(node, ast.Name):
        return node.id in SENTENCES
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        return node.slice.value in SENTENCES
    if isinstance(node, ast.Call):
        named = isinstance(node.func, ast.Name) and node.func.id == "str"
        called = isinstance(node.func, ast.Attribute) and node.func.attr in ("get", "lower")
        values = [a.value for a in node.args if isinstance(a, ast.Constant)]
        error = named and any(ERROR.search(ast.unparse(argument)) for argument in node.args)
        return error or (called and bool(SENTENCES & {str(value) for value in values}))
    return False


ERROR = re.compile(r"\b(error|refused|refusal|failure|why)\b")


@pytest.mark.slow
def test_no_code_reads_a_sentence(trees: dict[Path, ast.Module]) -> None:
    wrong = []
    for path, tree in trees.items():
        if path.name == "older.py":  # logs of before say it in words alone
            continue
        wrong += [
            f"{path.relative_to(SOURCE)}:{node.lineno}: {ast.unparse(node)}"
            for node in (*read_sentences(tree), *compared_kinds(tree))
        ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "line",
    [
        '"is not ready" in event.data["reason"]',
        '"is not ready" in event.data.get("reason", "")',
        'str(error).removeprefix(f"{path}: ")',
        'words.startswith("fault:")',
        'reply.message.endswith("late")',
        '"late" not in self.message',
    ],
)
def test_what_reads_a_sentence_is_found(line: str) -> None:
    assert list(read_sentences(ast.parse(line)))
