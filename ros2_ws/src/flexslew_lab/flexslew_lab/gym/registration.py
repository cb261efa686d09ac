"""Names under which Gymnasium finds the tasks: some-task of version 1 is flexslew/SomeTask-v1."""

import re
from importlib import resources

import gymnasium

_VERSION = re.compile(r"^version: *(\d+)", re.MULTILINE)


def register_tasks() -> None:
    """Register an environment for each benchmark task; the entry point of the package."""
    for name, version in _tasks():
        env_id = environment_id(name, version)
        if env_id in gymnasium.registry:
            continue
        gymnasium.register(
            id=env_id,
            entry_point="flexslew_lab.gym.environment:SlewEnvironment",
            vector_entry_point="flexslew_lab.gym.vector:VectorSlew",
            kwargs={"task": name},
        )


def environment_id(task: str, version: int) -> str:
    """Return the name of a task's environment."""
    camel = "".join(part.capitalize() for part in task.split("-"))
    return f"flexslew/{camel}-v{version}"


def _tasks() -> list[tuple[str, int]]:
    """Return names and versions of all tasks from their files; no task is loaded for it."""
    folder = resources.files("flexslew_lab") / "benchmark" / "tasks"
    found = []
    for file in sorted(folder.iterdir(), key=lambda one: one.name):
        version = _VERSION.search(file.read_text(encoding="utf-8"))
        if file.name.endswith(".yaml") and version is not None:
            found.append((file.name.removesuffix(".yaml").replace("_", "-"), int(version[1])))
    return found
