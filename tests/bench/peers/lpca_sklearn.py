#!/usr/bin/python3
"""MiniBatchKMeans, then TruncatedSVD of each cluster: a peer for bench_compression (python3-sklearn).

    bench_compression --dump rows.f32 --json
    peers/lpca_sklearn.py rows.f32 4096 -k 32 -c 8
"""
import argparse
import json
import time

import numpy as np
from sklearn.cluster import MiniBatchKMeans
from sklearn.decomposition import TruncatedSVD


def compress(rows, clusters, components):
    labels = MiniBatchKMeans(clusters, random_state=0, n_init=1).fit_predict(rows)
    models = {}
    for k in np.unique(labels):
        mean = rows[labels == k].mean(axis=0)
        centred = rows[labels == k] - mean
        if len(centred) <= components:
            continue
        svd = TruncatedSVD(components, random_state=0)
        weights = svd.fit_transform(centred)
        models[k] = mean, svd.components_, weights
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
                "peer": "scikit-learn",
                "seconds": round(seconds[0], 3),
                "processor_s": round(seconds[1], 3),
                "error": round(float(error), 5),
            }
        )
    )


if __name__ == "__main__":
    main()
