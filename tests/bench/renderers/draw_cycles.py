"""Renders what NAME_blender.py makes with Cycles, in each scene of SCENES.json: [[scene, OUT.png], …].
usage: blender -b --python draw_cycles.py -- NAME_blender.py SCENES.json
       python3 draw_cycles.py -- NAME_blender.py SCENES.json    with the package bpy of PyPI"""

import json
import runpy
import sys

import bpy
from mathutils import Vector


def z_up(v):
    return Vector((v[0], -v[2], v[1]))


def place(shape, given):
    """Moves a shape to the middle, and to where the maps' surface is, as sunk() of compare_renderers has it."""
    shape.location = (0, 0, 0)
    depth = given["depth"] * given["radius"]
    for vertex in shape.data.vertices:
        p = vertex.co
        if given["shape"] == "sphere":
            squeezed = (
                max(1 - (p.z / given["radius"]) ** 2, 0) ** 0.25
            )  # the root of cos(elevation)
            vertex.co = p * (1 - given["depth"] * squeezed)
        else:
            p.z -= depth
    shape.scale = [s / given["radius"] for s in shape.scale]


def render(script, given, out):
    bpy.ops.wm.read_factory_settings()
    runpy.run_path(script)
    scene = bpy.context.scene
    for thing in list(bpy.data.objects):
        if thing.type in ("LIGHT", "CAMERA") or (
            thing.type == "MESH" and thing.name.split("_")[-1] != given["shape"]
        ):
            bpy.data.objects.remove(thing)
    place(next(o for o in bpy.data.objects if o.type == "MESH"), given)
    lamp = bpy.data.objects.new("lamp", bpy.data.lights.new("lamp", "SUN"))
    lamp.data.energy = 3.14159265 * given["exposure"]
    lamp.data.angle = 0
    lamp.rotation_euler = z_up(given["light"]).to_track_quat("Z", "Y").to_euler()
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = z_up(given["camera"])
    camera.rotation_euler = camera.location.to_track_quat("Z", "Y").to_euler()
    camera.data.angle = given["fov"] * 3.14159265 / 180
    for thing in (lamp, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    scene.world = bpy.data.worlds.new("black")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    scene.render.engine = "CYCLES"
    scene.cycles.samples = given.get("samples", 24)
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.render.resolution_x = scene.render.resolution_y = given["size"]
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.filepath = out
    bpy.ops.render.render(write_still=True)


made, scenes = sys.argv[sys.argv.index("--") + 1 :][:2]
for one, picture in json.load(open(scenes)):
    render(made, one, picture)
