"""Tasks as environments: the rules of Gymnasium, and a batch that is its members one by one."""

import json
import tomllib
import warnings
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402
from tests.lab.gym.bench_environment import BenchEnvironment  # noqa: E402
from tests.present import present  # noqa: E402

from flexslew_lab.benchmark.task import development_seeds, load_task, task_names  # noqa: E402
from flexslew_lab.gym.environment import SlewEnvironment  # noqa: E402
from flexslew_lab.gym.registration import environment_id, register_tasks  # noqa: E402
from flexslew_lab.gym.vector import VectorSlew  # noqa: E402
from flexslew_plant.errors import BadInput  # noqa: E402

ROOT = Path(__file__).parents[3]
TASK = "csa-slew"
BASE: dict[str, Any] = {"base": {"kp": [460.0, 460.0], "kd": [920.0, 920.0]}, "authority": 0.2}
TOLERANCE = 1e-9
TICKS = 200
FLOWN = [
    (TASK, BASE),
    (TASK, {}),
    ("acc", {"authority": 0.1}),
    *(
        pytest.param(task, {"authority": 0.1}, marks=pytest.mark.slow)
        for task in ("antenna", "observatory-pointing", "scole", "three-axis-slew")
    ),
]


def test_an_environment_follows_the_rules_of_gymnasium() -> None:
    register_tasks()
    env = gymnasium.make("flexslew/CsaSlew-v1", render_mode="rgb_array", **BASE)
    check_env(env.unwrapped, skip_render_check=True)
    picture: Any = env.unwrapped.render()
    assert picture.dtype == np.uint8
    assert picture.shape[2] == 3
    assert picture.std() > 1.0  # not blank


def test_an_environment_follows_the_rules_of_stable_baselines3() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(SlewEnvironment(TASK, render_mode="rgb_array"))


def test_every_task_is_registered_with_its_version() -> None:
    register_tasks()
    for name in task_names():
        spec = gymnasium.spec(environment_id(name, load_task(name).version))
        assert spec.kwargs == {"task": name}


def test_the_package_names_the_entry_point_of_gymnasium() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    place = project["entry-points"]["gymnasium.envs"]["flexslew"]
    assert place == f"{register_tasks.__module__}:{register_tasks.__name__}"
    assert f"flexslew = {place}" in (ROOT / "ros2_ws/src/flexslew_lab/setup.py").read_text()


def test_the_same_seed_gives_the_same_bits() -> None:
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (TICKS, 2))
    found = []
    for _ in range(2):
        env = SlewEnvironment(TASK, **BASE)
        first, info = env.reset(seed=7)
        steps = [env.step(action)[:2] for action in actions]
        found.append((info["member"], first.tobytes(), [(o.tobytes(), r) for o, r in steps]))
    assert found[0] == found[1]


@pytest.mark.parametrize(("task", "settings"), FLOWN, ids=str)
def test_members_of_a_batch_are_those_of_the_bench_with_the_same_seeds(
    task: str, settings: dict[str, Any]
) -> None:
    many, one = VectorSlew(66, task, **settings), SlewEnvironment(task, **settings)
    joints = present(many.single_action_space.shape)[0]
    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (TICKS, 66, joints))
    started, info = many.reset(seed=3)
    steps = [many.step(action) for action in actions]
    for member in (0, 65):
        first, own = one.reset(seed=3 + member)
        assert own["member"] == info["member"][member]
        bench = BenchEnvironment(task, settings, own["member"])
        np.testing.assert_allclose(started[member], bench.observation, atol=TOLERANCE)
        np.testing.assert_allclose(first, bench.observation, atol=TOLERANCE)
        for (observed, reward, *_), action in zip(steps, actions[:, member], strict=True):
            theirs, growth, *_ = one.step(action)
            on_bench = bench.step(action)
            for found in (theirs, observed[member]):
                np.testing.assert_allclose(found, bench.observation, rtol=TOLERANCE, atol=TOLERANCE)
            assert (growth, reward[member]) == pytest.approx((on_bench, on_bench), abs=1e-6)


def test_rewards_add_up_to_the_score_and_all_members_are_reset_after_the_end() -> None:
    many = VectorSlew(2, TASK, **BASE)
    _, before = many.reset(seed=1)
    total, over, info = np.zeros(2), np.zeros(2, np.bool_), dict[str, Any]()
    while not over.any():
        _, reward, ended, over, info = many.step(np.zeros((2, 2)))
        total += reward
        assert not ended.any()
    np.testing.assert_allclose(total, info["score"] - 100.0, atol=1e-9)
    assert info["failure"].tolist() == ["", ""]
    _, reward, _, over, after = many.step(np.zeros((2, 2)))
    assert not reward.any()
    assert not over.any()
    assert (before["member"] != after["member"]).all()


def test_the_score_of_an_environment_is_that_of_its_member_on_the_bench() -> None:
    env, bench = SlewEnvironment(TASK, **BASE), BenchEnvironment(TASK, BASE, 5)
    env.reset(options={"member": 5})
    total, over, info = 0.0, False, dict[str, Any]()
    while not over:
        bench.step(np.full(2, 0.05))
        _, reward, _, over, info = env.step(np.full(2, 0.05))
        total += reward
    assert total == pytest.approx(info["score"] - 100.0, abs=1e-9)
    assert bench.score() == pytest.approx(info["score"], abs=1e-9)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.zeros(3), r"shape \(3,\), expected \(2,\)"),
        ([0.0, np.nan], r"nan at \[1\]"),
        ("full", "no array of numbers"),
    ],
)
def test_an_action_that_cannot_act_is_refused(action: Any, words: str) -> None:
    env = SlewEnvironment(TASK, **BASE)
    env.reset(seed=1)
    with pytest.raises(BadInput, match=words):
        env.step(action)
    assert env.step(np.zeros(2))[4] == {}  # and changes nothing


def test_a_batch_names_the_member_whose_action_is_not_finite() -> None:
    many, actions = VectorSlew(3, TASK, **BASE), np.zeros((3, 2))
    many.reset(seed=1)
    actions[2, 1] = np.inf
    with pytest.raises(BadInput, match=r"inf at \[2, 1\]"):
        many.step(actions)


@pytest.mark.parametrize("kind", [SlewEnvironment, lambda task, **k: VectorSlew(2, task, **k)])
def test_what_is_not_known_is_refused(kind: Any) -> None:
    with pytest.raises(BadInput, match="no benchmark task"):
        kind("csa-sleww")
    with pytest.raises(BadInput, match="authority"):
        kind(TASK, authority=2.0)
    with pytest.raises(BadInput, match="kq"):
        kind(TASK, base={"kq": 1.0})
    with pytest.raises(BadInput, match="allowed: member"):
        kind(TASK).reset(options={"members": 1})
    with pytest.raises(BadInput, match="reset"):
        kind(TASK).step(np.zeros(2))


def test_the_policy_that_is_shipped_has_the_scores_that_are_stated() -> None:
    folder = ROOT / "docs" / "examples"
    spec = present(spec_from_file_location("learn_residual", folder / "learn_residual.py"))
    learned = module_from_spec(spec)
    present(spec.loader).exec_module(learned)
    stated = json.loads((folder / "learned" / "curve.json").read_text())
    policy = np.load(folder / "learned" / "policy.npz")["policy"]
    seeds = list(development_seeds(load_task(TASK)))
    env = VectorSlew(2 * len(seeds), TASK, **learned.SETTINGS)
    baseline, score = learned.scores(env, np.stack((np.zeros_like(policy), policy)), seeds)
    assert (baseline, score) == pytest.approx((stated["baseline"], stated["learned"]), abs=1e-6)
    assert score > baseline + 2.0
