"""Flexible shapes of a trial file in SI, in appendage axes."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.spacecraft.assembly.bodies import (
    matrix_of,
    require_physical,
    unit_direction,
)
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import (
    ImportedModel,
    ImportOptions,
    import_model,
)
from flexslew_plant.testbeds.spacecraft.settings import (
    AppendageSettings,
    Body,
    FiniteElements,
)
from flexslew_plant.testbeds.spacecraft.settings import Beam as BeamSettings
from flexslew_plant.testbeds.spacecraft.settings import Membrane as MembraneSettings
from flexslew_plant.testbeds.spacecraft.shapes.beam import (
    ClampedBeam,
    TipBody,
    closed_form_beam,
    finite_element_beam,
)
from flexslew_plant.testbeds.spacecraft.shapes.membrane import membrane
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape, shape_of_data
from flexslew_plant.testbeds.spacecraft.shapes.selected import (
    MappedLine,
    select_modes,
    transform_point,
)
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape
from flexslew_plant.testbeds.spacecraft.units import Units


def flexible_shape(shape: object, units: Units, key: str) -> FlexibleShape:
    """Return a flexible shape in SI, in appendage axes."""
    if isinstance(shape, BeamSettings):
        return _beam(shape, units, f"{key}.shape")
    if isinstance(shape, MembraneSettings):
        return membrane(
            shape.radius * units.length,
            shape.density * units.mass / units.length**2,
            shape.wave_speed * units.length,
            shape.height * units.length,
            shape.waves,
            shape.rings,
            shape.poisson_ratio,
        )
    if isinstance(shape, FiniteElements):
        return shape_of_data(_imported(shape).content, shape.file)
    found = modal_shape(shape.file)  # type: ignore[attr-defined]
    kept = shape.modes  # type: ignore[attr-defined]
    if kept is not None and kept > found.modes:
        raise BadInput(f"the file has {found.modes}", key=f"{key}.shape.modes", value=kept)
    return found if kept is None else select_modes(found, list(range(kept)))


def _imported(shape: FiniteElements) -> ImportedModel:
    """Return the reduction of a finite element model."""
    options = ImportOptions(
        tuple(map(str, shape.boundary)),
        shape.modes,
        shape.units,
        shape.origin,
        shape.tip,
        shape.damping_ratio,
    )
    return import_model(shape.file, options)


def model_warnings(appendages: Mapping[str, AppendageSettings]) -> list[str]:
    """Return what may be wrong with the finite element models of appendages, a line each."""
    return [
        f"appendages.{name}.shape: {doubt}"
        for name, appendage in appendages.items()
        if isinstance(appendage.shape, FiniteElements)
        for doubt in _imported(appendage.shape).doubts
    ]


@lru_cache(maxsize=64)  # the same in every trial of a study
def _beam(b: BeamSettings, units: Units, key: str) -> FlexibleShape:
    z, x = unit_direction(b.along, f"{key}.along"), unit_direction(b.across, f"{key}.across")
    if abs(float(z @ x)) > 1e-6:
        raise BadInput(
            f"{key}.across: {list(b.across)} is not orthonormal to along {list(b.along)}: "
            f"their cosine is {float(z @ x):.3g}"
        )
    r = np.column_stack((x, np.cross(z, x), z))  # beam to appendage axes
    ei = np.broadcast_to(b.bending_stiffness, (2,)) * units.torque * units.length
    numbers = ClampedBeam(
        b.length * units.length,
        b.linear_density * units.mass / units.length,
        float(ei[0]),
        float(ei[1]),
        b.torsion_stiffness * units.torque * units.length,
        b.polar_inertia * units.mass * units.length,
    )
    if b.torsion_stiffness and not b.polar_inertia:
        raise BadInput(f"{key}.polar_inertia: must be positive for a beam that twists")
    if b.method == "closed_form":
        if b.tip_body is not None:
            raise BadInput(f"{key}.tip_body: needs method finite_elements")
        if b.modes_twist and not b.torsion_stiffness:
            raise BadInput(f"{key}.modes_twist: needs a torsion_stiffness")
        shape = closed_form_beam(numbers, b.modes_across, b.modes_third, b.modes_twist)
    else:
        largest = b.elements * (5 if b.torsion_stiffness else 4)
        if not 1 <= b.modes <= largest:
            raise BadInput(f"1 to {largest}", key=f"{key}.modes", value=b.modes)
        tip = None if b.tip_body is None else _tip(b.tip_body, units, r, f"{key}.tip_body")
        shape = finite_element_beam(numbers, tip, b.elements, b.modes)
    return replace(
        shape,
        integrals=shape.integrals.seen_from(np.zeros(3), r.T),
        tip=transform_point(r, shape.tip),
        line=shape.line @ r.T,
        line_shape=np.einsum("ab,kbn->kan", r, shape.line_shape),
        along=None if shape.along is None else MappedLine(shape.along, partial(transform_point, r)),
    )


def _tip(body: Body, units: Units, r: Matrix, key: str) -> TipBody:
    """Return a tip body in beam axes."""
    mass, inertia = body.mass * units.mass, matrix_of(body.inertia) * units.torque
    require_physical(mass, np.zeros(3), inertia, key)
    return TipBody(mass, r.T @ inertia @ r, r.T @ np.array(body.centre) * units.length)
