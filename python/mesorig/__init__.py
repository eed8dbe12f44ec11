"""Materials that Mesorig has captured, as NumPy arrays.

    session = mesorig.open("weave.session")
    session.btf.values      # height × width × views × lights × 3, float32
    session.mdf.distance_mm  # height × width × views, float32

docs/research/python.md of Mesorig's source tree is the manual, and docs/research/format.md
describes the files.
"""

from __future__ import annotations

import dataclasses
import os
from typing import List, Union

from . import _exr
from ._directions import Directions
from ._error import Error
from ._exr import Part
from ._version import __version__
from .btf import FLAG_BOUND, FLAG_HOLE, FLAG_PREDICTED, FLAG_SHORTER, Btf, BtfView
from .material import Hits, Material, MaterialInfo
from .mdf import SOURCE_MEASURED, SOURCE_NONE, SOURCE_OTHER, SOURCE_PREDICTED, Mdf
from .rig import Rig
from .session import Calibration, Event, Frame, Grid, Product, Session, Shot, find_session

__all__ = [
    "Btf",
    "BtfView",
    "Calibration",
    "Directions",
    "Error",
    "Event",
    "ExrFile",
    "FLAG_BOUND",
    "FLAG_HOLE",
    "FLAG_PREDICTED",
    "FLAG_SHORTER",
    "Frame",
    "Grid",
    "Hits",
    "Material",
    "MaterialInfo",
    "Mdf",
    "Part",
    "Product",
    "Rig",
    "SOURCE_MEASURED",
    "SOURCE_NONE",
    "SOURCE_OTHER",
    "SOURCE_PREDICTED",
    "Session",
    "Shot",
    "__version__",
    "open",
]


@dataclasses.dataclass(frozen=True)
class ExrFile:
    """Any other OpenEXR file of Mesorig: a frame, or a compressed BTF.

    kind is the name of the codec, such as "lpca", or "exr". docs/research/format.md describes the
    parts of each kind. Material evaluates compressed BTFs.
    """

    path: str
    kind: str
    parts: List[Part]

    def __getitem__(self, name: str) -> Part:
        for part in self.parts:
            if part.name == name:
                return part
        raise KeyError(name)


def open(path: Union[str, "os.PathLike[str]"]) -> Union[Session, Btf, Mdf, ExrFile]:
    """Open a session directory, the folder or a file of its BTF, its MDF, or another OpenEXR file.

    A file inside a session must have the checksum that the session has. The error of everything
    that cannot be read is an Error, whose text has the path.
    """
    text = os.fspath(path)
    if os.path.isdir(text):
        folder = os.path.abspath(text)
        above = os.path.dirname(os.path.dirname(folder))
        if folder.endswith("/products/btf") and os.path.isfile(os.path.join(above, "session.db")):
            return Session(above).btf
        return Session(text)
    if not os.path.exists(text):
        raise Error(f"{text}: there is no such file or directory; correct the path")
    session = find_session(text)
    if session is not None:
        session.check(os.path.abspath(text))
    header = _exr.read(text, pixels=False)
    first = header[0]
    kinds = [p.attributes["mesorig.kind"] for p in header if "mesorig.kind" in p.attributes]
    if kinds:
        return ExrFile(text, str(kinds[0]), _exr.read(text))
    if first.name.startswith("light_") and "light.theta_deg" in first.attributes:
        return Btf([text], session.grid if session else None)
    if first.name.startswith("view_") and "D" in first.channel_names:
        return Mdf(text)
    return ExrFile(text, "exr", _exr.read(text))
