"""The figure of curves.py: PSNR and FLIP over bytes a texel, a panel for each material."""

import os

import matplotlib

from curves_table import points_of

matplotlib.use("agg")
import matplotlib.pyplot as plt  # noqa: E402
from PIL import Image  # noqa: E402

COLUMNS = 5
LOOKS = {  # colour and marker
    "LPCA, drawn": ("#888888", "s"),
    "LPCA, packed": ("#444444", "^"),
    "eigen-maps": ("#b8860b", "v"),
    "NeuMIP": ("#2e8b57", "D"),
    "triple planes": ("#1f6fb4", "o"),
    "neural, no MDF": ("#e88080", "o"),
    "neural": ("#c00000", "o"),
}


def panel(axes, points, key):
    for series, (colour, marker) in LOOKS.items():
        chosen = sorted(
            (p for p in points if p["series"] == series), key=lambda p: p["bytes_per_texel"]
        )
        axes.plot(
            [p["bytes_per_texel"] for p in chosen],
            [p[key] for p in chosen],
            color=colour,
            marker=marker,
            markersize=3.5,
            linewidth=1.2,
            label=series,
        )
    btf = [p[key] for p in points if p["series"] == "BTF"]
    if btf:
        axes.axhline(btf[0], color="#888888", linestyle=":", linewidth=1, label="BTF, 17,496")
    axes.set_xscale("log")
    axes.set_xlim(8, 3500)
    axes.set_xticks([10, 33, 100, 1000], ["10", "33", "100", "1000"])
    axes.minorticks_off()
    axes.grid(True, color="#e6e6e6", linewidth=0.6)


def draw(folder, names):
    """Writes folder/curves.png from the points of DIR/NAME.curves."""
    rows = -(-len(names) // COLUMNS)
    columns = min(COLUMNS, len(names))
    plt.rcParams |= {"font.size": 7, "font.family": "sans-serif"}
    figure, table = plt.subplots(
        2 * rows, columns, figsize=(2.1 * columns, 3.3 * rows + 0.3), squeeze=False
    )
    for axes in table.flat:
        axes.set_visible(False)
    for number, name in enumerate(names):
        points = points_of(folder, name)
        for line, (key, label) in enumerate(
            [("psnr_db", "PSNR, dB"), ("flip", "FLIP (less is better)")]
        ):
            axes = table[2 * (number // columns) + line, number % columns]
            axes.set_visible(True)
            panel(axes, points, key)
            if line == 0:
                axes.set_title(name.replace("_part", "").split("_")[-1], fontsize=8)
                axes.set_xticklabels([])
            if number % columns == 0:
                axes.set_ylabel(label)
            if line == 1 and number // columns == rows - 1:
                axes.set_xlabel("bytes a texel")
    figure.legend(
        *table[0, 0].get_legend_handles_labels(), loc="upper center", ncol=8, frameon=False
    )
    figure.tight_layout(rect=(0, 0, 1, 1 - 0.25 / (3.3 * rows + 0.3)), pad=0.4)
    path = os.path.join(folder, "curves.png")
    figure.savefig(path, dpi=130)
    Image.open(path).convert("RGB").quantize(48).save(path, optimize=True)
