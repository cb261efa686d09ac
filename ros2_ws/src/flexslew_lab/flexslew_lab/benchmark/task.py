"""A frozen benchmark problem: its nominal trial, the members of its ensemble, and their seeds.

A member is drawn from its seed alone, so that a single member can be simulated again. The draws
are those of the studies (`studies.sampling`).
"""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from flexslew_lab.benchmark.task_settings import Requirement, TaskSettings, Term
from flexslew_lab.studies.cases import Case, case_trial, trial_seed
from flexslew_lab.studies.sampling.methods import Sampling, draw_samples
from flexslew_lab.studies.study import Study, study_of_values
from flexslew_lab.trial.own_code import texts_in
from flexslew_lab.trial.trial import Trial, checked_trial, trial_of_values
from flexslew_plant.errors import BadInput
from flexslew_plant.near_names import spelling_hint
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.settings import plain, validated
from flexslew_plant.yaml_data import load_yaml

MODELS = 1  # version of models and metrics: a new one when any frozen result changes
ENTRY_SECTIONS = ("controllers", "active", "plan")  # sections of the trial that an entry sets
_FOLDER = Path(str(resources.files("flexslew_lab"))) / "benchmark" / "tasks"
_ONE = Sampling(method="random", n=1)
_SHIPPED_FILES = Trust(files=False)  # a file of that name in the working directory does not count
_SEED_BYTES = 4  # of an evaluation seed


class Allowed(NamedTuple):
    """What a controller of a task receives, and what it may answer."""

    joints: tuple[str, ...]  # whose positions and velocities are measured
    units: tuple[str, ...]  # of these positions
    tips: tuple[str, ...]  # whose deflections are measured
    effort_limit: tuple[float, ...]  # largest |effort| of each actuator [N m or N]
    period: float  # of a tick [s]


@dataclass(frozen=True)
class Task:
    """One frozen benchmark problem.

    Args:
        name: with hyphens, such as csa-slew.
        version: of the task.
        about: one sentence.
        path: of its file.
        trial: the nominal trial with the baseline controller and its plan.
        ensemble: what differs from member to member, as `vary` of a study file.
        count: members of the development seeds, and of an evaluation round.
        score: terms by metric.
        require: bounds by metric.
    """

    name: str
    version: int
    about: str
    path: Path
    trial: Trial
    ensemble: dict[str, dict[str, Any]]
    count: int
    score: dict[str, Term]
    require: dict[str, Requirement]

    @cached_property
    def study(self) -> Study:
        """The baseline as a study of the ensemble."""
        return entry_study(self, {})

    @property
    def allowed(self) -> Allowed:
        """What a controller may see: measured joints and tips, the reference, period, limits."""
        model = self.trial.testbed.model()
        names = tuple(model.joint_names)
        return Allowed(
            names,
            tuple(model.units_by_joint[name] for name in names),
            tuple(model.appendages.names),
            tuple(map(float, self.trial.testbed.effort_limit)),
            self.trial.period,
        )


def task_names() -> list[str]:
    """Return the names of all tasks."""
    return sorted(path.stem.replace("_", "-") for path in _FOLDER.glob("*.yaml"))


def load_task(name: str) -> Task:
    """Return the task of a name.

    Raises:
        BadInput: there is no such task; the message names all of them.
    """
    if name not in task_names():
        known = task_names()
        raise BadInput(
            f"is no benchmark task; {spelling_hint(name, known)}allowed: {', '.join(known)}", name
        )
    path = _FOLDER / f"{name.replace('-', '_')}.yaml"
    text = path.read_text(encoding="utf-8")
    settings: TaskSettings = validated(TaskSettings, load_yaml(text, str(path)), str(path))
    source = f"{name}: trial"
    trial = checked_trial(trial_of_values(settings.trial, source, _SHIPPED_FILES), source)
    return Task(
        settings.task,
        settings.version,
        text.splitlines()[0].lstrip("# "),
        path,
        trial,
        settings.vary,
        settings.members,
        settings.score,
        settings.require,
    )


def entry_study(task: Task, entry: dict[str, Any], trust: Trust = NO_CODE) -> Study:
    """Return the study that flies an entry on a task's ensemble.

    Planners and laws are designed for the nominal trial (`replan: false`), classes of the user's
    own as well (`conceals_bench`).

    Args:
        task: the benchmark problem.
        entry: sections of the trial that replace the baseline's, of ENTRY_SECTIONS.
        trust: classes of the user's own that the entry may name.

    Raises:
        BadInput: if the entry sets anything else, or its values are not allowed.
    """
    for key in entry:
        if key not in ENTRY_SECTIONS:
            words = f"is fixed by {task.name}; an entry sets {', '.join(ENTRY_SECTIONS)}"
            raise BadInput(f"{key} {words}", "entry")
    source = f"{task.name}: entry"
    trial = checked_trial(trial_of_values(plain(task.trial) | entry, source, trust), source)
    values = {"study": task.name, "trial": task.name, "vary": task.ensemble, "replan": False}
    study = study_of_values(values, task.name, task.path.parent, trust, trial)
    return study._replace(conceals_bench=True)


def member_case(study: Study, seed: int) -> Case:
    """Return the member of a seed: its number is the seed, its draws depend on nothing else."""
    spread = [v.distribution for v in study.varied if v.distribution is not None]
    unit = draw_samples(_ONE, spread, seed).unit[0]
    drawn = tuple(one.at(unit[k : k + 1]).tolist()[0] for k, one in enumerate(spread))
    return Case(seed, 0, 0, trial_seed(seed, 0), drawn)


def members(task: Task, seeds: Sequence[int]) -> list[Trial]:
    """Return the trials of a task with its baseline, one per seed: the same for the same seed."""
    return [case_trial(task.study, member_case(task.study, seed)) for seed in seeds]


def development_seeds(task: Task) -> range:
    """Return the public seeds, on which entries are developed."""
    return range(1, 1 + task.count)


def evaluation_seeds(task: Task, round_name: str) -> list[int]:
    """Return the seeds of a round, which no entrant can choose.

    Each is from the SHA-256 of task hash, round and number.

    Args:
        task: the benchmark problem.
        round_name: a text that is published after the entries are in.

    Raises:
        BadInput: the text is empty.
    """
    if not round_name.strip():
        raise BadInput("give the published text of the round", key="--round", value=round_name)
    seeds: dict[int, None] = {}
    number = 0
    while len(seeds) < task.count:
        text = f"{task_hash(task)}\n{round_name}\n{number}"
        digest = hashlib.sha256(text.encode()).digest()
        seeds[int.from_bytes(digest[:_SEED_BYTES], "little")] = None
        number += 1
    return list(seeds)


def task_hash(task: Task) -> str:
    """Return the SHA-256 of a task's file, the data files of its trial, and MODELS.

    The trial of a task names its shipped data by absolute paths, see load_task.
    """
    digest = hashlib.sha256(f"models {MODELS}\n".encode())
    texts = {text for text in texts_in(plain(task.trial)) if os.path.isabs(text)}
    data = sorted(filter(os.path.isfile, texts))
    for path in (task.path, *map(Path, data)):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()
