"""A plan as a file that people can read: provenance first, then the arrays, exact."""

import hashlib
import json
import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from flexslew_control.plan import Plan
from flexslew_plant.errors import BadInput
from flexslew_plant.given_file import given_text
from flexslew_plant.yaml_data import YamlDumper, load_yaml

VERSION = 1  # of the layout of the file
_ARRAYS = ("position", "velocity", "effort", "state")
_GAINS = "gains"  # an array that most plans, their files and their hashes lack


def plan_hash(plan: Plan) -> str:
    """Return the SHA-256 of a plan's request and arrays, in hexadecimal.

    Over the canonical JSON of method, names, times and request, then the bytes of every array,
    little-endian float64. Summary and versions do not count: they describe how it was made.
    """
    head = {
        "method": plan.method,
        "joint_names": list(plan.joint_names),
        "start": plan.start,
        "period": plan.period,
        "duration": plan.duration,
        "request": plan.request,
    }
    digest = hashlib.sha256(json.dumps(head, sort_keys=True, separators=(",", ":")).encode())
    for name in _arrays(plan):
        array = getattr(plan, name)
        digest.update(json.dumps([name, *array.shape]).encode())
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()


def save_plan(plan: Plan, path: Path | str) -> None:
    """Write the plan as YAML, whole or not at all."""
    content: dict[str, Any] = {
        "flexslew_plan": VERSION,
        "hash": plan_hash(plan),
        "method": plan.method,
        "request": plan.request,
        "summary": plan.summary,
        "versions": plan.versions,
        "joint_names": list(plan.joint_names),
        "start": plan.start,
        "period": plan.period,
        "duration": plan.duration,
    }
    content |= {name: getattr(plan, name).tolist() for name in _arrays(plan)}
    target = Path(path)
    partial = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with partial.open("w", encoding="utf-8") as file:
            yaml.dump(content, file, Dumper=YamlDumper, sort_keys=False, default_flow_style=None)
        partial.replace(target)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise BadInput(f"{target}: cannot be written: {error.strerror}") from None


def load_plan(path: Path | str) -> Plan:
    """Return the plan in a file.

    Raises:
        BadInput: there is no such file, or it is no whole and unaltered plan.
    """
    content = load_yaml(given_text(path), str(path))
    if not isinstance(content, dict) or "flexslew_plan" not in content:
        raise BadInput("is not a plan: the key flexslew_plan is missing", path)
    if content["flexslew_plan"] != VERSION:
        raise BadInput(
            f"only version {VERSION} is known; plan again",
            path,
            "flexslew_plan",
            content["flexslew_plan"],
        )
    unknown = sorted(map(str, set(content) - {"flexslew_plan", "hash", *_names(), _GAINS}))
    if unknown:
        raise BadInput(f"unknown key; allowed: {', '.join(_names())}", path, unknown[0])
    missing = [name for name in ("hash", *_names()) if name not in content]
    if missing:
        raise BadInput(f"is damaged: missing {', '.join(missing)}; plan again", path)
    try:
        plan = _read(content)
        found = plan_hash(plan)
    except (TypeError, ValueError):
        raise BadInput("is damaged: wrong kinds of values; plan again", path) from None
    if found != content["hash"]:
        raise BadInput("is damaged: its hash does not fit its content; plan again", path)
    return plan


def _arrays(plan: Plan) -> tuple[str, ...]:
    return (*_ARRAYS, _GAINS) if plan.gains.size else _ARRAYS


def _names() -> list[str]:
    return [entry.name for entry in fields(Plan) if entry.name != _GAINS]


def _read(content: dict[str, Any]) -> Plan:
    """Return the plan of a file's content, checked only for what numpy and hashing need."""
    values = {name: content[name] for name in _names()}
    joints = len(values["joint_names"])
    for name in _ARRAYS:
        array = np.array(values[name], dtype=np.float64)
        values[name] = array if array.ndim == 2 else array.reshape(0, joints)
    if _GAINS in content:
        values[_GAINS] = np.array(content[_GAINS], dtype=np.float64)
    values["joint_names"] = tuple(values["joint_names"])
    return Plan(**values)
