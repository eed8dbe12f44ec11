"""A BSDF of Mitsuba 3 that draws materials which Mesorig captured: their whole BTF, or a compressed one.

    mi.set_variant("llvm_ad_rgb")
    import mesorig_bsdf
    mesorig_bsdf.register()
    mi.load_dict({"type": "mesorig", "filename": "weave.session", "tiles_u": 6.0, "tiles_v": 3.0})

filename is anything that mesorig_material_open() of libmesorig-material opens. tiles_u and tiles_v are the numbers of
tiles of the material for a unit of the texture coordinates; the default is 1.
"""

import os
from concurrent.futures import ThreadPoolExecutor

import drjit as dr
import mesorig
import mitsuba as mi
import numpy as np

CHUNK = 1 << 14  # points that a thread evaluates together


def register():
    """Registers the plug-in "mesorig" in the current variant.

    The library evaluates arrays of numbers, and cannot be part of a kernel that Dr.Jit compiles. Loops and virtual
    calls are therefore evaluated step by step, in wavefronts.
    """
    if not mi.is_rgb:
        raise RuntimeError(f"{mi.variant()}: materials have RGB values; choose an RGB variant")
    for flag in (dr.JitFlag.SymbolicLoops, dr.JitFlag.SymbolicCalls):
        dr.set_flag(flag, False)
    mi.register_bsdf("mesorig", MesorigBSDF)


def _rows(vector):
    """A vector, point or number of Mitsuba as an array, points × components."""
    array = np.array(vector, np.float32)
    components = 1 if isinstance(vector, (float, mi.Float)) else len(vector)
    return np.ascontiguousarray(array.reshape(components, -1).T)


class MesorigBSDF(mi.BSDF):
    """Values are B / π: B is the reflected radiance relative to a white diffuser, and contains n·l. Mitsuba's wi is the
    view, and its wo the light. Values are those of points, because a BSDF does not know the size of a pixel. The surface
    is black from behind."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.filename = props["filename"]
        self.tiles = np.float32([props.get("tiles_u", 1.0), props.get("tiles_v", 1.0)])
        self.material = mesorig.Material(self.filename)
        self.threads = ThreadPoolExecutor(os.cpu_count())
        flags = mi.BSDFFlags
        self.m_flags = (
            flags.GlossyReflection | flags.SpatiallyVarying | flags.Anisotropic | flags.FrontSide
        )
        self.m_components = [self.m_flags]

    def _points(self, ctx, si, active, *directions):
        """The points to evaluate: their indices, texture coordinates, and directions."""
        if ctx.mode != mi.TransportMode.Radiance:
            raise RuntimeError("the plug-in “mesorig” needs an integrator that starts at the eye")
        # v of a material goes down its rows, against the bitangent n × s. Where texture coordinates are right-handed,
        # v goes up.
        upwards = dr.dot(dr.cross(si.dp_du, si.dp_dv), si.n) > 0
        v = dr.select(upwards, -si.uv.y, si.uv.y)
        arrays = [_rows(mi.Point2f(si.uv.x, v)) * self.tiles, _rows(si.wi), *map(_rows, directions)]
        mask = np.array(active, bool).reshape(-1)
        n = max(len(mask), *map(len, arrays))
        inside = np.broadcast_to(mask, n) & np.broadcast_to(arrays[1][:, 2] > 0, n)
        at = np.flatnonzero(inside)
        return n, at, [np.broadcast_to(a, (n, a.shape[1]))[at] for a in arrays]

    def _call(self, function, *arrays):
        """Calls a function of the material in several threads, and joins its results."""
        n = len(arrays[0])
        parts = [[a[k : k + CHUNK] for a in arrays] for k in range(0, max(n, 1), CHUNK)]
        return list(self.threads.map(lambda part: function(*part), parts))

    @staticmethod
    def _spread(kind, n, at, values):
        """Values of the points `at` among n points, 0 elsewhere, as a type of Mitsuba."""
        values = values.reshape(len(at), -1)
        whole = np.zeros((n, values.shape[1]), np.float32)
        whole[at] = values
        if not dr.is_jit_v(mi.Float):
            return kind(*map(float, whole[0]))
        return kind(*(mi.Float(np.ascontiguousarray(column)) for column in whole.T))

    def eval(self, ctx, si, wo, active=True):
        n, at, points = self._points(ctx, si, active, wo)
        values = np.concatenate(self._call(self.material.evaluate, *points)) / np.float32(np.pi)
        return self._spread(mi.Color3f, n, at, values)

    def pdf(self, ctx, si, wo, active=True):
        n, at, points = self._points(ctx, si, active, wo)
        return self._spread(mi.Float, n, at, np.concatenate(self._call(self.material.pdf, *points)))

    def eval_pdf(self, ctx, si, wo, active=True):
        return self.eval(ctx, si, wo, active), self.pdf(ctx, si, wo, active)

    def sample(self, ctx, si, sample1, sample2, active=True):
        n, at, (uv, view, random) = self._points(ctx, si, active, sample2)
        drawn = self._call(self.material.sample, uv, view, random)
        light, pdf = (np.concatenate([part[k] for part in drawn]) for k in range(2))
        values = np.concatenate(self._call(self.material.evaluate, uv, view, light))
        weight = values / np.float32(np.pi) / np.maximum(pdf, 1e-20)[:, None]
        bs = mi.BSDFSample3f()
        bs.wo = self._spread(mi.Vector3f, n, at, light)
        bs.pdf = self._spread(mi.Float, n, at, pdf)
        bs.eta = 1.0
        bs.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        bs.sampled_component = mi.UInt32(0)
        return bs, self._spread(mi.Color3f, n, at, np.where(pdf[:, None] > 0, weight, 0))

    def traverse(self, callback):
        pass

    def to_string(self):
        return f"MesorigBSDF[filename={self.filename}, {self.material.info}]"
