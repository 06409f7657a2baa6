"""Deterministic fill rule + synthetic inputs for the ClimRT parity data (own code, numpy only).
Uses only the raw 64-bit stream of PCG64 (stable across NumPy versions), never Generator.normal()."""

import zlib

import numpy as np


def u01(seed, shape):
    """float64 uniforms in [0,1): PCG64(seed).random_raw -> top 53 bits * 2**-53, C order."""
    n = int(np.prod(shape)) if len(shape) else 1
    raw = np.random.PCG64(seed).random_raw(n)
    return ((np.atleast_1d(raw) >> np.uint64(11)) * 2.0**-53).reshape(shape)


def unit(seed, shape):
    """zero mean, unit variance uniform: (2u-1)*sqrt(3)."""
    return (2.0 * u01(seed, shape) - 1.0) * np.sqrt(3.0)


# multiplies the default gain sqrt(2) of weights with ndim >= 2; first matching prefix wins
GAIN = [
    ("backbone.layer1.0.weight", 0.02),
    ("grader.conv1.0.weight", 0.0004),
    ("grader.conv2.0.weight", 0.0004),
    ("grader.conv3.0.weight", 0.0004),
    ("grader.convloc.9.weight", 0.20),
    ("grader.cls1.weight", 0.50),
    ("grader.cls2.weight", 0.50),
    ("internet.decoder", 1.60),
    ("internet.encoder", 1.20),
]


def fill(key, shape, dtype="float32"):
    """numpy array for one state_dict entry, from its full official key name and shape."""
    if "int" in str(dtype):  # num_batches_tracked
        return np.zeros(shape, np.int64)
    seed = zlib.crc32(key.encode("ascii"))
    if key.endswith("running_mean"):
        a = 0.1 * unit(seed, shape)
    elif key.endswith("running_var"):
        a = 0.5 + u01(seed, shape)
    elif "_embed." in key:
        a = u01(seed, shape)
    elif len(shape) >= 2:
        g = next((v for p, v in GAIN if key.startswith(p)), 1.0)
        a = unit(seed, shape) * (g * np.sqrt(2.0 / np.prod(shape[1:])))
    elif key == "grader.convloc.9.bias":  # keeps predicted widths and heights positive
        a = 0.25 + 0.05 * unit(seed, shape)
    elif key.endswith("bias"):
        a = 0.05 * unit(seed, shape)
    else:  # 1-D scale of BN / GN / LN
        a = 0.8 + 0.4 * u01(seed, shape)
    return a.astype(np.float32)


def frame(t, h=480, w=640, seed=7, obj_xy=(300, 200), obj_wh=(48, 36), step=(6, -4)):
    """uint8 BGR frame number t: blocky textured ground, per-pixel noise, one textured moving rectangle."""
    g = np.kron(60 + np.floor(140 * u01(seed, (h // 20, w // 20, 3))), np.ones((20, 20, 1)))
    g = g + np.floor(21 * u01(seed + 1, (h, w, 3))) - 10
    ow, oh = obj_wh
    o = np.kron(np.floor(256 * u01(seed + 2, (oh // 6, ow // 6, 3))), np.ones((6, 6, 1)))
    x, y = obj_xy[0] + step[0] * t, obj_xy[1] + step[1] * t
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + ow, w), min(y + oh, h)
    g[y0:y1, x0:x1] = o[y0 - y : y1 - y, x0 - x : x1 - x]
    return np.clip(g, 0, 255).astype(np.uint8)


def patch(seed, h, w, batch=1):
    """float32 (B,3,h,w) image-like array, integers 0..255 (smooth blocks + noise)."""
    b = 16
    hh, ww = -(-h // b), -(-w // b)
    g = np.kron(30 + np.floor(190 * u01(seed, (batch, 3, hh, ww))), np.ones((1, 1, b, b)))[:, :, :h, :w]
    g = g + np.floor(31 * u01(seed + 1, (batch, 3, h, w))) - 15
    return np.clip(g, 0, 255).astype(np.float32)
