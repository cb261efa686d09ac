"""Retargeting flexible antennas (Kwak 1989): the numbers of examples 1 to 5, and ours."""

from typing import Any

import numpy as np
from scipy.linalg import eigh

from flexslew_control.controllers.lqr import regulator
from flexslew_control.controllers.retargeting.disturbance_accommodating import (
    IntegralWeights,
    augmented,
)
from flexslew_control.controllers.retargeting.modal_space import modal_gains
from flexslew_lab.reproduce import antenna_flights as flights
from flexslew_lab.reproduce.antennas_figures import antennas_figures as antennas_figures
from flexslew_lab.reproduce.membrane_flights import half_way, membrane_peaks
from flexslew_lab.reproduce.planar_antenna import ROUNDED, Antenna, constant, rate_matrices
from flexslew_lab.reproduce.rows import absolute, relative
from flexslew_lab.reproduce.trial_flights import example_trial_rows
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.beam import wave_numbers
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape
from flexslew_plant.testbeds.spacecraft.units import UNITS

NOT_AVAILABLE = "not printed"
_ONE = 0.01  # of a peak
_COEFFICIENTS = (  # C_j of (4-1), phi-bar / m and phi-tilde / (m l) of Appendix D
    ((0.7341, 0.734096), (0.783, 0.782992), (0.569, 0.568826)),
    ((1.0185, 1.018467), (0.434, 0.433936), (0.091, 0.090767)),
    ((0.9992, 0.999224), (0.254, 0.254425), (0.032, 0.032416)),
    ((1.0, 1.000034), (0.182, 0.181898), (0.017, 0.016542)),
    ((1.0, 0.999999), (0.141, 0.141471), (0.010, 0.010007)),
)
# beta_j l of (4-1) as printed, and the roots of cosh x cos x = -1
_WAVE_NUMBERS = (
    ("1.8751", 1.875104069), ("4.6941", 4.694091133), ("7.8548", 7.854757438),
    ("10.9955", 10.995540735), ("14.1732, a misprint of 14.1372", 14.137168391),
)  # fmt: skip
_MEMBRANE = (1.086840, -1.658066, 0.728059, 0.279194, -1.069237, 0.905737, 1.150609, -0.356352)
_SOURCE_VALUES = (1.08684, -1.65807, 0.72806, 0.27919, 1.06924, 0.90574, 1.15061, -0.35635)
_OMEGA = (16.03217, 36.80052, 25.54471, 46.77058, 34.23748, 56.11496)


def antennas_rows() -> list[dict[str, Any]]:
    """Return every public number of the five examples, and ours."""
    return [
        *_beam_constants(),
        *_example_1(),
        *_example_2(),
        *_example_3(),
        *_example_4(),
        *_example_5(),
        *example_trial_rows(),
    ]


def _peaks(example: str, columns: dict[str, tuple[float, float]]) -> list[dict[str, Any]]:
    """Return rows of one flight: name to reference and ours."""
    return [
        relative(f"{example}: {name}", NOT_AVAILABLE, reference, computed, _ONE)
        for name, (reference, computed) in columns.items()
    ]


def _beam_constants() -> list[dict[str, Any]]:
    shape = flights.flexible_shape("antenna_1")
    unit, mass = UNITS["slug_ft_lb"], 0.15
    # (4-1) is two at the tip, a mode of ours is one
    translation = 2.0 * shape.integrals.translation[0, :5] / unit.mass / mass
    rotation = 2.0 * shape.integrals.rotation[1, :5] / (unit.mass * unit.length) / (5.0 * mass)
    rows = []
    for j, ((source_value, root), found) in enumerate(
        zip(_WAVE_NUMBERS, wave_numbers(5), strict=True)
    ):
        rows.append(
            relative(f"beta_{j + 1} l of (4-1) [-]", source_value, root, float(found), 1e-9)
        )
    for j, (c, bar, tilde) in enumerate(_COEFFICIENTS):
        b = wave_numbers(5)[j]
        computed = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        rows += [
            relative(f"C_{j + 1} of (4-1) [-]", str(c[0]), c[1], float(computed), 1e-6),
            relative(f"phi-bar_{j + 1} / m [-]", str(bar[0]), bar[1],
                abs(float(translation[j])), 1e-5),
            relative(f"phi-tilde_{j + 1} / (m l) [-]", str(tilde[0]), tilde[1],
                abs(float(rotation[j])), 1e-4),
        ]  # fmt: skip
    return rows


def _example_1() -> list[dict[str, Any]]:
    case = flights.example("antenna_1")
    paths = {
        "open": flights.open_path("antenna_1"),
        "controlled": flights.minimum_disturbance_path(),
    }
    references = {
        "open": (0.0160848, 0.0054689, 0.0743038, 0.0076840),
        "controlled": (0.00018442, 0.0000951, 0.0006029, 0.0055613),
    }
    rows = []
    for name, path in paths.items():
        computed = (*_largest(path)[1:4], float(abs(case.tips(path)).max()))
        named = zip(("R_y [ft]", "R_z [ft]", "theta_x [rad]", "tip [ft]"),
                    references[name], computed, strict=True)  # fmt: skip
        rows += _peaks(
            f"example 1, {name}", {key: (expected, here) for key, expected, here in named}
        )
    full, one = (flights.reference_tips(modes) for modes in (5, 1))
    words = "example 1, m_e, S_e, I_e as printed: tip"
    largest, difference = float(abs(full).max()), float(abs(full - one).max())
    rows.append(relative(f"{words}, five modes [ft]", NOT_AVAILABLE, 0.01538, largest, _ONE))
    rows.append(
        relative(f"{words}, one mode against five [ft]", NOT_AVAILABLE, 5.1e-5, difference, _ONE)
    )
    return rows


def _example_2() -> list[dict[str, Any]]:
    case, path = flights.example("antenna_2"), flights.open_path("antenna_2")
    slew_path = path[: round(flights.SLEW_TIME / flights.STEP) + 1]
    peak, slew_peak, tips = _largest(path), _largest(slew_path), abs(case.tips(path)).max(axis=0)
    rows = _peaks(
        "example 2, open",
        {
            "R_y [ft]": (0.0047636, peak[1]),
            "R_z [ft]": (0.0037637, peak[2]),
            "theta_x [rad]": (0.0262066, peak[3]),
            "theta_x in the turn [rad]": (0.0261451, slew_peak[3]),
            "theta_y [rad]": (0.0262678, peak[4]),
            "theta_z [rad]": (0.0018352, peak[5]),
            "tip [ft]": (0.0349668, float(tips[1])),
        },
    )
    path = flights.integral_path()
    peak, tips = _largest(path), abs(case.tips(path)).max(axis=0)
    rows += _peaks(
        "example 2, PI",
        {
            "R_x [ft]": (5.4305e-5, peak[0]),
            "R_y [ft]": (5.4230e-5, peak[1]),
            "R_z [ft]": (8.2804e-5, peak[2]),
            "theta_y [rad]": (2.1567e-4, peak[4]),
            "tip [ft]": (0.00105045, float(tips[1])),
        },
    )
    before = case.motion.before()
    a, b = augmented(before)
    w = IntegralWeights()
    m = b.shape[1]
    weight = np.diag([w.state] * (len(a) - m) + [w.effort] * m)
    gain, _ = regulator(a, b, weight, w.effort_rate * np.eye(m))
    slow_pole = float(np.linalg.eigvals(a - b @ gain).real.max())
    condition = float(np.linalg.cond(before.input_matrix))
    rows.append(relative("example 2: condition of B* [-]", NOT_AVAILABLE, 174.26, condition, 1e-4))
    rows.append(
        relative("example 2: slowest pole [1/s]", NOT_AVAILABLE, -0.184709, slow_pole, 1e-5)
    )
    return rows


def _example_3() -> list[dict[str, Any]]:
    references = {"none": 2.20635, "zero": 0.684887, "imsc": 0.763104}
    named = {"none": "uncontrolled", "zero": "perturbation", "imsc": "independent modal space"}
    rows = [
        relative(f"example 3, {named[law]}: peak [m]", NOT_AVAILABLE, reference,
            float(abs(flights.time_varying_path(3, law)).max()), 1e-4)
        for law, reference in references.items()
    ]  # fmt: skip
    gains = flights.time_varying(3).regulator.gains()
    for name, reference, computed in (
        ("gi", 1000.0500, gains.integral),
        ("gp", 7.229746, gains.proportional),
        ("gd", 10.698574, gains.rate),
    ):
        item = f"example 3: gain {name} of zero order"
        rows.append(relative(item, NOT_AVAILABLE, reference, float(computed[0, 0]), 1e-6))
    added_stiffness, _ = modal_gains(np.array([100.0]), 0.01)
    static = 100.0 / (100.0 + float(added_stiffness[0]))
    item = "example 3: static error of independent modal space [m]"
    rows.append(relative(item, NOT_AVAILABLE, 0.7071, static, 1e-4))
    return rows


def _example_4() -> list[dict[str, Any]]:
    rows = []
    for law, name, references in (
        ("none", "uncontrolled", (0.0204943, 0.0232547, 8.34642)),
        ("zero", "perturbation, P1(tf) = 0", (0.000872318, 0.000855591, 0.237500)),
    ):
        x = flights.time_varying_path(4, law)
        peaks = (*_largest(x)[:2], float(np.degrees(_largest(x)[2])))
        named = zip(("R_y [ft]", "R_z [ft]", "theta [deg]"), references, peaks, strict=True)
        rows += _peaks(
            f"example 4, {name}", {key: (expected, here) for key, expected, here in named}
        )
    shape, unit = flights.flexible_shape("antenna_4"), UNITS["slug_ft_lb"]
    bar = 2.0 * float(abs(shape.integrals.translation[:, 0]).max()) / unit.mass
    tilde = 2.0 * float(abs(shape.integrals.rotation[:, 0]).max()) / (unit.mass * unit.length)
    stiffness = 4.0 * float(shape.stiffness[0]) / unit.mass
    mass, k0 = constant(ROUNDED)
    squares = eigh(k0, mass.round(3), eigvals_only=True)
    for item, source, reference, computed, tolerance in (
        ("phi-bar [slug]", "0.117", 0.117449, bar, 1e-5),
        ("phi-tilde [slug ft]", "0.427", 0.426619, tilde, 1e-5),
        ("K_e [lb/ft]", "49.449", 49.449453, stiffness, 1e-6),
        ("Lambda from the rounded M0 [1/s^2]", "369.2661", 369.26608, float(squares[-1]), 1e-6),
    ):
        rows.append(relative(f"example 4: {item}", source, reference, computed, tolerance))
    rows += _appendix_e()
    for end, reference in (("zero", 5.5), ("adiabatic", 0.099)):
        item = f"example 4: RMS error of P, P1(tf) {end}"
        rows.append(relative(item, NOT_AVAILABLE, reference, flights.riccati_error(4, end), _ONE))
    return rows


def _appendix_e() -> list[dict[str, Any]]:
    """Return the sums of Appendix E, which prints them with three decimals."""
    mass, matrices = constant(Antenna())[0], rate_matrices(Antenna())
    return [
        absolute(f"Appendix E: {item}", source_value, float(source_value), float(computed), 5e-4)
        for item, source_value, computed in (
            ("M0(2,3) [slug ft]", "0.435", mass[1, 2]),
            ("M0(3,3) [slug ft^2]", "14.574", mass[2, 2]),
            ("M0(3,4) [slug ft]", "0.474", mass[2, 3]),
            ("Mc(3,3) [slug ft^2]", "0.300", matrices["Mc"][2, 2]),
            ("Mc(3,4) [slug ft]", "0.047", matrices["Mc"][2, 3]),
            ("Gs(3,3) [slug ft^2]", "0.150", matrices["Gs"][2, 2]),
        )
    ]


def _example_5() -> list[dict[str, Any]]:
    shape, unit = flights.flexible_shape("antenna_5_1"), UNITS["slug_ft_lb"]
    i = shape.integrals
    second = i.second / unit.torque
    rows = []
    for item, source, reference, computed in (
        ("m_e [slug]", "0.283", 0.2827433, i.mass / unit.mass),
        ("S_z [slug ft]", "1.415", 1.413717, float(i.first[2]) / unit.mass / unit.length),
        ("I_xx [slug ft^2]", "7.712", 7.704756, float(second[1, 1] + second[2, 2])),
        ("I_zz [slug ft^2]", "1.274", 1.272345, float(second[0, 0] + second[1, 1])),
    ):
        rows.append(relative(f"example 5: {item}", source, reference, computed, 1e-6))
    for k, reference in enumerate(_OMEGA):
        computed = float(shape.frequencies[(0, 1, 2, 3, 6, 7)[k]])
        item = f"example 5: omega_{k + 1} [rad/s]"
        rows.append(relative(item, NOT_AVAILABLE, reference, computed, 1e-6))
    for k, (source_value, reference, computed) in enumerate(
        zip(_SOURCE_VALUES, _MEMBRANE, _membrane_constants(shape), strict=True)
    ):
        item = f"example 5: mode constant {k + 1} of (4-21) [-]"
        rows.append(relative(item, str(source_value), reference, computed, 1e-3))
    case, path = flights.example("antenna_5_1"), flights.open_path("antenna_5_1")
    linear = (*_largest(path)[1:4], float(abs(case.tips(path)).max()))
    for name, references, peaks in (
        ("non-linear, uncontrolled", (0.00708957, 0.00281987, 0.0358293, 0.00692745),
         membrane_peaks(1, False)),
        ("linear", (0.00725979, 0.00275007, 0.0358306, 0.00690926), linear),
        ("controlled", (0.00052634, 0.00017977, 0.0023152, 0.00137662),
         membrane_peaks(1, True)),
    ):  # fmt: skip
        columns = zip(("R_y [ft]", "R_z [ft]", "theta_x [rad]", "centre [ft]"),
                      references, peaks, strict=True)  # fmt: skip
        rows += _peaks(f"example 5, case 1 {name}", {k: (r, o) for k, r, o in columns})
    # figures 27 to 30, by an independent computation: the print has no legible numbers
    references = (0.0032288, 0.0010983, 0.023056, 0.0013411)
    columns = zip(("R_y [ft]", "R_z [ft]", "theta_x [rad]", "centre [ft]"),
                  references, membrane_peaks(2, True), strict=True)  # fmt: skip
    rows += _peaks("example 5, case 2 controlled", {k: (r, o) for k, r, o in columns})
    return rows


def _membrane_constants(shape: FlexibleShape) -> tuple[float, ...]:
    """Return the coefficients of (4-21): at the centre, then at r = a / 2, theta = 90 deg.

    They are for a mode times the radius and the root of the density; the printed ones come from
    zeros of Bessel's functions in four digits. theta is from x: x = r cos, y = r sin (F-1).
    """
    unit = UNITS["slug_ft_lb"]
    scale = 3.0 * np.sqrt(0.01) * np.sqrt(unit.mass)
    centre = scale * shape.tip.displacement[2, :2]
    half = scale * half_way(shape)
    return tuple(float(c) for c in (*centre, *half[:2], *half[6:8], *half[4:6]))


def _largest(path: Matrix) -> Vector:
    largest: Vector = abs(path).max(axis=0)
    return largest
