"""What a flight was flown with: versions, configuration, weights, clock, machine. The first file of its folder."""

from __future__ import annotations

import contextlib
import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from gcs.config import Config
from gcs.config_yaml import check_ranges
from gcs.errors import GcsError, one_line
from gcs.recorder.seconds import Seconds
from gcs.regular_file import open_regular
from gcs.video.frame import redact

MANIFEST: Final = "manifest.json"
FORMAT: Final = 1


class ManifestError(GcsError):
    """A manifest that is not there or cannot be read; names the file."""


class VideoFacts(msgspec.Struct, frozen=True):
    """The video source; address without user name and password."""

    address: str
    width_px: Annotated[int, msgspec.Meta(ge=1, le=65535)]
    height_px: Annotated[int, msgspec.Meta(ge=1, le=65535)]
    fps: float | None


class WeightsFacts(msgspec.Struct, frozen=True):
    """The tracker's weights; sha256 of the file. engine, threads: what ran them; others may change the last bits."""

    name: str
    sha256: str
    threads: int
    engine: str = "torch"
    latent: str | None = None  # provider of the latent frame; None: not told


class Manifest(msgspec.Struct, frozen=True, kw_only=True):
    """kind: run, demo, dry-run or import. started, ended: UTC, ISO 8601; ended: None until the orderly end.

    t_start_s: reading of the flight's monotonic clock at unix_start_s, seconds since 1970. software: version by name.
    machine: facts by name. config: as `gcs.config.Config`, in plain values. follows: how often something was followed,
    None: not known. dropped: records that were not written.
    """

    kind: str
    started: str
    t_start_s: Seconds
    unix_start_s: Seconds
    software: dict[str, str]
    machine: dict[str, str]
    config: dict[str, Any]
    video: VideoFacts | None = None
    vehicle: str | None = None  # its address
    weights: WeightsFacts | None = None
    seed: int | None = None
    watermark: str | None = None
    ended: str | None = None
    follows: int | None = None
    dropped: int = 0
    problems: tuple[str, ...] = ()
    format: int = FORMAT

    @property
    def configuration(self) -> Config:
        """As it was flown with. ManifestError where this version no longer takes it."""
        try:
            config = msgspec.convert(self.config, Config)
            check_ranges(config)
            return config
        except (msgspec.ValidationError, ValueError) as error:
            raise ManifestError(one_line(f"{MANIFEST}: its configuration is not of this version: {error}")) from error

    def unix_s(self, t_s: float) -> float:
        """Seconds since 1970 at t_s of the flight's clock."""
        return self.unix_start_s + t_s - self.t_start_s


def plain(config: Config) -> dict[str, Any]:
    """For `Manifest.config`: without the page's token, and addresses without what lets one in."""
    page = replace(config.page, token=None)
    values: dict[str, Any] = _redacted(msgspec.to_builtins(replace(config, page=page)))
    return values


def _redacted(value: Any) -> Any:
    match value:
        case dict():
            return {key: _redacted(each) for key, each in value.items()}
        case str():
            return redact(value)
        case _:
            return value


def write_manifest(folder: Path, manifest: Manifest) -> None:
    """At once or not at all; OSError where it cannot be."""
    draft = folder / f"{MANIFEST}.new"
    try:
        with draft.open("wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(manifest), indent=1) + b"\n")
            file.flush()
            os.fsync(file.fileno())
        draft.replace(folder / MANIFEST)
    except OSError:
        with contextlib.suppress(OSError):
            draft.unlink()
        raise


def read_manifest(folder: Path) -> Manifest:
    """Raises ManifestError."""
    path = folder / MANIFEST
    try:
        with open_regular(path) as file:
            manifest = msgspec.json.decode(file.read(), type=Manifest)
    except OSError as error:
        raise ManifestError(f"{path}: {(error.strerror or str(error)).lower()}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ManifestError(one_line(f"{path}: not a manifest: {error}")) from error
    if manifest.format != FORMAT:
        raise ManifestError(f"{path}: format {manifest.format}; this version reads {FORMAT}")
    return manifest
