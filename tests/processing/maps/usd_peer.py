#!/usr/bin/env python3
"""Reads a scene of “mesorig export usd” apart from processing/maps, and prints what it found wrong.

usage: usd_peer.py FILE.usda

Checks that every connection leads to an output of a shader, that every file that is named exists, that
meshes are complete and face outwards, and that texture coordinates go up where the maps do. Prints the
numbers of meshes, shaders and connections. Written with the standard library alone.
"""
import math
import os
import re
import sys

TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|@[^@]*@|<[^>]*>|[\[\](){}=,]|[^\s\[\](){}=,"@<]+')
path = sys.argv[1]
with open(path, encoding="utf-8") as file:
    header = file.readline()
    tokens = TOKEN.findall(file.read())
assert header == "#usda 1.0\n"
at = 0


def take(expected=None):
    global at
    at += 1
    assert expected in (None, tokens[at - 1]), (expected, tokens[at - 1])
    return tokens[at - 1]


def value():
    """A number, a text, a path, or a list of them."""
    ends = {"[": "]", "(": ")"}
    token = take()
    if token in ends:
        items = []
        while tokens[at] != ends[token]:
            items.append(value())
            if tokens[at] == ",":
                take()
        take()
        return items
    try:
        return float(token)
    except ValueError:
        return token.strip('"')


def block(end):
    """Attributes by name, and prims in braces."""
    attributes, prims = {}, {}
    while tokens[at] != end:
        words = []
        while tokens[at] not in ("=", "{", "(", end):
            words.append(take())
            if words[0] == "def" and len(words) == 3:
                break
            if tokens[at - 1].endswith((":out", ":rgb", ":r", ":result", ":surface")):
                break  # an output without a value
        if words[0] == "def":
            extra = {}
            if tokens[at] == "(":
                take()
                extra = block(")")[0]
                take()
            take("{")
            prims[words[2].strip('"')] = (words[1], extra, *block("}"))
            take()
            continue
        name = words[-1]
        found = None
        if tokens[at] == "=":
            take()
            if tokens[at] == "{":
                take()
                found = block("}")[0]
                take()
            else:
                found = value()
        if tokens[at] == "(":
            take()
            block(")")
            take()
        attributes[name] = (words[:-1], found)
    return attributes, prims


def all_prims(prims, above):
    for name, prim in prims.items():
        yield f"{above}/{name}", prim
        yield from all_prims(prim[3], f"{above}/{name}")


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def check_mesh(name, attributes):
    points, normals = attributes["points"][1], attributes["normals"][1]
    st, indices = attributes["primvars:st"][1], [int(i) for i in attributes["faceVertexIndices"][1]]
    counts = attributes["faceVertexCounts"][1]
    assert len(points) == len(normals) == len(st), name
    assert counts == [3.0] * (len(indices) // 3) and max(indices) == len(points) - 1, name
    low, high = attributes["extent"][1]
    for k in range(3):
        assert low[k] == min(p[k] for p in points) and high[k] == max(p[k] for p in points), name
    for n in normals:
        assert abs(math.hypot(*n) - 1) < 1e-5, name
    for i in range(0, len(indices), 3):
        a, b, c = (indices[i + k] for k in range(3))
        u = [q - p for p, q in zip(points[a], points[b])]
        v = [q - p for p, q in zip(points[a], points[c])]
        middle = [x + y + z for x, y, z in zip(normals[a], normals[b], normals[c])]
        assert dot(cross(u, v), middle) > 0, (name, "faces inwards", i)
        # The tangent along s and the bitangent along t are right-handed with the normal.
        s1, t1 = (q - p for p, q in zip(st[a], st[b]))
        s2, t2 = (q - p for p, q in zip(st[a], st[c]))
        assert s1 * t2 - s2 * t1 > 0, (name, "mirrored", i)


stage, roots = {}, {}
take("(")
stage = block(")")[0]
take()
tokens.append("end")
roots = block("end")[1]
assert stage["upAxis"][1] == "Y" and stage["metersPerUnit"][1] == 1
assert stage["defaultPrim"][1] in roots
prims = dict(all_prims(roots, ""))
outputs, connections, meshes = {}, [], 0
for name, (kind, extra, attributes, _) in prims.items():
    for key, (words, found) in attributes.items():
        if kind == "Shader" and key.startswith("outputs:"):
            outputs[f"<{name}.{key}>"] = words[-1]
        if key.endswith(".connect"):
            connections.append((name, key, words[-1], found))
        if isinstance(found, str) and found.startswith("@"):
            texture = os.path.join(os.path.dirname(path), found.strip("@"))
            assert os.path.isfile(texture), texture
    if kind == "Mesh":
        meshes += 1
        assert prims[attributes["material:binding"][1].strip("<>")][0] == "Material"
        check_mesh(name, attributes)
# Types that USD lets connect, as the same number of floats or as a token.
SAME = {"float3": 3, "color3f": 3, "normal3f": 3, "float2": 2, "float": 1, "token": "token"}
for name, key, kind, target in connections:
    assert target in outputs, (name, key, target)
    assert SAME[kind] == SAME[outputs[target]], (name, key)
used = {target for *_, target in connections}
assert set(outputs) == used, ("unused", set(outputs) - used)
material = next(prim for prim in prims.values() if prim[0] == "Material")
for key in ("outputs:surface.connect", "outputs:mtlx:surface.connect"):
    assert key in material[2]
print(meshes, len(outputs), len(connections), material[1]["customData"][1]["depth_mm"][1])
