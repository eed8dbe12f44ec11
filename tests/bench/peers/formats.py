#!/usr/bin/env python3
"""Checks files that Mesorig exports with the programs of those who own the formats.

    formats.py usd BUILD FOLDER SESSION…         usd-core, and Blender with its USD and MaterialX
    formats.py materialx BUILD FOLDER SESSION…   MaterialX validates and draws its documents
    formats.py bsdf BUILD FOLDER SESSION…        Mitsuba 3 reads .bsdf by its plug-in “measured”
    formats.py mitsuba BUILD FOLDER SESSION…     the plug-in contrib/mitsuba (BUILD has no sanitizers)
    formats.py packages FOLDER                   only the virtual environment, for renderers/compare_renderers

makes a virtual environment in FOLDER/venv with packages from PyPI (1.4 GB), for materialx also FOLDER/npm with a
package of npm (30 MB), exports each session with BUILD/bin/mesorig
into FOLDER, and prints a row for each. A name of tests/bench/capture_materials stands for the session that it
captures. Exit status 1: a check failed.
"""
import json
import os
import subprocess
import sys
import venv

PACKAGES = (
    "bpy==5.0.1",
    "MaterialX==1.39.5",
    "mitsuba==3.9.1",
    "numpy==1.26.4",
    "OpenEXR==3.5.3",
    "pillow==13.0.0",
    "usd-core==26.11",
)
NPM_PACKAGE = "@needle-tools/materialx@1.4.6"  # the WebAssembly build of MaterialX for web pages
# Mitsuba's own choice, the newest LLVM that is linked to libLLVM.so, is too old on Debian 12.
LLVM = "/usr/lib/x86_64-linux-gnu/libLLVM.so.19.1"
HERE = os.path.dirname(os.path.abspath(__file__))


def enter(folder):
    """Continues in the virtual environment, which the first call makes."""
    python = os.path.join(folder, "venv", "bin", "python3")
    if sys.prefix == os.path.join(folder, "venv"):
        return
    if not os.path.exists(python):
        venv.create(os.path.dirname(os.path.dirname(python)), with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    os.execv(python, [python, *sys.argv])


def export(build, kind, session, out, *options):
    mesorig = os.path.join(build, "bin", "mesorig")
    subprocess.run(
        [mesorig, "export", *kind.split(), session, "-o", out, "--force", *options],
        check=True,
        capture_output=True,
    )
    return out


def name_of(session):
    return os.path.basename(os.path.normpath(session)).removesuffix(".session")


def only(folder, end):
    """The file of a folder that ends so."""
    (found,) = (name for name in os.listdir(folder) if name.endswith(end))
    return os.path.join(folder, found)


def usd_core(path):
    """Errors of usd-core's validators. Its build has no MaterialX, so that it knows no node of that;
    Blender's build has."""
    from pxr import Usd, UsdValidation

    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(path))
    unknown = [e for e in found if "'ND_" in e.GetMessage() and "not found" in e.GetMessage()]
    return len(validators), [e.GetMessage() for e in found if e not in unknown]


def in_python(script, *arguments):
    """What a script of this folder prints as JSON in its last line."""
    done = subprocess.run(
        [sys.executable, os.path.join(HERE, script), *arguments],
        capture_output=True,
        text=True,
    )
    if done.returncode:
        sys.exit(done.stdout[-2000:] + done.stderr[-2000:])
    return json.loads(done.stdout.splitlines()[-1])


def check_usd(build, folder, session):
    name, bad = name_of(session), False
    for options in ([], ["--core"]):
        out = export(build, "usd", session, f"{folder}/{name}_usd{''.join(options)}", *options)
        path = only(out, ".usda")
        validators, errors = usd_core(path)
        glb = export(build, "gltf", session, f"{folder}/{name}{''.join(options)}.glb", *options)
        found = in_python("formats_blender.py", path, glb, f"{folder}/{name}{''.join(options)}")
        print(
            f"{name} {''.join(options) or '--'}: {validators} validators of usd-core, "
            f"{len(errors)} errors; {found['rules']} rules and {found['validators']} validators of "
            f"Blender's USD {found['usd']}, {len(found['errors'])} errors; Blender imports "
            f"{found['images']} maps; Cycles draws USD and glTF with a mean difference of "
            f"{found['difference']:.2f} steps of 8 bits"
        )
        for error in errors + found["errors"]:
            print("  ", error)
        bad = bad or errors or found["errors"] or found["images"] != 4
    return bad


def check_in_wasm(folder, documents):
    """Returns 0 if all documents are good for the WebAssembly build of MaterialX."""
    npm = f"{folder}/npm"
    install = [
        "npm",
        "install",
        "--silent",
        "--no-audit",
        "--no-fund",
        "--prefix",
        npm,
        NPM_PACKAGE,
    ]
    subprocess.run(install, check=True)
    script = f"{HERE}/formats_materialx.mjs"
    built = f"{npm}/node_modules/@needle-tools/materialx/bin"
    return subprocess.run(["node", script, built, *documents]).returncode


def check_materialx(build, folder, session):
    renderers = os.path.join(HERE, "..", "renderers")
    out = export(build, "materialx", session, f"{folder}/{name_of(session)}_materialx")
    documents = [only(out, end) for end in ("_openpbr.mtlx", "_standard_surface.mtlx")]
    validate = [sys.executable, f"{renderers}/materialx_glsl.py", "validate", *documents]
    bad = subprocess.run(validate).returncode or check_in_wasm(folder, documents)
    environment = {"RENDERERS": "model materialx openpbr", "MATERIALX_PYTHON": sys.executable}
    subprocess.run(
        [f"{renderers}/compare_renderers", build, folder, session],
        check=True,
        env=os.environ | environment,
    )
    return bad


def check_bsdf(build, folder, session):
    name, bad = name_of(session), False
    for options in ([], ["--isotropic"]):
        stem = f"{folder}/{name}{''.join(options)}"
        rgb = export(build, "bsdf", session, stem + "_rgb.bsdf", "--rgb", *options)
        both = export(build, "bsdf", session, stem + ".bsdf", *options)
        found = in_python("formats_mitsuba.py", build, session, rgb, both)
        print(
            f"{name} {''.join(options) or '--'}: values differ by {found['rgb']:.1e} (RGB) and "
            f"{found['spectra']:.1e} (spectra) of the largest; from the mean of the BTF by "
            f"{100 * found['measured']:.1f} % RMS, with light and view exchanged by "
            f"{100 * found['exchanged']:.1f} %; albedos by importance sampling by "
            f"{100 * found['sampling']:.2f} %"
        )
        bad = bad or max(found["rgb"], found["spectra"]) > 1e-4 or found["sampling"] > 0.01
    return bad


def check_mitsuba(build, folder, session):
    plugin = os.path.join(HERE, "..", "..", "..", "contrib", "mitsuba")
    paths = {
        "PYTHONPATH": os.path.join(HERE, "..", "..", "..", "python"),
        "LD_LIBRARY_PATH": os.path.join(build, "processing"),
    }
    print(name_of(session), flush=True)
    check = [sys.executable, f"{plugin}/check.py", f"{build}/bin/mesorig", session, folder]
    return subprocess.run(check, env=os.environ | paths).returncode


def captured(build, folder, name):
    """The session of this name or path."""
    if os.path.isdir(name):
        return name
    session = os.path.join(folder, name + ".session")
    if not os.path.exists(os.path.join(session, "products", "btf")):
        capture = os.path.join(HERE, "..", "capture_materials")
        subprocess.run([capture, build, folder, name], check=True)
    return session


CHECKS = {
    "usd": check_usd,
    "materialx": check_materialx,
    "bsdf": check_bsdf,
    "mitsuba": check_mitsuba,
}

if __name__ == "__main__":
    if sys.argv[1:2] == ["packages"] and len(sys.argv) == 3:
        os.makedirs(sys.argv[2], exist_ok=True)
        enter(os.path.abspath(sys.argv[2]))
        sys.exit()
    if len(sys.argv) < 5 or sys.argv[1] not in CHECKS:
        sys.exit(__doc__)
    what, build, folder, *sessions = sys.argv[1:]
    build, folder = os.path.abspath(build), os.path.abspath(folder)
    os.makedirs(folder, exist_ok=True)
    enter(folder)
    os.environ.setdefault("DRJIT_LIBLLVM_PATH", LLVM)
    sessions = [captured(build, folder, name) for name in sessions]
    sys.exit(any([CHECKS[what](build, folder, session) for session in sessions]))
