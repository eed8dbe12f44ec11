#!/usr/bin/env python3
"""Files of measured BRDFs, read and evaluated apart from processing/formats/brdf, to check that with.

  brdf_peer.py evaluate rgl|spectra|merl|utia FILE PAIRS VALUES   f_r of pairs of directions
  brdf_peer.py nodes FILE PAIRS              pairs of light and view that are nodes of a .bsdf
  brdf_peer.py utia FILE                     writes an UTIA .bin of numbers that utia_number() gives

PAIRS: f64, light x y z, view x y z, of each pair; VALUES: f64, R G B (of spectra: all wavelengths) of
each. Written from the descriptions of the formats (Dupuy & Jakob 2018, Matusik et al. 2003, Filip &
Vávra 2014) with the standard library alone, and with another shape than the C code: densities are
integrated as numbers of double precision, inverted by bisection, and directions turned by angles.
"""
import math
import struct
import sys

SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 8, 8: 8, 9: 2, 10: 4, 11: 8}


def read_tensors(path):
    with open(path, "rb") as file:
        data = file.read()
    assert data[:12] == b"tensor_file\0" and data[12:14] == b"\x01\x00"
    (count,) = struct.unpack_from("<I", data, 14)
    at, fields = 18, {}
    for _ in range(count):
        (length,) = struct.unpack_from("<H", data, at)
        name = data[at + 2 : at + 2 + length].decode()
        at += 2 + length
        rank, kind, offset = struct.unpack_from("<HBQ", data, at)
        shape = struct.unpack_from(f"<{rank}Q", data, at + 11)
        at += 11 + 8 * rank
        n = math.prod(shape)
        assert offset % 8 == 0 and offset + n * SIZES[kind] <= len(data)
        fields[name] = (
            shape,
            struct.unpack_from("<%d%s" % (n, {1: "B", 10: "f"}[kind]), data, offset),
        )
    return fields


class Density:
    """One slice of vndf, integrated exactly: p is bilinear in each cell."""

    def __init__(self, values, width, height):
        self.v, self.w, self.h = values, width, height
        self.rows = [self.row(j, width - 1) for j in range(height)]
        self.sums = [0.0]
        for j in range(height - 1):
            self.sums.append(self.sums[-1] + (self.rows[j] + self.rows[j + 1]) / 2)
        self.total = self.sums[-1]

    def row(self, y, until):
        """Integral of p(x, y) over x from 0 to until (in cells)."""
        j = min(int(y), self.h - 2)
        f, i = y - j, min(int(until), self.w - 2)
        k, t = j * self.w, until - i
        p = [
            (1 - f) * a + f * b
            for a, b in zip(self.v[k : k + i + 2], self.v[k + self.w : k + self.w + i + 2])
        ]
        return sum(p[: i + 1]) - (p[0] + p[i]) / 2 + t * (p[i] + t * (p[i + 1] - p[i]) / 2)

    def below(self, y):
        """Integral over all x, and over y from 0: rows are linear in y within a cell."""
        j = min(int(y), self.h - 2)
        t = y - j
        return self.sums[j] + t * (self.rows[j] + t * (self.rows[j + 1] - self.rows[j]) / 2)

    def uniform(self, u, v):
        x, y = u * (self.w - 1), v * (self.h - 1)
        return self.row(y, x) / self.row(y, self.w - 1), self.below(y) / self.total

    def place(self, s, t):
        """The opposite of uniform(), by bisection."""
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            if self.below(middle * (self.h - 1)) / self.total < t:
                low = middle
            else:
                high = middle
        v = (low + high) / 2
        y = v * (self.h - 1)
        end, low, high = self.row(y, self.w - 1), 0.0, 1.0
        for _ in range(60):
            middle = (low + high) / 2
            if self.row(y, middle * (self.w - 1)) / end < s:
                low = middle
            else:
                high = middle
        return (low + high) / 2, v


def bilinear(v, width, height, x, y, first=0):
    x, y = x * (width - 1), y * (height - 1)
    i, j = min(int(x), width - 2), min(int(y), height - 2)
    a, b = x - i, y - j
    k = first + j * width + i
    return (1 - b) * ((1 - a) * v[k] + a * v[k + 1]) + b * (
        (1 - a) * v[k + width] + a * v[k + width + 1]
    )


def unit(a):
    length = math.sqrt(sum(x * x for x in a))
    return [x / length for x in a]


def angles(a):
    return math.atan2(math.hypot(a[0], a[1]), a[2]), math.atan2(a[1], a[0])


def place(nodes, x):
    if len(nodes) == 1:
        return 0, 0.0
    i = 0
    while i < len(nodes) - 2 and nodes[i + 1] <= x:
        i += 1
    return i, min(max((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0), 1.0)


class Rgl:
    def __init__(self, path, field):
        self.f = read_tensors(path)
        self.phi, self.theta = self.f["phi_i"][1], self.f["theta_i"][1]
        self.isotropic = len(self.phi) <= 2
        self.channels = self.f[field][0][2]
        self.side = self.f[field][0][3]
        self.values = self.f[field][1]
        assert self.f["jacobian"][1] == (1,)
        self.densities = {}

    def density(self, slices):
        """The weighted sum of slices, each with integral 1."""
        key = tuple(slices)
        if key not in self.densities:
            height, width = self.f["vndf"][0][2:]
            n = width * height
            mixed = [0.0] * n
            for k, weight in slices:
                one = Density(self.f["vndf"][1][k * n : (k + 1) * n], width, height)
                for i in range(n):
                    mixed[i] += weight * one.v[i] / one.total
            self.densities = {key: Density(mixed, width, height)}
        return self.densities[key]

    def slices(self, theta, phi):
        i, a = place(self.phi, phi)
        j, b = place(self.theta, theta)
        n = len(self.theta)
        return [
            (k, w)
            for k, w in (
                (i * n + j, (1 - a) * (1 - b)),
                (i * n + j + 1, (1 - a) * b),
                ((i + 1) * n + j, a * (1 - b)),
                ((i + 1) * n + j + 1, a * b),
            )
            if w > 0
        ]

    def table(self, name, u, v):
        (height, width), values = self.f[name]
        return bilinear(values, width, height, u, v)

    def evaluate(self, light, view):
        theta, phi = angles(view)  # the file's direction of incidence
        theta_m, phi_m = angles(unit([a + b for a, b in zip(light, view)]))
        u = math.sqrt(theta_m * 2 / math.pi)
        v = ((phi_m - (phi if self.isotropic else 0) + math.pi) / (2 * math.pi)) % 1.0
        slices = self.slices(theta, phi)
        x, y = self.density(slices).uniform(u, v)
        factor = self.table("ndf", u, v) / (
            4 * self.table("sigma", math.sqrt(theta * 2 / math.pi), (phi + math.pi) / (2 * math.pi))
        )
        factor /= light[2]  # the file has f_r cos θ
        n = self.side * self.side
        return [
            factor
            * sum(
                w * bilinear(self.values, self.side, self.side, x, y, (k * self.channels + c) * n)
                for k, w in slices
            )
            for c in range(self.channels)
        ]

    def nodes(self):
        """Some of them, whose light lies well above the surface."""
        for p in range(0, len(self.phi), 5):
            for t in range(1, len(self.theta), 4):
                density = self.density([(p * len(self.theta) + t, 1.0)])
                view = [
                    math.sin(self.theta[t]) * math.cos(self.phi[p]),
                    math.sin(self.theta[t]) * math.sin(self.phi[p]),
                    math.cos(self.theta[t]),
                ]
                for i in range(3, self.side, 7):
                    for j in range(2, self.side, 9):
                        u, v = density.place(i / (self.side - 1), j / (self.side - 1))
                        theta_m = u * u * math.pi / 2
                        phi_m = (2 * v - 1) * math.pi + (self.phi[p] if self.isotropic else 0)
                        m = [
                            math.sin(theta_m) * math.cos(phi_m),
                            math.sin(theta_m) * math.sin(phi_m),
                            math.cos(theta_m),
                        ]
                        twice = 2 * sum(a * b for a, b in zip(view, m))
                        light = [twice * a - b for a, b in zip(m, view)]
                        if light[2] > 0.05:
                            yield light + view


class Merl:
    SCALES = (1 / 1500, 1.15 / 1500, 1.66 / 1500)

    def __init__(self, path):
        self.file = open(path, "rb")
        assert struct.unpack("<3i", self.file.read(12)) == (90, 90, 180)

    def evaluate(self, light, view):
        theta_h, phi_h = angles([a + b for a, b in zip(light, view)])
        theta, phi = angles(light)
        # l turned by −φ_h about z keeps θ; then by −θ_h about y.
        x, y = math.sin(theta) * math.cos(phi - phi_h), math.sin(theta) * math.sin(phi - phi_h)
        z = math.cos(theta)
        d = [
            math.cos(theta_h) * x - math.sin(theta_h) * z,
            y,
            math.sin(theta_h) * x + math.cos(theta_h) * z,
        ]
        theta_d, phi_d = angles(d)
        if phi_d < 0:
            phi_d += math.pi
        i = min(int(math.sqrt(math.degrees(theta_h) * 90)), 89)
        j = min(int(math.degrees(theta_d)), 89)
        k = min(int(math.degrees(phi_d)), 179)
        out = []
        for c, scale in enumerate(self.SCALES):
            self.file.seek(12 + 8 * (((c * 90 + i) * 90 + j) * 180 + k))
            out.append(struct.unpack("<d", self.file.read(8))[0] * scale)
        return [0.0] * 3 if min(out) < 0 else out


def utia_number(colour, light, view):
    """Any numbers, but those of θ = 0 do not depend on φ."""
    light, view = max(light, 47), max(view, 47)
    return ((light * 37 + view * 11 + colour * 101) % 509) / 254 + 0.1 * colour


class Utia:
    def __init__(self, path):
        with open(path, "rb") as file:
            self.v = struct.unpack("<%dd" % (3 * 288 * 288), file.read())

    @staticmethod
    def around(direction):
        theta, phi = (math.degrees(a) for a in angles(direction))
        theta, phi = min(theta, 75.0) / 15, (phi % 360) / 7.5
        i, j = min(int(theta), 4), int(phi)
        return [
            (
                (i + a) * 48 + (j + b) % 48,
                (theta - i if a else 1 - theta + i) * (phi - j if b else 1 - phi + j),
            )
            for a in (0, 1)
            for b in (0, 1)
        ]

    def evaluate(self, light, view):
        return [
            sum(
                wl * wv * self.v[(c * 288 + l) * 288 + v]
                for l, wl in self.around(light)
                for v, wv in self.around(view)
            )
            for c in range(3)
        ]


def main(what, *rest):
    if what == "evaluate":
        kind, path, pairs, values = rest
        brdf = (
            {"merl": Merl, "utia": Utia}[kind](path)
            if kind in ("merl", "utia")
            else Rgl(path, "rgb" if kind == "rgl" else "spectra")
        )
        with open(pairs, "rb") as file:
            numbers = file.read()
        with open(values, "wb") as file:
            for pair in struct.iter_unpack("<6d", numbers):
                result = brdf.evaluate(list(pair[:3]), list(pair[3:]))
                file.write(struct.pack("<%dd" % len(result), *result))
    elif what == "nodes":
        with open(rest[1], "wb") as file:
            for pair in Rgl(rest[0], "rgb").nodes():
                file.write(struct.pack("<6d", *pair))
    elif what == "utia":
        with open(rest[0], "wb") as file:
            for c in range(3):
                for light in range(288):
                    file.write(
                        struct.pack("<288d", *(utia_number(c, light, view) for view in range(288)))
                    )


if __name__ == "__main__":
    main(*sys.argv[1:])
