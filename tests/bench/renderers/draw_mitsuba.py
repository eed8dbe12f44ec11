"""Renders base colour, metallic, roughness and normals of .glb files with Mitsuba's BSDF “principled”, in the scenes of
SCENES.json: [[MAPS.glb, SHAPE.obj, scene, OUT.png], …]. “principled” has no map of the specular reflectance and no
direction of anisotropy. The .glb should therefore be one of “mesorig export gltf --core”.
usage: python3 draw_mitsuba.py SCENES.json    with the packages mitsuba and pillow of PyPI"""

import io
import json
import math
import sys

import mitsuba as mi
import numpy as np
from PIL import Image

import model

SAMPLES = 16

mi.set_variant("scalar_rgb")


def bitmap(root, binary, info, channels, raw):
    """A texture of these channels of a map. raw says that its values are linear."""
    image = root["images"][root["textures"][info["index"]]["source"]]
    view = root["bufferViews"][image["bufferView"]]
    first = view.get("byteOffset", 0)
    texels = np.asarray(Image.open(io.BytesIO(binary[first : first + view["byteLength"]])))
    texels = np.ascontiguousarray(texels[..., channels])
    return {"type": "bitmap", "bitmap": mi.Bitmap(texels), "raw": raw}


def material(glb):
    root, binary = model.read_glb(glb)
    of = root["materials"][0]
    pbr = of["pbrMetallicRoughness"]
    orm = pbr["metallicRoughnessTexture"]
    return {
        "type": "normalmap",
        "normalmap": bitmap(root, binary, of["normalTexture"], [0, 1, 2], True),
        "bsdf": {
            "type": "principled",
            "base_color": bitmap(root, binary, pbr["baseColorTexture"], [0, 1, 2], False),
            "roughness": bitmap(root, binary, orm, [1], True),
            "metallic": bitmap(root, binary, orm, [2], True),
            "specular": 0.5,
        },
    }


def render(glb, shape, given, out):
    camera = mi.ScalarTransform4f().look_at(origin=given["camera"], target=[0, 0, 0], up=[0, 1, 0])
    scene = {
        "type": "scene",
        "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
        "shape": {"type": "obj", "filename": shape, "bsdf": material(glb)},
        "lamp": {
            "type": "directional",
            "direction": [-x for x in given["light"]],
            "irradiance": math.pi * given["exposure"],
        },
        "camera": {
            "type": "perspective",
            "fov": given["fov"],
            "to_world": camera,
            "film": {
                "type": "hdrfilm",
                "width": given["size"],
                "height": given["size"],
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "stratified", "sample_count": SAMPLES},
        },
    }
    rgb = np.clip(np.array(mi.render(mi.load_dict(scene)))[..., :3], 0, 1)
    coded = np.where(rgb <= 0.0031308, 12.92 * rgb, 1.055 * rgb ** (1 / 2.4) - 0.055)
    Image.fromarray(np.rint(255 * coded).astype(np.uint8)).save(out)


for drawing in json.load(open(sys.argv[1])):
    render(*drawing)
