"""Evaluation of materials by the C library libmesorig-material."""

from __future__ import annotations

import ctypes
import os
import weakref
from typing import Any, List, NamedTuple, Optional, Tuple, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._error import Error

Floats = NDArray[np.float32]

_NAME = "libmesorig-material.so.0"
_CALLS = ("info", "directions", "evaluate", "intersect", "sample", "pdf")


class _CError(ctypes.Structure):
    _fields_ = [("status", ctypes.c_int), ("text", ctypes.c_char * 512)]


class _CInfo(ctypes.Structure):
    _fields_ = [
        ("size", ctypes.c_size_t),
        ("kind", ctypes.c_char_p),
        ("width", ctypes.c_int),
        ("height", ctypes.c_int),
        ("n_views", ctypes.c_int),
        ("n_lights", ctypes.c_int),
        ("texel_mm", ctypes.c_double),
        ("deepest_mm", ctypes.c_double),
        ("has_relief", ctypes.c_int),
        ("error", ctypes.c_double),
    ]


_HIT = np.dtype(
    [("hit", np.int32), ("distance_mm", np.float32), ("uv", "f4", 2), ("normal", "f4", 3)]
)


class MaterialInfo(NamedTuple):
    """Properties of a material."""

    kind: str  # the codec: "btf", "lpca", "eigenmaps", …
    width: int  # texels of a tile
    height: int
    n_views: int  # number of measured directions, or of samples of a grid of them
    n_lights: int
    texel_mm: float  # width of a texel; NaN if not known
    deepest_mm: float  # maximum depth of the relief below the reference plane; 0 without relief
    has_relief: bool  # whether there is an MDF
    error: float  # ‖compressed − BTF‖ / ‖BTF‖ of the codec; 0 for a BTF; NaN if not known


class Hits(NamedTuple):
    """The points at which rays meet the surface. mesorig_hit of material.h has the details."""

    hit: NDArray[np.bool_]  # False if the view is not above the horizon; all else is then 0
    distance_mm: Floats  # along the ray, from the reference plane
    uv: Floats  # […, 2]: the point of the reference plane vertically above the point
    normal: Floats  # […, 3]: unit normal of the surface


def _load() -> Any:
    try:
        library = ctypes.CDLL(_NAME)
    except OSError as error:
        raise Error(
            f"{_NAME} cannot be loaded ({error}); install the Debian package "
            "libmesorig-material0, which “./run package” builds, or set LD_LIBRARY_PATH to the "
            "folder processing of a build"
        ) from error
    library.mesorig_material_open.restype = ctypes.c_void_p
    library.mesorig_material_close.restype = None
    library.mesorig_material_close.argtypes = [ctypes.c_void_p]
    for call in _CALLS:
        getattr(library, "mesorig_material_" + call).restype = ctypes.c_int
    return library


def _pointer(array: Optional[NDArray[Any]]) -> Optional[ctypes.c_void_p]:
    return None if array is None else array.ctypes.data_as(ctypes.c_void_p)


def _broadcast(
    *arrays: Tuple[Optional[ArrayLike], int]
) -> Tuple[Tuple[int, ...], List[Optional[Floats]]]:
    """Broadcast points against each other as NumPy does, and return their common shape.

    Each array comes with the length of its last axis; 0 means that it has one number for each
    point. None stays None.
    """
    given: List[Tuple[Optional[Floats], int]] = []
    for values, length in arrays:
        array = None if values is None else np.asarray(values, np.float32)
        if array is not None and length and array.shape[-1:] != (length,):
            raise ValueError(f"an array has the shape {array.shape}, but must end with {length}")
        given.append((array, length))
    shape = np.broadcast_shapes(
        *(a.shape[:-1] if length else a.shape for a, length in given if a is not None)
    )
    return shape, [
        (
            None
            if a is None
            else np.ascontiguousarray(np.broadcast_to(a, shape + ((length,) if length else ())))
        )
        for a, length in given
    ]


class Material:
    """A material in any form: a session, its BTF, or a file of “mesorig compress”.

    path is opened as mesorig_material_open() of the C library does. mdf is a file of distances;
    without it, the MDF of a session is used.

    Texture coordinates u, v are in tiles; v goes downwards along the rows. Directions point away
    from the surface and need not have unit length. Points, views, lights and footprints are
    broadcast against each other as NumPy does. Values are as in Btf.values, but not negative: the
    library clips values that noise made negative at 0. Holes are filled from their neighbours.
    """

    def __init__(
        self, path: Union[str, "os.PathLike[str]"], mdf: Union[str, "os.PathLike[str]", None] = None
    ) -> None:
        self._library = _load()
        error = _CError()
        handle = self._library.mesorig_material_open(
            os.fsencode(path), None if mdf is None else os.fsencode(mdf), ctypes.byref(error)
        )
        if not handle:
            raise Error(error.text.decode(errors="replace"))
        self._handle = ctypes.c_void_p(handle)
        self._close = weakref.finalize(self, self._library.mesorig_material_close, self._handle)

    def __enter__(self) -> "Material":
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the material's memory. Otherwise this happens with the object."""
        self._close()

    def _call(self, name: str, *arguments: Any) -> None:
        if not self._close.alive:
            raise ValueError("the material is closed")
        status = getattr(self._library, "mesorig_material_" + name)(self._handle, *arguments)
        if status != 0:
            raise Error(f"mesorig_material_{name}() failed with status {status} (material.h)")

    @property
    def info(self) -> MaterialInfo:
        """Properties of the material."""
        c = _CInfo(ctypes.sizeof(_CInfo))
        self._call("info", ctypes.byref(c))
        return MaterialInfo(
            kind=c.kind.decode(),
            width=c.width,
            height=c.height,
            n_views=c.n_views,
            n_lights=c.n_lights,
            texel_mm=c.texel_mm or np.nan,
            deepest_mm=c.deepest_mm,
            has_relief=bool(c.has_relief),
            error=c.error if c.error >= 0 else np.nan,
        )

    @property
    def directions(self) -> Tuple[Floats, Floats]:
        """Unit vectors of the measured views and lights, n_views × 3 and n_lights × 3."""
        info = self.info
        views = np.empty((info.n_views, 3), np.float32)
        lights = np.empty((info.n_lights, 3), np.float32)
        self._call("directions", _pointer(views), _pointer(lights))
        return views, lights

    def texel_uv(self) -> Floats:
        """Texture coordinates of the centres of all texels, height × width × 2."""
        info = self.info
        v, u = np.indices((info.height, info.width), np.float32) + np.float32(0.5)
        return np.stack([u / info.width, v / info.height], axis=-1)

    def evaluate(
        self,
        uv: ArrayLike,
        view: ArrayLike,
        light: ArrayLike,
        footprint: Optional[ArrayLike] = None,
    ) -> Floats:
        """Return the values [..., 3] at points [..., 2] for views and lights [..., 3].

        footprint [...] is the diameter of a pixel's footprint in tiles; None means points.
        """
        shape, inputs = _broadcast((uv, 2), (view, 3), (light, 3), (footprint, 0))
        rgb = np.empty(shape + (3,), np.float32)
        self._call(
            "evaluate", ctypes.c_size_t(rgb.size // 3), *map(_pointer, inputs), _pointer(rgb)
        )
        return rgb

    def intersect(self, uv: ArrayLike, view: ArrayLike) -> Hits:
        """Return where rays that enter the reference plane at uv and continue along −view meet the
        surface."""
        shape, inputs = _broadcast((uv, 2), (view, 3))
        hits = np.zeros(shape, _HIT)
        self._call("intersect", ctypes.c_size_t(hits.size), *map(_pointer, inputs), _pointer(hits))
        return Hits(hits["hit"] != 0, hits["distance_mm"], hits["uv"], hits["normal"])

    def sample(
        self,
        uv: ArrayLike,
        view: ArrayLike,
        random: ArrayLike,
        footprint: Optional[ArrayLike] = None,
    ) -> Tuple[Floats, Floats]:
        """Draw light directions approximately in proportion to the light that is reflected to the
        view. random [..., 2] is in [0, 1).

        Return the directions [..., 3] and their densities [...] per solid angle. A density of 0
        means that there is no direction.
        """
        # Numbers just below 1 become 1 as float32.
        random = np.minimum(np.asarray(random, np.float32), np.float32(1 - 2**-24))
        shape, inputs = _broadcast((uv, 2), (view, 3), (footprint, 0), (random, 2))
        light, pdf = np.zeros(shape + (3,), np.float32), np.zeros(shape, np.float32)
        outputs = (_pointer(light), _pointer(pdf))
        self._call("sample", ctypes.c_size_t(pdf.size), *map(_pointer, inputs), *outputs)
        return light, pdf

    def pdf(
        self,
        uv: ArrayLike,
        view: ArrayLike,
        light: ArrayLike,
        footprint: Optional[ArrayLike] = None,
    ) -> Floats:
        """Return the density [...] with which sample() draws the given lights."""
        shape, inputs = _broadcast((uv, 2), (view, 3), (light, 3), (footprint, 0))
        pdf = np.zeros(shape, np.float32)
        self._call("pdf", ctypes.c_size_t(pdf.size), *map(_pointer, inputs), _pointer(pdf))
        return pdf
