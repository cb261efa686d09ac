"""Output feedback control of one appendage, apart from the platform's (Sung and Joo, sec. 4)."""

from typing import Annotated

import numpy as np
from pydantic import Field

from flexslew_control.controllers.sliding.one_appendage import OneAppendage, PlatformCoupling
from flexslew_control.controllers.sliding.sliding_surface import LinearSystem, SlidingDesign, design
from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, Positive, section
from flexslew_plant.testbeds import design_testbed
from flexslew_plant.testbeds.contract import Clamped, HasClampedAppendages


@section
class AppendageFeedback:
    """Which appendage is controlled, and how the platform is held."""

    name: str  # the appendage that is controlled
    process_density: Positive = 1e-3  # density of the noise on every state, L = 1
    sensor_density: Positive = 1e-4  # density of the noise on every reading of the tip
    # a and b of Q_s = diag(omega^a, omega^b)
    weight_exponents: tuple[float, float] = (0.0, -2.0)
    platform_gain: NonNegative = 0.0  # kappa, about the axis of least inertia [N m/rad]
    # damping ratio of that loop [-]
    platform_damping: Annotated[float, Field(gt=0.0, le=2.0)] = 0.7


def appendage_system(c: Clamped, settings: AppendageFeedback, name: str) -> LinearSystem:
    """Return (41): A = [0, 1; -K, -C], B = [0; Psi^T], the tip's displacements and rates."""
    n = len(c.mass)
    lower = np.hstack((-np.diag(c.stiffness / c.mass), -c.damping / c.mass[:, None]))
    a = np.vstack((np.hstack((np.zeros((n, n)), np.eye(n))), lower))
    b = np.vstack((np.zeros((n, len(c.joints))), c.torque_input / c.mass[:, None]))
    zero = np.zeros_like(c.tip)
    modes = [f"{name} mode {k + 1}" for k in range(n)]
    return LinearSystem(
        a,
        b,
        np.block([[c.tip, zero], [zero, c.tip]]),
        np.eye(2 * n),
        settings.process_density * np.eye(2 * n),
        settings.sensor_density * np.eye(2 * len(c.tip)),
        (*modes, *(f"{mode} rate" for mode in modes)),
    )


def appendage_weight(c: Clamped, exponents: tuple[float, float]) -> Matrix:
    """Return Q_s = diag(omega^a, omega^b), shape (2 n, 2 n)."""
    omega = np.sqrt(c.stiffness / c.mass)
    diagonal = np.concatenate([omega**power for power in exponents])
    return np.diag(diagonal)


def platform_gains(c: Clamped, settings: AppendageFeedback) -> tuple[Vector, Vector]:
    """Return stiffness and damping per joint of the feedback that holds the platform.

    torque_i = -kappa (I_ii/I_least) th_i - k_d (I_ii/I_least) w_i, k_d = 2 zeta sqrt(kappa
    I_least); force = -m (kappa/I_least R + 2 zeta sqrt(kappa/I_least) R').
    """
    least = float(np.diag(c.inertia).min())
    axis_inertia = np.einsum("aj,ab,bj->j", c.torque, c.inertia, c.torque)
    is_force = abs(c.force).sum(axis=0) > 0.0
    load = np.where(is_force, c.total_mass, axis_inertia)
    square = settings.platform_gain / least
    return load * square, load * 2.0 * settings.platform_damping * np.sqrt(square)


def appendage_model(
    settings: AppendageFeedback,
    mode: str,
    reaching_rate: float,
    model: dict[str, object] | None,
    plant: PlantDescription,
) -> tuple[OneAppendage, SlidingDesign]:
    """Return what the law believes of one appendage, and its design.

    Args:
        settings: the `appendage` section.
        mode: tracking_a, tracking_b or rigid_hold.
        reaching_rate: nu [1/s].
        model: keys of the testbed that are believed otherwise.
        plant: what stands on the bench.

    Raises:
        BadInput: no such appendage, none of its torques, or no stable design.
    """
    testbed = design_testbed(plant.testbed, model, "model", plant.trust)
    if not isinstance(testbed, HasClampedAppendages):
        raise BadInput(f"appendage: {testbed.kind} has no appendages that can be taken alone")
    c = testbed.clamped(settings.name)
    if not c.joints:
        raise BadInput(
            f"appendage: {settings.name} has no torque at its tip; add actuators "
            f"{{kind: torque, appendage: {settings.name}}}"
        )
    system = appendage_system(c, settings, settings.name)
    found = design(system, appendage_weight(c, settings.weight_exponents), reaching_rate)
    stiffness, damping = platform_gains(c, settings)
    load = PlatformCoupling(c.torque, c.inertia, c.tangential, c.centrifugal, c.mass)
    observed = OneAppendage(
        system,
        found.observer_gain,
        load,
        mode != "tracking_b",
        mode != "rigid_hold",
        plant.period,
        c.first,
        c.joints,
        c.torque.shape[1],
        c.rows,
        stiffness,
        damping,
    )
    return observed, found
