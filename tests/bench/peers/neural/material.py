"""A captured material for training: values, directions, and what its MDF says of each ray."""

import json
import os
import subprocess
import sys

import numpy as np
from scipy import ndimage

SOURCE = os.path.join(os.path.dirname(os.path.abspath(__file__)), *[".."] * 4)
sys.path.insert(0, os.path.join(SOURCE, "python"))
import mesorig  # noqa: E402

MARGIN = 8
SUBRAYS = np.array([(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)])  # texels


def left_out(build, path, seed):
    """The views and the lights that mesorig compare leaves out."""
    mesorig_program = os.path.join(build, "bin", "mesorig")
    command = [mesorig_program, "compare", path, "-m", "ptm", "--seed", str(seed), "--json"]
    found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    views = [row["index"] for row in found["left_out_views"]]
    lights = [row["index"] for row in found["left_out_lights"]]
    return views, lights


class Relief:
    """Heights in mm below (negative) the reference plane, on a square grid over the sample."""

    def __init__(self, heights, width_mm):
        self.heights, self.width_mm = heights, width_mm
        self.cell_mm = width_mm / len(heights)

    def cells(self, x_mm, y_mm):
        """Row and column of a place; row 0 is at +y."""
        return [
            (self.width_mm / 2 - y_mm) / self.cell_mm - 0.5,
            (x_mm + self.width_mm / 2) / self.cell_mm - 0.5,
        ]

    def at(self, x_mm, y_mm):
        return ndimage.map_coordinates(
            self.heights, self.cells(x_mm, y_mm), order=1, mode="nearest"
        )

    def hit(self, x_mm, y_mm, towards):
        """Where rays through (x, y, 0) from the direction towards meet the relief."""
        slope_x, slope_y = (-towards[..., k] / towards[..., 2] for k in (0, 1))
        deepest, above = -self.heights.min(), np.zeros(x_mm.shape)
        below = np.full(x_mm.shape, deepest)
        # The first step that is below the surface, then bisection.
        found = np.zeros(x_mm.shape, bool)
        step = self.cell_mm / 2 / max(1, np.hypot(slope_x, slope_y).max())
        for depth in np.arange(step, deepest + step, step):
            under = ~found & (self.at(x_mm + slope_x * depth, y_mm + slope_y * depth) >= -depth)
            below[under], above[under] = depth, depth - step
            found |= under
        for _ in range(8):
            middle = (above + below) / 2
            under = self.at(x_mm + slope_x * middle, y_mm + slope_y * middle) >= -middle
            below, above = np.where(under, middle, below), np.where(under, above, middle)
        return x_mm + slope_x * below, y_mm + slope_y * below

    def rounded(self):
        """With the heights in 8 bits."""
        low, high = self.heights.min(), self.heights.max()
        step = max(high - low, 1e-6) / 255
        return Relief(low + step * np.rint((self.heights - low) / step), self.width_mm)


def relief_of(session, views, cells):
    """A height map from the points that the given views have measured: the median in each cell."""
    mdf, centres = session.mdf, session.grid.centres_mm
    width = session.grid.texel_mm * centres.shape[1]
    points = []
    for view in views:
        ray = centres - mdf.camera_mm[view]
        ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
        point = centres + ray * mdf.distance_mm[:, :, view, None]
        points.append(point[mdf.seen[:, :, view] & np.isfinite(point[..., 2])])
    points = np.concatenate(points)
    points[:, 2] -= centres[0, 0, 2]
    grid = Relief(np.zeros((cells, cells)), width)
    row, column = (np.floor(c + 0.5).astype(int) for c in grid.cells(points[:, 0], points[:, 1]))
    inside = (row >= 0) & (row < cells) & (column >= 0) & (column < cells)
    cell, z = (row * cells + column)[inside], points[inside, 2]
    order = np.lexsort((z, cell))
    cell, z = cell[order], z[order]
    first, count = np.unique(cell, return_index=True, return_counts=True)[1:]
    heights = np.full(cells * cells, np.nan)
    heights[cell[first]] = z[first + count // 2]
    heights = heights.reshape(cells, cells)
    missing = np.isnan(heights)
    nearest = ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
    return Relief(heights[tuple(nearest)], width), 1 - missing.mean()


def light_features(relief, lamps_mm):
    """On each cell of the relief and for each lamp: n·l where lit, lit or not, and the angle above
    the horizon as a difference of slopes, -1 … 1. Cells × cells × lamps × 3."""
    cells = len(relief.heights)
    centre = (np.arange(cells) + 0.5) * relief.cell_mm - relief.width_mm / 2
    x, y = np.meshgrid(centre, -centre)
    smooth = ndimage.gaussian_filter(relief.heights, 0.7, mode="nearest")
    slope_y, slope_x = np.gradient(smooth, relief.cell_mm)
    normal = np.stack([-slope_x, slope_y, np.ones_like(x)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    place = np.stack([x, y, relief.heights], -1)
    made = np.empty((cells, cells, len(lamps_mm), 3), np.float32)
    for k, lamp in enumerate(lamps_mm):
        to = lamp - place
        to /= np.linalg.norm(to, axis=-1, keepdims=True)
        across = np.hypot(to[..., 0], to[..., 1])
        rises = to[..., 2] / across
        horizon = np.full(x.shape, -1e3)
        farthest = np.ptp(relief.heights) / rises.min() + relief.cell_mm
        for t in np.arange(0.75, farthest / relief.cell_mm + 0.5, 0.5) * relief.cell_mm:
            there = relief.at(x + to[..., 0] / across * t, y + to[..., 1] / across * t)
            horizon = np.maximum(horizon, (there - relief.heights) / t)
        lit = rises > horizon
        made[:, :, k, 0] = np.maximum((normal * to).sum(-1), 0) * lit
        made[:, :, k, 1] = lit
        made[:, :, k, 2] = np.clip(rises - horizon, -1, 1)
    return made


class Captured:
    """The arrays of a material.

    values    height × width × views × lights × 3
    place     height × width × views × rays × 2: where the ray of a texel ends, -1 … 1 over the sample
    lit       height × width × views × lights × 3, int8 of 127: light_features() there, mean of the rays
    to_view   height × width × views × 3;  to_light: height × width × lights × 3
    flat      height × width × 2: the places of the texels

    Without rays there is no place and no lit, for networks that read only flat. With whole, no direction is left out.
    """

    def __init__(self, build, path, seed=1, cells=128, rays=1, whole=False):
        session = mesorig.open(path)
        self.held_views, self.held_lights = ([], []) if whole else left_out(build, path, seed)
        btf = session.btf
        n, m, n_views, n_lights, _ = btf.shape
        self.kept_views = [k for k in range(n_views) if k not in self.held_views]
        self.kept_lights = [k for k in range(n_lights) if k not in self.held_lights]
        self.view_vectors, self.light_vectors = btf.views.vectors, btf.lights.vectors
        self.views, self.lights = btf.views, btf.lights
        self.texel_mm = session.grid.texel_mm
        centres = session.grid.centres_mm
        self.values = np.nan_to_num(btf.values)
        cameras = np.stack([btf.view(k).camera_mm.mean(0) for k in range(n_views)])
        lamps = np.stack([btf.view(k).lamp_mm for k in range(n_views)]).mean(0)
        reference = centres[0, 0, 2]

        def towards(points):
            to = points - centres[:, :, None]
            return (to / np.linalg.norm(to, axis=-1, keepdims=True)).astype(np.float32)

        self.to_view, self.to_light = towards(cameras), towards(lamps)
        self.flat = np.empty((n, m, 2), np.float32)
        self.flat[..., 0] = centres[..., 0] / (self.texel_mm * m / 2)
        self.flat[..., 1] = -centres[..., 1] / (self.texel_mm * m / 2)
        if rays == 0:
            return
        self.relief, self.known = relief_of(session, self.kept_views, cells)
        self.relief = self.relief.rounded()
        offsets = np.zeros((1, 2)) if rays == 1 else SUBRAYS
        light = light_features(self.relief, lamps - [0, 0, reference]).reshape(cells, cells, -1)
        self.place = np.empty((n, m, n_views, len(offsets), 2), np.float32)
        self.lit = np.empty((n, m, n_views, n_lights, 3), np.int8)
        for k in range(n_views):
            mean = np.zeros((n, m, light.shape[-1]), np.float32)
            for r, (dx, dy) in enumerate(offsets * self.texel_mm):
                x, y = self.relief.hit(
                    centres[..., 0] + dx, centres[..., 1] + dy, self.to_view[:, :, k].astype(float)
                )
                self.place[:, :, k, r, 0] = x / (self.relief.width_mm / 2)
                self.place[:, :, k, r, 1] = -y / (self.relief.width_mm / 2)
                row, column = (np.clip(c, 0, cells - 1.001) for c in self.relief.cells(x, y))
                i, j = row.astype(int), column.astype(int)
                a, b = (row - i)[..., None], (column - j)[..., None]
                mean += (1 - a) * ((1 - b) * light[i, j] + b * light[i, j + 1])
                mean += a * ((1 - b) * light[i + 1, j] + b * light[i + 1, j + 1])
            mean = mean.reshape(n, m, n_lights, 3) / len(offsets)
            self.lit[:, :, k] = np.rint(127 * mean)

    def crop(self, texels):
        """Keeps only a square in the middle. Places are then -1 … 1 over this square and MARGIN
        texels around it, where oblique rays end."""
        first = (self.values.shape[0] - texels) // 2
        part, scale = slice(first, first + texels), self.values.shape[0] / (texels + 2 * MARGIN)
        for name in "values lit to_view to_light place flat".split():
            setattr(self, name, np.ascontiguousarray(getattr(self, name)[part, part]))
        self.place *= scale
        self.flat *= scale
