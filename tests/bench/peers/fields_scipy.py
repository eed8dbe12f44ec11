#!/usr/bin/python3
"""Reflectance fields fitted one by one by SciPy's least_squares (python3-scipy): a peer that
bench_compression --fields runs on the problems it gives to its own solver, from the same start.
"""
import sys
import time

import numpy as np
from scipy.optimize import least_squares

LOWEST, HIGHEST = np.log(0.5), np.log(64)


def lobes(x, lights):
    """Values of the lobes, and the columns of the Jacobian."""
    columns, total = [], 0
    for g, log_n in ((x[0:3], x[3]), (x[4:7], x[7])):
        size = np.linalg.norm(g) + 1e-20
        inside = LOWEST <= log_n <= HIGHEST
        n = np.exp(np.clip(log_n, LOWEST, HIGHEST))
        cosine = lights @ (g / size)
        lit = cosine > 1e-4
        safe = np.where(lit, cosine, 1)
        slope = np.where(lit, safe ** (n - 1), 0)
        power = slope * safe
        total = total + size * power
        columns.append((power * (1 - n))[:, None] * (g / size) + (n * slope)[:, None] * lights)
        columns.append((size * power * n * np.log(safe) * inside)[:, None])
    return total, np.hstack(columns)


def main():
    with open(sys.argv[1], "rb") as file:
        n, m = np.fromfile(file, np.int32, 2)
        lights = np.fromfile(file, np.float32, 3 * m).reshape(m, 3).astype(float)
        rows = np.fromfile(file, np.float32, n * m).reshape(n, m).astype(float)
        starts = np.fromfile(file, np.float32, 8 * n).reshape(n, 8).astype(float)
    cost = 0.0
    begun = time.process_time()
    for row, start in zip(rows, starts):
        found = least_squares(
            lambda x: lobes(x, lights)[0] - row,
            start,
            lambda x: lobes(x, lights)[1],
            method="lm",
            ftol=1e-5,
            xtol=1e-7,
            max_nfev=80,
        )
        cost += 2 * found.cost
    seconds = time.process_time() - begun
    print('{"peer": "scipy", "seconds": %.6f, "cost": %.6g}' % (seconds, cost))


if __name__ == "__main__":
    main()
