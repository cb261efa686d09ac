"""A reduced model is the full one: closed forms, sums, and a platform that carries it."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh
from tests.plant.testbeds.spacecraft.finite_elements.frames import (
    ANGLE,
    BEAM,
    Array,
    arrays,
    saved,
)
from tests.plant.testbeds.spacecraft.finite_elements.platforms import (
    PLATFORM,
    craft,
    free_frequencies,
    platform_matrix,
)
from tests.present import present

from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportOptions,
    import_model,
)

CANTILEVER = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])


def test_a_cantilever_has_its_closed_form_frequencies_and_effective_masses(tmp_path: Path) -> None:
    found = import_model(saved(tmp_path, **arrays(BEAM, 30)), ImportOptions(modes=7))
    hertz = np.array(found.content["frequencies_hz"])
    across = [CANTILEVER**2 * np.sqrt(ei / 0.8) / 4.0 / (2.0 * np.pi) for ei in (90.0, 250.0)]
    twist = np.sqrt(60.0 / 2e-3) / 2.0 / 4.0
    exact = np.sort([*np.concatenate(across), twist])
    np.testing.assert_allclose(hertz, exact, rtol=2e-4)
    share = found.reduction.effective_mass
    bends = np.flatnonzero(share[2] > 1e-9)  # along z
    np.testing.assert_allclose(share[2, bends], [0.6131, 0.1883, 0.0647], atol=2e-4)
    assert abs(share[3, int(np.argmin(abs(hertz - twist)))] - 8.0 / np.pi**2) < 1e-3
    assert found.doubts == []


def test_rigid_sums_are_those_of_the_frame_about_the_clamp(tmp_path: Path) -> None:
    rigid = import_model(saved(tmp_path, **arrays(ANGLE, 8)), ImportOptions(modes=4)).content[
        "rigid"
    ]
    places = np.array(ANGLE) - ANGLE[0]
    mass, first, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for a, b in pairwise(places):
        length = float(np.linalg.norm(b - a))
        m, along = 0.8 * length, (b - a) / length
        second = (
            m * (np.outer(a, a) + np.outer(b, b) + 0.5 * (np.outer(a, b) + np.outer(b, a))) / 3.0
        )
        mass, first = mass + m, first + m * (a + b) / 2.0
        inertia += np.trace(second) * np.eye(3) - second + 2e-3 * length * np.outer(along, along)
    assert rigid["mass"] == pytest.approx(mass)
    np.testing.assert_allclose(rigid["first_moment"], first, atol=1e-9)
    np.testing.assert_allclose(rigid["inertia"], inertia, atol=1e-9)


def assembled(data: dict[str, Any], platform: dict[str, Any]) -> Array:
    """Return the same of the whole model with the platform's matrix at its first node [Hz]."""
    whole = data["M"].copy()
    whole[:6, :6] += platform_matrix(platform)
    squares = eigh(data["K"], whole, eigvals_only=True)
    assert (abs(squares[:6]) < 1e-6 * squares[6]).all()
    return np.sqrt(squares[6:]) / (2.0 * np.pi)


@pytest.mark.parametrize("corners", [BEAM, ANGLE], ids=["beam", "angle"])
def test_a_floating_spacecraft_has_the_frequencies_of_the_whole_model(
    tmp_path: Path, corners: list[list[float]]
) -> None:
    """Within 0.1 % up to half of the highest mode that is kept."""
    data = arrays(corners)
    shape = {"kind": "finite_elements", "file": str(saved(tmp_path, **data)), "modes": 10}
    found, exact = free_frequencies(craft(shape)), assembled(data, PLATFORM)
    highest = import_model(tmp_path / "model.npz", ImportOptions(modes=10)).content[
        "frequencies_hz"
    ][-1]
    count = int((exact < 0.5 * highest).sum())
    assert count >= 4
    np.testing.assert_allclose(found[:count], exact[:count], rtol=1e-3)


def test_a_whole_craft_is_a_model_on_a_platform_of_almost_no_mass(tmp_path: Path) -> None:
    data = arrays(ANGLE)
    data["M"][:6, :6] += np.diag([9.0, 9.0, 9.0, 4.0, 4.0, 4.0])  # its bus, in the model itself
    shape = {"kind": "finite_elements", "file": str(saved(tmp_path, **data)), "modes": 10}
    tiny = {"mass": 1e-3, "inertia": dict.fromkeys(("xx", "yy", "zz"), 1e-3)}
    found, exact = free_frequencies(craft(shape, tiny)), assembled(data, tiny)
    np.testing.assert_allclose(found[:4], exact[:4], rtol=1e-3)


def test_matrices_of_a_rigid_interface_need_no_nodes(tmp_path: Path) -> None:
    """Craig-Bampton matrices of the same frame: six rows of the interface, then modes."""
    data = arrays(ANGLE)
    one = import_model(saved(tmp_path, **data), ImportOptions(modes=6))
    inner = slice(6, None)
    static = np.vstack((np.eye(6), -np.linalg.solve(data["K"][inner, inner], data["K"][inner, :6])))
    _, modes = eigh(data["K"][inner, inner], data["M"][inner, inner])
    basis = np.hstack((static, np.vstack((np.zeros((6, 20)), modes[:, :20]))))
    reduced = {name: basis.T @ data[name] @ basis for name in ("M", "K")}
    other = import_model(saved(tmp_path, **reduced, boundary=np.arange(6)), ImportOptions(modes=6))
    for key in ("frequencies_hz", "translation", "rotation"):
        found, expected = (abs(np.array(content[key])) for content in (other.content, one.content))
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(
        other.content["rigid"]["inertia"], one.content["rigid"]["inertia"], rtol=1e-6
    )
    assert "points" not in other.content


@pytest.mark.parametrize("elements", [10, 130])
def test_dense_and_sparse_models_have_the_same_modes(tmp_path: Path, elements: int) -> None:
    """Small models are solved whole, larger ones by Lanczos' method from one start."""
    found = import_model(saved(tmp_path, **arrays(BEAM, elements)), ImportOptions(modes=6))
    exact = CANTILEVER[0] ** 2 * np.sqrt(90.0 / 0.8) / 4.0 / (2.0 * np.pi)
    assert found.content["frequencies_hz"][0] == pytest.approx(exact, rel=1e-4)
    assert present(found.reduction.residual) < 1e-6
    m = found.reduction.shapes.T @ (found.model.mass @ found.reduction.shapes)
    np.testing.assert_allclose(m, np.eye(6), atol=1e-6)


def test_a_model_in_mm_and_tonnes_is_the_same_as_in_si(tmp_path: Path) -> None:
    data = arrays(ANGLE)
    one = import_model(saved(tmp_path, **data), ImportOptions(modes=4)).content
    scale = np.tile(np.repeat([1e-3, 1.0], 3), len(data["nodes"]))  # of (mm, rad) in (m, rad)
    energy = 1e3 * 1e-6  # t mm^2/s^2
    data |= {name: scale[:, None] * data[name] * scale / energy for name in ("M", "K")}
    data["nodes"] = data["nodes"] * 1e3
    path = saved(tmp_path, **data)
    other = import_model(path, ImportOptions(modes=4, units="mm_t_s"))
    assert other.doubts == []
    for key in ("frequencies_hz", "translation", "rotation", "points", "masses"):
        np.testing.assert_allclose(other.content[key], one[key], rtol=1e-6, atol=1e-7)
    (doubt,) = import_model(path, ImportOptions(modes=4)).doubts
    assert "--units" in doubt


def test_damping_of_the_model_is_that_of_its_modes(tmp_path: Path) -> None:
    data = arrays(BEAM)
    path = saved(tmp_path, **data, C=0.3 * data["M"] + 1e-5 * data["K"])
    found = import_model(path, ImportOptions(modes=4))
    omega = found.reduction.frequencies
    np.testing.assert_allclose(
        found.content["damping_ratios"], 0.15 / omega + 0.5e-5 * omega, rtol=1e-6
    )
    assert (
        import_model(path, ImportOptions(modes=4, damping=0.02)).content["damping_ratios"]
        == [0.02] * 4
    )


def test_planes_numbers_and_the_file_name_the_same_boundary(tmp_path: Path) -> None:
    path = saved(tmp_path, **arrays(BEAM))
    by = [import_model(path, ImportOptions(entries, 3)).content["frequencies_hz"]
          for entries in ((), ("1",), ("x=0",), ("1-1", "x=0"))]  # fmt: skip
    assert by[0] == by[1] == by[2] == by[3]


@pytest.mark.parametrize("parts", [0.04, 0.08])
def test_a_weak_support_that_is_left_gives_a_warning_with_its_size(
    tmp_path: Path, parts: float
) -> None:
    """A spring to the ground lets a rigid motion swing with a part of the first frequency."""
    data = arrays(BEAM)
    free = import_model(saved(tmp_path, **data), ImportOptions(modes=3))
    first, rigid = free.reduction.frequencies[0], free.reduction.rigid
    data["K"][2, 2] += (parts * first) ** 2 / np.linalg.inv(rigid)[2, 2]  # at the root, along z
    (doubt,) = import_model(saved(tmp_path, **data), ImportOptions(modes=3)).doubts
    assert f"{parts:.2g} of the first frequency" in doubt
