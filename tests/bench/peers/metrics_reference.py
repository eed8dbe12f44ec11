#!/usr/bin/env python3
"""Values of FLIP, SSIM and PSNR from other programs, for tests/processing/metrics/test_metrics.c.

    peers/metrics_reference.py FOLDER

makes a virtual environment in FOLDER, installs flip-evaluator (the program of FLIP's authors) and
scikit-image from PyPI, and prints the rows of the table references[] in the test. value() draws the
same pictures as value() in the test: it has integers and + - * / only.
"""
import os
import subprocess
import sys
import venv

PACKAGES = "numpy==2.4.6", "flip-evaluator==1.7", "scikit-image==0.26.0"

try:
    import flip_evaluator
    import numpy as np
    from skimage.metrics import peak_signal_noise_ratio, structural_similarity
except ImportError:
    if len(sys.argv) != 2 or "METRICS_REFERENCE" in os.environ:
        sys.exit(__doc__)
    python = os.path.join(sys.argv[1], "bin", "python3")
    venv.create(sys.argv[1], with_pip=True)
    subprocess.run([python, "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
    os.execve(python, [python, *sys.argv], os.environ | {"METRICS_REFERENCE": "1"})

# width, height, pixels per degree, factor of all values
PAIRS = [
    ("noise", 40, 30, 67.0, 1),
    ("shift", 33, 47, 67.0, 1),
    ("blur", 64, 48, 30.0, 1),
    ("stripes", 48, 20, 67.0, 1),
    ("levels", 50, 31, 67.0, 1),
    ("hue", 60, 60, 40.0, 1),
    ("contrast", 24, 36, 67.0, 1),
    ("opposite", 16, 12, 67.0, 1),
    ("small", 7, 5, 67.0, 1),
    ("darker", 45, 45, 67.0, 1),
    ("bright noise", 40, 30, 67.0, 8),
    ("bright blocks", 51, 35, 50.0, 20),
]


def noise(x, y, c):
    h = (x * 374761393 + y * 668265263 + c * 2246822519) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 1274126177) & 0xFFFFFFFF
    return ((h ^ (h >> 16)) & 0xFFFF) / 65535.0


def value(kind, test, x, y, c, w, h):
    ramp = ((x + 0.5) / w, (y + 0.5) / h, (x + y + 1.0) / (w + h))[c]
    if kind == 0:
        return 0.1 + 0.8 * ramp + (0.2 * (noise(x, y, c) - 0.5) if test else 0)
    if kind == 1:
        return 0.1 + 0.7 * (((x + test) // 6 + y // 6) % 2) * (c + 1) / 3.0
    if kind == 2:
        if not test:
            return noise(x, y, c)
        return sum(noise(x + i % 3, y + i // 3, c) for i in range(9)) / 9.0
    if kind == 3:
        return 0.5 if test else 0.2 + 0.6 * (x // 2 % 2)
    if kind == 4:
        return int(ramp * 6) / 6.0 if test else ramp
    if kind == 5:
        inside = (2 * x - w) * (2 * x - w) + (2 * y - h) * (2 * y - h) < w * h / 2
        return (0.7, 0.3, 0.1)[(c + test) % 3] if inside else 0.4
    if kind == 6:
        return 0.25 + 0.5 * ramp if test else ramp
    if kind == 7:
        return 1.0 if c == 1 + test else 0.0
    if kind == 8:
        return noise(x + 50 * test, y, c)
    if kind == 9:
        return 0.05 * ramp * (0.5 if test else 1.0)
    if kind == 10:
        return ramp * ramp * ramp + (0.1 * noise(x, y, c) if test else 0)
    return noise(x // 5, y // 5, c) * noise(x // 5, y // 5, 7) * (0.8 if test else 1.0)


def picture(kind, test):
    _, w, h, _, factor = PAIRS[kind]
    return np.array(
        [
            [[factor * value(kind, test, x, y, c, w, h) for c in range(3)] for x in range(w)]
            for y in range(h)
        ],
        np.float32,
    )


def shown(linear):
    v = np.clip(linear.astype(np.float64), 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def flip(a, b, kind, which):
    options = {"ppd": PAIRS[kind][3]}
    ranged = [np.clip(p, 0, 1) if which == "LDR" else p for p in (a, b)]
    made, mean, _ = flip_evaluator.evaluate(
        *ranged, which, inputsRGB=False, applyMagma=False, parameters=options
    )
    made = np.asarray(made).reshape(*a.shape[:2], -1)[:, :, 0]
    return mean, made[0, 0], made[a.shape[0] // 2, a.shape[1] // 3]


def similarity(a, b):
    if min(a.shape[:2]) < 11:
        return "NAN"
    found = structural_similarity(
        shown(a),
        shown(b),
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1,
        channel_axis=2,
    )
    return f"{found:.7f}"


for number, (name, width, height, ppd, times) in enumerate(PAIRS):
    one, other = picture(number, 0), picture(number, 1)
    ldr, hdr = (", ".join(f"{v:.6f}" for v in flip(one, other, number, k)) for k in ("LDR", "HDR"))
    decibels = peak_signal_noise_ratio(shown(one), shown(other), data_range=1)
    print(f'    {{"{name}", {width}, {height}, {ppd}, {times}, {{{ldr}}},')
    print(f"     {{{hdr}}}, {similarity(one, other)}, {decibels:.6f}}},")
