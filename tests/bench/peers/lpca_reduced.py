#!/usr/bin/python3
"""Local PCA that reduces first, as bench_compression's own does, in NumPy: the axes of some drawn
texels, clusters in that space by reconstruction error, one polish in all dimensions.

    bench_compression --dump rows.f32 --json
    peers/lpca_reduced.py rows.f32 4096 -k 32 -c 8
"""
import argparse
import json
import time

import numpy as np

SAMPLES, REDUCED, MEANS, MOST, SETTLED = 768, 128, 3, 40, 1e-4


def reduce_rows(rows, random):
    sample = rows[random.permutation(len(rows))[:SAMPLES]]
    mean = sample.mean(axis=0)
    sample = sample - mean
    values, vectors = np.linalg.eigh(sample @ sample.T)
    r = min(REDUCED, len(sample))
    axes, _ = np.linalg.qr((vectors[:, ::-1][:, :r].T @ sample).T)
    return rows @ axes - mean @ axes


def seed(rows, clusters, random):
    """k-means++."""
    means = [rows[random.integers(len(rows))]]
    nearest = ((rows - means[0]) ** 2).sum(axis=1)
    while len(means) < clusters:
        means.append(rows[random.choice(len(rows), p=nearest / nearest.sum())])
        nearest = np.minimum(nearest, ((rows - means[-1]) ** 2).sum(axis=1))
    return np.stack(means)


def assign(rows, means, axes):
    """Axes: clusters × components × dimensions, or None."""
    squares = (rows**2).sum(axis=1)[:, None]
    errors = squares - 2 * rows @ means.T + (means**2).sum(axis=1)
    if axes is not None:
        k, c, r = axes.shape
        products = (rows @ axes.reshape(k * c, r).T).reshape(-1, k, c)
        errors -= ((products - np.einsum("kcr,kr->kc", axes, means)) ** 2).sum(axis=2)
    return errors.argmin(axis=1), np.maximum(errors.min(axis=1), 0).sum()


def update(rows, labels, means, axes, components):
    """Means, and axes if there are any: by two power steps from those before, or exactly."""
    found = np.zeros((len(means), components, rows.shape[1]), np.float32)
    for k in range(len(means)):
        members = rows[labels == k]
        if len(members) == 0:
            continue
        means[k] = members.mean(axis=0)
        centred = members - means[k]
        if axes is None:
            found[k] = np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :components].T
            continue
        step = axes[k]
        for _ in range(2):
            step = np.linalg.qr(((centred @ step.T).T @ centred).T)[0].T
        found[k] = step
    return found


def cluster(rows, clusters, components, random):
    means, axes, before = seed(rows, clusters, random), None, np.inf
    for i in range(MEANS + MOST):
        labels, error = assign(rows, means, axes)
        if i + 1 < MEANS:
            means = np.stack(
                [
                    rows[labels == k].mean(axis=0) if (labels == k).any() else means[k]
                    for k in range(clusters)
                ]
            )
        else:
            axes = update(rows, labels, means, axes, components)
        if i > MEANS and error >= before * (1 - SETTLED):
            break
        before = np.inf if i < MEANS else error
    return labels, means, axes


def compress(rows, clusters, components):
    random = np.random.default_rng(0)
    reduced = reduce_rows(rows, random)
    labels, means, axes = cluster(reduced, clusters, components, random)
    models = {}
    for k in range(clusters):
        members = labels == k
        if not members.any():
            continue
        mean = rows[members].mean(axis=0)
        centred = rows[members] - mean
        products = (reduced[members] - means[k]) @ axes[k].T
        found, _ = np.linalg.qr((products.T @ centred).T)
        models[k] = mean, found.T, centred @ found
    return labels, models


def error_of(rows, labels, models):
    """Not timed, as ours knows its error from sums that it has anyway."""
    rest = 0.0
    for k, (mean, axes, weights) in models.items():
        rest += ((rows[labels == k] - mean - weights @ axes).astype(np.float64) ** 2).sum()
    return np.sqrt(rest / np.einsum("ij,ij->", rows, rows, dtype=np.float64))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("rows", type=int)
    parser.add_argument("-k", "--clusters", type=int, default=32)
    parser.add_argument("-c", "--components", type=int, default=8)
    options = parser.parse_args()
    rows = np.fromfile(options.file, dtype=np.float32).reshape(options.rows, -1)
    start = time.monotonic(), time.process_time()
    found = compress(rows, options.clusters, options.components)
    seconds = time.monotonic() - start[0], time.process_time() - start[1]
    error = error_of(rows, *found)
    print(
        json.dumps(
            {
                "peer": "NumPy, reduced first",
                "seconds": round(seconds[0], 3),
                "processor_s": round(seconds[1], 3),
                "error": round(float(error), 5),
            }
        )
    )


if __name__ == "__main__":
    main()
