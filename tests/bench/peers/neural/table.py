#!/usr/bin/env python3
"""Neural planes with and without the measured parallax beside NeuMIP and the local PCA, at directions left out.

    tests/bench/capture_materials BUILD DIR paper_brick relief_weave flat_leather
    peers/neural/table.py BUILD DIR paper_brick relief_weave flat_leather

prints a Markdown table for each session DIR/NAME.session, and writes DIR/NAME.json and DIR/NAME.png,
pictures at three pairs of directions. A command that was interrupted continues where it stopped. Makes a virtual
environment in DIR/venv (environment.py). Debian packages: python3-torch python3-scipy
python3-openimageio python3-pil. The samples of a training, not its time, are the same for all networks.
"""
import argparse
import json
import os
import pickle

import environment


def parse():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("build")
    parser.add_argument("folder")
    parser.add_argument("names", nargs="+")
    parser.add_argument(
        "--texels", type=int, default=32, help="train only these texels in the middle (32)"
    )
    parser.add_argument(
        "--samples", type=float, default=3000, help="samples of a training for each texel (3000)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the directions that are left out (1)"
    )
    parser.add_argument("--rays", type=int, choices=(1, 4), default=4, help="rays of a texel (4)")
    parser.add_argument("--only", nargs="*", help="measure only these networks; none: only prepare")
    return parser.parse_args()


if __name__ == "__main__":
    OPTIONS = parse()
    environment.enter(OPTIONS.folder)

import numpy as np  # noqa: E402
import torch  # noqa: E402
from PIL import Image  # noqa: E402

import local_pca  # noqa: E402
import planes  # noqa: E402
from material import MARGIN, Captured  # noqa: E402
from measure import errors, shown  # noqa: E402


def networks(size):
    """Name, model, and bytes a texel of the relief: 2 × 2 cells of 8 bits."""
    make, both = planes.TriplePlanes, {"parallax": True, "shading": True, "angular": (8, 8)}
    return [
        ("triple planes", lambda: make(size), 0),
        ("NeuMIP", lambda: planes.NeuMip(size), 0),
        ("parallax", lambda: make(size, parallax=True), 4),
        ("parallax, shading, 24 channels", lambda: make(size, 24, **both), 4),
        ("parallax, shading, 12 channels", lambda: make(size, 12, **both), 4),
        ("parallax, shading, 6 channels", lambda: make(size, 6, **both), 4),
    ]


def drawn_by(model, pairs, chosen, size):
    with torch.no_grad():
        made = [planes.decode(model(pairs.picture(v, k))).numpy() for v, k in chosen]
    return np.stack(made).reshape(len(chosen), size, size, 3)


def middle(pictures, texels):
    first = (pictures.shape[1] - texels) // 2
    return pictures[:, first : first + texels, first : first + texels]


def captured_of(options, name):
    """Read once: the rays and the shadows take some seconds."""
    path = os.path.join(options.folder, "%s_%d_%d.pickle" % (name, options.rays, options.seed))
    if not os.path.exists(path):
        session = os.path.join(options.folder, name + ".session")
        captured = Captured(options.build, session, options.seed, rays=options.rays)
        with open(path + ".part", "wb") as file:
            pickle.dump(captured, file, protocol=5)
        os.rename(path + ".part", path)
    with open(path, "rb") as file:
        return pickle.load(file)


def measure(options, name):
    captured, texels = captured_of(options, name), options.texels
    held = [(v, k) for v in captured.held_views for k in captured.held_lights]
    seen = [(v, k) for v in captured.kept_views[4::9] for k in captured.kept_lights[4::9]]

    def pictures(chosen):
        return middle(np.stack([captured.values[:, :, v, k] for v, k in chosen]), texels)

    truth, truth_seen = pictures(held), pictures(seen)
    rows, shots = [], [("truth", truth)]

    def add(label, size, made, made_seen, **more):
        row = {"name": label, "bytes_per_texel": size, **errors(made, truth), **more}
        row["seen"] = errors(made_seen, truth_seen)["error"]
        rows.append(row)
        shots.append((label, made))
        print("| %s | %.1f | %.2f %% |" % (label, size, 100 * row["error"]), end="")
        print(" %(psnr_db).2f dB | %(flip).4f |" % row, end="")
        print(" %.2f %% |" % (100 * row["seen"]), flush=True)

    print("\n%s, %d² texels, %d rays" % (name, texels, options.rays))
    print("\n| | bytes/texel | error | PSNR | FLIP | error, seen |\n|---|---|---|---|---|---|")
    if options.only is None:
        folder = os.path.join(options.folder, name + ".pca")
        os.makedirs(folder, exist_ok=True)
        for label, size, path in local_pca.models(options.build, captured, folder):
            made = [
                middle(local_pca.evaluate(options.build, path, captured, chosen), texels)
                for chosen in (held, seen)
            ]
            add(label, size, *made)
    captured.crop(texels)
    pairs = planes.Pairs(captured)
    trained = os.path.join(options.folder, name + ".neural")
    os.makedirs(trained, exist_ok=True)
    for label, make, relief in networks(texels + 2 * MARGIN):
        if options.only is None or label in options.only:
            numbers = (texels, options.rays, options.samples, options.seed)
            kind = label.replace(",", "").replace(" ", "_") + "_%d_%d_%g_%d.npz" % numbers
            path = os.path.join(trained, kind)
            if not os.path.exists(path):
                torch.manual_seed(1)
                model = make()
                seconds = planes.train(model, pairs, int(options.samples * texels**2))
                surface, rest = planes.quantise(model)
                made = [drawn_by(model, pairs, chosen, texels) for chosen in (held, seen)]
                size = surface + relief + rest / texels**2
                np.savez(path, size=size, held=made[0], seen=made[1], cpu_s=seconds)
            found = np.load(path)
            made = found["held"], found["seen"]
            add(label, float(found["size"]), *made, cpu_s=float(found["cpu_s"]))
    path = os.path.join(options.folder, name)
    with open(path + ".json", "w", encoding="utf-8") as file:
        json.dump(rows, file, indent=1)
    # A column for each form; the rows are pairs of three views, each under another light.
    chosen = [k * (len(captured.held_lights) + 1) for k in (0, 2, 4)]
    sheet = np.concatenate([np.concatenate(shown(made[chosen]), 0) for _, made in shots], 1)
    sheet = np.kron(np.rint(255 * sheet).astype(np.uint8), np.ones((4, 4, 1), np.uint8))
    Image.fromarray(sheet).save(path + ".png")
    print("\ncolumns of %s.png: %s" % (name, ", ".join(label for label, _ in shots)))


def main():
    torch.set_num_threads(1)
    for name in OPTIONS.names:
        measure(OPTIONS, name)


if __name__ == "__main__":
    main()
