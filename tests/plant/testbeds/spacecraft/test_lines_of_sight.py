"""Where antennas look: the hinges of the plant itself, and closed forms."""

from inspect import unwrap
from typing import Any

import numpy as np
import pytest

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.hinge_motion import prescribed
from flexslew_plant.testbeds.spacecraft.lines_of_sight import (
    hinge_axes_and_angle,
    target_directions,
)
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

TABLE = [[0.0, 0.0, 0.0, 0.0], [0.4, 0.3, 1.4, 0.5], [1.0, 1.0, 0.0, 0.0]]


def antenna(seed: int) -> SpacecraftTestbed:
    """Return antenna_4 with three turns in every profile, about axes of their own."""
    rng = np.random.default_rng(seed)
    turns: list[dict[str, Any]] = []
    begin = 0.0
    for profile in rng.permutation(["smooth", "bang_bang", "table"]).tolist():
        begin += float(rng.uniform(0.0, 0.5))
        duration = float(rng.uniform(0.3, 1.5))
        turns.append(
            {
                "at": begin, "duration": duration, "to": float(rng.uniform(-1.5, 1.5)),
                "profile": profile, "axis": rng.standard_normal(3).tolist(),
                "table": TABLE if profile == "table" else [],
            }
        )  # fmt: skip
        begin += duration
    values = {"testbed": {"appendages": {"beam": {"hinge": {"motion": turns}}}}}
    testbed = example_trial("antenna_4", values).testbed
    assert isinstance(testbed, SpacecraftTestbed)
    return testbed


@pytest.mark.parametrize("seed", range(4))
def test_hinges_are_drawn_and_measured_where_the_plant_turns_them(seed: int) -> None:
    craft = antenna(seed).craft
    [beam] = craft.appendages
    p, turn = packed(craft), unwrap(prescribed)
    times = np.sort(np.random.default_rng(seed).uniform(-0.2, 7.0, 60))
    axes, angle = hinge_axes_and_angle(beam, times)
    block = int(p[int(p[at.APPENDAGE_TABLE])])
    for t, e in zip(times.tolist(), axes, strict=True):
        np.testing.assert_allclose(e.ravel(), turn(p, block, t)[0], atol=1e-12)
    assert angle[-1] == pytest.approx(sum(m.angle for m in beam.manoeuvres))


@pytest.mark.parametrize("seed", range(4))
def test_an_antenna_at_rest_looks_at_its_target(seed: int) -> None:
    testbed = antenna(seed)
    [beam] = testbed.craft.appendages
    ends = np.array([m.begin + m.duration for m in beam.manoeuvres])
    axes, _ = hinge_axes_and_angle(beam, ends)
    np.testing.assert_allclose(axes[:, 2], target_directions(beam, ends), atol=1e-12)
    q = np.tile(testbed.model().rest({}), (len(ends), 1))
    sight = testbed.lines_of_sight(ends, q, {})["beam"]
    np.testing.assert_allclose(sight.error, 0.0, atol=1e-12)
    assert sight.rests.all()


def test_the_scene_turns_an_antenna_and_aims_at_its_target() -> None:
    testbed = example_trial("antenna_5_1").testbed  # turns by 45 deg about x in 3 s
    scene, rest = testbed.scene(), testbed.model().rest({})
    for t, angle in ((0.0, 0.0), (1.5, np.pi / 8), (3.0, np.pi / 4), (9.0, np.pi / 4)):
        [turned] = [f for f in scene.frames_at(rest, t) if f.child == "membrane"]
        np.testing.assert_allclose(
            turned.rotation, [np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)], atol=1e-12
        )
    assert scene.aims is not None
    [aim] = scene.aims(0.1)
    assert aim.frame == "membrane"
    np.testing.assert_allclose(aim.target, [0.0, -np.sqrt(0.5), np.sqrt(0.5)], atol=1e-12)


def test_a_heavier_platform_adds_its_share_to_the_mass_matrix() -> None:
    testbed = antenna(0)
    rest = testbed.model().rest({})
    one, more, most = (testbed.heavier(f).model().mass_matrix(rest) for f in (1.0, 1.5, 2.0))
    np.testing.assert_allclose(most - one, 2.0 * (more - one), atol=1e-9)
    np.testing.assert_allclose(one, testbed.model().mass_matrix(rest))
    assert np.diag(most - one)[:3] == pytest.approx([testbed.craft.mass] * 3)
