/*
 * The rig and the simulated world of bench_measurement. Both are made from the same numbers, so
 * that the geometry is exact and only the error of the method is left. Noise, Bayer pattern,
 * distortion and vignetting are on.
 */
#pragma once

#include "geometry/rig.h"
#include "session/session.h"
#include "world/truth.h"

#define RIG_VIEWS 5 /* also lamps and lasers: one at each elevation of 15, 30, 45, 60, 75° */

struct bench_setup {
    const char *material; /* kind of the sample: weave, brick, peanuts, brushed; or another */
    double relief_mm;     /* 0: what that kind has here */
    int texels;
    double texel_mm;
    double pixels_a_texel; /* across, in the direction in which a view shortens it */
    int supersample, gather_rays;
    gboolean noise, mono, keep_focal; /* keep_focal: pixels_a_texel is for a view from above */
};

double bench_elevation_deg(int index);

/* Both describe the same; geometry in the rig alone is calib's. */
World *bench_world(const struct bench_setup *setup, GError **error);
void bench_rig(const struct bench_setup *setup, struct rig *ret);
struct session_grid bench_grid(const struct bench_setup *setup);
struct truth_grid bench_truth_grid(const struct bench_setup *setup);

/* A frame as capture stores it: noise over something smooth, neither easier nor harder to compress
 * than a picture. */
void bench_write_frame(const char *path, const struct rig_camera *camera);
