"""Networks in the format ONNX for tests."""

from pathlib import Path

import numpy as np
import pytest

from flexslew_plant.arrays import Matrix


def save_network(path: Path, gains: Matrix, squash: bool = True) -> None:
    """Write a policy of one layer: action = o W, or its tanh."""
    onnx = pytest.importorskip("onnx")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    weights = onnx.numpy_helper.from_array(gains.astype(np.float32), "W")
    nodes = [
        helper.make_node("MatMul", ["observation", "W"], ["sum"]),
        helper.make_node("Tanh" if squash else "Identity", ["sum"], ["action"]),
    ]
    inside, outside = (
        helper.make_tensor_value_info(name, kind, ["N", size])
        for name, size in zip(("observation", "action"), gains.shape, strict=True)
    )
    graph = helper.make_graph(nodes, "policy", [inside], [outside], [weights])
    opset = [helper.make_opsetid("", 17)]
    onnx.save(helper.make_model(graph, opset_imports=opset, ir_version=9), str(path))
