"""Embed in 8 bits: post-training static quantisation, with ranges calibrated on patches of real frames.

Convolutions take unsigned 8-bit inputs and 8-bit weights with a scale per output channel. The graph carries its
scales (QDQ), so every runtime reads it.
"""

from __future__ import annotations

import io
import logging
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tracker.crop import Image
from tracker.engines.engine import EngineError
from tracker.engines.export import SEARCH_PX, Graphs
from tracker.engines.exported import missing
from tracker.engines.quantise_means import correct_means

if TYPE_CHECKING:
    import onnx

# Of the backbone's five, the first two have 72 % of the work; those after them make what is correlated, and there each
# bit lost costs score.
LAYERS: Final = 2
# Grey levels are whole numbers already, and this little more than 1 rounds each to itself. At exactly 1 OpenVINO
# takes the step for none and computes the first, dearest convolution in float32.
_GREY_LEVEL: Final = 1 + 2**-12


class Calibration(Enum):
    """How a range follows from the values seen, by its name in onnxruntime.quantization."""

    MINMAX = "MinMax"  # all of them
    ENTROPY = "Entropy"  # the one that loses the least information (Kullback-Leibler)
    PERCENTILE = "Percentile"  # all but the outermost 0.001 %


def quantised(
    graphs: Graphs,
    patches: Sequence[Image],
    calibration: Calibration = Calibration.PERCENTILE,
    layers: int = LAYERS,
) -> Graphs:
    """The graphs with embed's first layers in 8 bits, from search patches (S, S, 3) uint8 such as it will see.

    One set of scales for both sizes, so that template and search features stay comparable. EngineError where
    the packages onnx and onnxruntime are missing, or there are no patches.
    """
    try:
        import onnx
        from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static
    except ImportError as error:
        raise EngineError(missing("int8", error.name or "onnxruntime", "onnx")) from error
    if not len(patches):
        raise EngineError("int8: no patches to calibrate on")
    model = onnx.load_from_string(graphs.embed[SEARCH_PX])
    convolutions = [node for node in model.graph.node if node.op_type == "Conv"][:layers]
    with tempfile.TemporaryDirectory() as folder, _quiet():
        path = Path(folder) / "embed.onnx"
        quantize_static(
            model,
            path,
            _reader(patches),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            calibrate_method=CalibrationMethod[calibration.value],
            nodes_to_quantize=[node.name for node in convolutions],
            extra_options={
                "OpTypesToExcludeOutputQuantization": ["Conv"],  # the activation's, but for layer 5's, which has none
                "TensorQuantOverrides": {str(convolutions[0].input[0]): [_scale(_GREY_LEVEL)]},
            },
        )
        int8 = onnx.load(path)
    correct_means(int8, graphs.embed[SEARCH_PX], [str(node.output[0]) for node in convolutions], patches)
    return graphs.with_int8({side_px: _resized(int8, side_px) for side_px in graphs.embed})


def _reader(patches: Sequence[Image]) -> Any:
    from onnxruntime.quantization import CalibrationDataReader

    class Reader(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self._left = iter(patches)

        def get_next(self) -> dict[str, Image] | None:
            patch = next(self._left, None)
            return None if patch is None else {"patch": patch[None]}

    return Reader()


@contextmanager
def _quiet() -> Iterator[None]:
    """Without the quantiser's advice to pre-process, given by logging's root: there is nothing left to fold."""
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(logging.NOTSET)


def _scale(scale: float) -> dict[str, Any]:
    return {"scale": np.array(scale, np.float32), "zero_point": np.array(0, np.uint8)}


def _resized(model: onnx.ModelProto, side_px: int) -> bytes:
    """The same convolutions for a patch of another size."""
    import onnx

    resized = onnx.ModelProto()
    resized.CopyFrom(model)
    sizes = resized.graph.input[0].type.tensor_type.shape.dim
    sizes[1].dim_value = sizes[2].dim_value = side_px
    del resized.graph.value_info[:]
    for output in resized.graph.output:
        output.type.tensor_type.ClearField("shape")
    inferred: bytes = onnx.shape_inference.infer_shapes(resized, strict_mode=True).SerializeToString()
    return inferred
