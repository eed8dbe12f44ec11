"""python -m mesorig info SESSION: prints what a session or a file contains."""

from __future__ import annotations

import argparse
import collections
import sys

import numpy as np

from . import Btf, Error, ExrFile, Mdf, Session, __version__
from . import open as open_path


def _say(name: str, text: str) -> None:
    print(f"{name:<10} {text}")


def _tell_btf(btf: Btf) -> None:
    _say(
        "BTF",
        f"{btf.width} × {btf.height} texels, {len(btf.views)} views, {len(btf.lights)} lights: "
        f"{btf.nbytes / 2**20:.1f} MiB as float32",
    )
    _say("flags", ", ".join(f"{n} {name}" for name, n in btf.flag_counts().items()))


def _tell_mdf(mdf: Mdf) -> None:
    text = f"{np.mean(~np.isnan(mdf.distance_mm)):.1%} of the distances are known"
    if mdf.seen is not None:
        text += f", {np.mean(mdf.seen):.1%} were measured by their own view"
    _say("MDF", f"{mdf.width} × {mdf.height} texels, {len(mdf.views)} views: {text}")


def _tell_session(session: Session) -> None:
    grid = session.grid
    states = collections.Counter(shot.state for shot in session.shots)
    _say("session", f"{session.name}, {session.state}")
    _say("made by", f"{session.program}, {session.created}")
    _say(
        "sample",
        f"{grid.width_mm:g} × {grid.height_mm:g} mm, {grid.width} × {grid.height} texels",
    )
    _say(
        "directions",
        f"{len(session.views)} views, {len(session.lights)} lights, "
        f"{len(session.lasers)} laser positions",
    )
    _say(
        "shots",
        f"{states['done']} of {len(session.shots)} done, {states['skipped']} skipped",
    )
    _say("files", f"{len(session.frames)} of frames")
    _say("calibrated", session.calibration.origin)
    for product in session.products:
        if not product.path.startswith("products/btf/"):
            _say("product", f"{product.path}, {product.bytes} bytes")
    if any((session.path / "products" / "btf").glob("view_*.exr")):
        _tell_btf(session.btf)
    if (session.path / "products" / "mdf.exr").exists():
        _tell_mdf(session.mdf)


def _info(path: str) -> None:
    found = open_path(path)
    if isinstance(found, Session):
        _tell_session(found)
    elif isinstance(found, Btf):
        _tell_btf(found)
    elif isinstance(found, Mdf):
        _tell_mdf(found)
    elif isinstance(found, ExrFile):
        _say("kind", found.kind)
        for part in found.parts:
            _say("part", f"{part.name}: {part.width} × {part.height}, {' '.join(part.channels)}")


def main() -> int:
    """Run the command line. The exit code is 0, 1 after an error, or 2 after bad usage."""
    parser = argparse.ArgumentParser(prog="python -m mesorig", description=__doc__)
    parser.add_argument("--version", action="version", version=f"mesorig {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)
    info = commands.add_parser("info", help="print what a session or a file contains")
    info.add_argument("path", metavar="SESSION|FILE")
    arguments = parser.parse_args()
    try:
        _info(arguments.path)
    except Error as error:
        print(f"mesorig: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
