"""Validates MaterialX documents, or draws one with MaterialX's own GLSL renderer.

    materialx_glsl.py validate FILE.mtlx…
    materialx_glsl.py draw FILE.mtlx SHAPE.obj SCENE.json OUT.npy

The package is MaterialX 1.39 of PyPI; drawing needs a display (xvfb-run). The scene is that of compare_renderers.
OUT.npy has linear light."""
import json
import math
import os
import sys

import MaterialX as mx
import numpy as np

FINER = 2  # samples of a pixel each way
LAMP = """<?xml version="1.0"?>
<materialx version="1.39">
  <directional_light name="lamp" type="lightshader">
    <input name="direction" type="vector3" value="%.9g, %.9g, %.9g" />
    <input name="color" type="color3" value="1, 1, 1" />
    <input name="intensity" type="float" value="%.9g" />
  </directional_light>
</materialx>
"""


def read(path):
    libraries, document = mx.createDocument(), mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), libraries)
    mx.readFromXmlFile(document, path)
    document.setDataLibrary(libraries)
    return libraries, document


def validate(path):
    """Prints what MaterialX finds wrong. Its own check passes over nodes that no library defines, over inputs that a
    node does not have, and over types that differ from the definition, so that these are checked as well.
    """
    document = read(path)[1]
    good, text = document.validate()
    errors = [] if good else [text]
    for node in document.getNodes():
        definition = node.getNodeDef()
        if definition is None:
            errors.append(f"{node.getName()}: no library defines such a {node.getCategory()}")
            continue
        for given in node.getInputs():
            known = definition.getActiveInput(given.getName())
            if known is None or known.getType() != given.getType():
                errors.append(
                    f"{node.getName()}: input {given.getName()} of type {given.getType()}"
                )
        for given in node.getInputs():
            file = given.getValueString()
            folder = os.path.dirname(path)
            if given.getType() == "filename" and not os.path.exists(os.path.join(folder, file)):
                errors.append(f"{node.getName()}: there is no {file}")
    print(f"{os.path.basename(path)}: {len(document.getNodes())} nodes, {len(errors)} errors")
    for error in errors:
        print("  ", error)
    return not errors


def draw(path, shape, scene, out):
    import MaterialX.PyMaterialXGenGlsl as glsl
    import MaterialX.PyMaterialXGenShader as gen
    import MaterialX.PyMaterialXRender as render
    import MaterialX.PyMaterialXRenderGlsl as gl

    scene = json.load(open(scene))
    libraries, document = read(path)
    lamp = mx.createDocument()
    mx.readFromXmlString(lamp, LAMP % (*(-x for x in scene["light"]), math.pi * scene["exposure"]))
    document.importLibrary(lamp)

    generator = glsl.GlslShaderGenerator.create()
    colours = gen.DefaultColorManagementSystem.create(generator.getTarget())
    colours.loadLibrary(libraries)
    generator.setColorManagementSystem(colours)
    generator.registerTypeDefs(document)
    context = gen.GenContext(generator)
    context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
    context.getOptions().targetColorSpaceOverride = "lin_rec709"
    context.getOptions().hwMaxActiveLightSources = 1
    context.getOptions().fileTextureVerticalFlip = True  # v goes up, and pictures begin at the top

    size = scene["size"] * FINER
    renderer = gl.GlslRenderer.create(size, size, render.BaseType.FLOAT)
    renderer.initialize()
    images = gl.GLTextureHandler.create(render.StbImageLoader.create())
    images.setSearchPath(mx.FileSearchPath(os.path.dirname(os.path.abspath(path))))
    renderer.setImageHandler(images)
    geometry = render.GeometryHandler.create()
    geometry.addLoader(render.TinyObjLoader.create())
    assert geometry.loadGeometry(mx.FilePath(shape), False)
    renderer.setGeometryHandler(geometry)
    lights = render.LightHandler.create()
    black = render.createUniformImage(2, 2, 3, render.BaseType.FLOAT, mx.Color4(0, 0, 0, 1))
    lights.setEnvRadianceMap(black)
    lights.setEnvIrradianceMap(black)
    lights.registerLights(document, [document.getNode("lamp")], context)
    lights.setLightSources([document.getNode("lamp")])
    lights.setIndirectLighting(False)
    renderer.setLightHandler(lights)
    near, far = 1, 10
    half = near * math.tan(math.radians(scene["fov"]) / 2)
    camera = render.Camera.create()
    camera.setWorldMatrix(mx.Matrix44.IDENTITY)
    camera.setViewMatrix(
        render.Camera.createViewMatrix(
            mx.Vector3(*scene["camera"]), mx.Vector3(0, 0, 0), mx.Vector3(0, 1, 0)
        )
    )
    camera.setProjectionMatrix(
        render.Camera.createPerspectiveMatrix(-half, half, -half, half, near, far)
    )
    renderer.setCamera(camera)
    (material,) = document.getMaterialNodes()
    renderer.createProgram(generator.generate("material", material, context))
    renderer.validateInputs()
    renderer.render()
    picture = renderer.captureImage(None)
    pixels = np.array(
        [[tuple(picture.getTexelColor(x, y))[:3] for x in range(size)] for y in range(size)]
    )[
        ::-1
    ]  # row 0 of the picture is at the bottom
    pixels = pixels.reshape(size // FINER, FINER, size // FINER, FINER, 3).mean((1, 3))
    np.save(out, pixels)


if __name__ == "__main__":
    if sys.argv[1] == "validate":
        sys.exit(not all([validate(path) for path in sys.argv[2:]]))
    draw(*sys.argv[2:])
