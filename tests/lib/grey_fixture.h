/*
 * Measures a grey scale after a calibration with a white tile, through sessions of the rig of
 * radiometry_rig.h. The lamps drift by 3 %, the lenses have 20 % of vignetting, and all radiometric
 * values of the rig file are wrong. For tests and for measurements.
 */
#pragma once

#include "btf/btf.h"
#include "pipeline/pipeline.h"
#include "radiometry_rig.h"
#include "targets/tile_session.h"

static const struct tile_options grey_tile = {.reflectance = {0.96, 0.96, 0.96}};

char *grey_folder(void);

/* Captures the tile and writes calibration.conf. */
void grey_calibrate(const char *folder, int seed, struct tile_result *ret);

/* The true reflectances of four grey patches, and their positions. They are captured in a separate
 * session. */
static const double grey_values[] = {0.1, 0.2, 0.45, 0.85};
static const double grey_mm[][2] = {{-12, 12}, {12, 12}, {-12, -12}, {12, -12}};

#define GREY_CONF                                                                                  \
    "[session]\nname=grey\n[sample]\nwidth_mm=48\nheight_mm=48\ntexels=32\nreference_mm=4\n"       \
    "depth_mm=4\n[views]\nrings=10:2; 40:2:20; 65:2\n[lights]\nrings=15:4; 45:4; 70:4\n"           \
    "offset_deg=50\n[capture]\nexposures_us=2000;6000\ndark_frames=4\n"

void grey_write(const char *folder, int seed, const char *world_keys);

/* Returns the largest relative error of the four patches with all deviations above, with or without
 * calibration. */
double grey_error(int seed, gboolean calibrated);

/* Writes the true values as a calibration file. The cameras were calibrated this number of days
 * ago. */
void grey_truth(const char *folder, const char *id, int days);

#define GREY_FEW_CONF                                                                              \
    "[session]\nname=few\n[sample]\nwidth_mm=48\nheight_mm=48\ntexels=8\nreference_mm=4\n"         \
    "depth_mm=4\n[views]\nrings=10:2; 40:2:20; 65:2\n[lights]\nrings=15:2; 45:2\n"                 \
    "offset_deg=50\n[capture]\nexposures_us=4000\ndark_frames=2\n"

/* Captures the session GREY_FEW_CONF of a rig in which something may have changed since its
 * calibration. world_keys are further lines for the second camera in world.conf, or NULL.
 * turntable_keys are further lines for the turntable in rig.conf. Returns the reason of the pause.
 * If the capture did not pause, returns its events. Free the text with g_free(). */
char *grey_pause(int seed, const char *world_keys, const char *turntable_keys,
                 enum capture_state *ret_state);

/* Sum of squared errors of the calibration, relative to their standard errors. The intensities of
 * lamps are not included, because the drift of the tile's session is not known here. They are
 * tested by the grey scale, which depends on them. */
struct grey_chi2 {
    double sum;
    int n;
};

void grey_compare(const struct calibration *found, struct grey_chi2 *to);
