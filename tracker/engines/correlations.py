"""A graph of ONNX without its correlations: a runtime may be slow where a convolution has kernels it is only given."""

from __future__ import annotations

from typing import Any, NamedTuple


class Correlation(NamedTuple):
    """One that is left out: the names of its inputs in the whole graph, and of the map that the rest wants instead."""

    search: str
    template: str
    map: str


def without_correlations(graph: bytes) -> tuple[bytes, tuple[Correlation, ...]]:
    """The rest of the graph, and what it has to be given; all of it where nothing given is slid over anything given."""
    import onnx  # here: it comes with the runtime's own extra

    model = onnx.load_model_from_string(graph)
    shapes = {each.name: [side.dim_value for side in each.type.tensor_type.shape.dim] for each in model.graph.input}
    producers = {name: node for node in model.graph.node for name in node.output}
    found = []
    for node in model.graph.node:
        if node.op_type != "Conv" or len(node.input) != 2:
            continue
        search, template = (_source(name, producers) for name in node.input)
        if search in shapes and template in shapes:
            found.append(Correlation(search, template, node.output[0]))
            (batch, channels, *sides), kernel = shapes[search], shapes[template][2:]
            shape = [batch, channels, *(side - of_kernel + 1 for side, of_kernel in zip(sides, kernel, strict=True))]
            value = onnx.helper.make_tensor_value_info(node.output[0], onnx.TensorProto.FLOAT, shape)
            model.graph.value_info.append(value)
    if not found:
        return graph, ()
    outputs = [each.name for each in model.graph.output]
    rest = onnx.utils.Extractor(model).extract_model([each.map for each in found], outputs)
    return rest.SerializeToString(), tuple(found)


def _source(name: str, producers: dict[str, Any]) -> str:
    """The input it is, if only reshaped."""
    while name in producers and producers[name].op_type == "Reshape":
        name = producers[name].input[0]
    return name
