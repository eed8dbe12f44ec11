"""The Markdown tables of curves.py: all points, and a summary at 33 bytes a texel."""

import json
import os

LIMIT = 33.5  # bytes a texel


def points_of(folder, name, ending=".curves"):
    """The points of a material. Of several trainings with 3000 samples for each texel, the one with the highest PSNR."""
    with open(os.path.join(folder, name + ending, "points.json"), "rb") as file:
        found = json.load(file)
    points = {}
    for point in found:
        label, *training = point["label"].split(",")
        if training and not training[-1].endswith(" 3000 samples"):
            continue
        key = point["series"], label
        if key not in points or point["psnr_db"] > points[key]["psnr_db"]:
            points[key] = point | {"label": label, "path": "%(series)s %(label)s.npy" % point}
    return list(points.values())


def best(points, series, limit=LIMIT):
    """The model of at most limit bytes a texel with the highest PSNR, or None."""
    chosen = [p for p in points if p["series"] == series and p["bytes_per_texel"] <= limit]
    return max(chosen, key=lambda p: p["psnr_db"], default=None)


def cell(point):
    if point is None:
        return "–"
    numbers = [100 * point["error"], 100 * point["seen"], point["psnr_db"], point["flip"]]
    return "%.2f, %.2f, %.2f, %.4f" % tuple(numbers)


def full(folder, names, order):
    """A row for each form, a column for each material: error and seen in %, PSNR in dB, FLIP."""
    table = {name: points_of(folder, name) for name in names}
    forms = {}  # bytes a texel of each series and label
    for points in table.values():
        for point in points:
            forms.setdefault((point["series"], point["label"]), point["bytes_per_texel"])
    print("\n| | bytes/texel | %s |\n|---|---|%s" % (" | ".join(names), "---|" * len(names)))
    for series, label in sorted(forms, key=lambda f: (order.index(f[0]), forms[f])):
        found = [
            next((p for p in points if (p["series"], p["label"]) == (series, label)), None)
            for points in table.values()
        ]
        size = "{:,.1f}".format(forms[series, label])
        cells = " | ".join(map(cell, found))
        print("| %s | %s | %s |" % (" ".join([series, label]).strip(), size, cells))


def summary(folder, names):
    """PSNR and FLIP of the best model of at most 33 bytes, and the sizes with the error of 32 clusters of 8."""
    series = ["triple planes", "NeuMIP", "neural, no MDF", "neural"]
    print("\n| | %s | gain over triple planes | smallest neural |" % " | ".join(series))
    print("|---|%s" % ("---|" * (len(series) + 2)))
    for name in names:
        points = points_of(folder, name)
        found = [best(points, s) for s in series]
        cells = ["%(psnr_db).2f dB, %(flip).4f" % p if p else "–" for p in found]
        gain = "–"
        if found[0] and found[-1]:
            gain = "%+.2f dB" % (found[-1]["psnr_db"] - found[0]["psnr_db"])
        wanted = [p for p in points if p["series"] == "LPCA, drawn" and p["label"] == "32 of 8"]
        reached = [
            p["bytes_per_texel"]
            for p in points
            if p["series"] == "neural" and wanted and p["error"] <= wanted[0]["error"]
        ]
        smallest = "%.1f" % min(reached) if reached else "none"
        print("| %s | %s | %s | %s |" % (name, " | ".join(cells), gain, smallest))
