"""Pages that follow from definitions: interface, parameters and API.

Run by the site's generator (the plugin gen-files) at every build.
"""

import ast
import importlib
import re
from collections.abc import Iterator
from importlib.metadata import files
from pathlib import Path
from typing import NamedTuple

import mkdocs_gen_files

from flexslew_plant.graph import topics
from flexslew_plant.keys.settings_fields import describe_section

SOURCES = Path("ros2_ws/src")
REQUESTS = "flexslew_plant/flexslew_plant/bench/operation/requests.py"  # requests without fields
MESSAGES = SOURCES / "flexslew_msgs"
PACKAGES = ("flexslew_plant", "flexslew_control", "flexslew_lab")
PARTS = {
    "msg": ("",),
    "srv": ("Request", "Response"),
    "action": ("Goal", "Result", "Feedback"),
}


class Field(NamedTuple):
    """A line of a definition."""

    name: str
    type: str
    default: str
    comment: str


def cell(text: str) -> str:
    """Return text for a cell of a table."""
    return text.replace("|", "\\|").replace("\n", " ").strip()


def code(text: str) -> str:
    """Return text as code in a cell; empty stays empty."""
    return f"`{cell(text)}`" if text else ""


def table(fields: list[Field], defaults: bool = False) -> str:
    """Return fields as a table."""
    head = ["name", "type", *(["default"] if defaults else []), "meaning"]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for f in fields:
        row = [code(f.name), code(f.type), *([code(f.default)] if defaults else [])]
        lines.append(f"| {' | '.join([*row, cell(f.comment)])} |")
    return "\n".join(lines) + "\n"


def definition(path: Path) -> tuple[str, list[list[Field]]]:
    """Return the leading comment of a .msg, .srv or .action file and the fields of its parts."""
    about: list[str] = []
    parts: list[list[Field]] = [[]]
    for line in path.read_text().splitlines():
        content, _, comment = line.partition("#")
        words = content.split(None, 1)
        if line.strip() == "---":
            parts.append([])
        elif len(words) == 2:
            name, _, default = words[1].partition("=")
            parts[-1].append(Field(name.strip(), words[0], default.strip(), comment.strip()))
        elif comment and parts[-1]:  # a comment goes on below its field
            last = parts[-1][-1]
            parts[-1][-1] = last._replace(comment=f"{last.comment} {comment.strip()}")
        elif comment:
            about.append(comment.strip())
    return " ".join(about), parts


def services() -> Iterator[tuple[str, str]]:
    """Yield the name and the type of every service and action.

    Raises:
        ValueError: the type of one is not found in the sources.
    """
    sources = [path.read_text() for path in sorted(SOURCES.glob("*/*/ros/**/*.py"))]
    text = "\n".join([*sources, (SOURCES / REQUESTS).read_text()])
    known = {value: key for key, value in vars(topics).items() if isinstance(value, str)}
    skipped = {topic.name for topic in topics.TOPICS.values()}
    for name, constant in known.items():
        if not constant.isupper() or name in skipped:
            continue
        kind = rf"(?<!: )\b(srv|action)\.(\w+),\s*topics\.{constant}\b"
        typed = [(found, one) for one in sources if (found := re.search(kind, one))]
        if typed:
            found, source = typed[0]
            package = re.findall(r"from (\w+) import [^\n]*\bsrv\b", source)[0]
            yield name, f"{package}/{found[1]}/{found[2]}"
        elif re.search(rf"\baction\b|PlanSlew,\s*topics\.{constant}\b", text) and "plan" in name:
            yield name, "flexslew_msgs/action/PlanSlew"
        elif re.search(rf"\bFollowJointTrajectory,\s*topics\.{constant}\b", text):
            yield name, "control_msgs/action/FollowJointTrajectory"
        elif re.search(rf"\btopics\.{constant}:", text):
            yield name, "std_srvs/srv/Trigger"
        else:
            raise ValueError(f"the type of the service {name} is not found")
    for kind, name in re.findall(r'create_service\((srv\.\w+|Trigger), "~/(\w+)"', text):
        package = "std_srvs/srv/Trigger" if kind == "Trigger" else f"flexslew_msgs/srv/{kind[4:]}"
        yield f"play/{name}", package


def linked(kind: str) -> str:
    """Return a type, with a link where it is one of ours."""
    package, _, name = kind.split("/")
    return f"[`{kind}`](#{name.lower()})" if package == "flexslew_msgs" else f"`{kind}`"


def interface() -> str:
    """Return the page of topics, services, actions and messages."""
    page = [
        "# Topics, services, actions, messages\n",
        "Names are relative, so a namespace holds a whole bench; what begins with / is global.\n",
        "## Topics\n",
        "| name | type | reliable | latched | depth |\n|---|---|---|---|---|",
    ]
    for topic in topics.TOPICS.values():
        flags = ["yes" if flag else "no" for flag in (topic.reliable, topic.latched)]
        row = [f"`{topic.name}`", linked(topic.type), *flags, str(topic.depth)]
        page.append(f"| {' | '.join(row)} |")
    page.append("\n## Services and actions\n\n| name | type |\n|---|---|")
    page += [f"| `{name}` | {linked(kind)} |" for name, kind in services()]
    for kind, names in PARTS.items():
        page.append(f"\n## Definitions: {kind}\n")
        for path in sorted((MESSAGES / kind).glob(f"*.{kind}")):
            about, parts = definition(path)
            page.append(f"### {path.stem}\n\n{about}\n")
            for name, fields in zip(names, parts, strict=True):
                page.append(f"{name}:\n" if name and fields else "")
                page.append(table(fields) if fields else "")
    return "\n".join(page) + "\n"


def sections() -> Iterator[tuple[str, str, str, list[Field]]]:
    """Yield module, class, docstring and fields of every settings section."""
    for package in PACKAGES:
        for path in sorted((SOURCES / package / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.ClassDef) and any(
                    isinstance(d, ast.Name) and d.id == "section" for d in node.decorator_list
                ):
                    module = ".".join(path.relative_to(SOURCES / package).with_suffix("").parts)
                    yield module, node.name, ast.get_docstring(node) or "", keys(module, node)


def keys(module: str, node: ast.ClassDef) -> list[Field]:
    """Return the keys of a section with their types and defaults as the code has them."""
    meanings = describe_section(getattr(importlib.import_module(module), node.name))
    found = []
    for item in node.body:
        name = ast.unparse(item.target) if isinstance(item, ast.AnnAssign) else ""
        if isinstance(item, ast.AnnAssign) and name in meanings:
            default = ast.unparse(item.value) if item.value else ""
            found.append(
                Field(name, ast.unparse(item.annotation), default, meanings[name].description)
            )
    return found


def parameters() -> str:
    """Return the page of all settings."""
    page = [
        "# Settings and parameters\n",
        "Each section of a trial file, and the parameters of each node, as they are defined. A",
        "parameter of a node is called as the key, nested sections with dots (`bench.duration`).",
        "An unknown key, a wrong type or a number out of range is refused.\n",
    ]
    last = ""
    for module, name, about, fields in sections():
        if module != last:
            page.append(f"## {module}\n")
            last = module
        page.append(f"### {name}\n\n{about}\n")
        page.append(table(fields, defaults=True) if fields else "It has no keys.\n")
    return "\n".join(page) + "\n"


def api() -> str:
    """Return the page of the API, one entry per module that needs no ROS."""
    page = ["# API\n", "Importable without ROS; the nodes below `ros` are adapters around it.\n"]
    for package in PACKAGES:
        page.append(f"## {package}\n")
        for path in sorted((SOURCES / package / package).rglob("*.py")):
            parts = path.relative_to(SOURCES / package).with_suffix("").parts
            if "ros" in parts or "cli" in parts or parts[-1] == "__main__":
                continue
            if parts[-1] == "__init__":
                parts = parts[:-1]
            page.append(f"::: {'.'.join(parts)}\n")
    return "\n".join(page)


def carried(distribution: str, name: str) -> str:
    """Return the text of a file that an installed distribution carries.

    Raises:
        FileNotFoundError: it carries none of that name.
    """
    for path in files(distribution) or []:
        if path.name == name:
            return Path(str(path.locate())).read_text()
    raise FileNotFoundError(f"{distribution} carries no {name}")


PAGES = {
    "reference/interface.md": interface(),
    "reference/parameters.md": parameters(),
    "reference/api.md": api(),
    "assets/katex.min.js": carried("sphinxcontrib-katex", "katex.min.js"),
}
for name, text in PAGES.items():
    with mkdocs_gen_files.open(name, "w") as file:
        file.write(text)
