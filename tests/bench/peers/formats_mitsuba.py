#!/usr/bin/env python3
"""Mitsuba's part of formats.py: formats_mitsuba.py BUILD SESSION RGB.bsdf BOTH.bsdf

Mitsuba 3 reads files of “mesorig export bsdf” by its plug-in “measured”. RGB.bsdf was written with --rgb, BOTH.bsdf
without. Prints, as JSON:
  rgb       the largest difference from Mesorig's own evaluation of the file (f_r cos θ of the light), at random
            pairs of view and light, relative to the largest value
  spectra   the same of BOTH.bsdf at its wavelengths, from tests/brdf_peer.py
  measured  the RMS difference from the mean of the BTF at its measured directions, relative to its RMS
  exchanged the same if light and view change places: how far the material is from reciprocal
  sampling  the largest relative difference of albedos from the plug-in's importance sampling and from uniform
            directions
"""
import json
import os
import subprocess
import sys
import tempfile

import mitsuba as mi
import numpy as np

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "..")
sys.path[:0] = [ROOT + "/python", ROOT + "/tests"]
import mesorig  # noqa: E402
from brdf_peer import read_tensors  # noqa: E402

PAIRS, LOWEST = 4000, np.radians(80)
build, session, rgb_file, both_file = sys.argv[1:]


def directions(random, n):
    """Uniform in solid angle down to LOWEST."""
    z = 1 - random.random(n) * (1 - np.cos(LOWEST))
    phi = 2 * np.pi * random.random(n)
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(phi), r * np.sin(phi), z], 1).astype(np.float32)


def interaction(wi, wavelengths=None):
    si = mi.SurfaceInteraction3f()
    si.wi = mi.Vector3f(*wi.T)
    if wavelengths is not None:
        si.wavelengths = mi.Color0f() if mi.is_rgb else mi.UnpolarizedSpectrum(wavelengths)
    return si


def evaluate(bsdf, light, view, wavelengths=None):
    """f_r cos θ of the light. Mitsuba's wi is the direction to the eye."""
    value = bsdf.eval(mi.BSDFContext(), interaction(view, wavelengths), mi.Vector3f(*light.T))
    return np.array(value).T


def of_program(command, pairs, dtype, shape):
    with tempfile.TemporaryDirectory() as folder:
        pairs.astype(dtype).tofile(folder + "/pairs")
        if command[-1] == "VALUES":
            command = command[:-2] + [folder + "/pairs", folder + "/values"]
            subprocess.run(command, check=True)
            return np.fromfile(folder + "/values", dtype).reshape(shape)
        done = subprocess.run(command[:-1] + [folder + "/pairs"], check=True, capture_output=True)
        return np.frombuffer(done.stdout, dtype).reshape(shape)


def largest(a, b):
    return float(np.abs(a - b).max() / np.abs(b).max())


def relative_rms(a, b):
    return float(np.sqrt(np.square(a - b).mean() / np.square(b).mean()))


random = np.random.default_rng(1)
light, view = directions(random, PAIRS), directions(random, PAIRS)
pairs = np.concatenate([light, view], 1)
found = {}

mi.set_variant("llvm_ad_rgb")
bsdf = mi.load_dict({"type": "measured", "filename": rgb_file})
ours = of_program([build + "/tests/bench/bsdf_values", rgb_file, "PAIRS"], pairs, "f4", (PAIRS, 3))
found["rgb"] = largest(evaluate(bsdf, light, view), ours * light[:, 2:])

btf = mesorig.open(session).btf
mean = np.nanmean(btf.values, (0, 1), dtype=np.float64)
lights = np.tile(btf.lights.vectors, (len(btf.views), 1)).astype(np.float32)
views = np.repeat(btf.views.vectors, len(btf.lights), 0).astype(np.float32)
truth = mean.reshape(-1, 3) / np.pi
found["measured"] = relative_rms(evaluate(bsdf, lights, views), truth)
exchanged = evaluate(bsdf, views, lights) * lights[:, 2:] / views[:, 2:]
found["exchanged"] = relative_rms(exchanged, truth)

found["sampling"] = 0
for theta in (0, 30, 60):
    n = 1 << 18
    wi = np.tile(np.float32([[np.sin(np.radians(theta)), 0, np.cos(np.radians(theta))]]), (n, 1))
    draws = mi.Point2f(*random.random((2, n)).astype(np.float32))
    _, weight = bsdf.sample(mi.BSDFContext(), interaction(wi), mi.Float(0.5), draws)
    z = random.random(n)
    phi = 2 * np.pi * random.random(n)
    r = np.sqrt(1 - z * z)
    wo = np.stack([r * np.cos(phi), r * np.sin(phi), z], 1).astype(np.float32)
    uniform = evaluate(bsdf, wo, wi).mean(0) * 2 * np.pi
    sampled = np.array(weight).T.mean(0)
    found["sampling"] = max(found["sampling"], float(np.abs(sampled / uniform - 1).max()))

mi.set_variant("llvm_ad_spectral")
bsdf = mi.load_dict({"type": "measured", "filename": both_file})
wavelengths = read_tensors(both_file)["wavelengths"][1]
n = PAIRS // 10  # the peer is slow
peer = [sys.executable, ROOT + "/tests/brdf_peer.py", "evaluate", "spectra", both_file]
spectra = of_program(peer + ["PAIRS", "VALUES"], pairs[:n], "f8", (n, len(wavelengths)))
spectra = spectra * light[:n, 2:]
theirs = [evaluate(bsdf, light[:n], view[:n], list(wavelengths[k : k + 4])) for k in range(0, 3, 2)]
theirs = np.concatenate([theirs[0][:, :2], theirs[1]], 1)
found["spectra"] = largest(theirs, spectra)
print(json.dumps(found))
