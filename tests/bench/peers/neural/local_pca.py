"""The project's local PCA without the directions that are left out: as drawn, and packed."""

import ctypes
import json
import os
import subprocess

import numpy as np
import OpenImageIO as oiio

from material import mesorig

# Clusters and components: from small to large.
SIZES = [(1, 4), (2, 4), (4, 4), (4, 8), (8, 8), (16, 8), (32, 8)]
PACKED = [20, 40]  # bytes a texel


def rest_session(build, captured, folder):
    """Imports the pictures at the other directions into a session of their own."""
    session = os.path.join(folder, "rest.session")
    if os.path.isdir(session):
        return session
    pictures = os.path.join(folder, "rest")
    os.makedirs(pictures, exist_ok=True)
    for v in captured.kept_views:
        for k in captured.kept_lights:
            values = np.ascontiguousarray(captured.values[:, :, v, k])
            name = "tl%07.3f_pl%07.3f_tv%07.3f_pv%07.3f.exr" % (
                captured.lights.theta_deg[k],
                captured.lights.phi_deg[k],
                captured.views.theta_deg[v],
                captured.views.phi_deg[v],
            )
            spec = oiio.ImageSpec(values.shape[1], values.shape[0], 3, "half")
            file = oiio.ImageOutput.create(os.path.join(pictures, name))
            file.open(os.path.join(pictures, name), spec)
            file.write_image(values)
            file.close()
    program = os.path.join(build, "bin", "mesorig")
    command = [program, "import", "pictures", pictures, "-o", session]
    command += ["--texel-mm", str(captured.texel_mm), "--transfer", "linear"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return session


def evaluate(build, path, captured, chosen):
    """Pictures under pairs of a view and a light: pairs × height × width × 3."""
    library = os.path.join(build, "processing", "libmesorig-material.so.0")
    ctypes.CDLL(library, ctypes.RTLD_GLOBAL)  # found by its name when mesorig loads it
    with mesorig.Material(path) as material:
        views = captured.view_vectors[[v for v, _ in chosen]][:, None, None]
        lights = captured.light_vectors[[k for _, k in chosen]][:, None, None]
        return material.evaluate(material.texel_uv(), views, lights)


def models(build, captured, folder):
    """Yields a name, bytes a texel and the path of the BTF itself and of each compressed form."""
    session = rest_session(build, captured, folder)
    height, width = captured.values.shape[:2]
    yield "BTF", 6 * len(captured.kept_views) * len(captured.kept_lights), session
    wanted = [
        ("drawn", ["-q", "8bit-weights", "-k", str(k), "--components", str(n)]) for k, n in SIZES
    ]
    wanted += [("packed", ["-q", "packed", "--size", str(s * height * width)]) for s in PACKED]
    for number, (kind, options) in enumerate(wanted):
        path = os.path.join(folder, "%s_%d" % (kind, number))
        if not os.path.exists(path + ".json"):
            program = os.path.join(build, "bin", "mesorig")
            command = [program, "compress", session, *options, "-o", path + ".exr", "--json"]
            done = subprocess.run([*command, "--force"], capture_output=True, text=True)
            if "is too small" in done.stdout:  # of few texels, the header alone takes more
                continue
            if done.returncode != 0:
                raise SystemExit("%s: %s" % (" ".join(command), done.stdout + done.stderr))
            made = done.stdout.encode()
            with open(path + ".json", "wb") as file:
                file.write(made.splitlines()[-1])  # the lines before it tell what was tried
        with open(path + ".json", "rb") as file:
            found = json.load(file)
        size = found["bytes"] if kind == "drawn" else found["file_bytes"]
        label = " ".join(options[3::2]) if kind == "drawn" else options[3]
        yield "LPCA %s %s" % (kind, label), size / (height * width), path + ".exr"
