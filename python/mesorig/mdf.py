"""The MDF of a session."""

from __future__ import annotations

from typing import Callable, List, Optional

import numpy as np
from numpy.typing import NDArray

from . import _exr
from ._error import Error
from .btf import _no_check, directions_of, points_of

# Sources of a distance.
SOURCE_NONE = 0  # not known
SOURCE_MEASURED = 1  # measured by this view
SOURCE_OTHER = 2  # the other distance that this view may have measured
SOURCE_PREDICTED = 3  # predicted from other views, not measured


class Mdf:
    """An MDF: for each texel and view, the distance from the reference plane to the surface.

    Arrays are height × width × views. Row 0 is at +y.

    distance_mm  float32: along the line of sight, in mm. NaN where it is not known.
    seen         bool: whether the view itself measured the distance; None in a compressed MDF, as
                 are source, measured_mm, sigma_mm, other_mm and n_sweeps
    source       uint8: SOURCE_…
    measured_mm  float32: the distance that this view measured. NaN where it measured none.
    sigma_mm     float32: standard error of measured_mm. NaN where measured_mm is.
    other_mm     float32: another distance that this view may have measured. NaN: none.
    n_sweeps     uint8: number of laser positions over which measured_mm is the mean
    views        nominal directions
    camera_mm    views × 3: position of the camera, in the frame of the sample. NaN: not known.
    """

    def __init__(self, path: str, check: Callable[[str], None] = _no_check) -> None:
        check(path)
        parts = _exr.read(path)
        self.path = path
        self.height, self.width = parts[0].height, parts[0].width
        for part in parts:
            if "D" not in part.channels:
                raise Error(
                    f"{path}: part {part.name} lacks channel D with the distances; process the "
                    "session again"
                )
            if (part.height, part.width) != (self.height, self.width):
                raise Error(
                    f"{path}: part {part.name} has {part.width} × {part.height} texels, but the "
                    f"first view has {self.width} × {self.height}; process the session again"
                )
        self.views = directions_of(parts, "view", path)
        self.camera_mm = points_of(parts, "view.centre_mm")
        self.texel_mm = float(parts[0].attributes.get("texel_mm", np.nan))  # type: ignore[arg-type]
        self.reference_mm = float(
            parts[0].attributes.get("reference_mm", np.nan)  # type: ignore[arg-type]
        )
        scale = [float(p.attributes.get("mesorig.scale_mm", 1)) for p in parts]  # type: ignore
        self.distance_mm = _lengths(parts, "D") * np.array(scale, np.float32)
        self.source: Optional[NDArray[np.uint8]] = None
        self.n_sweeps: Optional[NDArray[np.uint8]] = None
        self.seen: Optional[NDArray[np.bool_]] = None
        self.measured_mm: Optional[NDArray[np.float32]] = None
        self.sigma_mm: Optional[NDArray[np.float32]] = None
        self.other_mm: Optional[NDArray[np.float32]] = None
        if all("P" in part.channels for part in parts):
            self.source = _stack(parts, "P").astype(np.uint8)
            self.n_sweeps = _stack(parts, "N").astype(np.uint8)
            self.measured_mm = _lengths(parts, "M")
            self.sigma_mm = _lengths(parts, "S")
            self.other_mm = _lengths(parts, "O")
            self.seen = (self.source == SOURCE_MEASURED) | (self.source == SOURCE_OTHER)

    def __repr__(self) -> str:
        return f"<mesorig.Mdf {self.width} × {self.height} texels, {len(self.views)} views>"


def _stack(parts: List[_exr.Part], channel: str) -> NDArray[np.float32]:
    return np.stack([part.channels[channel] for part in parts], axis=-1)


def _lengths(parts: List[_exr.Part], channel: str) -> NDArray[np.float32]:
    """Return a channel, NaN where it is negative."""
    values = _stack(parts, channel)
    values[values < 0] = np.nan
    return values
