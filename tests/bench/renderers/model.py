"""The maps of a .glb drawn by formulas of glTF 2.0's appendix B and its extensions for specular reflection
and anisotropy alone: what a renderer adds to the model's own error is its picture's difference from this
one. Tangents are at right angles to the bent normal, as the maps were fitted, or with mesh_tangents those of
the mesh, as three.js has them. Textures are bilinear and repeat; sheen and clear coats are not drawn."""
import io
import json
import math
import struct
import numpy as np
from PIL import Image

SAMPLES = 3  # of a pixel each way


def read_glb(path):
    """The JSON of a .glb and its binary part."""
    data = open(path, "rb").read()
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length]), data[20 + length + 8 :]


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def dot(a, b):
    return (a * b).sum(-1)


def linear(x):
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


class Material:
    def __init__(self, root, binary, mesh_tangents):
        self.root, self.binary, self.m = root, binary, root["materials"][0]
        self.mesh_tangents = mesh_tangents

    def texture(self, info, at, coded=0):
        """At texture coordinates; the first channels are sRGB."""
        image = self.root["images"][self.root["textures"][info["index"]]["source"]]
        view = self.root["bufferViews"][image["bufferView"]]
        first = view.get("byteOffset", 0)
        file = io.BytesIO(self.binary[first : first + view["byteLength"]])
        texels = np.asarray(Image.open(file)).astype(float) / 255
        texels = np.concatenate([linear(texels[..., :coded]), texels[..., coded:]], -1)
        h, w = texels.shape[:2]
        x, y = at[..., 0] * w - 0.5, at[..., 1] * h - 0.5
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = (x - i)[..., None], (y - j)[..., None]
        row = lambda k: texels[k % h, i % w] * (1 - fx) + texels[k % h, (i + 1) % w] * fx
        return row(j) * (1 - fy) + row(j + 1) * fy

    def evaluate(self, at, v, l):
        """π f n·l, of directions in the frame of tangent, bitangent and normal."""
        pbr, more = self.m["pbrMetallicRoughness"], self.m.get("extensions", {})
        base = self.texture(pbr["baseColorTexture"], at, 3)
        orm = self.texture(pbr["metallicRoughnessTexture"], at)
        n = unit(2 * self.texture(self.m["normalTexture"], at)[..., :3] - 1)
        weight, tint = np.ones(at.shape[:-1] + (1,)), np.ones(3)
        if "KHR_materials_specular" in more:
            specular = more["KHR_materials_specular"]
            tint = self.texture(specular["specularTexture"], at, 3)
            weight, tint = tint[..., 3:], tint[..., :3] * specular["specularColorFactor"]
        across = orm[..., 1] ** 2
        along, t = across, np.stack([1 + 0 * across, 0 * across, 0 * across], -1)
        if "KHR_materials_anisotropy" in more:
            a = self.texture(more["KHR_materials_anisotropy"]["anisotropyTexture"], at)
            along = across + (1 - across) * a[..., 2] ** 2
            t[..., :2] = 2 * a[..., :2] - 1 + 1e-6
        anisotropic = "KHR_materials_anisotropy" in more
        up = np.broadcast_to([0, 0, 1.0], n.shape) if self.mesh_tangents and anisotropic else n
        t = unit(t - dot(t, up)[..., None] * up)
        b, h = np.cross(up, t), unit(v + l)
        nl, nv, nh, vh = dot(n, l), dot(n, v), dot(n, h), dot(v, h)
        seen = (nl > 1e-4) & (nv > 1e-4) & (l[..., 2] > 0)
        nl, nv = np.maximum(nl, 1e-4), np.maximum(nv, 1e-4)
        w = (dot(h, t) / along) ** 2 + (dot(h, b) / across) ** 2 + nh**2
        smith = lambda d, c: np.sqrt((along * dot(d, t)) ** 2 + (across * dot(d, b)) ** 2 + c**2)
        lobe = (0.5 / (nl * smith(v, nv) + nv * smith(l, nl)) / (math.pi * along * across * w * w))[
            ..., None
        ]
        f5 = ((1 - vh) ** 5)[..., None]
        f0 = np.minimum(0.04 * tint, 1)
        fresnel = f0 + (1 - f0) * f5
        plain = (
            1 - weight * fresnel.max(-1, keepdims=True)
        ) * base / math.pi + weight * fresnel * lobe
        metal = lobe * (base + (1 - base) * f5)
        return math.pi * (nl * seen)[..., None] * (plain + orm[..., 2:3] * (metal - plain))


def rays(scene, size):
    """Of the pixels' samples: from where, and their directions."""
    eye = np.array(scene["camera"])
    back = eye / np.linalg.norm(eye)
    right = np.array([1.0, 0, 0])
    at = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(at, -at)
    wide = math.tan(math.radians(scene["fov"]) / 2)
    return eye, unit(wide * (x[..., None] * right + y[..., None] * np.cross(back, right)) - back)


def draw(root, binary, scene, out, mesh_tangents=False):
    size = scene["size"] * SAMPLES
    eye, d = rays(scene, size)
    if scene["shape"] == "sphere":
        b = d @ eye
        under = b * b - (eye @ eye - 1)
        p = eye + d * (-b - np.sqrt(np.maximum(under, 0)))[..., None]
        n, hit = unit(p), under > 0
        e, a = np.arcsin(n[..., 1]), np.arctan2(-n[..., 2], n[..., 0]) % (2 * math.pi)
        at = np.stack([6 * a / (2 * math.pi), 3 * (0.5 - e / math.pi)], -1)
        t = np.stack([-np.sin(a), 0 * a, -np.cos(a)], -1)
        squeezed, tile = np.maximum(np.cos(e), 1e-2)[..., None], 2 * math.pi / 6
        depth = scene["depth"] / tile * np.concatenate([squeezed**-0.5, squeezed**0.5], -1)
    else:
        p = eye - d * (eye[1] / d[..., 1])[..., None]
        half = np.array([scene["half"][0], scene["half"][2]])
        at = (p[..., [0, 2]] / half + 1) / 2
        hit = (np.abs(p[..., [0, 2]]) < half).all(-1)
        n, t = np.broadcast_to([0.0, 1, 0], p.shape), np.broadcast_to([1.0, 0, 0], p.shape)
        depth = scene["depth"] / (2 * half)
    axes = (t, np.cross(n, t), n)
    v = np.stack([dot(unit(eye - p), axis) for axis in axes], -1)
    l = np.stack([axis @ np.array(scene["light"]) for axis in axes], -1)
    at = at - depth * v[..., :2] * [1, -1] / np.maximum(v[..., 2:], 0.1)  # the surface lies lower
    rgb = np.zeros(hit.shape + (3,))
    rgb[hit] = (
        Material(root, binary, mesh_tangents).evaluate(at[hit], v[hit], l[hit]) * scene["exposure"]
    )
    rgb = np.clip(rgb.reshape(scene["size"], SAMPLES, scene["size"], SAMPLES, 3).mean((1, 3)), 0, 1)
    coded = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    Image.fromarray(np.rint(255 * coded).astype(np.uint8)).save(out)
