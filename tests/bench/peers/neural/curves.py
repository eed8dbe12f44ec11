#!/usr/bin/env python3
"""Error over bytes a texel of all ways to draw a BTF from less memory, at directions that were left out.

    tests/bench/capture_materials BUILD DIR paper_brick_part relief_weave_part …
    peers/neural/curves.py BUILD DIR paper_brick_part relief_weave_part …

measures the session DIR/NAME.session of each NAME: the local PCA as drawn and packed, eigen-maps, neural planes with
and without the MDF, and two peers in PyTorch, triple planes and NeuMIP. Errors are those at the pairs of a view and a
light that mesorig compare leaves out (seed 1). --between takes the pictures of DIR/NAME_quiet_between.session
instead, and leaves nothing out. Each point is stored in DIR/NAME.curves as soon as it is measured, and a command that
was interrupted continues where it stopped. The points of all names are printed as tables and drawn into
DIR/curves.png. DIR/NAME.curves.png has pictures at three pairs of directions, and DIR/curves_pictures.png one of them
of each material.

All networks have the same number of samples for each texel. Makes a virtual environment in DIR/venv (environment.py).
Debian packages: python3-torch python3-scipy python3-openimageio python3-pil.
"""
import argparse
import ctypes
import fcntl
import json
import os
import subprocess
import time

import environment


def parse():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("build")
    parser.add_argument("folder")
    parser.add_argument("names", nargs="+")
    parser.add_argument(
        "--samples", type=float, default=3000, help="samples of a training for each texel (3000)"
    )
    parser.add_argument(
        "--series", nargs="*", help="measure only these series; none: only draw and print"
    )
    parser.add_argument(
        "--between",
        action="store_true",
        help="take the truth from NAME_quiet_between.session, without noise",
    )
    parser.add_argument(
        "--bytes",
        type=float,
        nargs="+",
        default=[16.5, 33, 66],
        help="sizes of the peers, bytes a texel (16.5 33 66, NeuMIP only the first two)",
    )
    parser.add_argument(
        "--rate", type=float, help="learning rate of the peers (triple planes 0.04, NeuMIP 0.02)"
    )
    parser.add_argument("--batch", type=int, default=1024, help="batch of the peers (1024)")
    return parser.parse_args()


if __name__ == "__main__":
    OPTIONS = parse()
    environment.enter(OPTIONS.folder)

import numpy as np  # noqa: E402
import torch  # noqa: E402
from PIL import Image  # noqa: E402

import curves_figure  # noqa: E402
import curves_table  # noqa: E402
import local_pca  # noqa: E402
import planes  # noqa: E402
from material import Captured, mesorig  # noqa: E402
from measure import errors, shown  # noqa: E402

CLUSTERS = [(1, 4), (2, 4), (4, 4), (4, 8), (8, 8), (16, 8), (32, 8)]  # and components
PACKED = [20, 40, 160]  # bytes a texel
MAPS = [1, 2, 4, 8]
RATES = {"triple planes": 0.04, "NeuMIP": 0.02}  # the best of 0.01, 0.02 and 0.04 on brick
CHANNELS = {False: [4, 8, 12, 16], True: [4, 12, 16]}  # with the MDF, and without it
PICTURED = ["BTF", "LPCA, drawn", "triple planes", "NeuMIP", "neural, no MDF", "neural"]


class Truth:
    """Pictures at pairs of a view and a light.

    values          pairs × height × width × 3
    view, light     pairs × height × width × 3: unit vectors from each texel
    nominal_view, nominal_light   pairs × 3: the directions of the session
    """

    def __init__(self, captured, pairs):
        views, lights = [v for v, _ in pairs], [k for _, k in pairs]
        self.values = np.stack([captured.values[:, :, v, k] for v, k in pairs])
        self.view = np.stack([captured.to_view[:, :, v] for v in views])
        self.light = np.stack([captured.to_light[:, :, k] for k in lights])
        self.nominal_view = captured.view_vectors[views]
        self.nominal_light = captured.light_vectors[lights]


class Subject:
    """A material, the pictures to compare with, and the points measured so far."""

    def __init__(self, options, name):
        self.options, self.name = options, name
        self.build = os.path.abspath(options.build)
        self.session = os.path.join(options.folder, name + ".session")
        self.ending = ".between" if options.between else ".curves"
        self.folder = os.path.join(options.folder, name + self.ending)
        os.makedirs(self.folder, exist_ok=True)
        captured = self.captured = Captured(
            options.build, self.session, rays=0, whole=options.between
        )
        self.texels = captured.values.shape[0] * captured.values.shape[1]
        if options.between:
            path = os.path.join(options.folder, name + "_quiet_between.session")
            other = Captured(options.build, path, rays=0, whole=True)
            # Each view with every fourth light, from another light on.
            views, lights = len(other.kept_views), len(other.kept_lights)
            self.truth = Truth(
                other, [(v, k) for v in range(views) for k in range(v % 4, lights, 4)]
            )
        else:
            self.truth = Truth(
                captured, [(v, k) for v in captured.held_views for k in captured.held_lights]
            )
        self.seen = Truth(
            captured,
            [(v, k) for v in captured.kept_views[4::9] for k in captured.kept_lights[4::9]],
        )
        self.points = os.path.join(self.folder, "points.json")

    def read(self):
        if not os.path.exists(self.points):
            return []
        with open(self.points, "rb") as file:
            return json.load(file)

    def rest(self):
        """The session of the pictures that were not left out."""
        if self.options.between:
            return self.session
        return local_pca.rest_session(self.build, self.captured, self.folder)

    def has(self, series, label):
        return any((p["series"], p["label"]) == (series, label) for p in self.read())

    def add(self, series, label, bytes_per_texel, made, made_seen, **more):
        """Adds the pictures of a form to the points."""
        point = {"series": series, "label": label, "bytes_per_texel": bytes_per_texel}
        point |= errors(made, self.truth.values) | more
        point["seen"] = errors(made_seen, self.seen.values)["error"]
        np.save(os.path.join(self.folder, "%s %s.npy" % (series, label)), made[self.shots()])
        with open(self.points + ".lock", "w", encoding="utf-8") as lock:
            fcntl.flock(
                lock, fcntl.LOCK_EX
            )  # several programs may measure other series of the material
            points = [p for p in self.read() if (p["series"], p["label"]) != (series, label)] + [
                point
            ]
            with open(self.points + ".part", "w", encoding="utf-8") as file:
                json.dump(points, file, indent=1)
            os.rename(self.points + ".part", self.points)
        print("| %s | %s | %.1f |" % (series, label, bytes_per_texel), end="")
        print(" %.2f %% | %.2f %% |" % (100 * point["error"], 100 * point["seen"]), end="")
        print(" %(psnr_db).2f dB | %(flip).4f |" % point, flush=True)

    def shots(self):
        """Three pairs with different views and lights."""
        n = len(self.truth.values)
        side = int(np.sqrt(n))
        return [0, 2 * (side + 1), 4 * (side + 1)] if side ** 2 == n else [n // 12, n // 2, n - 2]

    def run(self, program, *arguments):
        """Runs a program of the build. Returns what it prints, and its CPU seconds."""
        before = os.times()
        command = [os.path.join(self.build, program), *arguments]
        text = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
        after = os.times()
        spent = after.children_user + after.children_system
        return text, spent - before.children_user - before.children_system


def evaluate(subject, path, truth, nominal):
    """Pictures of a file of this project. nominal: under the directions of the session, not of each texel."""
    library = os.path.join(subject.build, "processing", "libmesorig-material.so.0")
    ctypes.CDLL(library, ctypes.RTLD_GLOBAL)  # found by its name when mesorig loads it
    with mesorig.Material(path) as material:
        if not nominal:
            return material.evaluate(material.texel_uv(), truth.view, truth.light)
        view, light = truth.nominal_view[:, None, None], truth.nominal_light[:, None, None]
        return material.evaluate(material.texel_uv(), view, light)


def add_file(subject, series, label, path, size, nominal=True, **more):
    made = [evaluate(subject, path, truth, nominal) for truth in (subject.truth, subject.seen)]
    subject.add(series, label, size, *made, **more)


def measure_btf(subject):
    if not subject.has("BTF", ""):
        captured = subject.captured
        size = 6 * len(captured.kept_views) * len(captured.kept_lights)
        add_file(subject, "BTF", "", subject.rest(), size)


def compressed(subject, series, label, options, size_key):
    """Adds what mesorig compress makes of the rest with these options."""
    if subject.has(series, label):
        return
    path = os.path.join(subject.folder, "compressed.exr")
    command = ["compress", subject.rest(), *options, "-o", path, "--json", "--force"]
    try:
        text, spent = subject.run("bin/mesorig", *command)
    except subprocess.CalledProcessError:
        print("%s %s is not possible" % (series, label))  # the program has said why
        return
    found = json.loads(text.splitlines()[-1])  # the lines before it tell what was tried
    add_file(subject, series, label, path, found[size_key] / subject.texels, cpu_s=spent)


def measure_drawn(subject):
    for clusters, components in CLUSTERS:
        options = ["-q", "8bit-weights", "-k", str(clusters), "--components", str(components)]
        compressed(subject, "LPCA, drawn", "%d of %d" % (clusters, components), options, "bytes")


def measure_packed(subject):
    for size in PACKED:
        options = ["-q", "packed", "--size", str(size * subject.texels)]
        compressed(subject, "LPCA, packed", str(size), options, "file_bytes")


def measure_maps(subject):
    for n in MAPS:
        options = ["-m", "eigenmaps", "--components", str(n)]
        compressed(subject, "eigen-maps", str(n), options, "bytes")


def measure_neural(subject, flat):
    series = "neural, no MDF" if flat else "neural"
    samples = "%.0f" % subject.options.samples
    for n in CHANNELS[flat] if samples == "3000" else [12]:
        label = "%d channels" % n + ("" if samples == "3000" else ", %s samples" % samples)
        if subject.has(series, label):
            continue
        path = os.path.join(subject.folder, "neural_%d_%s.exr" % (n, samples))
        if subject.options.between:
            path = os.path.join(subject.folder, "neural.exr")
            if flat or n != 12:
                continue
            options = ["-m", "neural", "--components", str(n), "--samples", samples, "-o", path]
            command = ["compress", subject.session, *options, "--json", "--force"]
            text, spent = subject.run("bin/mesorig", *command)
            size = json.loads(text.splitlines()[-1])["bytes"] / subject.texels
            add_file(subject, series, label, path, size, False, cpu_s=spent)
            continue
        command = ["--channels", str(n), "--samples", samples, "--write", subject.folder, "--json"]
        command += ["--flat"] if flat else []
        text, _ = subject.run("tests/bench/bench_neural", subject.session, *command)
        found = json.loads(text)["trainings"][0]
        more = {"cpu_s": found["cpu_s"], "compare": found}
        add_file(subject, series, label, path, found["bytes_per_texel"], False, **more)
        os.remove(path)


def drawn_by(model, captured, truth):
    """Pictures of a network."""

    def flat(values):
        return torch.from_numpy(np.ascontiguousarray(values, np.float32)).reshape(
            -1, values.shape[-1]
        )

    with torch.no_grad():
        made = [
            planes.decode(model({"flat": flat(captured.flat), "view": flat(v), "light": flat(k)}))
            for v, k in zip(truth.view, truth.light)
        ]
    return torch.stack(made).numpy().reshape(truth.values.shape)


def largest(make, texels, limit):
    """The model with most channels within this many bytes a texel, and the number of its channels."""
    channels = 1
    while True:
        surface, rest = planes.quantise(make(channels + 1))
        if surface + rest / texels > limit:
            return channels
        channels += 1


def measure_peer(subject, series, make, limits):
    torch.set_num_threads(1)
    side, pairs = subject.captured.values.shape[0], None
    for limit in limits:
        channels = largest(lambda n: make(side, n), subject.texels, limit)
        label = "%d channels" % channels
        options = subject.options
        rate = options.rate or RATES[series]
        if options.rate or (options.batch, options.samples) != (1024, 3000):
            label += ", rate %g, batch %d, %g samples" % (rate, options.batch, options.samples)
        if subject.has(series, label):
            continue
        pairs = pairs or planes.Pairs(subject.captured)
        torch.manual_seed(1)
        model, begin = make(side, channels), time.time()
        samples = int(options.samples * subject.texels)
        spent = planes.train(model, pairs, samples, batch=options.batch, rate=rate)
        surface, rest = planes.quantise(model)
        made = [drawn_by(model, subject.captured, t) for t in (subject.truth, subject.seen)]
        size = surface + rest / subject.texels
        subject.add(series, label, size, *made, cpu_s=spent, wall_s=time.time() - begin)


SERIES = {
    "BTF": measure_btf,
    "LPCA, drawn": measure_drawn,
    "LPCA, packed": measure_packed,
    "eigen-maps": measure_maps,
    "neural": lambda subject: measure_neural(subject, False),
    "neural, no MDF": lambda subject: measure_neural(subject, True),
    "triple planes": lambda s: measure_peer(
        s, "triple planes", planes.TriplePlanes, s.options.bytes
    ),
    "NeuMIP": lambda s: measure_peer(s, "NeuMIP", planes.NeuMip, s.options.bytes[:2]),
}


def sheet(rows, times):
    """Rows of pictures, with a white line below and to the right of each."""
    gap = [(0, 1), (0, 1), (0, 0)]
    rows = [
        np.concatenate([np.pad(shown(p), gap, constant_values=1) for p in row], 1) for row in rows
    ]
    pixels = np.rint(255 * np.concatenate(rows, 0)).astype(np.uint8)
    return Image.fromarray(np.kron(pixels, np.ones((times, times, 1), np.uint8)))


def chosen(folder, name, ending):
    """Of each series the best model of at most 33 bytes, or its smallest: the three pictures of its shots()."""
    points = curves_table.points_of(folder, name, ending)
    for series in SERIES:
        smallest = min(
            (p for p in points if p["series"] == series),
            key=lambda p: p["bytes_per_texel"],
            default=None,
        )
        point = curves_table.best(points, series) or smallest
        if point:
            yield series, np.load(os.path.join(folder, name + ending, point["path"]))


def picture(subject):
    """A column for the truth and for each form, a row for each of shots()."""
    truth = subject.truth.values[subject.shots()]
    np.save(os.path.join(subject.folder, "truth.npy"), truth)
    found = list(chosen(subject.options.folder, subject.name, subject.ending))
    columns = [truth] + [pictures for _, pictures in found]
    times = max(1, 128 // truth.shape[1])
    sheet(zip(*columns), times).save(subject.folder + ".png")
    labels = ", ".join(["truth"] + [series for series, _ in found])
    print("columns of %s.png: %s" % (subject.folder, labels))


def one_row_each(folder, names):
    """Writes folder/curves_pictures.png, with a row for each material: the last of its shots()."""
    rows = []
    for name in names:
        found = dict(chosen(folder, name, ".curves"))
        truth = np.load(os.path.join(folder, name + ".curves", "truth.npy"))
        blank = np.ones_like(truth[2])
        rows.append([truth[2]] + [found[s][2] if s in found else blank for s in PICTURED])
    path = os.path.join(folder, "curves_pictures.png")
    sheet(rows, 3).quantize(128).save(path, optimize=True)


def main():
    for name in OPTIONS.names if OPTIONS.series != [] else []:
        subject = Subject(OPTIONS, name)
        print("\n%s, %d texels, %d pictures" % (name, subject.texels, len(subject.truth.values)))
        print("\n| | | bytes/texel | error | seen | PSNR | FLIP |\n|---|---|---|---|---|---|---|")
        for series, measure in SERIES.items():
            if OPTIONS.series is None or series in OPTIONS.series:
                measure(subject)
        picture(subject)
    if not OPTIONS.between and not OPTIONS.series:
        curves_figure.draw(OPTIONS.folder, OPTIONS.names)
        one_row_each(OPTIONS.folder, OPTIONS.names)
        curves_table.full(OPTIONS.folder, OPTIONS.names, list(SERIES))
        curves_table.summary(OPTIONS.folder, OPTIONS.names)


if __name__ == "__main__":
    main()
