#!/usr/bin/python3
"""Local PCA the plain way, in NumPy: a peer for bench_compression, on the rows that it dumps.

    bench_compression --dump rows.f32 --json
    peers/lpca_numpy.py rows.f32 4096 -k 32 -c 8
"""
import argparse
import json
import time

import numpy as np


def axes_of(rows, components):
    """Mean, and principal axes by a randomised SVD with one power step."""
    mean = rows.mean(axis=0)
    centred = rows - mean
    random = np.random.default_rng(1)
    width = min(components + 8, *centred.shape)
    y = centred @ random.standard_normal((rows.shape[1], width), dtype=np.float32)
    y, _ = np.linalg.qr(centred @ (centred.T @ y))
    _, _, vt = np.linalg.svd(y.T @ centred, full_matrices=False)
    return mean, vt[:components]


def errors_of(rows, squares, mean, axes):
    weights = rows @ axes.T - mean @ axes.T
    return squares - 2 * rows @ mean + mean @ mean - (weights**2).sum(axis=1)


def lpca(rows, clusters, components, iterations):
    random = np.random.default_rng(0)
    squares = np.einsum("ij,ij->i", rows, rows)
    seeds = rows[random.choice(len(rows), clusters, replace=False)]
    labels = (((seeds**2).sum(axis=1) - 2 * rows @ seeds.T)).argmin(axis=1)
    for _ in range(iterations):
        models = [
            axes_of(rows[labels == k], components) for k in range(clusters) if (labels == k).any()
        ]
        errors = np.stack([errors_of(rows, squares, *model) for model in models], axis=1)
        labels = errors.argmin(axis=1)
    weights = [(rows[labels == k] - mean) @ axes.T for k, (mean, axes) in enumerate(models)]
    return labels, models, weights


def error_of(rows, labels, models, weights):
    """Not timed, as ours knows its error from sums that it has anyway."""
    rest = 0.0
    for k, (mean, axes) in enumerate(models):
        rest += ((rows[labels == k] - mean - weights[k] @ axes).astype(np.float64) ** 2).sum()
    return np.sqrt(rest / np.einsum("ij,ij->", rows, rows, dtype=np.float64))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("rows", type=int)
    parser.add_argument("-k", "--clusters", type=int, default=32)
    parser.add_argument("-c", "--components", type=int, default=8)
    parser.add_argument("-i", "--iterations", type=int, default=10)
    options = parser.parse_args()
    rows = np.fromfile(options.file, dtype=np.float32).reshape(options.rows, -1)
    start = time.monotonic(), time.process_time()
    found = lpca(rows, options.clusters, options.components, options.iterations)
    seconds = time.monotonic() - start[0], time.process_time() - start[1]
    error = error_of(rows, *found)
    print(
        json.dumps(
            {
                "peer": "numpy",
                "seconds": round(seconds[0], 3),
                "processor_s": round(seconds[1], 3),
                "error": round(float(error), 5),
            }
        )
    )


if __name__ == "__main__":
    main()
