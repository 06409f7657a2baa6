"""Import of the authors' checkpoints, from files made with their key names and shapes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from tests.parity.conftest import official_keys
from tracker.checkpoints import import_checkpoint
from tracker.configs import FULL, LatentProvider
from tracker.network.climrt import ClimRT
from tracker.weights import WeightsError, load_network, load_parts, read_manifest

State = dict[str, Tensor]


def official(part: str = "") -> State:
    """Tensors of the whole checkpoint, or of one part; zeros, but marked ones."""
    return {
        key: torch.full(shape, 0.25, dtype=getattr(torch, dtype))
        for key, (shape, dtype) in official_keys().items()
        if key.startswith(part)
    }


def renamed(state: State, rename: Callable[[str], str]) -> State:
    return {rename(key): value for key, value in state.items()}


def write(path: Path, content: object) -> Path:
    torch.save(content, path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("prefix", ["", "module."])
def test_whole_checkpoint(tmp_path: Path, prefix: str) -> None:
    content = {
        "epoch": 70,
        "state_dict": renamed(official(), lambda key: prefix + key),
        "optimizer": {"param_groups": [{"lr": 0.1}]},
    }
    source = write(tmp_path / "t_best.pth", content)
    imported = import_checkpoint(source, tmp_path / "full.safetensors")
    assert imported.parts == ("backbone", "internet", "grader")
    network = load_network(imported.path)
    assert network.config == FULL
    assert {float(value.max()) for value in network.state_dict().values() if value.ndim} == {0.25}
    manifest = read_manifest(imported.path)
    assert manifest.tracker.latent is LatentProvider.CLIMNET
    assert manifest.extra == {"source": "imported from t_best.pth"}


def test_climnet_alone(tmp_path: Path) -> None:
    state = renamed(official("internet."), lambda key: "module." + key.removeprefix("internet."))
    source = write(tmp_path / "model_best.pth", {"epoch": 1, "state_dict": state, "best_psnr": 33.5})
    imported = import_checkpoint(source, tmp_path / "climnet.safetensors")
    assert imported.parts == ("internet",)
    with pytest.raises(WeightsError, match="holds only internet"):
        load_network(imported.path)


@pytest.mark.parametrize(
    "rename",
    [
        lambda key: key,
        lambda key: key.removeprefix("backbone."),
        lambda key: key.replace("backbone.", "features."),
        lambda key: key.replace("backbone.", "backbone.features."),
    ],
    ids=["backbone.", "bare", "features.", "backbone.features."],
)
def test_backbone_alone(tmp_path: Path, rename: Callable[[str], str]) -> None:
    source = write(tmp_path / "alexnet-bn.pth", renamed(official("backbone."), rename))
    imported = import_checkpoint(source, tmp_path / "backbone.safetensors")
    assert imported.parts == ("backbone",)
    network = ClimRT(FULL)
    assert load_parts(imported.path, network) == ("backbone",)
    assert float(network.backbone.layer1[0].weight.detach().min()) == 0.25


def test_unused_entries_may_be_absent(tmp_path: Path) -> None:
    state = {key: value for key, value in official("internet.").items() if ".bn3d." not in key}
    assert len(state) < len(official("internet."))
    import_checkpoint(write(tmp_path / "m.pth", state), tmp_path / "out.safetensors")


def spoil(state: State) -> State:
    del state["backbone.layer2.0.weight"]
    state["backbone.layer6.0.weight"] = torch.zeros(1)
    state["backbone.layer3.0.bias"] = torch.zeros(7)
    return state


def test_misfits_are_named_in_one_line(tmp_path: Path) -> None:
    source = write(tmp_path / "bad.pth", spoil(official("backbone.")))
    out = tmp_path / "out.safetensors"
    with pytest.raises(WeightsError) as caught:
        import_checkpoint(source, out)
    message = str(caught.value)
    assert "bad.pth" in message
    assert "1 missing (backbone.layer2.0.weight)" in message
    assert "1 unexpected (backbone.layer6.0.weight)" in message
    assert "1 of another shape (backbone.layer3.0.bias is (7,), not (384,))" in message
    assert "\n" not in message
    assert not out.exists()


class Trap:
    """A pickled object that would run code when read."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (pytest.fail, ("the checkpoint's code was run",))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"state_dict": {"a": Trap()}}, "is no checkpoint, or holds more than plain tensors"),
        ([1, 2], "not a dictionary of tensors"),
        ({}, "not a dictionary of tensors"),
        ({"backbone.layer1.0.weight": 3}, "not a dictionary of tensors"),
        ({"net.weight": torch.zeros(2)}, "holds nothing of ClimRT"),
    ],
    ids=["code", "list", "empty", "numbers", "another network"],
)
def test_other_files_are_refused(tmp_path: Path, content: object, reason: str) -> None:
    source = write(tmp_path / "odd.pth", content)
    with pytest.raises(WeightsError, match=reason) as caught:
        import_checkpoint(source, tmp_path / "out.safetensors")
    assert "\n" not in str(caught.value)


def test_broken_files_are_refused(tmp_path: Path) -> None:
    for name, data in (("text.pth", b"hello"), ("empty.pth", b"")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(WeightsError, match=name):
            import_checkpoint(tmp_path / name, tmp_path / "out.safetensors")
    whole = write(tmp_path / "cut.pth", official("backbone.layer1")).read_bytes()
    (tmp_path / "cut.pth").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(WeightsError, match="cannot be read"):
        import_checkpoint(tmp_path / "cut.pth", tmp_path / "out.safetensors")
    with pytest.raises(WeightsError, match="no such checkpoint"):
        import_checkpoint(tmp_path / "none.pth", tmp_path / "out.safetensors")
