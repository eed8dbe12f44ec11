#!/usr/bin/python3
"""Temporal peaks of a laser sweep the plain way, in NumPy: a peer for bench_speed.

    peers/sweep_numpy.py FRAMES WIDTH HEIGHT THRESHOLD PEAKS

FRAMES holds 16-bit pictures one after the other; PEAKS (written) the time of each pixel's peak as
f32, or −1. Accumulating is timed by itself, the ways there are: maxima keeps what a peak through
three samples needs, samples all that ours keeps (what it takes to fit a whole pulse, and a second).
To peaks, by three samples, is timed with the faster of accumulating maxima and having all frames in
memory. Calls into NumPy write where they can (out=), values stay 16 bits wide.
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
    """All frames in memory: no accumulator, but what one would write first."""
    first = frames.argmax(axis=0)
    n = len(frames)
    pick = lambda i: np.take_along_axis(frames, np.clip(i, 0, n - 1)[None], axis=0)[0]
    return interpolate(first, pick(first - 1), pick(first), pick(first + 1), frames.min(axis=0), n)


def maxima(frames):
    """Frame by frame: the brightest, those before and after it, and the darkest of each pixel."""
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
        np.maximum(peak, frame, out=peak)
        np.minimum(darkest, frame, out=darkest)
    return first, before, peak, after, darkest, len(frames)


def samples(frames):
    """Frame by frame: every sample that is above its pixel's darkest by more than noise, as ours."""
    darkest = frames[0].copy()
    noise = np.median(np.abs(frames[1].astype(np.int32) - frames[0])) / 0.954
    margin = np.uint16(max(4, 6 * noise))
    limit = np.empty_like(darkest)
    kept = []
    for t in range(1, len(frames)):
        np.minimum(darkest, frames[t], out=darkest)
        np.add(darkest, margin, out=limit)
        lit = np.flatnonzero(frames[t] > limit)
        kept.append((lit, frames[t][lit]))
    return kept, darkest


def accumulate(way, frames):
    start = time.process_time()
    way(frames)
    return time.process_time() - start


spent = {}
for _ in range(3):
    for way in (maxima, samples):
        spent.setdefault(way.__name__, []).append(accumulate(way, frames))
    for name, way in (("at_once", at_once), ("maxima_to_peaks", lambda f: interpolate(*maxima(f)))):
        start = time.process_time()
        peaks = way(frames)
        spent.setdefault(name, []).append(time.process_time() - start)
peaks.tofile(out)
best = {name: min(times) for name, times in spent.items()}
print(
    json.dumps({"peer": "numpy", "to_peaks": min(best["at_once"], best["maxima_to_peaks"]), **best})
)
