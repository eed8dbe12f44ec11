#!/usr/bin/env python3
"""Relight's bases in NumPy: each picture of a dome predicted from all others, by fits that are repeated.

    relight_numpy.py SESSION [--json]

Reads the only view of a session from its EXR files, and repeats the fit without each light, as “relight-cli -E” does.
The formulas are those of Relight 2026 (src/cli/rtibuilder.cpp, src/rti.cpp): ptm with 18 planes, hsh with 27, rbf with
18 and 27 planes and its default sigma of 0.125 and others, bilinear on 8 x 8 octahedral samples with 27 planes. Pictures
are taken as sRGB, before coefficients are rounded to 8 bits and stored as JPEG. Light is distant: the direction is
that of the middle of the sample. This peer shares no code with Mesorig but the package “mesorig” that reads EXR files.
"""
import argparse
import json
import os
import sys

import numpy as np

sys.path.insert(
    0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..", "python")
)
import mesorig  # noqa: E402


def encode(linear):
    linear = np.clip(linear, 0, None)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def fall_off(points, middle, lamps, aims, exponents):
    """Irradiance of points (n x 3) on planes that face each lamp, relative to that of the middle: lamps x n."""

    def irradiance(at):
        way = at[None] - lamps[:, None]
        r = np.linalg.norm(way, axis=2)
        return np.clip((way * aims[:, None]).sum(2) / r, 0, None) ** exponents[:, None] / r**2

    return irradiance(points) / irradiance(middle[None])


def read(path):
    """Pictures (lights x texels x 3, sRGB) relative to a white plane in the middle, and directions of the lights."""
    file = mesorig.open(path).btf.view(0)
    taken = [
        i
        for i in range(file.values.shape[2])
        if (file.flags[:, :, i] & mesorig.FLAG_PREDICTED).mean() < 0.5
    ]
    values = np.nan_to_num(file.values[:, :, taken].reshape(-1, len(taken), 3)).transpose(1, 0, 2)
    lights = file.lights.vectors[taken].astype(float)
    lamps, aims, exponents = file.lamp_mm[taken], file.lamp_aim[taken], file.lamp_exponent[taken]
    if np.isfinite(lamps).all():
        middle = np.array([0, 0, file.grid.reference_mm])
        lights = (lamps - middle) / np.linalg.norm(lamps - middle, axis=1, keepdims=True)
        values = (
            values
            * fall_off(file.grid.centres_mm.reshape(-1, 3), middle, lamps, aims, exponents)[
                :, :, None
            ]
        )
    return encode(values), lights


def ptm(l):
    return np.stack(
        [np.ones(len(l)), l[:, 0], l[:, 1], l[:, 0] ** 2, l[:, 0] * l[:, 1], l[:, 1] ** 2], -1
    )


def hsh(l):
    """lightWeightsHsh(): nine terms."""
    phi, z = np.arctan2(l[:, 1], l[:, 0]), np.minimum(
        np.arccos(np.clip(l[:, 2], 0, 1)), np.pi / 2 - 0.01
    )
    c = np.cos(z)
    w = np.sqrt(c - c * c)
    return np.stack(
        [
            np.full(len(l), 1 / np.sqrt(2 * np.pi)),
            np.sqrt(6 / np.pi) * np.cos(phi) * w,
            np.sqrt(3 / (2 * np.pi)) * (2 * c - 1),
            np.sqrt(6 / np.pi) * w * np.sin(phi),
            np.sqrt(30 / np.pi) * np.cos(2 * phi) * (c * c - c),
            np.sqrt(30 / np.pi) * np.cos(phi) * (2 * c - 1) * w,
            np.sqrt(5 / (2 * np.pi)) * (1 - 6 * c + 6 * c * c),
            np.sqrt(30 / np.pi) * (2 * c - 1) * w * np.sin(phi),
            np.sqrt(30 / np.pi) * (c * c - c) * np.sin(2 * phi),
        ],
        -1,
    )


def gaussian(at, lights, sigma, least):
    """Normalised Gaussians at (n x 3), of which those below `least` are dropped."""
    d2 = ((at[:, None] - lights[None]) ** 2).sum(-1)
    w = np.exp(-(d2 - d2.min(1, keepdims=True)) / sigma**2)
    w /= w.sum(1, keepdims=True)
    w[w <= least] = 0
    return w / w.sum(1, keepdims=True)


SIDE = 8  # of the octahedral samples


def octahedral(l):
    """Bilinear weights of the SIDE x SIDE samples at directions: n x SIDE^2 (buildResampleMap())."""
    s = np.abs(l).sum(-1)
    x = ((l[:, 0] + l[:, 1]) / s + 1) / 2 * (SIDE - 1)
    y = ((l[:, 1] - l[:, 0]) / s + 1) / 2 * (SIDE - 1)
    sx, sy = (np.clip(np.floor(v), 0, SIDE - 2).astype(int) for v in (x, y))
    dx, dy = x - sx, y - sy
    ret = np.zeros((len(l), SIDE * SIDE))
    rows = np.arange(len(l))
    ret[rows, sx + sy * SIDE] = (1 - dx) * (1 - dy)
    ret[rows, sx + 1 + sy * SIDE] = dx * (1 - dy)
    ret[rows, sx + (sy + 1) * SIDE] = (1 - dx) * dy
    ret[rows, sx + 1 + (sy + 1) * SIDE] = dx * dy
    return ret


def samples():
    """Directions of the samples (fromOcta())."""
    o = 2 * np.arange(SIDE) / (SIDE - 1) - 1
    ox, oy = np.meshgrid(o, o)
    x, y = (ox - oy) / 2, (ox + oy) / 2
    n = np.stack([x, y, np.maximum(1 - abs(x) - abs(y), 0)], -1).reshape(-1, 3)
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def components(values, planes):
    """Values (samples x texels x 3) as Relight keeps them: mean and principal components of each texel's values."""
    x = values.transpose(1, 0, 2).reshape(values.shape[1], -1)
    mean = np.clip(x.mean(0), 0, 1)
    x = x - mean
    _, vectors = np.linalg.eigh(x.T @ x)
    v = vectors[:, -planes:]
    return (mean + x @ v @ v.T).reshape(values.shape[1], values.shape[0], 3).transpose(1, 0, 2)


def linear_fit(terms):
    def predict(y, l, at):
        a = terms(l)
        inverse = np.linalg.solve(a.T @ a, a.T)
        return np.einsum("i,itc->tc", terms(at[None])[0] @ inverse, y)

    return predict


def rbf(sigma, planes):
    def predict(y, l, at):
        return np.einsum("i,itc->tc", gaussian(at[None], l, sigma, 0.001)[0], components(y, planes))

    return predict


def bilinear(sigma, planes, k=0.1):
    """x = (B + (AᵀA + kI)⁻¹ Aᵀ (I − A B)) y"""

    def predict(y, l, at):
        a, b = octahedral(l), gaussian(samples(), l, sigma, 0.005)
        m = b + np.linalg.solve(a.T @ a + k * np.eye(SIDE * SIDE), a.T @ (np.eye(len(l)) - a @ b))
        m[abs(m) <= 0.005] = 0
        kept = components(np.einsum("si,itc->stc", m, y), planes)
        return np.einsum("s,stc->tc", octahedral(at[None])[0], kept)

    return predict


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("session")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    pictures, lights = read(options.session)
    bases = {("ptm", 18): linear_fit(ptm), ("hsh", 27): linear_fit(hsh)}
    for sigma in (0.125, 0.25, 0.4):
        for planes in (18, 27):
            bases["rbf %g" % sigma, planes] = rbf(sigma, planes)
            bases["bilinear %g" % sigma, planes] = bilinear(sigma, planes)
    rows = []
    for (name, planes), predict in bases.items():
        square = 0
        for j in range(len(lights)):
            rest = np.arange(len(lights)) != j
            found = predict(pictures[rest], lights[rest], lights[j])
            square += ((np.clip(found, 0, 1) - np.clip(pictures[j], 0, 1)) ** 2).mean() / len(
                lights
            )
        rows.append({"basis": name, "numbers": planes, "psnr_db": -10 * np.log10(square)})
    if options.json:
        json.dump({"session": options.session, "bases": rows}, sys.stdout, indent=1)
    else:
        for row in rows:
            print("%-16s %3d %7.2f dB" % (row["basis"], row["numbers"], row["psnr_db"]))


main()
