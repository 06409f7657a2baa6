"""Backbone, ClimNet, cross transformer and heads against the authors' code."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.parity.conftest import Golden, official_keys, patch
from tracker.configs import FULL
from tracker.network.climnet import latent_patch
from tracker.network.climrt import ClimRT
from tracker.network.correlation import correlate
from tracker.network.folded import FoldedClimNet
from tracker.network.inference import for_inference

Features = dict[str, tuple[Tensor, Tensor]]


def assert_close(found: Tensor, wanted: np.ndarray, atol: float) -> None:
    assert tuple(found.shape) == wanted.shape
    np.testing.assert_allclose(found.numpy(), wanted, rtol=0, atol=atol)


def test_filled_weights_are_the_reference_ones(state_dict: dict[str, Tensor], golden: Golden) -> None:
    check = golden("weights_check")
    for key, total in zip(check["keys"], check["sums"], strict=True):
        assert float(state_dict[str(key)].double().sum()) == pytest.approx(float(total), rel=1e-12, abs=1e-9)


def test_names_and_shapes_are_the_official_ones() -> None:
    with torch.device("meta"):
        ours = {key: tuple(value.shape) for key, value in ClimRT(FULL).state_dict().items()}
    official = {key: shape for key, (shape, _) in official_keys().items()}
    unused = {key for key in official if ".eles." in key or ".bn3d." in key}
    assert ours == {key: shape for key, shape in official.items() if key not in unused}


@pytest.mark.parametrize("ready", [False, True], ids=["reference", "for_inference"])
def test_backbone(full: ClimRT, golden: Golden, ready: bool) -> None:
    data = golden("a_backbone")
    network = for_inference(full) if ready else full
    z4, z5 = network.template(patch(100, 127))
    x4, x5 = network.features(patch(200, 287))
    assert_close(z4, data["z4"], 1e-3)
    assert_close(z5, data["z5"], 1e-3)
    assert_close(x4[:, ::24], data["x4_ch0_24"], 1e-3)
    assert_close(x5[:, ::16], data["x5_ch0_16"], 1e-3)
    f4, f5 = network.features(patch(300, 287))
    for name, value in (("x4", x4), ("x5", x5), ("f4", f4), ("f5", f5)):
        assert_close(value.mean((2, 3)), data[f"{name}_chmean"], 1e-3)


def test_correlations(features: Features, golden: Golden) -> None:
    data = golden("c_lct_heads")
    (z4, z5), (x4, x5), (_, f5) = features["z"], features["x"], features["f"]
    for name, pair in (("corr4", (x4, z4)), ("corr5", (x5, z5)), ("corrt", (f5, z5))):
        sums = correlate(*pair).sum((2, 3)).numpy().ravel()
        np.testing.assert_allclose(sums, data[f"{name}_sum"].ravel(), rtol=1e-4, atol=1.0)


def test_cross_transformer_and_heads(full: ClimRT, features: Features, golden: Golden) -> None:
    data = golden("c_lct_heads")
    seen: dict[str, Tensor] = {}

    def keep(name: str):  # type: ignore[no-untyped-def]
        return lambda _module, _inputs, output: seen.__setitem__(
            name, output[0] if isinstance(output, tuple) else output
        )

    grader = full.grader
    layer = grader.transformer.encoder.layers[0]
    hooks = [
        module.register_forward_hook(keep(name))
        for name, module in (
            ("Ms4", grader.conv1),
            ("Ms5", grader.conv2),
            ("Mt5", grader.conv3),
            ("enc_norm1_SBC", layer.norm1),
            ("enc_attn_SBC", layer.self_attn),
            ("enc_conv2_BCHW", layer.conv2),
            ("memory_SBC", grader.transformer.encoder),
            ("decoded_SBC", grader.transformer.decoder),
        )
    ]
    try:
        out = full.heads(features["x"], features["z"], features["f"][1])
    finally:
        for hook in hooks:
            hook.remove()
    assert len(seen) == 8
    for name, value in seen.items():
        assert_close(value.transpose(0, 1) if name.endswith("_SBC") else value, data[name], 1e-4)
    for name, value in out._asdict().items():
        assert_close(value, data[name], 1e-4)


def test_heads_of_the_inference_form(full: ClimRT, golden: Golden) -> None:
    data = golden("c_lct_heads")
    ready = for_inference(full)
    x, z, f = ready.features(patch(200, 287)), ready.template(patch(100, 127)), ready.features(patch(300, 287))
    for name, value in ready.heads(x, z, f[1])._asdict().items():
        assert_close(value, data[name], 1e-4)


def test_quirks_are_told_apart(full: ClimRT, features: Features, golden: Golden) -> None:
    """The reference data would show a permuted encoder or a residual in the cross-attention."""
    data = golden("c_lct_heads")
    for change in ({"legacy_layout": False}, {"cross_attention_residual": True}):
        other = ClimRT(replace(FULL, climnet=None, **change)).eval().requires_grad_(False)
        other.load_state_dict({k: v for k, v in full.state_dict().items() if not k.startswith("internet.")})
        out = other.heads(features["x"], features["z"], features["f"][1])
        assert np.abs(out.loc.numpy() - data["loc"]).max() > 0.1


def test_batch_does_not_mix_samples(full: ClimRT, features: Features) -> None:
    z, x, f = features["z"], features["x"], features["f"]
    pair = [torch.cat([a, b]) for a, b in zip(x, f, strict=True)]
    twice = [torch.cat([a, a]) for a in z]
    out = full.heads((pair[0], pair[1]), (twice[0], twice[1]), torch.cat([f[1], x[1]]))
    alone = full.heads(x, z, f[1])
    assert_close(out.loc[:1], alone.loc.numpy(), 1e-5)


@pytest.mark.parametrize("folded", [False, True], ids=["reference", "folded"])
def test_climnet_64(full: ClimRT, golden: Golden, folded: bool) -> None:
    data = golden("b_climnet")
    climnet = FoldedClimNet(full.internet) if folded else full.internet
    first, second = patch(400, 64) / 255, patch(500, 64) / 255
    assert_close(climnet(first, second), data["out64"], 2e-5)
    assert_close(climnet(first, first), data["out64_same"], 2e-5)


def test_climnet_stages(full: ClimRT, golden: Golden) -> None:
    data = golden("b_climnet")
    names = sorted({key.removeprefix("stage64_").rsplit("_", 1)[0] for key in data if key.startswith("stage64_")})
    assert len(names) >= 10
    modules = {name.replace(".", "_"): module for name, module in full.internet.named_modules()}
    seen: dict[str, Tensor] = {}
    hooks = [
        modules[name].register_forward_hook(lambda _m, _i, out, name=name: seen.__setitem__(name, out.clone()))
        for name in names
    ]
    try:
        full.internet(patch(400, 64) / 255, patch(500, 64) / 255)
    finally:
        for hook in hooks:
            hook.remove()
    assert sorted(seen) == names
    for name, value in seen.items():
        sub = value[:, ::16, :, ::4, ::4] if value.ndim == 5 else value[:, ::16, ::4, ::4]
        assert_close(sub, data[f"stage64_{name}_sub"], 1e-4)
        mean = value.mean(tuple(range(2, value.ndim))).numpy().ravel()
        np.testing.assert_allclose(mean, data[f"stage64_{name}_mean"].ravel(), rtol=0, atol=1e-4)


@pytest.mark.slow
def test_climnet_288_and_latent_frame(full: ClimRT, golden: Golden) -> None:
    data = golden("b_climnet")
    climnet = FoldedClimNet(full.internet)
    outputs: list[Tensor] = []
    hook = climnet.register_forward_hook(lambda _m, _i, out: outputs.append(out))
    latent = latent_patch(climnet, patch(410, 287), patch(510, 287))
    hook.remove()
    assert_close(outputs[0][..., ::4, ::4], data["out288_sub4"].reshape(1, 3, 72, 72), 2e-5)
    assert latent.shape == (1, 3, 287, 287)
    wanted = data["latent287_u8_sub3"].astype(int)
    difference = latent[..., ::3, ::3].numpy().astype(int).reshape(wanted.shape) - wanted
    assert np.abs(difference).max() <= 1
    assert (difference != 0).mean() < 0.005
