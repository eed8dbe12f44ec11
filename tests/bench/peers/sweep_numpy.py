#!/usr/bin/python3
"""Temporal peaks of a laser sweep the plain way, in NumPy: a peer for bench_speed.

    peers/sweep_numpy.py FRAMES WIDTH HEIGHT THRESHOLD PEAKS

FRAMES holds 16-bit pictures one after the other; PEAKS (written) the time of each pixel's peak as
f32, or −1. Both ways that suggest themselves are tried, and the faster one counts.
"""
import json
import sys
import time

import numpy as np

path, width, height, threshold, out = sys.argv[1:]
threshold = float(threshold)
frames = np.fromfile(path, dtype="<u2").reshape(-1, int(height) * int(width))


def interpolate(first, before, peak, after, darkest, n):
    a, b, c = (x.astype(np.float32) - darkest for x in (before, peak, after))
    with np.errstate(divide="ignore", invalid="ignore"):
        la, lb, lc = np.log(a), np.log(b), np.log(c)
        offset = 0.5 * (la - lc) / (la - 2 * lb + lc)
        plain = 0.5 * (a - c) / (a - 2 * b + c)
    offset = np.where(np.isfinite(offset), offset, plain)
    time_of = first + np.clip(np.nan_to_num(offset), -0.5, 0.5)
    good = (b >= threshold) & (first > 0) & (first < n - 1)
    return np.where(good, time_of, -1).astype(np.float32)


def at_once(frames):
    first = frames.argmax(axis=0)
    n = len(frames)
    pick = lambda i: np.take_along_axis(frames, np.clip(i, 0, n - 1)[None], axis=0)[0]
    return interpolate(first, pick(first - 1), pick(first), pick(first + 1), frames.min(axis=0), n)


def streaming(frames):
    peak = frames[0].copy()
    darkest = frames[0].copy()
    before = np.zeros_like(peak)
    after = np.zeros_like(peak)
    first = np.zeros(peak.shape, np.int32)
    for t in range(1, len(frames)):
        frame = frames[t]
        after = np.where(first == t - 1, frame, after)
        more = frame > peak
        before = np.where(more, frames[t - 1], before)
        first = np.where(more, t, first)
        peak = np.maximum(peak, frame)
        darkest = np.minimum(darkest, frame)
    return interpolate(first, before, peak, after, darkest, len(frames))


best = {}
for way in (at_once, streaming):
    for _ in range(2):
        start = time.process_time()
        peaks = way(frames)
        spent = time.process_time() - start
        best[way.__name__] = min(best.get(way.__name__, spent), spent)
peaks.tofile(out)
print(json.dumps({"peer": "numpy", "seconds": min(best.values()), **best}))
