"""The page of an imported finite element model: its numbers, and its modes on its nodes."""

import numpy as np
from scipy.spatial import cKDTree

from flexslew_lab.finite_elements.tables import COLUMNS, mode_rows, verdict
from flexslew_lab.report.panels import COLOURS, LIGHT, Group, Panel, legend
from flexslew_lab.report.sections import Section, Table, Text, page_of_sections
from flexslew_plant.arrays import Indices, Matrix
from flexslew_plant.testbeds.spacecraft.finite_elements.imported import ImportedModel
from flexslew_plant.testbeds.spacecraft.finite_elements.modal_content import displacements

_MOST_NODES = 1500  # of a drawn mode
_NEIGHBOURS = 4  # of a node, to which it is joined
_MOST_MODES = 12  # that are drawn
_LARGEST = 0.15  # deflection that is drawn, of the size of the model
_NAMES = ("at rest", "mode")
# x to the right and down, y to the right and up, z up
_VIEW = np.array([[0.87, 0.87, 0.0], [-0.35, 0.35, 1.0]]) / 1.3


def import_page(found: ImportedModel, name: str) -> str:
    """Return tables and modes of a model as HTML that needs nothing else."""
    words = (
        "Effective mass: the share of the mass, and of the inertia about the hinge, that each mode "
        "carries; rx, ry, rz are rotations about x, y, z. What is left out moves with the hinge as "
        "if it were rigid."
    )
    sections: list[Section] = [
        Text("Warnings", " ".join(f"{doubt}." for doubt in found.doubts), "bad"),
        Table("Modes with the hinge clamped", words, COLUMNS, mode_rows(found)),
    ]
    if found.model.nodes is not None:
        sections.append(_drawn_modes(found))
    return page_of_sections(
        "import", name, "A finite element model, reduced to modal data.", sections, verdict(found)
    )


def _drawn_modes(found: ImportedModel) -> Group:
    """Return a panel with the nodes at rest and deflected for each mode."""
    nodes = found.model.nodes
    assert nodes is not None
    shown = np.arange(0, len(nodes), 1 + len(nodes) // _MOST_NODES)
    shapes = displacements(found.model, found.reduction.shapes)[shown]
    places = nodes[shown] - found.reduction.origin
    size = float(np.ptp(nodes, axis=0).max())
    edges = _edges(places)
    panels = []
    for k, frequency in enumerate(found.content["frequencies_hz"][:_MOST_MODES]):
        panel = Panel(f"mode {k + 1}: {frequency:.4g} Hz", "m", height=220, single=True, equal=True)
        largest = float(np.linalg.norm(shapes[..., k], axis=1).max()) or 1.0
        deflected = places + shapes[..., k] * (_LARGEST * size / largest)
        for one, label, colour in zip(
            (places, deflected), _NAMES, (LIGHT, COLOURS[0]), strict=True
        ):
            ends = (one @ _VIEW.T)[edges]
            x, y = np.concatenate((ends, np.full((len(edges), 1, 2), np.nan)), axis=1).T.reshape(
                2, -1, order="F"
            )
            panel.line(x, y, label, {"color": colour, "width": 1.0}, hoverinfo="skip")
        panels.append(panel)
    words = (
        "Lines join each node to its nearest ones. Seen from a corner: x to the lower right, y to "
        "the upper right, z up, from the hinge [m]. "
        f"The largest deflection is drawn as {_LARGEST:.0%} of the size."
    )
    entries = legend(_NAMES)
    coloured = (entries[0]._replace(colour=LIGHT), entries[1]._replace(colour=COLOURS[0]))
    return Group("Mode shapes", words, panels, coloured, side_by_side=True)


def _edges(places: Matrix) -> Indices:
    """Return the pairs of nodes of which one is among the nearest of the other, shape (e, 2)."""
    near: Indices
    near = np.asarray(cKDTree(places).query(places, k=min(_NEIGHBOURS + 1, len(places)))[1])
    pairs = np.stack((np.repeat(near[:, :1], near.shape[1] - 1, axis=1), near[:, 1:]), axis=-1)
    edges: Indices = np.unique(np.sort(pairs.reshape(-1, 2), axis=1), axis=0)
    return edges
