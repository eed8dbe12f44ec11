#!/usr/bin/env python3
"""Reads the material of a .glb and evaluates it, apart from processing/maps: glTF 2.0's appendix B and
the extensions' own formulas. Only the standard library, and nothing but loops.

  gltf_peer.py FILE.glb < QUERIES

A query is a line X Y VX VY VZ LX LY LZ: a texel, and unit vectors to view and light in the frame of
tangent, bitangent and normal of the mesh. The answer is a line R G B: π f(v, l) times the cosine
between the texel's normal and the light.
"""
import json
import math
import struct
import sys
import zlib


def unfilter(kind, line, before, bpp):
    for i in range(len(line)):
        a = line[i - bpp] if i >= bpp else 0
        b = before[i]
        c = before[i - bpp] if i >= bpp else 0
        p = a + b - c
        paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
        line[i] = (line[i] + (0, a, b, (a + b) // 2, paeth)[kind]) & 255
    return line


def read_png(data):
    """Rows of pixels of 0 … 1, each a list of channels."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed = 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, bits, colour = struct.unpack(">IIBB", body[:10])
        elif kind == b"IDAT":
            packed += body
        at += 12 + length
    assert bits == 8
    channels = {0: 1, 2: 3, 6: 4}[colour]
    raw, before, rows = zlib.decompress(packed), bytes(width * channels), []
    for y in range(height):
        line = raw[y * (width * channels + 1) : (y + 1) * (width * channels + 1)]
        before = bytes(unfilter(line[0], bytearray(line[1:]), before, channels))
        rows.append(
            [[before[x * channels + c] / 255 for c in range(channels)] for x in range(width)]
        )
    return rows


def linear(x):
    return x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def unit(a):
    length = math.sqrt(dot(a, a))
    return [x / length for x in a]


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Material:
    def __init__(self, path):
        data = open(path, "rb").read()
        length = struct.unpack("<I", data[12:16])[0]
        self.root = json.loads(data[20 : 20 + length])
        self.binary = data[20 + length + 8 :]
        self.m = self.root["materials"][0]
        self.pictures = {}

    def texel(self, info, x, y):
        index = info["index"]
        if index not in self.pictures:
            image = self.root["images"][self.root["textures"][index]["source"]]
            view = self.root["bufferViews"][image["bufferView"]]
            first = view.get("byteOffset", 0)
            self.pictures[index] = read_png(self.binary[first : first + view["byteLength"]])
        return self.pictures[index][y][x]

    def evaluate(self, x, y, v, l):
        pbr, more = self.m["pbrMetallicRoughness"], self.m.get("extensions", {})
        base = [linear(c) for c in self.texel(pbr["baseColorTexture"], x, y)[:3]]
        orm = self.texel(pbr["metallicRoughnessTexture"], x, y)
        alpha, metallic = orm[1] ** 2, orm[2]
        n = unit([2 * c - 1 for c in self.texel(self.m["normalTexture"], x, y)])
        weight, tint = 1.0, [1.0, 1.0, 1.0]
        if "KHR_materials_specular" in more:
            s = more["KHR_materials_specular"]
            weight = self.texel(s["specularTexture"], x, y)[3] * s.get("specularFactor", 1)
            tint = [
                f * linear(c)
                for f, c in zip(
                    s["specularColorFactor"], self.texel(s["specularColorTexture"], x, y)
                )
            ]
        nl, nv = dot(n, l), dot(n, v)
        if nl <= 1e-4 or nv <= 1e-4:
            return [0.0, 0.0, 0.0]
        h = unit([a + b for a, b in zip(v, l)])
        if "KHR_materials_anisotropy" in more:
            lobe = self.anisotropic(more["KHR_materials_anisotropy"], x, y, alpha, n, v, l, h)
        else:
            nh, a2 = dot(n, h), alpha * alpha
            d = a2 / (math.pi * (nh * nh * (a2 - 1) + 1) ** 2)
            g = (
                2
                * nl
                * nv
                / (
                    nl * math.sqrt(a2 + (1 - a2) * nv * nv)
                    + nv * math.sqrt(a2 + (1 - a2) * nl * nl)
                )
            )
            lobe = d * g / (4 * nl * nv)
        f5 = (1 - abs(dot(v, h))) ** 5
        f0 = [min(0.04 * t, 1.0) for t in tint]
        fresnel = [f + (1 - f) * f5 for f in f0]
        ret = []
        for c in range(3):
            dielectric = (1 - weight * max(fresnel)) * base[c] / math.pi + weight * fresnel[
                c
            ] * lobe
            metal = lobe * (base[c] + (1 - base[c]) * f5)
            ret.append(math.pi * nl * (dielectric + metallic * (metal - dielectric)))
        return ret

    def anisotropic(self, given, x, y, alpha, n, v, l, h):
        r, g, b = self.texel(given["anisotropyTexture"], x, y)[:3]
        direction = unit([2 * r - 1, 2 * g - 1, 0])
        at = alpha + (1 - alpha) * (b * given["anisotropyStrength"]) ** 2
        along = dot(direction, n)
        t = unit([d - along * k for d, k in zip(direction, n)])
        bt = cross(n, t)
        a2 = at * alpha
        f = [alpha * dot(t, h), at * dot(bt, h), a2 * dot(n, h)]
        w2 = a2 / dot(f, f)
        d = a2 * w2 * w2 / math.pi
        nl, nv = dot(n, l), dot(n, v)
        gv = nl * math.sqrt((at * dot(t, v)) ** 2 + (alpha * dot(bt, v)) ** 2 + nv * nv)
        gl = nv * math.sqrt((at * dot(t, l)) ** 2 + (alpha * dot(bt, l)) ** 2 + nl * nl)
        return d * 0.5 / (gv + gl)


material = Material(sys.argv[1])
for query in sys.stdin:
    q = [float(word) for word in query.split()]
    print("%.7f %.7f %.7f" % tuple(material.evaluate(int(q[0]), int(q[1]), q[2:5], q[5:8])))
