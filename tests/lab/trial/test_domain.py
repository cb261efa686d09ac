import os
from pathlib import Path

import pytest

from flexslew_lab.trial import domain
from flexslew_plant.errors import BadInput, FlexslewError


@pytest.fixture(autouse=True)
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the locks of other runs out of sight."""
    monkeypatch.setattr(domain, "_folder", lambda: tmp_path)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)


def test_a_run_leaves_its_domain_for_those_who_look_for_it() -> None:
    assert domain.domains_in_use() == {}
    assert domain.bench_domain() == (0, False)
    with domain.own_domain("m1") as first:
        assert domain.domains_in_use() == {first: "m1"}
        assert domain.bench_domain() == (first, True)
        with domain.own_domain("swap_demo") as second:
            assert second != first
            assert domain.domains_in_use() == {first: "m1", second: "swap_demo"}
            with pytest.raises(FlexslewError, match=rf"{first} \(m1\), {second} \(swap_demo\)"):
                domain.bench_domain()
    assert domain.domains_in_use() == {}


def test_the_users_own_domain_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    with domain.own_domain("m1") as first:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(first + 1))
        assert domain.bench_domain() == (first + 1, False)
        with domain.own_domain("mine") as wanted:
            assert wanted == first + 1
            assert domain.bench_domain() == (first + 1, True)


@pytest.mark.parametrize("wanted", ["x", "-1", "233", "1.5"])
def test_a_domain_that_is_none_is_told(monkeypatch: pytest.MonkeyPatch, wanted: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", wanted)
    with pytest.raises(BadInput, match="ROS_DOMAIN_ID: "), domain.own_domain():
        pass


def test_a_lock_of_a_run_that_was_killed_counts_no_more(tmp_path: Path) -> None:
    (tmp_path / "flexslew_domain_7.lock").write_text("gone")
    assert domain.domains_in_use() == {}
    with domain.own_domain("m1") as number:
        assert number == 1
        assert os.listdir(tmp_path)
