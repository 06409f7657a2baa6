"""What a flight was flown with, as its manifest says: software, machine, weights, and what was configured."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from gcs.config import Config
from gcs.config_explain import shown
from gcs.recorder.manifest import Manifest, plain
from gcs.report.figures import IMPORT, Changed, Provenance
from gcs.video.frame import redact

_SECRET: Final = frozenset({"page.token"})


def provenance_of(manifest: Manifest) -> Provenance:
    """For the report; addresses without user name and password."""
    video, weights = manifest.video, manifest.weights
    return Provenance(
        kind=manifest.kind,
        simulated=manifest.kind == "demo" or dict(_leaves(manifest.config)).get("vehicle.simulated") is True,
        vehicle=redact(manifest.vehicle or ""),
        video="" if video is None else f"{redact(video.address)}, {video.width_px}x{video.height_px} px",
        video_size_px=None if video is None else (video.width_px, video.height_px),
        weights="" if weights is None else weights.name,
        weights_sha256="" if weights is None else weights.sha256,
        seed=manifest.seed,
        software=manifest.software,
        machine=manifest.machine,
        changed=() if manifest.kind == IMPORT else tuple(_changed(manifest.config)),
    )


def _changed(config: Mapping[str, Any]) -> Iterator[Changed]:
    """Against the defaults of this version, whatever version it was flown with."""
    defaults = dict(_leaves(plain(Config())))
    for key, value in _leaves(config):
        default = defaults.get(key)
        if value != default:
            yield Changed(key, "(secret)" if key in _SECRET else redact(shown(value)), shown(default))


def _leaves(section: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in section.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{name}.")
        else:
            yield prefix + name, list(value) if isinstance(value, tuple) else value
