#!/usr/bin/env python3
"""Blender's part of formats.py: formats_blender.py SCENE.usda SCENE.glb PICTURES, with the package bpy.

Checks the USD scene with the USD of Blender, which has MaterialX, and imports it. Cycles draws both
scenes under the same lamp, as PICTURES_usd.png and PICTURES_gltf.png.
"""
import glob
import json
import math
import sys

import numpy as np

import bpy

# The modules of Blender's build, instead of those of usd-core.
sys.path.insert(0, glob.glob(bpy.utils.resource_path("LOCAL") + "/python/lib/*/site-packages")[0])
from pxr import Usd, UsdUtils, UsdValidation  # noqa: E402

SIZE, SAMPLES = 256, 64


def validate(path):
    errors = []
    for arkit in (False, True):
        checker = UsdUtils.ComplianceChecker(arkit=arkit, skipARKitRootLayerCheck=True)
        checker.CheckCompliance(path)
        errors += checker.GetErrors() + checker.GetWarnings() + checker.GetFailedChecks()
    rules = len(UsdUtils.ComplianceChecker.GetRules(arkit=True))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(path))
    return rules, len(validators), errors + [e.GetMessage() for e in found]


def draw(path, picture):
    """Imports a scene and draws it; returns the pixels and the material's images."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if path.endswith(".glb"):
        bpy.ops.import_scene.gltf(filepath=path)
    else:
        bpy.ops.wm.usd_import(filepath=path)
    shapes = [o for o in bpy.data.objects if o.type == "MESH"]
    size = max(max(o.dimensions) for o in shapes)
    scene = bpy.context.scene
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    lamp.data.energy, lamp.data.angle = 3, 0.0
    lamp.rotation_euler = (math.radians(40), 0, math.radians(60))
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = (0.6 * size, -1.6 * size, 1.9 * size)
    camera.rotation_euler = (math.radians(40), 0, math.radians(0))
    camera.data.clip_start = 0.001
    for thing in (lamp, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = SAMPLES, False, 0
    scene.cycles.seed = 1
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(picture)
    pixels = np.array(image.pixels[:]).reshape(SIZE, SIZE, 4)[..., :3] * 255
    (material,) = {slot.material for o in shapes for slot in o.material_slots}
    nodes = material.node_tree.nodes
    return pixels, sum(node.type == "TEX_IMAGE" and node.image is not None for node in nodes)


usda, glb, pictures = sys.argv[1:]
rules, validators, errors = validate(usda)
ours, images = draw(usda, pictures + "_usd.png")
theirs, _ = draw(glb, pictures + "_gltf.png")
shown = ((ours > 3) | (theirs > 3)).any(-1)
found = {
    "rules": rules,
    "validators": validators,
    "errors": errors,
    "images": images,
    "usd": ".".join(map(str, Usd.GetVersion()[1:])),
    "difference": float(np.abs(ours - theirs)[shown].mean()),
    "shown": float(shown.mean()),
}
print("\n" + json.dumps(found))
