"""What rounding weights does to the means of features is known, and taken out again (bias correction, Nagel 2019).

Inputs of a convolution are not zero on average, so errors of its weights add up to a shift of each output channel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tracker.crop import Image

if TYPE_CHECKING:
    import onnx

PATCHES: Final = 40  # means need no more


def correct_means(int8: onnx.ModelProto, whole: bytes, outputs: Sequence[str], patches: Sequence[Image]) -> None:
    """Shift the biases of a quantised graph until each channel has the mean it has in the whole one.

    outputs: of the convolutions, as both graphs name them, in their order: one after the other, as each moves those
    behind it.
    """
    import onnx

    patches = patches[:: -(-len(patches) // PATCHES)]
    wanted = _means(onnx.load_from_string(whole), outputs, patches)
    makers = {name: node for node in int8.graph.node for name in node.output}
    constants = {each.name: each for each in int8.graph.initializer}
    for i, output in enumerate(outputs):
        shift = wanted[i] - _means(int8, outputs, patches)[i]  # (C,)
        dequantised = makers[makers[output].input[2]]
        bias, scale = (constants[name] for name in dequantised.input[:2])
        steps = np.round(shift / onnx.numpy_helper.to_array(scale)).astype(np.int32)
        bias.CopyFrom(onnx.numpy_helper.from_array(onnx.numpy_helper.to_array(bias) + steps, bias.name))


def _means(model: onnx.ModelProto, outputs: Sequence[str], patches: Sequence[Image]) -> list[NDArray[Any]]:
    """Of each channel (C,) of these outputs, over places and patches."""
    import onnx
    import onnxruntime

    asked = onnx.ModelProto()
    asked.CopyFrom(model)
    known = {each.name for each in asked.graph.output}
    asked.graph.output.extend(onnx.helper.make_empty_tensor_value_info(name) for name in outputs if name not in known)
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors
    session = onnxruntime.InferenceSession(asked.SerializeToString(), options, providers=["CPUExecutionProvider"])
    runs = [session.run([*outputs], {"patch": patch[None]}) for patch in patches]
    return [np.mean([features.mean((0, 2, 3)) for features in of_layer], 0) for of_layer in zip(*runs, strict=True)]
