"""Reading of OpenEXR files, by the module OpenEXR (PyPI, 3.3 or later) or OpenImageIO (Debian)."""

from __future__ import annotations

import dataclasses
import importlib
import os
from typing import Any, Dict, List, Union

import numpy as np
from numpy.typing import NDArray

from ._error import Error

Attribute = Union[str, int, float, NDArray[np.float64]]

# Attributes that every OpenEXR file has, or that OpenImageIO adds.
_STANDARD = {
    "channels",
    "chunkCount",
    "compression",
    "dataWindow",
    "displayWindow",
    "lineOrder",
    "name",
    "pixelAspectRatio",
    "PixelAspectRatio",
    "screenWindowCenter",
    "screenWindowWidth",
    "type",
    "version",
}


@dataclasses.dataclass(frozen=True)
class Part:
    """A part of an OpenEXR file.

    channels has the values by name, float32 of height × width, row 0 first. It is empty if only
    headers were read. attributes are str, int, float, or arrays of three float64.
    """

    name: str
    width: int
    height: int
    channel_names: List[str]
    channels: Dict[str, NDArray[np.float32]]
    attributes: Dict[str, Attribute]


def _attribute(value: Any) -> Attribute:
    if isinstance(value, (str, int, float)):
        return value
    array = np.asarray(value, np.float64).ravel()
    return float(array[0]) if array.size == 1 else array


def _attributes(pairs: Any) -> Dict[str, Attribute]:
    return {
        name: _attribute(value)
        for name, value in pairs
        if name not in _STANDARD and not name.startswith(("oiio:", "openexr:"))
    }


def _size(part: Any, axis: int) -> int:
    least, most = part.header["dataWindow"]
    return int(most[axis]) - int(least[axis]) + 1


def _read_openexr(module: Any, path: str, pixels: bool) -> List[Part]:
    try:
        headers = module.File(path, separate_channels=True, header_only=True).parts
        parts = module.File(path, separate_channels=True).parts if pixels else headers
    except RuntimeError as error:
        raise Error(
            f"{path}: {error}; the file is damaged, or is not an OpenEXR file: copy it again, or "
            "give another file"
        ) from error
    # OpenEXR 3.5 leaves out parts whose values it cannot read, and reports no error.
    if len(parts) != len(headers):
        missing = [p.name() for p in headers if p.name() not in {q.name() for q in parts}]
        raise Error(
            f"{path}: the values of part {missing[0]} cannot be read; the file is damaged: copy or "
            "make it again"
        )
    return [
        Part(
            name=part.name(),
            width=_size(part, 0),
            height=_size(part, 1),
            channel_names=[channel.name for channel in part.header["channels"]],
            channels=(
                {k: np.asarray(c.pixels, np.float32) for k, c in part.channels.items()}
                if pixels
                else {}
            ),
            attributes=_attributes(part.header.items()),
        )
        for part in parts
    ]


def _read_openimageio(module: Any, path: str, pixels: bool) -> List[Part]:
    file = module.ImageInput.open(path)
    if file is None or file.format_name() != "openexr":
        message = module.geterror() if file is None else f"its format is {file.format_name()}"
        raise Error(
            f"{path}: {message}; the file is damaged, or is not an OpenEXR file: copy it again, or "
            "give another file"
        )
    parts: List[Part] = []
    while file.seek_subimage(len(parts), 0):
        spec = file.spec()
        names = list(spec.channelnames)
        values: Any = file.read_image("float") if pixels else None
        if pixels and values is None:
            raise Error(f"{path}: {file.geterror()}; the file is damaged: copy or make it again")
        parts.append(
            Part(
                name=spec.get_string_attribute("oiio:subimagename"),
                width=spec.width,
                height=spec.height,
                channel_names=names,
                channels=(
                    {name: np.ascontiguousarray(values[..., k]) for k, name in enumerate(names)}
                    if pixels
                    else {}
                ),
                attributes=_attributes((a.name, a.value) for a in spec.extra_attribs),
            )
        )
    file.close()
    return parts


def reader() -> str:
    """Return the name of the module that reads OpenEXR files: "OpenEXR" or "OpenImageIO"."""
    # The module OpenEXR before 3.3 does not read parts.
    for name, needed in (("OpenEXR", "File"), ("OpenImageIO", "ImageInput")):
        try:
            module = importlib.import_module(name)
        except ImportError:
            continue
        if hasattr(module, needed):
            return name
    raise Error(
        "reading OpenEXR files needs a module: on Debian “apt install python3-openimageio”, "
        "elsewhere “pip install 'OpenEXR>=3.3'”"
    )


def read(path: Union[str, "os.PathLike[str]"], pixels: bool = True) -> List[Part]:
    """Read the parts of an OpenEXR file, or only their headers."""
    text = os.fspath(path)
    name = reader()
    if not os.path.isfile(text):
        raise Error(f"{text}: there is no such file; correct the path")
    function = _read_openexr if name == "OpenEXR" else _read_openimageio
    parts = function(importlib.import_module(name), text, pixels)
    if not parts:
        raise Error(f"{text}: the file has no parts, and is damaged: copy or make it again")
    return parts
