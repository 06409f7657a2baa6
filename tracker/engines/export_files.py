"""Exported graphs in a folder: one .onnx each, and a manifest that says of which weights and whether all is there."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tracker.configs import ConfigError, NetworkConfig
from tracker.engines.engine import EngineError
from tracker.engines.export import FLOAT32, INT8, OPSET, Graphs

FORMAT = "climrt-graphs/1"
MANIFEST = "export.json"
_EMBED = "embed-"


def write_graphs(folder: str | Path, graphs: Graphs, extra: Mapping[str, Any] | None = None) -> Path:
    """Write the graphs as ONNX and their manifest; returns its path. extra: JSON values that go into it."""
    return write_files(folder, graphs, graphs.files(), extra or {})


def write_files(folder: str | Path, graphs: Graphs, files: Mapping[str, bytes], extra: Mapping[str, Any]) -> Path:
    """The same for graphs in another form than ONNX. Raises EngineError for a folder that cannot be written."""
    folder = Path(folder)
    manifest = {
        "format": FORMAT,
        "precision": graphs.precision,
        "opset": OPSET,
        "network": graphs.network.to_dict(),
        "files": {name: {"bytes": len(content), "sha256": sha256(content)} for name, content in files.items()},
        **extra,
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in files.items():
            _write(folder / name, content)
        _write(folder / MANIFEST, (json.dumps(manifest, indent=2) + "\n").encode())  # last: now all is there
    except OSError as error:
        raise EngineError(f"{error.filename or folder}: {(error.strerror or str(error)).lower()}") from error
    return folder / MANIFEST


def read_graphs(folder: str | Path, *, weights_sha256: str | None = None) -> Graphs:
    """What write_graphs wrote, each file as its manifest says. Raises EngineError, naming what is wrong.

    weights_sha256: of the weights that it must have been exported from; None takes any.
    """
    folder = Path(folder)
    source = folder / MANIFEST
    try:
        values = json.loads(source.read_text(encoding="utf-8"))
        if not isinstance(values, dict) or values.get("format") != FORMAT:
            raise EngineError(f"{source}: is not a {FORMAT} manifest")
        if weights_sha256 is not None and values.get("weights_sha256") != weights_sha256:
            raise EngineError(f"{source}: was exported from other weights: export these (gcs weights export)")
        files = {name: _read(folder, name, str(entry["sha256"])) for name, entry in values["files"].items()}
        precision = values["precision"]
        if precision not in (FLOAT32, INT8):
            raise EngineError(f"{source}: precision {str(precision)[:40]!r}: must be {FLOAT32} or {INT8}")
        if "compare.onnx" not in files:
            raise EngineError(f"{source}: lists no compare.onnx: exported for another runtime, or not whole")
        embed = {int(name[len(_EMBED) : -5]): graph for name, graph in files.items() if name.startswith(_EMBED)}
        network = NetworkConfig.from_dict(values["network"])
        return Graphs(network, embed, files["compare.onnx"], files.get("between.onnx"), precision)
    except EngineError:
        raise
    except FileNotFoundError:
        raise EngineError(f"{folder}: no exported graphs there ({MANIFEST} is missing)") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError, ConfigError) as error:
        raise EngineError(f"{source}: is incomplete or malformed: {error}") from error


def _read(folder: Path, name: str, wanted: str) -> bytes:
    path = folder / name
    if Path(name).name != name:
        raise EngineError(f"{path}: must be a file in the manifest's own folder")
    try:
        graph = path.read_bytes()
    except OSError as error:
        raise EngineError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    if sha256(graph) != wanted:
        raise EngineError(f"{path}: sha256 is not the manifest's: the file is damaged or another one")
    return graph


def _write(path: Path, content: bytes) -> None:
    temporary = path.with_name(path.name + ".part")
    temporary.write_bytes(content)
    os.replace(temporary, path)


def sha256(content: bytes) -> str:
    """In hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()
