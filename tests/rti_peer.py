#!/usr/bin/env python3
"""RTI files, read and written apart from processing/formats/rti, with the standard library alone.

  rti_peer.py evaluate ptm|relight FILE LIGHTS VALUES    values of all texels of a file under lights
  rti_peer.py ptm VERSION FORMAT FILE LIGHTS VALUES      writes a small PTM and what is in it
  rti_peer.py hsh TERMS FILE LIGHTS VALUES               the same with a .rti of harmonics

LIGHTS: f64, x y z of each; VALUES: f64, R G B of each texel, row by row from the top, light by light.
"""
import json
import math
import os
import struct
import sys
import zlib

W, H = 5, 3


def number(*keys):
    return sum(k * f for k, f in zip(keys, (41, 67, 97, 13))) % 256


def read_ptm(path):
    with open(path, "rb") as file:
        assert file.readline() == b"PTM_1.2\n"
        rgb = {b"PTM_FORMAT_RGB\n": True, b"PTM_FORMAT_LRGB\n": False}[file.readline()]
        width, height = int(file.readline()), int(file.readline())
        scale = [float(x) for x in file.readline().split()]
        bias = [int(x) for x in file.readline().split()]
        data = file.read()
    assert len(scale) == len(bias) == 6 and len(data) == width * height * (18 if rgb else 9)
    assert min(bias) >= 0 and max(bias) <= 255

    def texel(x, y, light):
        u, v, _ = light
        basis = (u * u, v * v, u * v, u, v, 1)
        at = (height - 1 - y) * width + x

        def total(first):
            return sum((data[first + j] - bias[j]) * scale[j] * basis[j] for j in range(6)) / 255

        if rgb:
            return [total(6 * (c * width * height + at)) for c in range(3)]
        colour = data[6 * width * height + 3 * at :][:3]
        return [total(6 * at) * c / 255 for c in colour]

    return width, height, texel


def read_png(path):
    """8 bits, RGB, not interlaced."""
    with open(path, "rb") as file:
        data = file.read()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, packed = 8, b""
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colour = struct.unpack_from(">IIBB", body)
            assert depth == 8 and colour == 2 and body[12] == 0
        packed += body if kind == b"IDAT" else b""
        at += 12 + length
    raw, rows, before = zlib.decompress(packed), [], bytes(3 * width)
    for y in range(height):
        kind, row = raw[y * (3 * width + 1)], bytearray(raw[y * (3 * width + 1) + 1 :][: 3 * width])
        for i in range(3 * width):
            a, b = row[i - 3] if i > 2 else 0, before[i]
            c = before[i - 3] if i > 2 else 0
            p = a + b - c
            paeth = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            row[i] = (row[i] + (0, a, b, (a + b) // 2, paeth)[kind]) % 256
        rows.append(bytes(row))
        before = row
    return width, height, rows


def read_relight(folder):
    with open(os.path.join(folder, "info.json"), encoding="utf-8") as file:
        info = json.load(file)
    assert info["type"] == "ptm" and info["format"] == "png"
    n = info["nplanes"]
    scale, bias = info["materials"][0]["scale"], info["materials"][0]["bias"]
    assert len(scale) == len(bias) == n and len(info["lights"]) % 3 == 0
    planes = [read_png(os.path.join(folder, "plane_%d.png" % k)) for k in range(n // 3)]
    assert all(p[:2] == (info["width"], info["height"]) for p in planes)

    def texel(x, y, light):
        u, v, _ = light
        basis = (1, u, v, u * u, u * v, v * v)
        c = [(planes[k // 3][2][y][3 * x + k % 3] / 255 - bias[k]) * scale[k] for k in range(n)]
        if info["colorspace"] == "rgb":
            return [sum(c[3 * j + k] * basis[j] for j in range(6)) for k in range(3)]
        lit = sum(c[3 + j] * basis[j] for j in range(6))
        return [c[k] * lit for k in range(3)]

    return info["width"], info["height"], texel


def write_ptm(version, form, path):
    scale, bias = [1.5, 0.75, 0.5, 1.25, 2.0, 1.0], [100, 120, 140, 90, 128, 10]
    out = "%s\n%s\n%d %d\n%s \n%s \n" % (
        version,
        form,
        W,
        H,
        " ".join(map(str, scale)),
        " ".join(map(str, bias)),
    )
    cells = [(x, y) for y in reversed(range(H)) for x in range(W)]
    body = b""
    if form == "PTM_FORMAT_RGB":
        for c in range(3):
            body += bytes(number(x, y, j, c) for x, y in cells for j in range(6))
    else:
        colours = [bytes(number(x, y, 9, c) for c in range(3)) for x, y in cells]
        sums = [bytes(number(x, y, j, 0) for j in range(6)) for x, y in cells]
        body = (
            b"".join(sums) + b"".join(colours)
            if version == "PTM_1.2"
            else b"".join(s + c for s, c in zip(sums, colours))
        )
    with open(path, "wb") as file:
        file.write(out.encode() + body)

    def texel(x, y, light):
        u, v, _ = light
        basis = (u * u, v * v, u * v, u, v, 1)

        def total(c):
            return sum((number(x, y, j, c) - bias[j]) * scale[j] * basis[j] for j in range(6)) / 255

        if form == "PTM_FORMAT_RGB":
            return [total(c) for c in range(3)]
        return [total(0) * number(x, y, 9, c) / 255 for c in range(3)]

    return W, H, texel


def harmonics(light, n):
    """Gautron et al. 2004 in the order of RTIViewer, from angles."""
    theta, phi = math.acos(max(light[2], math.sin(0.15))), math.atan2(light[1], light[0])
    c = math.cos(theta)
    s = math.sqrt(c - c * c)
    return [
        1 / math.sqrt(2 * math.pi),
        math.sqrt(6 / math.pi) * math.cos(phi) * s,
        math.sqrt(3 / (2 * math.pi)) * (2 * c - 1),
        math.sqrt(6 / math.pi) * s * math.sin(phi),
        math.sqrt(30 / math.pi) * math.cos(2 * phi) * (c * c - c),
        math.sqrt(30 / math.pi) * math.cos(phi) * (2 * c - 1) * s,
        math.sqrt(5 / (2 * math.pi)) * (1 - 6 * c + 6 * c * c),
        math.sqrt(30 / math.pi) * (2 * c - 1) * s * math.sin(phi),
        math.sqrt(30 / math.pi) * (c * c - c) * math.sin(2 * phi),
    ][:n]


def write_hsh(terms, path):
    scale = [struct.unpack("f", struct.pack("f", 1.1 + 0.1 * j))[0] for j in range(terms)]
    bias = [struct.unpack("f", struct.pack("f", 0.5 - 0.2 * j))[0] for j in range(terms)]
    with open(path, "wb") as file:
        file.write(b"#HSH1.2\n# a comment\n3\n%d %d 3\n%d 2 1\n" % (W, H, terms))
        file.write(struct.pack("<%df" % terms, *scale) + struct.pack("<%df" % terms, *bias))
        for y in range(H):
            for x in range(W):
                file.write(bytes(number(x, y, j, c) for c in range(3) for j in range(terms)))

    def texel(x, y, light):
        basis = harmonics(light, terms)
        return [
            sum((number(x, y, j, c) / 255 * scale[j] + bias[j]) * basis[j] for j in range(terms))
            for c in range(3)
        ]

    return W, H, texel


def values(picture, lights, path):
    width, height, texel = picture
    with open(lights, "rb") as file:
        directions = list(struct.iter_unpack("<3d", file.read()))
    with open(path, "wb") as file:
        for light in directions:
            for y in range(height):
                for x in range(width):
                    file.write(struct.pack("<3d", *texel(x, y, light)))


def main(what, *rest):
    if what == "evaluate":
        values((read_ptm if rest[0] == "ptm" else read_relight)(rest[1]), rest[2], rest[3])
    elif what == "ptm":
        values(write_ptm(*rest[:3]), rest[3], rest[4])
    elif what == "hsh":
        values(write_hsh(int(rest[0]), rest[1]), rest[2], rest[3])


main(*sys.argv[1:])
