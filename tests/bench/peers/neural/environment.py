"""The virtual environment of the scripts in this folder: Debian's packages, and others from PyPI."""

import importlib.util
import os
import subprocess
import sys
import venv

# FLIP by its authors; the last Matplotlib for Debian 12's NumPy.
PACKAGES = {"flip_evaluator": "flip-evaluator==1.7", "matplotlib": "matplotlib==3.7.5"}


def enter(folder):
    """Runs the program again in folder/venv, which is made if it is missing, unless its Python has all packages."""
    missing = [
        package for name, package in PACKAGES.items() if importlib.util.find_spec(name) is None
    ]
    if not missing:
        return
    if "NEURAL_ENVIRONMENT" in os.environ:
        sys.exit("%s cannot be installed" % " ".join(missing))
    folder = os.path.join(folder, "venv")
    python = os.path.join(folder, "bin", "python3")
    if not os.path.exists(python):
        venv.create(folder, system_site_packages=True, with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *missing], check=True)
    os.execve(python, [python, *sys.argv], os.environ | {"NEURAL_ENVIRONMENT": "1"})
