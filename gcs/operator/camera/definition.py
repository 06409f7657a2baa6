"""The camera definition: a file from which a ground station learns the camera's parameters, and shows them."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

from gcs.operator.camera.parameter_types import Kind, Parameter

if TYPE_CHECKING:
    from aiohttp import web

PATH: Final = "/camera.xml"
_TYPES: Final = {Kind.UINT8: "uint8", Kind.REAL32: "float"}


@dataclass(frozen=True, slots=True)
class Definition:
    """version: of the content, since QGroundControl keeps what it has once read under that number."""

    xml: bytes
    version: int


def definition(parameters: tuple[Parameter, ...], model: str = "Tracking camera", vendor: str = "ClimRT") -> Definition:
    """The file for these parameters."""
    version = zlib.crc32(_xml(parameters, model, vendor, 0)) % 65_535 + 1
    return Definition(_xml(parameters, model, vendor, version), version)


def _xml(parameters: tuple[Parameter, ...], model: str, vendor: str, version: int) -> bytes:
    root = ElementTree.Element("mavlinkcamera")
    head = ElementTree.SubElement(root, "definition", version=str(version))
    ElementTree.SubElement(head, "model").text = model
    ElementTree.SubElement(head, "vendor").text = vendor
    listed = ElementTree.SubElement(root, "parameters")
    for parameter in parameters:
        _add(listed, parameter)
    ElementTree.indent(root)
    data: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return data + b"\n"


def _add(listed: ElementTree.Element, parameter: Parameter) -> None:
    attributes = {"name": parameter.name, "type": _TYPES[parameter.kind], "default": "0"}
    if parameter.order is None:
        attributes["readonly"] = "1"
    if parameter.kind is Kind.REAL32:
        attributes["decimalPlaces"] = "1"
    if parameter.high:
        low = min(parameter.low, 0.0)  # 0 is allowed besides, and the default
        attributes |= {"min": f"{low:g}", "max": f"{parameter.high:g}", "step": "1"}
    if parameter.unit:
        attributes["unit"] = parameter.unit
    element = ElementTree.SubElement(listed, "parameter", attributes)
    ElementTree.SubElement(element, "description").text = parameter.text
    if parameter.options:
        options = ElementTree.SubElement(element, "options")
        for name, number in parameter.options:
            ElementTree.SubElement(options, "option", name=name, value=str(number))


def routes(found: Definition, path: str = PATH) -> list[web.RouteDef]:
    """For a web server: the file, open to all; it holds no secret."""
    from aiohttp import web  # only where there is a server

    async def get(request: web.Request) -> web.Response:
        return web.Response(body=found.xml, content_type="application/xml")

    return [web.get(path, get)]
