"""Frequency responses and modes as universal files of modal tests (UFF 58, 55, 15, 2411)."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.identification.files.uff import (
    COORDINATES,
    DATA_AT_NODES,
    FREQUENCY_RESPONSE,
    FUNCTION,
    Dataset,
    abscissa,
    datasets_by_type,
    degree_of_freedom,
    integer,
    numbers,
    read_datasets,
)
from flexslew_lab.identification.modal.modes import FittedMode, ModalModel
from flexslew_lab.identification.records.record import Quantity
from flexslew_lab.identification.responses.frequency_response import FrequencyResponse
from flexslew_lab.identification.responses.frf_fit import MeasuredResponses, ResponseModel
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required

_ORDERS = {8: 0, 11: 1, 12: 2}  # orders of derivative by type of ordinate
_KINDS = {order: kind for kind, order in _ORDERS.items()}
_FORCE, _NORMAL_MODE = 13, 2  # types of a denominator and of an analysis
_QUANTITY_ORDERS = {
    Quantity.JOINT_POSITION: 0,
    Quantity.DEFLECTION: 0,
    Quantity.JOINT_RATE: 1,
    Quantity.DEFLECTION_RATE: 1,
    Quantity.ACCELERATION: 2,
}


def read_responses(path: Path) -> MeasuredResponses:
    """Return the frequency responses of a universal file.

    Raises:
        BadInput: if it has none, they are not of displacement, velocity or acceleration per force,
            or they have not the same frequencies.
    """
    missing = "holds no frequency response (dataset 58 of function type 4)"
    found = _datasets(path, FUNCTION, ("func_type", FREQUENCY_RESPONSE), missing)
    frequency = abscissa(path, found[0])
    orders, outputs, inputs, values = [], [], [], []
    for one in found:
        output = degree_of_freedom(path, one, "rsp")
        kind = integer(path, one, "ordinate_spec_data_type")
        if kind not in _ORDERS:
            raise BadInput(
                f"{output}: the response is of type {kind}; allowed are displacement (8), velocity "
                "(11) and acceleration (12)",
                path,
            )
        if not np.array_equal(abscissa(path, one), frequency):
            raise BadInput(f"{output}: its frequencies are not those of the first response", path)
        orders.append(_ORDERS[kind])
        outputs.append(output)
        inputs.append(degree_of_freedom(path, one, "ref"))
        values.append(np.asarray(one["data"], dtype=np.complex128))
    matrix = np.column_stack(values)
    if not (np.isfinite(matrix).all() and np.isfinite(frequency).all()):
        raise BadInput("a response has a value that is no finite number", path)
    if (np.diff(frequency) <= 0.0).any():
        raise BadInput("the frequencies do not rise", path)
    kept = frequency > 0.0
    return MeasuredResponses(
        2.0 * np.pi * frequency[kept],
        matrix[kept],
        tuple(orders),
        tuple(outputs),
        tuple(inputs),
        str(path),
    )


def write_model(path: Path, model: ModalModel, response: FrequencyResponse | None) -> None:
    """Write modes, and frequency responses if there are any, of a record as a universal file.

    Nodes are numbered: outputs first, in their order; a reference is the node of the position of
    its joint, or one behind the outputs.

    Args:
        path: of the file.
        model: modes of the record.
        response: frequency responses of the same outputs; None: modes alone.
    """
    record = model.record
    names = [output.name for output in record.outputs]
    functions = []
    if response is not None:
        for o, output in enumerate(response.outputs):
            for i, name in enumerate(response.inputs):
                joint = f"position.{name}"
                functions.append(
                    _function(
                        response.frequency,
                        response.response[:, o, i],
                        f"{output.name} per {name}",
                        (o + 1, names.index(joint) + 1 if joint in names else len(names) + i + 1),
                        _QUANTITY_ORDERS[output.quantity],
                    )
                )
    places = [group.columns[0][0] + 1 for group in model.groups]
    modes = [_mode(k, mode, places, mode.shape) for k, mode in enumerate(model.modes, 1)]
    _write(path, [*functions, *modes])


def write_response_model(path: Path, model: ResponseModel) -> None:
    """Write the fitted frequency responses and their modes as a universal file."""
    responses = model.responses
    outputs, inputs = list(dict.fromkeys(responses.outputs)), list(dict.fromkeys(responses.inputs))
    nodes = {name: k for k, name in enumerate(dict.fromkeys((*outputs, *inputs)), 1)}
    pairs = zip(responses.outputs, responses.inputs, responses.orders, strict=True)
    functions = [
        _function(responses.frequency, model.fitted[:, k], f"{o} per {i}", (nodes[o], nodes[i]), n)
        for k, (o, i, n) in enumerate(pairs)
    ]
    first = [k for k, name in enumerate(responses.inputs) if name == inputs[0]]
    places = [nodes[responses.outputs[k]] for k in first]
    modes = [_mode(k, m, places, m.shape[first]) for k, m in enumerate(model.modes, 1)]
    _write(path, [*functions, *modes])


def _function(
    w: Vector, values: NDArray[Any], name: str, nodes: tuple[int, int], order: int
) -> Dataset:
    pyuff: Any = required("pyuff")
    f = w / (2.0 * np.pi)
    even = bool(np.allclose(np.diff(f), f[1] - f[0], rtol=1e-6))
    found: Dataset = pyuff.prepare_58(
        binary=0, func_type=FREQUENCY_RESPONSE, id1=name[:80], rsp_node=nodes[0], rsp_dir=0,
        ref_node=nodes[1], ref_dir=0, x=f, data=values, abscissa_spacing=int(even),
        abscissa_min=float(f[0]), abscissa_inc=float(f[1] - f[0]), abscissa_spec_data_type=18,
        ordinate_spec_data_type=_KINDS[order], orddenom_spec_data_type=_FORCE,
    )  # fmt: skip
    return found


def _mode(number: int, mode: FittedMode, nodes: list[int], shape: Vector) -> Dataset:
    """Return a mode with its shape along the first direction of each node."""
    pyuff: Any = required("pyuff")
    zero = np.zeros(len(nodes))
    found: Dataset = pyuff.prepare_55(
        model_type=1, analysis_type=_NORMAL_MODE, data_ch=2, spec_data_type=8, data_type=2,
        n_data_per_node=3, r1=np.asarray(shape), r2=zero, r3=zero, load_case=1, mode_n=number,
        freq=mode.frequency.value / (2.0 * np.pi), modal_m=1.0,
        modal_damp_vis=mode.damping_ratio.value, modal_damp_his=0.0, node_nums=np.array(nodes),
        id1=f"mode {number}", id2="NONE", id3="NONE", id4="NONE", id5="NONE",
    )  # fmt: skip
    return found


def _write(path: Path, datasets: list[Dataset]) -> None:
    pyuff: Any = required("pyuff")
    try:
        pyuff.UFF(str(path)).write_sets(datasets, "overwrite")
    except OSError as error:
        raise BadInput(f"cannot be written: {error}", path) from None


def read_modal_data(path: Path, mass: float) -> dict[str, Any]:
    """Return the modes of a universal file as modal data of an appendage.

    A modal test measures no masses: that of the appendage is spread evenly over the nodes. The tip
    is the node that is farthest from the origin, which is the hinge.

    Args:
        path: of the file, with datasets 55 (normal modes) and 15 or 2411 (nodes), in SI.
        mass: of the appendage [kg].

    Raises:
        BadInput: if it has no modes or nodes, or a mode lacks a node.
    """
    if not 0.0 < mass < np.inf:
        raise BadInput("a mass above 0 [kg]", key="--mass", value=mass)
    places = _coordinates(path)
    missing = "holds no normal mode (dataset 55 of analysis type 2)"
    modes = _datasets(path, DATA_AT_NODES, ("analysis_type", _NORMAL_MODE), missing)
    values = np.hstack([numbers(path, one, "freq", "modal_damp_vis") for one in modes])
    order = np.argsort(values[0])
    tables = [numbers(path, modes[k], "node_nums", "r1", "r2", "r3") for k in order]
    nodes = sorted({int(node) for table in tables for node in table[0]})
    if unplaced := [node for node in nodes if node not in places]:
        raise BadInput(f"node {unplaced[0]} of a mode has no coordinates", path)
    points = np.array([places[node] for node in nodes])
    shapes = np.zeros((len(modes), len(nodes), 3))
    for k, table in enumerate(tables):
        shapes[k, [nodes.index(int(node)) for node in table[0]]] = table[1:].T
    each = mass / len(nodes)
    return {
        "units": "si",
        "frequencies_hz": values[0, order].tolist(),
        "damping_ratios": values[1, order].tolist(),
        "points": points.tolist(),
        "masses": [each] * len(nodes),
        "shapes": shapes.tolist(),
        "tip": int(np.argmax(np.linalg.norm(points, axis=1))),
    }


def _datasets(path: Path, kind: int, entry: tuple[str, int], missing: str) -> list[Dataset]:
    """Return the datasets of a type of which an entry has a value."""
    name, value = entry
    found = [one for one in read_datasets(path, kind) if integer(path, one, name) == value]
    if not found:
        raise BadInput(missing, path)
    return found


def _coordinates(path: Path) -> dict[int, tuple[float, float, float]]:
    """Return the places of the nodes [m]."""
    found = {}
    for one in datasets_by_type(path, COORDINATES):
        for node, x, y, z in numbers(path, one, "node_nums", "x", "y", "z").T.tolist():
            found[int(node)] = (x, y, z)
    if not found:
        raise BadInput("holds no coordinates of nodes (dataset 15 or 2411)", path)
    return found
