"""A policy as a network in the format ONNX, run by onnxruntime on one thread."""

import base64
import binascii
from typing import Any

import numpy as np

from flexslew_control.law import LawFailed, WrongShape
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import required
from flexslew_plant.given_file import given_bytes

_MOST = 512 * 1024  # bytes of a network: a log holds it as text
_FLOAT = "tensor(float)"


def network_from_file(path: str, source: str) -> dict[str, Any]:
    """Return the key `network` of the law `policy` from an .onnx file.

    Args:
        path: the file, as torch.onnx, skl2onnx or onnx.helper write it.
        source: file or node that names it, for an error.

    Raises:
        BadInput: it cannot be read, or is too large.
    """
    if not path.endswith(".onnx"):
        raise BadInput(f"{source}: file: {path}: give a file that ends in .onnx")
    try:
        content = given_bytes(path)
    except BadInput as error:
        raise BadInput(f"{source}: file: {error}") from None
    if len(content) > _MOST:
        words = f"it has {len(content):,} bytes; a log holds at most {_MOST:,} of a network"
        raise BadInput(f"{source}: file: {path}: {words}")
    return {"network": base64.b64encode(content).decode()}


class Network:
    """A network without a state: one observation in, one action out, both of float32.

    Args:
        text: the ONNX model, base64.
        inputs: size of an observation.
        outputs: size of an action.

    Raises:
        BadInput: it is no ONNX model, has external data or unknown operators, or other shapes.
        ModuleNotFoundError: onnxruntime is not installed.
    """

    def __init__(self, text: str, inputs: int, outputs: int) -> None:
        runtime = required("onnxruntime")
        options = runtime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # the same sums everywhere
        options.log_severity_level = 4
        try:
            content = base64.b64decode(text, validate=True)
            self._session = runtime.InferenceSession(
                content, options, providers=["CPUExecutionProvider"]
            )
        except binascii.Error:
            raise BadInput("give an ONNX model in base64, or its file", key="network") from None
        except Exception as error:  # onnxruntime has a class for each of its error codes
            words = " ".join(str(error).split())
            raise BadInput(
                f"is no ONNX model that runs here: {words:.200}", key="network"
            ) from None
        self._outputs = outputs
        given, made = self._session.get_inputs(), self._session.get_outputs()
        if len(given) != 1 or len(made) != 1:
            words = f"has {len(given)} inputs and {len(made)} outputs; give one of each"
            raise BadInput(words, key="network")
        self._input, self._output = given[0].name, made[0].name
        _require_shape(given[0], "input", inputs)
        _require_shape(made[0], "output", outputs)

    def __deepcopy__(self, memo: dict[int, Any]) -> "Network":
        """Return itself: it has no state, and a session of onnxruntime cannot be copied."""
        return self

    def action(self, observed: Vector) -> Vector:
        """Return the action, shape (joints,).

        Args:
            observed: see observation.observation.

        Raises:
            LawFailed: the network raises, or its action is not finite.
        """
        row = observed.astype(np.float32)[None]
        try:
            (made,) = self._session.run([self._output], {self._input: row})
        except Exception as error:
            words = " ".join(str(error).split())
            raise LawFailed(f"the network raised {type(error).__name__}: {words:.200}") from None
        action = np.asarray(made, dtype=np.float64)
        if action.size != self._outputs:
            raise WrongShape(
                f"the network gave an action of shape {action.shape}, expected ({self._outputs},)"
            )
        return action.reshape(-1)


def _require_shape(node: Any, what: str, size: int) -> None:
    """Refuse an input or output that is not of shape (1 or N, size) and float32."""
    shape = list(node.shape)
    fits = len(shape) == 2 and shape[1] == size and (shape[0] == 1 or not isinstance(shape[0], int))
    if not fits or node.type != _FLOAT:
        words = f"its {what} {node.name} is {node.type} of shape {shape}; give {_FLOAT} of shape"
        raise BadInput(f"{words} (1 or N, {size})", key="network")
