"""Errors of pictures at the directions that were left out, as mesorig compare measures them."""

import flip_evaluator
import numpy as np

PIXELS_PER_DEGREE = 0.7 * 3840 / 0.7 * np.pi / 180  # as in processing/metrics/flip.h


def shown(linear):
    v = np.clip(linear, 0, 1)
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.maximum(v, 1e-9) ** (1 / 2.4) - 0.055)


def errors(made, truth):
    """Of pictures, pictures × rows × columns × 3: the relative RMS error, PSNR in dB and mean FLIP."""
    made, truth = made.astype(np.float64), truth.astype(np.float64)
    square = np.square(shown(made) - shown(truth)).mean()
    flips = [
        flip_evaluator.evaluate(
            *(np.clip(p, 0, 1).astype(np.float32) for p in pair),
            "LDR",
            inputsRGB=False,
            applyMagma=False,
            parameters={"ppd": PIXELS_PER_DEGREE},
        )[1]
        for pair in zip(truth, made)
    ]
    return {
        "error": float(np.sqrt(np.square(made - truth).sum() / np.square(truth).sum())),
        "psnr_db": float(-10 * np.log10(square)),
        "flip": float(np.mean(flips)),
    }
