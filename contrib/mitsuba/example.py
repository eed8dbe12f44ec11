#!/usr/bin/env python3
"""Draws two captured materials with Mitsuba: example.py BALL CLOTH PICTURE.png [SAMPLES]

BALL and CLOTH are sessions or compressed materials. A ball lies on a cloth with folds, next to a red ball, under a
lamp and a sky.
"""
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("llvm_ad_rgb")
import mesorig_bsdf  # noqa: E402

mesorig_bsdf.register()

N = 200  # quads of the cloth along an edge


def cloth(bsdf):
    """A square of 6 × 6 with soft folds, and with texture coordinates of 1 for its edge."""
    u, v = np.meshgrid(np.linspace(0, 1, N + 1), np.linspace(0, 1, N + 1))
    x, y = 6 * u - 3, 6 * v - 3
    z = 0.09 * np.sin(1.7 * x + 0.8 * y) + 0.06 * np.sin(2.6 * y - 0.9 * x + 1)
    a = (np.arange(N)[:, None] * (N + 1) + np.arange(N)).ravel()
    faces = np.stack([a, a + 1, a + N + 2, a, a + N + 2, a + N + 1], 1).reshape(-1, 3)
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    mesh = mi.Mesh("cloth", (N + 1) ** 2, 2 * N * N, properties, True, True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = np.stack([x, y, z], 2).ravel().astype(np.float32)
    parameters["vertex_texcoords"] = np.stack([u, v], 2).ravel().astype(np.float32)
    parameters["faces"] = faces.ravel().astype(np.uint32)
    parameters.update()
    mesh.recompute_vertex_normals()
    return mesh


def scene_of(ball, ground):
    look = mi.ScalarTransform4f().look_at
    captured = {"type": "mesorig", "filename": ball, "tiles_u": 6.0, "tiles_v": 3.0}
    folds = mi.load_dict({"type": "mesorig", "filename": ground, "tiles_u": 9.0, "tiles_v": 9.0})
    red = {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.06, 0.04]}}
    move = mi.ScalarTransform4f().translate
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 5},
            "cloth": cloth(folds),
            "ball": {
                "type": "sphere",
                "radius": 0.8,
                "to_world": move([-0.35, 0, 0.85]).rotate([1, 0, 0], 15),
                "bsdf": captured,
            },
            "red": {"type": "sphere", "radius": 0.4, "center": [0.95, -0.35, 0.45], "bsdf": red},
            "lamp": {
                "type": "rectangle",
                "to_world": look([-3, -3, 5], [0, 0, 0], [0, 0, 1]).scale(0.7),
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 38.0}},
            },
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": [0.28, 0.32, 0.4]}},
            "sensor": {
                "type": "perspective",
                "fov": 30,
                "to_world": look([0.8, -6.3, 3.3], [0.2, 0, 0.6], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 720, "height": 480},
            },
        }
    )


if __name__ == "__main__":
    if len(sys.argv) not in (4, 5):
        sys.exit(__doc__)
    scene = scene_of(*sys.argv[1:3])
    samples = int(sys.argv[4]) if len(sys.argv) == 5 else 64
    # Rays of all samples of a picture are in memory together: a few samples at a time.
    parts = [mi.render(scene, spp=4, seed=k) for k in range(max(samples // 4, 1))]
    picture = sum(np.array(part) for part in parts) / len(parts)
    mi.util.write_bitmap(sys.argv[3], mi.Bitmap(picture))
