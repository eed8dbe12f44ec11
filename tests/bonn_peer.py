#!/usr/bin/env python3
"""Bonn's .btf files, written and read apart from processing/formats/bonn*.c, to check that with.

  bonn_peer.py write KIND FILE VALUES   a small BTF of KIND, and what is in it
  bonn_peer.py read FILE VALUES         what is in a file

VALUES: f32, view by view, of each light by light, of each texel by texel, R G B. Only the standard
library, and nothing but loops: what is hardly worth reading twice can hardly be wrong twice.
"""
import math
import struct
import sys

W, H, NV, NL = 5, 3, 3, 4
VIEWS = [(0.0, 0.0), (0.5, 1.0), (1.0, 4.0)]
LIGHTS = [(0.1, 0.0), (0.4, 2.0), (0.8, 3.0), (1.2, 6.0)]


def value(t, v, l, c):
    """A number that a half holds exactly."""
    return ((t * 31 + v * 17 + l * 7 + c * 3) % 251) / 64


def is_hole(t):
    return t in (2, 7, 8)


def metadata(names, version=4):
    text = [b"a set-up".ljust(80, b"\0"), b"a sensor".ljust(80, b"\0"), b"a lamp".ljust(80, b"\0")]
    body = struct.pack("<I", version) + b"".join(text)
    body += struct.pack("<4f", 2.5, 1.0, 2.0, 3.0)
    if version > 1:
        body += struct.pack("<I", 1)
    if version > 2:
        xml = b"<measured/>"
        body += struct.pack("<I", len(xml)) + xml
    if version > 3:
        body += struct.pack("<I", len(names))
        for name in names:
            body += struct.pack("<I", len(name)) + name.encode()
    return struct.pack("<I", len(body) + 4) + body


def sampling():
    out = struct.pack("<I", NV)
    for theta, phi in VIEWS:
        out += struct.pack("<2fI", theta, phi, NL)
        for light in LIGHTS:
            out += struct.pack("<2f", *light)
    return out + struct.pack("<2I", W, H)


def halves(numbers):
    return b"".join(struct.pack("<e", x) for x in numbers)


def write_bdi(signature, sparse):
    """Two lines a chunk; its channels in the order B, G, R."""
    order = [2, 1, 0]
    out = signature + metadata(["B", "G", "R"]) + sampling()
    out += struct.pack("<IB", 2, 2 if sparse else 0)
    out += bytes(0 if sparse and is_hole(t) else 1 for t in range(W * H))
    out += struct.pack("<I", 1) + struct.pack("<9f", 1, 0, 0, 0, 1, 0, 0, 0, 1)
    stored = [t for t in range(W * H) if not (sparse and is_hole(t))]
    for first in range(0, len(stored), 2 * W):
        chunk = b""
        for t in stored[first : first + 2 * W]:
            for v in range(NV):
                for l in range(NL):
                    chunk += halves(value(t, v, l, c) for c in order)
        out += struct.pack("<I", len(chunk)) + chunk
    values = []
    for v in range(NV):
        for l in range(NL):
            for t in range(W * H):
                for c in range(3):
                    values.append(0 if sparse and is_hole(t) else value(t, v, l, c))
    return out, values


def factor(rows, seed):
    return [[((r * 13 + k * 29 + seed) % 17 - 8) / 16 for k in range(2)] for r in range(rows)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def write_matrix(u, sv, scalar):
    code = {2: "e", 4: "f", 8: "d"}[scalar]
    out = struct.pack("<B3I", scalar, 2, len(u), len(sv))
    for row in [[2.0, 1.0]] + u + sv:
        out += b"".join(struct.pack("<" + code, x) for x in row)
    return out


def write_fmf(old, images, logarithm, scalar):
    out = (b"!FMF06FCR" if old else b"!FMF12FCER") + metadata(["R", "G", "B"], 3) + sampling()
    out += struct.pack("<I", 0)
    if not old:
        out += struct.pack("<BI", 2, 1 if logarithm else 0)
        out += struct.pack("<2I", 2, 3) + halves([0.5] * 6)
    out += struct.pack("<I", 2)
    directions, texels = NV * NL, W * H
    u = factor(3 * (texels if images else directions), 1)
    sv = factor(directions if images else texels, 5)
    out += write_matrix(u, sv, scalar)
    values = []
    for v in range(NV):
        for l in range(NL):
            for t in range(texels):
                for c in range(3):
                    d = v * NL + l
                    x = dot(u[t * 3 + c], sv[d]) if images else dot(u[d * 3 + c], sv[t])
                    values.append(math.exp(x) - 1e-5 if logarithm else x)
    return out, values


def colours(model, mean, m, p):
    eps = 1e-5
    yuv = lambda y, u, v: [y + 1.13983 * v, y - 0.39465 * u - 0.5806 * v, y + 2.03211 * u]
    sign = lambda x: (x > 0) - (x < 0)
    if model == 0:
        return p
    if model == 1:
        return yuv(*p)
    if model == 3:
        return [mean[j] + sum(p[i] * m[i][j] for i in range(3)) for j in range(3)]
    if model == 4:
        y, co, cg = p
        return [y + co - cg, y + cg, y - co - cg]
    if model == 9:
        return yuv(math.exp(p[0]) - eps, p[1], p[2])
    if model == 10:
        return yuv(
            math.exp(p[0]) - eps, *[sign(x) * math.exp(abs(x) + math.log(eps)) for x in p[1:]]
        )
    if model == 11:
        y = math.exp(p[0]) - eps
        return yuv(y, p[1] * (y + eps), p[2] * (y + eps))
    return [math.exp(x) - eps for x in p]


def write_dfmf(model, images):
    mean, m = [0.5, 0.25, 0.125], [[1, 2, 0.5], [0, 1, 0.25], [3, 0, 1]]
    out = b"!DFMF08FCR" + metadata(["R", "G", "B"]) + sampling() + struct.pack("<I", 0)
    out += struct.pack("<Ii", 2, model) + struct.pack("<3f", *mean)
    out += b"".join(struct.pack("<3f", *row) for row in m)
    directions, texels = NV * NL, W * H
    factors = []
    for c in range(3):
        u = factor(texels if images else directions, c)
        sv = factor(directions if images else texels, 4 + c)
        out += write_matrix(u, sv, 2)
        factors.append((u, sv))
    values = []
    for v in range(NV):
        for l in range(NL):
            for t in range(texels):
                d = v * NL + l
                p = [dot(u[t], sv[d]) if images else dot(u[d], sv[t]) for u, sv in factors]
                values += colours(model, mean, m, p)
    return out, values


def write(kind, path, values_path):
    name, *flags = kind.split("-")
    if name == "bdi":
        out, values = write_bdi(
            b"!BDI06R2!" if "short" in flags else b"!BDIF06R2!", "sparse" in flags
        )
    elif name == "fmf":
        scalar = 4 if "float" in flags else 8 if "double" in flags else 2
        out, values = write_fmf("old" in flags, "images" in flags, "log" in flags, scalar)
    else:
        out, values = write_dfmf(int(flags[0]), "images" in flags)
    with open(path, "wb") as f:
        f.write(out)
    save(values, values_path)


def save(values, path):
    with open(path, "wb") as f:
        f.write(b"".join(struct.pack("<f", x) for x in values))


class Reader:
    def __init__(self, path):
        with open(path, "rb") as f:
            self.data = f.read()
        self.at = 0

    def take(self, code):
        got = struct.unpack_from("<" + code, self.data, self.at)
        self.at += struct.calcsize("<" + code)
        return got if len(got) > 1 else got[0]

    def rows(self, n, k):
        return [struct.unpack("<%de" % k, self.raw(2 * k)) for _ in range(n)]

    def raw(self, n):
        assert self.at + n <= len(self.data)
        self.at += n
        return self.data[self.at - n : self.at]


def read_header(r):
    begin = r.at
    size, version = r.take("2I")
    r.raw(240)
    r.take("4f")
    assert version == 4 and r.take("I") == 1
    r.raw(r.take("I"))
    assert [r.raw(r.take("I")) for _ in range(r.take("I"))] == [b"R", b"G", b"B"]
    assert r.at - begin == size
    n_views = r.take("I")
    for _ in range(n_views):
        r.take("2f")
        n_lights = r.take("I")
        for _ in range(n_lights):
            r.take("2f")
    return (n_views, n_lights) + r.take("2I")


def read_bdi(r):
    nv, nl, w, h = read_header(r)
    lines, compression = r.take("IB")
    mask = r.raw(w * h)
    assert r.take("I") == 0
    stored = [t for t in range(w * h) if compression == 0 or mask[t]]
    abrdf = {}
    for first in range(0, len(stored), lines * w):
        some = stored[first : first + lines * w]
        assert r.take("I") == len(some) * nv * nl * 6
        for t in some:
            abrdf[t] = struct.unpack("<%de" % (nv * nl * 3), r.raw(nv * nl * 6))
    zero = [0] * (nv * nl * 3)
    return [
        abrdf.get(t, zero)[(v * nl + l) * 3 + c]
        for v in range(nv)
        for l in range(nl)
        for t in range(w * h)
        for c in range(3)
    ]


def read_factors(r):
    scalar, k, rows, columns = r.take("B3I")
    assert scalar == 2
    r.rows(1, k)
    return r.rows(rows, k), r.rows(columns, k)


def read(path, values_path):
    r = Reader(path)
    signature = r.raw(10)
    if signature == b"!BDIF06R2!":
        values = read_bdi(r)
    elif signature == b"!FMF12FCER":
        nv, nl, w, h = read_header(r)
        assert r.take("I") == 0 and r.take("B") == 2 and r.take("3I") == (0, 0, 0)
        r.take("I")
        u, sv = read_factors(r)
        values = [
            dot(u[(v * nl + l) * 3 + c], sv[t])
            for v in range(nv)
            for l in range(nl)
            for t in range(w * h)
            for c in range(3)
        ]
    else:
        assert signature == b"!DFMF08FCR"
        nv, nl, w, h = read_header(r)
        assert r.take("I") == 0
        r.take("I")
        assert r.take("I") == 0
        r.take("12f")
        m = [read_factors(r) for _ in range(3)]
        values = [
            dot(m[c][0][v * nl + l], m[c][1][t])
            for v in range(nv)
            for l in range(nl)
            for t in range(w * h)
            for c in range(3)
        ]
    assert r.at == len(r.data)
    save(values, values_path)


if sys.argv[1] == "write":
    write(*sys.argv[2:])
else:
    read(*sys.argv[2:])
