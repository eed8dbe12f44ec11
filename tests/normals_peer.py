#!/usr/bin/env python3
"""Robust photometric stereo apart from processing/maps, with the standard library alone.

  normals_peer.py N_LIGHTS LIGHTS VALUES NORMALS

LIGHTS: f64, x y z of each; VALUES: f64, N_LIGHTS of each texel; NORMALS: f64, written, x y z of each texel.
Each texel: least median of squares over triples of lights (Rousseeuw 1984), then least squares reweighted by
Tukey's biweight with the median absolute deviation of its residuals as the scale, over the lights that it faces.
"""
import itertools
import random
import sys
from array import array

MOST_TRIPLES = 120
ROUNDS = 10


def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def solve3(m, v):
    """Solves m x = v for a symmetric matrix (xx, xy, xz, yy, yz, zz); None: singular."""
    a, b, c, d, e, f = m
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * p + b * q + c * r
    if abs(det) < 1e-9:
        return None
    s, t, u = a * f - c * c, b * c - a * e, a * d - b * b
    return (
        (p * v[0] + q * v[1] + r * v[2]) / det,
        (q * v[0] + s * v[1] + t * v[2]) / det,
        (r * v[0] + t * v[1] + u * v[2]) / det,
    )


def weighted(lights, values, weights):
    m, v = [0.0] * 6, [0.0] * 3
    for l, y, w in zip(lights, values, weights):
        if w > 0:
            x0, x1, x2 = l
            m[0] += w * x0 * x0
            m[1] += w * x0 * x1
            m[2] += w * x0 * x2
            m[3] += w * x1 * x1
            m[4] += w * x1 * x2
            m[5] += w * x2 * x2
            v[0] += w * x0 * y
            v[1] += w * x1 * y
            v[2] += w * x2 * y
    return solve3(m, v)


def median(values):
    values = sorted(values)
    n = len(values)
    return 0.5 * (values[(n - 1) // 2] + values[n // 2])


def normal_of(lights, values, triples):
    best, least = None, float("inf")
    for i, j, k in triples:
        b = weighted(
            [lights[i], lights[j], lights[k]], [values[i], values[j], values[k]], [1, 1, 1]
        )
        if b is None:
            continue
        off = median([abs(y - max(dot(b, l), 0)) for l, y in zip(lights, values)])
        if off < least:
            best, least = b, off
    for _ in range(ROUNDS):
        if best is None:
            return (0, 0, 0)
        rest = [(y - dot(best, l), dot(best, l) > 0) for l, y in zip(lights, values)]
        facing = [abs(r) for r, faces in rest if faces]
        if len(facing) < 3:
            break
        # Three unknowns make the smallest residuals small: the median of the others.
        scale = 1.4826 * median(sorted(facing)[min(3, len(facing) - 1) :] or facing) + 1e-9
        weights = [max(1 - (r / (4.685 * scale)) ** 2, 0) ** 2 if faces else 0 for r, faces in rest]
        b = weighted(lights, values, weights)
        if b is None:
            break
        best = b
    length = dot(best, best) ** 0.5
    return tuple(x / length for x in best) if length > 0 else (0, 0, 0)


def main():
    n = int(sys.argv[1])
    data = [array("d"), array("d")]
    for to, path in zip(data, sys.argv[2:4]):
        with open(path, "rb") as file:
            to.frombytes(file.read())
    lights = [tuple(data[0][3 * i : 3 * i + 3]) for i in range(n)]
    triples = list(itertools.combinations(range(n), 3))
    if len(triples) > MOST_TRIPLES:
        triples = random.Random(1).sample(triples, MOST_TRIPLES)
    out = array("d")
    for t in range(len(data[1]) // n):
        out.extend(normal_of(lights, list(data[1][n * t : n * (t + 1)]), triples))
    with open(sys.argv[4], "wb") as file:
        file.write(out.tobytes())


main()
