#!/usr/bin/env python3
"""Evaluates a local PCA at the points that bench_material wrote: eigenbrdfs_numpy.py FOLDER.

Prints evaluations a second of a loop over the points and of one expression for all of them. Values must be
those of the library. Exit status 3: there is no NumPy.
"""
import sys
import time

try:
    import numpy as np
except ImportError:
    sys.exit(3)

folder = sys.argv[1]


def read(name, kind, *shape):
    return np.fromfile(f"{folder}/{name}", kind).reshape(shape)


n, width, height, n_views, n_lights, n_clusters, c = map(
    int, open(f"{folder}/sizes").read().split()
)
clusters = read("clusters", np.int32, -1)
# With a weight of 1 for the mean.
weights = np.concatenate(
    [np.ones((width * height, 1), np.float32), read("weights", np.float32, -1, c)], axis=1
)
brdfs = read("brdfs", np.float32, n_clusters, c + 1, n_views, n_lights, 3)
uv, expected = read("uv", np.float32, n, 2), read("rgb", np.float32, n, 3)
four = np.dtype([("index", np.int32, 4), ("weight", np.float32, 4)])
views, lights = read("views", four, n), read("lights", four, n)

# The four texels around each point, and their bilinear weights.
at = uv * [width, height] - 0.5
first = np.floor(at).astype(int)
part = at - first
x = (first[:, :1] + [0, 1, 0, 1]) % width
y = (first[:, 1:] + [0, 0, 1, 1]) % height
texels = y * width + x
shares = (
    np.where(np.arange(4) % 2, part[:, :1], 1 - part[:, :1])
    * np.where(np.arange(4) // 2, part[:, 1:], 1 - part[:, 1:])
).astype(np.float32)


def one(k):
    """Σ_x s_x Σ_a Σ_b g_a h_b Σ_i w_i E_i(a, b)"""
    pairs = np.outer(views["weight"][k], lights["weight"][k]).ravel()
    value = 0
    for texel, share in zip(texels[k], shares[k]):
        table = brdfs[clusters[texel]][:, views["index"][k][:, None], lights["index"][k]]
        value = value + share * (pairs @ (weights[texel] @ table.reshape(c + 1, -1)).reshape(16, 3))
    return value


def all_points():
    pairs = (views["weight"][:, :, None] * lights["weight"][:, None, :]).reshape(n, 16)
    value = np.zeros((n, 3), np.float32)
    for k in range(4):
        table = brdfs[
            clusters[texels[:, k]][:, None, None],
            :,
            views["index"][:, :, None],
            lights["index"][:, None, :],
        ]
        value += shares[:, k : k + 1] * np.einsum(
            "np,npic,ni->nc",
            pairs,
            table.reshape(n, 16, c + 1, 3),
            weights[texels[:, k]],
            optimize=True,
        )
    return value


def rate(function):
    best, values = 0, None
    for _ in range(3):
        begun = time.process_time()
        values = function()
        best = max(best, n / (time.process_time() - begun))
    if np.abs(np.maximum(values, 0) - expected).max() > 1e-4:
        sys.exit(f"values differ by {np.abs(values - expected).max()}")
    return best


print(rate(lambda: np.array([one(k) for k in range(n)])), rate(all_points))
