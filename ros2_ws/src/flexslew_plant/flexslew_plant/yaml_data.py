"""YAML as trials, requests and logs hold it: plain data that can be walked through."""

import re
from collections.abc import Hashable
from math import inf
from typing import Any

import yaml

from flexslew_plant.errors import BadInput

_MOST = 1_000_000  # values in a YAML text with aliases
_SHORT = 10_000  # characters that cannot nest too deep for the stack
DEEPEST = 32  # lists and keys in one another
LONGEST = 1 << 20  # of a YAML or JSON text that a log can hold [characters]


def load_yaml(text: str, source: str) -> Any:
    """Return the content of a YAML text, with the place of a syntax error named.

    Raises:
        BadInput: the text is not YAML, or is more than can be used: see `bounded`.
    """
    try:
        if len(text) > _SHORT:
            _require_flat(text, source)
        return bounded(yaml.load(text, Loader=YamlLoader), source, len(text))
    except yaml.YAMLError as error:
        where = getattr(error, "problem_mark", None)
        line = f" line {where.line + 1}, column {where.column + 1}" if where else ""
        problem = str(getattr(error, "problem", None) or error)
        words = problem if isinstance(error, _DuplicateKeyError) else f"is not YAML: {problem}"
        raise BadInput(f"{source}:{line} {' '.join(words.split())}") from None
    except RecursionError as error:  # [[[
        raise BadInput(f"is not YAML: {error}", source) from None


def require_short(text: str, source: str) -> None:
    """Refuse a text that no log can hold.

    Raises:
        BadInput: it has more than LONGEST characters.
    """
    if len(text) > LONGEST:
        words = f"has {len(text):,} characters; a log holds at most {LONGEST:,}"
        raise BadInput(words, source)


def require_no_anchor(text: str, source: str) -> None:
    """Refuse aliases, which can make gigabytes of a few lines; a text that is no YAML passes.

    Raises:
        BadInput: the text has an anchor or an alias.
    """
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                raise BadInput("has a YAML anchor; write the value at each place", source)
    except yaml.YAMLError:
        pass  # load_yaml names the place


def _require_flat(text: str, source: str) -> None:
    """Refuse deep nesting before the C loader descends into it: it overflows the stack."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise BadInput(f"is nested more than {DEEPEST} deep", source)


def bounded(value: Any, source: str, length: int) -> Any:
    """Return what a YAML text holds, if it can be walked through.

    Aliases let a few lines stand for gigabytes, or hold themselves.

    Args:
        value: that was read.
        source: the file (or node) to name in an error.
        length: of the text; without aliases it holds no more values than characters.

    Raises:
        BadInput: it has more than 1,000,000 values for its aliases, or is nested more than 32 deep.
    """
    known: dict[int, tuple[float, float]] = {}

    def measure(part: Any) -> tuple[float, float]:
        """Return the values in a part and how deep it is nested."""
        if not isinstance(part, dict | list):
            return 1, 0
        if id(part) not in known:
            known[id(part)] = inf, inf  # where it holds itself
            inside = part.values() if isinstance(part, dict) else part
            sizes, depths = zip((0, 0), *map(measure, inside), strict=True)
            known[id(part)] = sum(sizes), 1 + max(depths)
        return known[id(part)]

    size, depth = measure(value)
    if depth > DEEPEST:
        raise BadInput(f"is nested more than {DEEPEST} deep, or is recursive", source)
    if size > max(_MOST, length):
        raise BadInput(f"holds more than {_MOST} values, aliases written out", source)
    return value


class _DuplicateKeyError(yaml.MarkedYAMLError):
    """A key stands twice in one mapping."""


class YamlLoader(yaml.CSafeLoader):
    """Reads plain data; of two equal keys YAML would silently keep the last."""

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Return the value of a node.

        Raises:
            ConstructorError: a tag, or the form of a number, promises what the value is not.
        """
        try:
            return super().construct_object(node, deep)
        except (LookupError, ValueError, OverflowError) as error:  # !!bool maybe, !!int abc
            words = f"{node.value!r:.80} is no {node.tag.rpartition(':')[2]}"
            raise yaml.constructor.ConstructorError(
                problem=words, problem_mark=node.start_mark
            ) from error

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Hashable, Any]:
        """Return the mapping of a node.

        Raises:
            _DuplicateKeyError: a key stands twice.
        """
        lines: dict[Hashable, int] = {}
        for key_node, _ in node.value if isinstance(node, yaml.MappingNode) else ():
            key = key_node.value
            if not isinstance(key, str) or key == "<<":
                continue
            if key in lines:
                words = f"duplicate key {key}, first in line {lines[key]}; remove one"
                raise _DuplicateKeyError(problem=words, problem_mark=key_node.start_mark)
            lines[key] = key_node.start_mark.line + 1
        return super().construct_mapping(node, deep)


class YamlDumper(yaml.CSafeDumper):
    """Writes every value where it stands: ROS and rosbag2 read no aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True, always."""
        return True


# 1e-5, 1.0e3 and 1e-05, as Python and JSON write numbers: YAML 1.1 takes them for texts
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")
for _side in (YamlLoader, YamlDumper):  # what is written as a text must come back as one
    _side.add_implicit_resolver("tag:yaml.org,2002:float", _NUMBER, [*"+-.0123456789"])
# 017 is 17, 1:30 and 2026-11-27 are texts, as in YAML 1.2 and JSON: YAML 1.1 reads 15, 90, a date
_OF_1_1 = re.compile(r"[-+]?(0[0-9_]+|[0-9][0-9_]*(:[0-5]?[0-9])+(\.[0-9_]*)?)$")
_DATE = "tag:yaml.org,2002:timestamp"
for _first, _resolvers in list(YamlLoader.yaml_implicit_resolvers.items()):
    if _first and _first in "+-0123456789":
        YamlLoader.yaml_implicit_resolvers[_first] = [
            ("tag:yaml.org,2002:str", _OF_1_1),
            *(one for one in _resolvers if one[0] != _DATE),
        ]
_PLAIN = ("null", "bool", "int", "float", "str", "seq", "map")  # no dates, sets, bytes
YamlLoader.yaml_constructors = {
    tag: YamlLoader.yaml_constructors[tag]
    for tag in (None, *(f"tag:yaml.org,2002:{kind}" for kind in _PLAIN))
}


def yaml_text(values: Any, flow: bool | None = None) -> str:
    """Return plain data as YAML without anchors, keys in their order.

    Args:
        values: dictionaries, lists and scalars.
        flow: True all on one line, None the innermost lists only, False nothing.
    """
    return str(yaml.dump(values, Dumper=YamlDumper, sort_keys=False, default_flow_style=flow))
