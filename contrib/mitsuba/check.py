#!/usr/bin/env python3
"""Checks the plug-in against the BTF and against itself: check.py MESORIG SESSION FOLDER

MESORIG is the program mesorig, SESSION a session with its BTF. FOLDER receives a white material. Prints:
  values     the largest difference from the BTF at its texels and measured directions, of its largest value
  chi²       p-values of Mitsuba's own test that sample() draws with the density pdf()
  variance   of directions drawn in proportion to the cosine, divided by that of sample()
  white      a white diffuser in a white furnace, which must be 1 everywhere. Between the measured lights, 15° apart, a
             cosine is interpolated with an error of up to 0.9 %.
  furnace    the material in a white furnace: the largest pixel, the mean of the pixels, and the mean of the integral
             of eval(), without sample() and pdf()
Exit status 1: a figure is out of its bound.
"""
import os
import struct
import subprocess
import sys

import drjit as dr
import mesorig
import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import mesorig_bsdf  # noqa: E402

mesorig_bsdf.register()
program, session, folder = sys.argv[1:]
SIZE, SPP, LIGHTS = 48, 256, 400


def interaction(uv, view):
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(*uv.T)
    si.wi = mi.Vector3f(*view.T)
    si.n = mi.Normal3f(0, 0, 1)
    si.dp_du, si.dp_dv = mi.Vector3f(1, 0, 0), mi.Vector3f(0, -1, 0)  # v goes down, as in a BTF
    return si


def rows(array):
    return np.ascontiguousarray(np.array(array).T)


def direction(theta_deg, phi_deg=20):
    t, p = np.radians(theta_deg), np.radians(phi_deg)
    return np.float32([[np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)]])


def value_difference(bsdf, btf, random):
    n = 20000
    height, width, n_views, n_lights = btf.values.shape[:4]
    y, x, v, l = (random.integers(k, size=n) for k in (height, width, n_views, n_lights))
    truth = np.maximum(np.nan_to_num(btf.values[y, x, v, l]), 0) / np.pi
    uv = np.stack([(x + 0.5) / width, (y + 0.5) / height], 1).astype(np.float32)
    view, light = btf.views.vectors[v], btf.lights.vectors[l]
    si = interaction(uv, view.astype(np.float32))
    values = rows(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(*light.T.astype(np.float32))))
    measured = ~np.isnan(btf.values[y, x, v, l]).any(1)
    return float(np.abs(values - truth)[measured].max() / truth.max())


def chi_square(bsdf, theta_deg):
    """The p-value for the hypothesis that directions are drawn with their density."""
    uv, view = np.float32([[0.3, 0.6]]), direction(theta_deg)

    def sample(draws):
        n = np.array(draws).shape[-1]
        si = interaction(np.repeat(uv, n, 0), np.repeat(view, n, 0))
        return bsdf.sample(mi.BSDFContext(), si, mi.Float(0), draws)[0].wo

    def density(wo):
        n = np.array(wo).shape[-1]
        si = interaction(np.repeat(uv, n, 0), np.repeat(view, n, 0))
        return bsdf.pdf(mi.BSDFContext(), si, wo)

    test = mi.chi2.ChiSquareTest(
        domain=mi.chi2.SphericalDomain(),
        sample_func=sample,
        pdf_func=density,
        sample_dim=2,
        sample_count=1 << 18,
        res=51,
    )
    passed = test.run(0.01, 3)  # three tests, whose level is 1 % together
    return float(np.array(test.p_value)), passed


def variance_ratio(bsdf, random):
    n = 1 << 16
    uv, view = np.float32([[0.3, 0.6]]), direction(50)
    si = interaction(np.repeat(uv, n, 0), np.repeat(view, n, 0))
    draws = mi.Point2f(*random.random((2, n), np.float32))
    weight = rows(bsdf.sample(mi.BSDFContext(), si, mi.Float(0), draws)[1]).mean(1)
    wo = mi.warp.square_to_cosine_hemisphere(draws)
    plain = rows(bsdf.eval(mi.BSDFContext(), si, wo)).mean(1) / rows(wo)[:, 2] * np.pi
    return float(plain.var() / weight.var())


def furnace(path):
    """A sphere in light of radiance 1 from everywhere. Returns its pixels, their distances from the middle of the
    picture, and the mean of the integrals of eval() over the lights, at the middles of the pixels.
    """
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path"},
            "sphere": {"type": "sphere", "bsdf": {"type": "mesorig", "filename": path}},
            "light": {"type": "constant"},
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at([0, -3, 0.5], [0, 0, 0], [0, 0, 1]),
                "film": {
                    "type": "hdrfilm",
                    "width": SIZE,
                    "height": SIZE,
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent", "sample_count": SPP},
            },
        }
    )
    pixels = np.array(mi.render(scene, spp=SPP, seed=1))[..., :3]
    at = (np.arange(SIZE) + 0.5) / SIZE
    x, y = np.meshgrid(at, at)
    radius = np.hypot(2 * x - 1, 2 * y - 1)
    inside = radius < 0.95
    film = mi.Point2f(*(np.float32(c[inside]).repeat(LIGHTS) for c in (x, y)))
    rays, _ = scene.sensors()[0].sample_ray(0, 0, film, 0.5)
    si = scene.ray_intersect(rays)
    draws = np.random.default_rng(2).random((2, dr.width(film)), np.float32)
    lights = mi.warp.square_to_uniform_hemisphere(mi.Point2f(*draws))
    values = si.bsdf().eval(mi.BSDFContext(), si, lights)
    return pixels[inside], radius[inside], float(np.mean(np.array(values)) * 2 * np.pi)


def white_material():
    """A session of f_r = 1 / π, from a file of MERL's format."""
    path = os.path.join(folder, "white.session")
    if os.path.exists(path):
        return path
    merl = os.path.join(folder, "white.binary")
    with open(merl, "wb") as file:
        file.write(struct.pack("<3i", 90, 90, 180))
        for scale in (1 / 1500, 1.15 / 1500, 1.66 / 1500):
            np.full(90 * 90 * 180, 1 / np.pi / scale).tofile(file)
    subprocess.run([program, "import", "merl", merl, "-o", path], check=True, capture_output=True)
    return path


def main():
    random = np.random.default_rng(1)
    bsdf = mi.load_dict({"type": "mesorig", "filename": session})
    bounds = {}
    found = value_difference(bsdf, mesorig.open(session).btf, random)
    print(f"values: {found:.1e}")
    bounds["values"] = found < 1e-5
    for theta in (0, 40, 70):
        p, passed = chi_square(bsdf, theta)
        print(f"chi² at {theta}°: p = {p:.2f}")
        bounds[f"chi² {theta}"] = passed
    ratio = variance_ratio(bsdf, random)
    print(f"variance: {ratio:.1f} times smaller than of cosine-weighted directions")
    pixels, radius, _ = furnace(white_material())
    rings = [pixels[(radius >= r) & (radius < r + 0.19)].mean() for r in np.arange(5) * 0.19]
    print("white: mean of rings from the middle to the rim:", *(f"{ring:.4f}" for ring in rings))
    bounds["white"] = max(abs(ring - 1) for ring in rings) < 0.01
    pixels, _, integral = furnace(session)
    print(
        f"furnace: largest pixel {pixels.max():.3f}, mean {pixels.mean():.5f}, integral {integral:.5f}"
    )
    bounds["furnace"] = pixels.max() < 1 and abs(pixels.mean() / integral - 1) < 0.01
    wrong = [name for name, good in bounds.items() if not good]
    print("wrong:", ", ".join(wrong) if wrong else "nothing")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
