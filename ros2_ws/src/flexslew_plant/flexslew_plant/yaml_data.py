"""YAML as trials, requests and logs hold it: plain data that can be walked through."""

import re
from collections.abc import Hashable, Iterator
from math import inf
from typing import Any

import yaml

from flexslew_plant.errors import BadInput

_MOST = 1_000_000  # values and characters of a YAML text, with its aliases written out
_MERGED = 10_000  # keys that the merges (<<) of a text copy
_BITS = 1023  # of a whole number that is a finite float, too
_SHORT = 10_000  # characters that cannot nest too deep for the stack
MAX_DEPTH = 32  # lists and keys in one another
_MERGE = "tag:yaml.org,2002:merge"
MAX_LENGTH = 1 << 20  # of a YAML or JSON text that a log can hold [characters]


def load_yaml(text: str, source: str) -> Any:
    """Return the content of a YAML text, with the place of a syntax error named.

    Raises:
        BadInput: the text is not YAML, or is more than can be used: see `bounded`.
    """
    try:
        if len(text) > _SHORT:
            for _ in _events(text, source):
                pass
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
    if len(text) > MAX_LENGTH:
        words = f"has {len(text):,} characters; a log holds at most {MAX_LENGTH:,}"
        raise BadInput(words, source)


def require_no_anchor(text: str, source: str) -> None:
    """Refuse aliases, which can make gigabytes of a few lines; a text that is no YAML passes.

    Raises:
        BadInput: the text has an anchor or an alias, or is nested too deep.
    """
    try:
        for event in _events(text, source):
            if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
                raise BadInput("has a YAML anchor; write the value at each place", source)
    except yaml.YAMLError:
        pass  # load_yaml names the place


def _events(text: str, source: str) -> Iterator[yaml.Event]:
    """Yield the events of a text, up to a nesting of 32.

    The time of the parser grows with the square of the depth, and the C loader overflows the stack.

    Raises:
        BadInput: the text is nested deeper.
    """
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise BadInput(f"is nested more than {MAX_DEPTH} deep", source)
        yield event


def bounded(value: Any, source: str, length: int) -> Any:
    """Return what a YAML text holds, if it can be walked through.

    Aliases let a few lines stand for gigabytes, or hold themselves.

    Args:
        value: that was read.
        source: the file (or node) to name in an error.
        length: of the text; without aliases its values are not longer.

    Raises:
        BadInput: if its aliases stand for more than 1,000,000 values and characters, or it is
            nested more than 32 deep.
    """
    known: dict[int, tuple[float, float]] = {}

    def measure(part: Any) -> tuple[float, float]:
        """Return the values in a part and how deep it is nested."""
        if not isinstance(part, dict | list):
            return (len(part) or 1) if isinstance(part, str) else 1, 0
        if id(part) not in known:
            known[id(part)] = inf, inf  # where it holds itself
            children = [*part, *part.values()] if isinstance(part, dict) else part
            sizes, depths = zip((0, 0), *map(measure, children), strict=True)
            known[id(part)] = sum(sizes), 1 + max(depths)
        return known[id(part)]

    size, depth = measure(value)
    if depth > MAX_DEPTH:
        raise BadInput(f"is nested more than {MAX_DEPTH} deep, or is recursive", source)
    if size > max(_MOST, length):
        words = f"holds more than {_MOST} values and characters, aliases written out"
        raise BadInput(words, source)
    return value


class _DuplicateKeyError(yaml.MarkedYAMLError):
    """A key stands twice in one mapping."""


class YamlLoader(yaml.CSafeLoader):
    """Reads plain data; of two equal keys YAML would silently keep the last."""

    _merged = 0  # keys that merges have copied

    def flatten_mapping(self, node: Any) -> None:
        """Replace the merges (<<) of a mapping node by the keys that they stand for.

        Keys of the mapping itself win, then those of the last `<<`, and in a list of mappings
        those of the first. PyYAML copies equal keys, too: a few lines would make millions of them.

        Raises:
            ConstructorError: if something else than mappings is merged, or merges copy more than
                10,000 keys.
        """
        merges = [value for key, value in node.value if key.tag == _MERGE]
        if not merges:
            super().flatten_mapping(node)
            return
        node.value = [pair for pair in node.value if pair[0].tag != _MERGE]
        pairs = {_identity(key): (key, value) for key, value in node.value}
        for merge in reversed(merges):
            for part in merge.value if isinstance(merge, yaml.SequenceNode) else [merge]:
                if not isinstance(part, yaml.MappingNode):
                    words = "<< merges mappings only, for example <<: *name"
                    raise yaml.constructor.ConstructorError(
                        problem=words, problem_mark=part.start_mark
                    )
                self.flatten_mapping(part)
                self._merged += len(part.value)
                if self._merged > _MERGED:
                    words = f"the merges (<<) of this text copy more than {_MERGED} keys"
                    raise yaml.constructor.ConstructorError(
                        problem=words, problem_mark=part.start_mark
                    )
                for key, value in part.value:
                    pairs.setdefault(_identity(key), (key, value))
        node.value = [*pairs.values()]
        super().flatten_mapping(node)

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Return the value of a node.

        Raises:
            ConstructorError: a tag, or the form of a number, promises what the value is not.
        """
        try:
            value = super().construct_object(node, deep)
            if isinstance(value, int) and value.bit_length() > _BITS:
                raise ValueError
            return value
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


def _identity(key: Any) -> tuple[str, object]:
    """Return by what two key nodes are equal."""
    return key.tag, key.value if isinstance(key, yaml.ScalarNode) else id(key)


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
