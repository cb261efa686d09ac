from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from tests.plants import plant

from flexslew_control.planners import make_plan
from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_control.planners.reference import NoPlan, ReferenceOnly
from flexslew_control.plans.plan_file import load_plan, plan_hash, save_plan
from flexslew_plant.errors import BadInput

SECTIONS = [NoPlan(), ReferenceOnly(), OptimizedFeedforward()]


@pytest.fixture(scope="module", params=SECTIONS, ids=lambda s: s.method)
def plan(request: pytest.FixtureRequest) -> Any:
    return make_plan(request.param, plant(0.05, [150.0, 150.0]))


def test_a_plan_survives_its_file_bit_for_bit(plan: Any, tmp_path: Path) -> None:
    save_plan(plan, tmp_path / "plan.yaml")
    loaded = load_plan(tmp_path / "plan.yaml")
    for name in ("position", "velocity", "effort", "state"):
        assert getattr(loaded, name).shape == getattr(plan, name).shape
        np.testing.assert_array_equal(getattr(loaded, name), getattr(plan, name))
    assert (loaded.request, loaded.summary) == (plan.request, plan.summary)
    assert (loaded.versions, loaded.joint_names) == (plan.versions, plan.joint_names)
    assert plan_hash(loaded) == plan_hash(plan)
    assert [p.name for p in tmp_path.iterdir()] == ["plan.yaml"]


def test_hash_sees_every_array_and_the_request(plan: Any) -> None:
    seen = {plan_hash(plan)}
    for name in ("position", "velocity"):
        array = getattr(plan, name).copy()
        array[-1, 0] = np.nextafter(array[-1, 0], 2.0)
        seen.add(plan_hash(replace(plan, **{name: array})))
    seen.add(plan_hash(replace(plan, request=plan.request | {"start": 1.0})))
    seen.add(plan_hash(replace(plan, start=1.0)))
    assert len(seen) == 5


def altered(plan: Any, path: Any, change: Any) -> Any:
    save_plan(plan, path)
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content))
    return path


def set_first(content: Any) -> None:
    content["position"][0][0] += 1e-9


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (set_first, "does not fit its content"),
        (lambda c: c.pop("effort"), "missing effort"),
        (lambda c: c.pop("hash"), "missing hash"),
        (lambda c: c.update(flexslew_plan=99), "99 is not allowed"),
        (lambda c: c.pop("flexslew_plan"), "is not a plan"),
        (lambda c: c.update(position="x"), "wrong kinds"),
        (lambda c: c.update(no_such_name=1.0), "no_such_name: unknown key; allowed: method"),
        (lambda c: c.update(joint_names=3), "wrong kinds"),
    ],
)
def test_an_altered_file_is_refused_by_name(tmp_path: Path, change: Any, words: str) -> None:
    path = altered(make_plan(NoPlan(), plant(0.05, [1.0, 1.0])), tmp_path / "p.yaml", change)
    with pytest.raises(BadInput, match=words) as caught:
        load_plan(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("text", ["{", "[1, 2]", "", "\x00"])
def test_what_is_no_plan_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "p.yaml").write_text(text)
    with pytest.raises(BadInput, match=r"p\.yaml"):
        load_plan(tmp_path / "p.yaml")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="No such file"):
        load_plan(tmp_path / "none.yaml")


def test_an_unwritable_place_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="cannot be written"):
        save_plan(make_plan(NoPlan(), plant(0.05, [1.0, 1.0])), tmp_path / "none" / "p.yaml")
