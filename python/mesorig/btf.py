"""The BTF of a session, view by view or as one array."""

from __future__ import annotations

import functools
import os
import re
from typing import TYPE_CHECKING, Callable, Dict, List, Optional

import numpy as np
from numpy.typing import NDArray

from . import _exr
from ._directions import Directions
from ._error import Error

if TYPE_CHECKING:
    from .session import Grid

# Flags of a value. processing/btf/btf.h defines them.
FLAG_SHORTER = 1  # saturated in the longest exposure: from shorter exposures, with more noise
FLAG_BOUND = 2  # saturated in all exposures: the value is a lower bound
FLAG_HOLE = 4  # not measured: the value is NaN
FLAG_PREDICTED = 8  # not captured: predicted from the lights around it

_COUNTS = {
    "holes": FLAG_HOLE,
    "bounds": FLAG_BOUND,
    "shorter": FLAG_SHORTER,
    "predicted": FLAG_PREDICTED,
}


def _no_check(path: str) -> None:
    """Accept a file that belongs to no session."""


def _attribute(part: _exr.Part, name: str, path: str) -> float:
    value = part.attributes.get(name)
    if not isinstance(value, (int, float)) or not np.isfinite(value):
        raise Error(
            f"{path}: part {part.name} has no number {name}; copy the file again, or process or "
            "import the session again"
        )
    return float(value)


def directions_of(parts: List[_exr.Part], of: str, path: str) -> Directions:
    """Return the directions in the attributes OF.theta_deg and OF.phi_deg of each part."""
    return Directions(
        np.array([_attribute(part, of + ".theta_deg", path) for part in parts]),
        np.array([_attribute(part, of + ".phi_deg", path) for part in parts]),
    )


def points_of(parts: List[_exr.Part], name: str) -> NDArray[np.float64]:
    """Return a vector attribute of each part, n × 3: NaN for a part that lacks the attribute."""
    unknown = np.full(3, np.nan)
    return np.array([part.attributes.get(name, unknown) for part in parts], np.float64)


class BtfView:
    """One view of a BTF: the file of the view, read into memory.

    values     height × width × lights × 3 (R, G, B) float32: the reflectance relative to a white
               diffuser lit from its normal, linear sRGB, with the factor n·l. NaN in holes.
               Noise can make dark values negative.
    sigma      in the shape of values: standard error of each value. NaN if it is not known.
    flags      height × width × lights uint8: a sum of FLAG_…
    lights     nominal directions of the lights
    theta_deg, phi_deg   nominal direction of the view
    camera_mm  lights × 3: position of the camera in each picture, in the frame of the sample. It
               is NaN in imported sessions without positions, as is lamp_mm.
    lamp_mm    lights × 3: position of the lamp
    lamp_aim   lights × 3: direction in which the lamp shines; NaN if it is not known
    lamp_exponent  lights: n of the lamp's fall-off cosⁿ away from its aim; 0 if it is not known
    sigma_common  lights × 3: relative standard error that all values of a picture have in common
               (R, G, B). It is not included in sigma. NaN if it is not known.
    """

    def __init__(self, path: str, grid: Optional["Grid"] = None) -> None:
        parts = _exr.read(path)
        _check_parts(parts, path, grid)
        self.path = path
        self.grid = grid
        self.lights = directions_of(parts, "light", path)
        view = directions_of(parts[:1], "view", path)
        self.theta_deg, self.phi_deg = float(view.theta_deg[0]), float(view.phi_deg[0])
        self.camera_mm = points_of(parts, "view.centre_mm")
        self.lamp_mm = points_of(parts, "light.position_mm")
        self.lamp_aim = points_of(parts, "light.aim")
        self.lamp_exponent = np.array(
            [part.attributes.get("light.exponent", 0.0) for part in parts], np.float64
        )
        self.sigma_common = points_of(parts, "sigma.scale")
        shape = (parts[0].height, parts[0].width, len(parts))
        self.values: NDArray[np.float32] = np.empty(shape + (3,), np.float32)
        self.sigma: NDArray[np.float32] = np.full(shape + (3,), np.nan, np.float32)
        self.flags: NDArray[np.uint8] = np.zeros(shape, np.uint8)
        for k, part in enumerate(parts):
            for c, channel in enumerate("RGB"):
                self.values[:, :, k, c] = part.channels[channel]
            self.flags[:, :, k] = _flags(part, self.values[:, :, k])
            colour = part.attributes.get("sigma.colour")
            if "sigma" in part.channels and colour is not None:
                self.sigma[:, :, k] = part.channels["sigma"][..., None] * np.float32(colour)
        holes = (self.flags & FLAG_HOLE) != 0
        self.values[holes] = np.nan
        self.sigma[holes] = np.nan

    def to_camera(self) -> NDArray[np.float32]:
        """Unit vectors from each texel to the camera, height × width × lights × 3.

        The nominal direction is the same for all texels. These vectors are those of the calibrated
        positions.
        """
        return self._towards(self.camera_mm)

    def to_lamp(self) -> NDArray[np.float32]:
        """Unit vectors from each texel to the lamp, height × width × lights × 3."""
        return self._towards(self.lamp_mm)

    def _towards(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        if self.grid is None:
            raise Error(
                f"{self.path}: the positions of the texels are known only in a session; open the "
                "session, or the file in its folder products/btf"
            )
        to = points - self.grid.centres_mm[:, :, None]
        return (to / np.linalg.norm(to, axis=-1, keepdims=True)).astype(np.float32)


def _check_parts(parts: List[_exr.Part], path: str, grid: Optional["Grid"]) -> None:
    """Check that all parts have the same size, and all colours."""
    for part in parts:
        width, height = (grid.width, grid.height) if grid else (parts[0].width, parts[0].height)
        if (part.width, part.height) != (width, height):
            raise Error(
                f"{path}: part {part.name} has {part.width} × {part.height} texels instead of "
                f"{width} × {height}; delete the file and process the session again, or import it "
                "again"
            )
        missing = [channel for channel in "RGB" if channel not in part.channel_names]
        if missing:
            raise Error(
                f"{path}: part {part.name} lacks channel {missing[0]}; delete the file and process "
                "the session again, or import it again"
            )


def _flags(part: _exr.Part, values: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the channel "mark". Without it, black texels are holes if mesorig.holes is above 0."""
    if "mark" in part.channels:
        return part.channels["mark"].astype(np.uint8)
    if part.attributes.get("mesorig.holes", 0):
        return np.where((values == 0).all(axis=-1), FLAG_HOLE, 0).astype(np.uint8)
    return np.zeros(values.shape[:2], np.uint8)


class Btf:
    """A BTF. view() reads one view; values, sigma and flags read all views into one array.

    width, height   texels
    views, lights   nominal directions, which are the same for all texels
    view_index, light_index  the numbers of these views and lights in the session. Views that are
                    not made yet are left out.
    texel_mm        width of a texel; None if the files are outside of a session
    reference_mm    height of the reference plane above the turntable; None like texel_mm
    """

    def __init__(
        self,
        paths: List[str],
        grid: Optional["Grid"] = None,
        check: Callable[[str], None] = _no_check,
    ) -> None:
        for path in paths:
            check(path)
        headers = [_exr.read(path, pixels=False) for path in paths]
        for path, parts in zip(paths, headers):
            _check_parts(parts, path, grid)
        self.paths = paths
        self.grid = grid
        self._headers = headers
        first = headers[0]
        self.width, self.height = first[0].width, first[0].height
        self.texel_mm = grid.texel_mm if grid else None
        self.reference_mm = grid.reference_mm if grid else None
        self.lights = directions_of(first, "light", paths[0])
        each = [directions_of(parts[:1], "view", path) for path, parts in zip(paths, headers)]
        self.views = Directions(
            np.array([view.theta_deg[0] for view in each]),
            np.array([view.phi_deg[0] for view in each]),
        )
        self.view_index = [_number(os.path.basename(path)) for path in paths]
        self.light_index = [_number(part.name) for part in first]
        for path, parts in zip(paths, headers):
            lights = directions_of(parts, "light", path)
            if len(parts) != len(first) or np.any(lights.vectors != self.lights.vectors):
                raise Error(
                    f"{path}: the lights of the view are not those of {paths[0]}; delete the file "
                    "and process again, or import again"
                )

    def __repr__(self) -> str:
        height, width, views, lights, _ = self.shape
        return f"<mesorig.Btf {width} × {height} texels, {views} views, {lights} lights>"

    @property
    def shape(self) -> "tuple[int, int, int, int, int]":
        """Shape of values: height, width, views, lights, 3."""
        return self.height, self.width, len(self.views), len(self.lights), 3

    @property
    def nbytes(self) -> int:
        """Bytes of values. sigma has as many."""
        return 4 * int(np.prod(self.shape, dtype=np.int64))

    def view(self, k: int) -> BtfView:
        """Read view k, counted from 0 in the order of views."""
        return BtfView(self.paths[k], self.grid)

    @functools.cached_property
    def values(self) -> NDArray[np.float32]:
        """All values, height × width × views × lights × 3, as in BtfView. nbytes tells their size."""
        return self._stack("values", 3, np.float32)

    @functools.cached_property
    def sigma(self) -> NDArray[np.float32]:
        """Standard errors of all values, in the shape of values. NaN if not known."""
        return self._stack("sigma", 3, np.float32)

    @functools.cached_property
    def flags(self) -> NDArray[np.uint8]:
        """Flags of all values, height × width × views × lights: sums of FLAG_…"""
        return self._stack("flags", 0, np.uint8)

    def _stack(self, name: str, colours: int, dtype: type) -> NDArray:
        shape = self.shape[:4] + ((colours,) if colours else ())
        try:
            stacked: NDArray = np.empty(shape, dtype)
        except MemoryError as error:
            raise Error(
                f"{os.path.dirname(self.paths[0])}: {name} of the BTF takes "
                f"{np.prod(shape, dtype=float) * np.dtype(dtype).itemsize / 2**30:.1f} GiB, for which "
                "there is no memory; read the views one by one with view()"
            ) from error
        for k in range(len(self.views)):
            stacked[:, :, k] = getattr(self.view(k), name)
        return stacked

    def flag_counts(self) -> Dict[str, int]:
        """Number of values with each flag, by name: holes, bounds, shorter, predicted.

        Only headers are read. A part without the attribute counts as 0.
        """
        return {
            name: sum(
                int(_attribute(part, "mesorig." + name, path))
                for path, parts in zip(self.paths, self._headers)
                for part in parts
                if "mesorig." + name in part.attributes
            )
            for name in _COUNTS
        }


def _number(name: str) -> int:
    found = re.search(r"(\d+)(\.exr)?$", name)
    return int(found[1]) if found else -1
