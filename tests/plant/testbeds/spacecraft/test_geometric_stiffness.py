"""Spinning and accelerating appendages, beside chains of rigid links and closed forms."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.special import jn_zeros, jv, jvp
from tests.plant.testbeds.spacecraft.chain import Hub, small_motions

from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Model, read_testbed
from flexslew_plant.testbeds.spacecraft.settings import AppendageSettings, Beam
from flexslew_plant.testbeds.spacecraft.shapes.membrane import _stress
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

HUB = Hub(100.0, np.array([60.0, 70.0, 80.0]), 0.5, 10.0, 1.0, 500.0)
LONG: dict[str, Any] = {"length": 6.0, "linear_density": 0.4, "bending_stiffness": 90.0}
CLAMPED = 3.5160153 * np.sqrt(HUB.stiffness / HUB.linear_density) / HUB.length**2


def craft(hub: Hub, method: str = "finite_elements", **changes: Any) -> Model:
    """Return the same on the bench."""
    tip = {} if not hub.tip else {"tip_body": {"mass": hub.tip}}
    shape = {
        "kind": "beam",
        "method": method,
        "length": hub.length,
        "linear_density": hub.linear_density,
        "bending_stiffness": hub.stiffness,
        "across": [0.0, 1.0, 0.0],
        "modes": 6,
        "modes_across": 3,
        "modes_third": 3,
        **tip,
    }
    sides = {
        name: {
            "hinge": {"place": [side * hub.radius, 0.0, 0.0]},
            "shape": {**shape, "along": [side, 0.0, 0.0]},
            **changes,
        }
        for name, side in (("right", 1.0), ("left", -1.0))
    }
    inertia = dict(zip(("xx", "yy", "zz"), hub.inertia.tolist(), strict=True))
    platform = {"mass": hub.mass, "inertia": inertia}
    return read_testbed(
        {"kind": "spacecraft", "platform": platform, "appendages": sides}, "test"
    ).model()


def spinning(model: Model, spin: float) -> Vector:
    """Return a steady spin about z."""
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    x[model.positions + 5] = spin
    return x


def frequencies(matrix: Any) -> Vector:
    """Return what oscillates, rising [rad/s]."""
    found = np.linalg.eigvals(matrix)
    return np.sort(found.imag[found.imag > 0.05])


@pytest.mark.first(3)
@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 1.0])
@pytest.mark.parametrize(
    ("method", "tip"), [("finite_elements", 0.0), ("finite_elements", 2.0), ("closed_form", 0.0)]
)
def test_spinning_beams_have_the_frequencies_of_a_chain(
    share: float, method: str, tip: float
) -> None:
    hub = HUB._replace(tip=tip)
    model, spin = craft(hub, method), share * CLAMPED
    matrix = model.jacobian(spinning(model, spin), np.zeros(model.efforts))[0]
    expected = frequencies(small_motions(hub, spin))
    np.testing.assert_allclose(frequencies(matrix)[:9], expected[:9], rtol=0.01)
    assert np.linalg.eigvals(matrix).real.max() < 1e-6  # steady, as the chain is


def test_without_the_geometric_stiffness_a_spinning_beam_is_too_soft() -> None:
    model = craft(HUB, geometric_stiffness=False)
    found = frequencies(model.jacobian(spinning(model, CLAMPED), np.zeros(model.efforts))[0])
    expected = frequencies(small_motions(HUB, CLAMPED))
    assert abs(found[:6] / expected[:6] - 1.0).max() > 0.2


def test_a_beam_that_is_pushed_along_its_axis_buckles_where_a_column_does() -> None:
    # a column under its own weight: rho g L^3/EI = 7.8373 (Greenhill)
    values = {
        "kind": "spacecraft",
        "platform": {"mass": 1e9, "inertia": {"xx": 1e9, "yy": 1e9, "zz": 1e9}},
        "appendages": {
            "boom": {
                "shape": {
                    "kind": "beam",
                    "length": 4.0,
                    "linear_density": 0.5,
                    "bending_stiffness": 20.0,
                    "modes": 4,
                }
            }
        },
        "actuators": {"push": {"kind": "force", "direction": [0.0, 0.0, 1.0], "limit": 1e12}},
    }
    model = read_testbed(values, "test").model()
    critical = 7.8373 * 20.0 / (0.5 * 4.0**3)
    rest = np.concatenate((model.rest({}), np.zeros(model.coordinates)))

    def lowest(share: float) -> float:
        matrix = model.jacobian(rest, np.array([1e9 * share * critical]))[0]
        n = model.coordinates
        return float(np.linalg.eigvals(-matrix[n + 6 :, 6:n]).real.min())

    assert lowest(0.0) == pytest.approx((3.5160153 / 16.0) ** 2 * 40.0, rel=1e-3)
    assert lowest(0.99) > 0.0 > lowest(1.01)
    assert lowest(-1.0) > 1.5 * lowest(0.0)


def test_the_tension_of_a_spinning_membrane_is_that_of_a_disc_with_a_fixed_rim() -> None:
    radius, nu, places = 3.0, 0.3, np.random.default_rng(1).uniform(-1.5, 1.5, (20, 2))
    stress = _stress(places, radius, nu)
    spun = stress[:, 2] + stress[:, 5]  # x along x and y along y: w^2 r with w = 1
    r = np.linalg.norm(places, axis=1)
    along = np.einsum("ka,kab,kb->k", places, spun, places) / r**2
    expected = ((1.0 + nu) * radius**2 - (3.0 + nu) * r**2) / 8.0
    np.testing.assert_allclose(along, expected, rtol=1e-12)


def test_the_tension_of_a_membrane_balances_every_load() -> None:
    radius, change = 2.0, 1e-5
    places = np.random.default_rng(2).uniform(-1.0, 1.0, (10, 2))
    balance = np.zeros((10, 6, 2))
    for axis, step in enumerate(change * np.eye(2)):
        ahead, back = (_stress(places + sign * step, radius, 0.25) for sign in (1.0, -1.0))
        balance += (ahead - back)[..., axis, :] / (2.0 * change)
    x, y = places.T
    one, nothing = np.ones(10), np.zeros(10)
    loads = np.array(
        [[one, nothing], [nothing, one], [x, nothing], [nothing, x], [y, nothing], [nothing, y]]
    ).transpose(2, 0, 1)
    np.testing.assert_allclose(balance, -loads, atol=1e-8)


def test_a_spin_about_its_axis_stiffens_a_membrane_by_that_tension() -> None:
    shape = {"kind": "membrane", "radius": 3.0, "density": 0.01, "wave_speed": 2.0, "waves": 0}
    values = {
        "kind": "spacecraft",
        "platform": {"mass": 1e6, "inertia": {"xx": 1e6, "yy": 1e6, "zz": 1e6}},
        "appendages": {"sail": {"shape": {**shape, "rings": 1}}},
    }
    model, spin = read_testbed(values, "test").model(), 0.8
    found = frequencies(model.jacobian(spinning(model, spin), np.zeros(model.efforts))[0])[-1]
    zero, r = float(jn_zeros(0, 1)[0]), np.linspace(0.0, 3.0, 4001)
    size = 1.0 / (np.sqrt(np.pi * 0.01) * 3.0 * jv(1, zero))
    slope = size * zero / 3.0 * jvp(0, zero * r / 3.0)
    tension = 0.01 * spin**2 * (1.3 * 9.0 - 3.3 * r**2) / 8.0
    more = 2.0 * np.pi * np.trapezoid(tension * slope**2 * r, r)
    assert found == pytest.approx(np.sqrt((2.0 * zero / 3.0) ** 2 + more), rel=1e-4)


def test_modal_data_carry_a_geometric_stiffness_of_their_own(tmp_path: Path) -> None:
    bench = SpacecraftTestbed(
        appendages={"boom": AppendageSettings(shape=Beam(**LONG))}
    ).craft.appendages[0]
    i = bench.integrals
    assert i.shortening is not None
    data = {
        "frequencies_hz": (np.sqrt(bench.stiffness / bench.mass) / (2.0 * np.pi)).tolist(),
        "translation": i.translation.tolist(),
        "rotation": i.rotation.tolist(),
        "rigid": {
            "mass": i.mass,
            "first_moment": i.first.tolist(),
            "inertia": i.inertia.tolist(),
        },
        "geometric_stiffness": {
            "uniform": i.shortening.first.transpose(2, 0, 1).tolist(),
            "linear": i.shortening.second.transpose(3, 2, 0, 1).tolist(),
        },
    }
    (tmp_path / "boom.yaml").write_text(yaml.safe_dump(data))
    read = modal_shape(tmp_path / "boom.yaml").integrals.shortening
    assert read is not None
    np.testing.assert_allclose(read.first, i.shortening.first)
    np.testing.assert_allclose(read.second, i.shortening.second)
    del data["geometric_stiffness"]
    (tmp_path / "plain.yaml").write_text(yaml.safe_dump(data))
    asked = {"shape": {"kind": "modal_data", "file": str(tmp_path / "plain.yaml")}}
    with pytest.raises(BadInput, match="no key geometric_stiffness"):
        read_testbed(
            {
                "kind": "spacecraft",
                "appendages": {"boom": {**asked, "geometric_stiffness": True}},
            },
            "test",
        )
