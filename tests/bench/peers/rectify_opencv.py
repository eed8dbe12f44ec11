#!/usr/bin/python3
"""Rectification the plain way, in OpenCV: demosaic, supersample by remap, average. A peer for
bench_speed.

    peers/rectify_opencv.py SETTINGS.json

SETTINGS: mosaics (f32, one after the other), truth (f32, frames × texels × R G B), frames, width,
height, texels, texel_mm, reference_mm, matrix, distortion, rotation, translation, turntable_rad,
vignetting, corner, centre, scale (mosaic to radiance), wanted (the error to reach). Maps are made
once and not counted.
"""
import json
import sys
import time

import cv2
import numpy as np

cv2.setNumThreads(1)
with open(sys.argv[1]) as f:
    s = json.load(f)
shape = (s["frames"], s["height"], s["width"])
mosaics = np.fromfile(s["mosaics"], np.float32).reshape(shape)
n = s["texels"]
truth = np.fromfile(s["truth"], np.float32).reshape(s["frames"], n, n, 3)
top = float(mosaics.max())
pictures = np.clip(mosaics * (65535 / top), 0, 65535).astype(np.uint16)


def maps(fine):
    """Where each of the fine texels' centres is in the picture, and what undoes vignetting there."""
    m = n * fine
    step = n * s["texel_mm"] / m
    x = (np.arange(m) + 0.5) * step - n * s["texel_mm"] / 2
    u, v = np.meshgrid(x, -x)
    c, d = np.cos(s["turntable_rad"]), np.sin(s["turntable_rad"])
    points = np.stack([c * u - d * v, d * u + c * v, np.full_like(u, s["reference_mm"])], axis=-1)
    rotation, _ = cv2.Rodrigues(np.array(s["rotation"], np.float64).reshape(3, 3))
    at, _ = cv2.projectPoints(
        points.reshape(-1, 1, 3),
        rotation,
        np.array(s["translation"], np.float64),
        np.array(s["matrix"], np.float64).reshape(3, 3),
        np.array(s["distortion"], np.float64),
    )
    at = at.reshape(m, m, 2)
    r2 = ((at - np.array(s["centre"])) ** 2).sum(axis=-1) / s["corner"] ** 2
    flat = (s["scale"] * top / 65535 / (1 - s["vignetting"] * r2)).astype(np.float32)
    a, b = cv2.convertMaps(
        at[..., 0].astype(np.float32), at[..., 1].astype(np.float32), cv2.CV_32FC1
    )
    return a, b, cv2.merge([flat] * 3)


def rectify(picture, demosaic, interpolation, prepared):
    a, b, flat = prepared
    rgb = cv2.cvtColor(picture, demosaic)
    if picture.dtype == np.uint8:
        rgb = rgb.astype(np.float32) * 257
    fine = cv2.remap(rgb, a, b, interpolation)
    return cv2.resize(fine * flat, (n, n), interpolation=cv2.INTER_AREA)


ways = []
small = np.rint(pictures / 257).astype(np.uint8)  # OpenCV has its best way for 8 bits alone
for name, demosaic, pictures in (
    ("bilinear", cv2.COLOR_BAYER_BG2RGB, pictures),
    ("edge-aware", cv2.COLOR_BAYER_BG2RGB_EA, pictures),
    ("vng", cv2.COLOR_BAYER_BG2RGB_VNG, small),
):
    for cubic in (False, True):
        for fine in (1, 2, 3, 4, 6):
            prepared = maps(fine)
            spent = 1e9
            for _ in range(2):
                start = time.process_time()
                got = np.stack(
                    [
                        rectify(
                            p, demosaic, cv2.INTER_CUBIC if cubic else cv2.INTER_LINEAR, prepared
                        )
                        for p in pictures
                    ]
                )
                spent = min(spent, (time.process_time() - start) / len(pictures))
            error = float(np.sqrt(((got - truth) ** 2).mean() / (truth**2).mean()))
            ways.append(
                {"demosaic": name, "cubic": cubic, "fine": fine, "ms": 1e3 * spent, "error": error}
            )
reached = [w for w in ways if w["error"] <= s["wanted"]]
best = min(reached, key=lambda w: w["ms"]) if reached else min(ways, key=lambda w: w["error"])
print(
    json.dumps(
        {
            "peer": "opencv",
            "ms": best["ms"],
            "error": best["error"],
            "reached": int(bool(reached)),
            "fine": best["fine"],
            "cubic": int(best["cubic"]),
            "demosaic": best["demosaic"],
            "ways": ways,
        }
    )
)
