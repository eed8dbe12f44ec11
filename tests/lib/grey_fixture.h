/*
 * From a white tile to the reflectances of a grey scale, through sessions of the rig of
 * radiometry_rig.h: 3 % of drift, 20 % of vignetting, all that the rig file says of light wrong.
 * For the test and for measuring.
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

/* Four greys next to each other, in a session of their own, and what the world says they are. */
static const double grey_values[] = {0.1, 0.2, 0.45, 0.85};
static const double grey_mm[][2] = {{-12, 12}, {12, 12}, {-12, -12}, {12, -12}};

#define GREY_CONF                                                                                  \
    "[session]\nname=grey\n[sample]\nwidth_mm=48\nheight_mm=48\ntexels=32\nreference_mm=4\n"       \
    "depth_mm=4\n[views]\nrings=10:2; 40:2:20; 65:2\n[lights]\nrings=15:4; 45:4; 70:4\n"           \
    "offset_deg=50\n[capture]\nexposures_us=2000;6000\ndark_frames=4\n"

void grey_write(const char *folder, int seed, const char *world_keys);

/* A held grey scale: 3 % of drift, 20 % of vignetting, everything nominal wrong. */
double grey_error(int seed, gboolean calibrated);

/* The truth as a calibration, with cameras calibrated days ago. */
void grey_truth(const char *folder, const char *id, int days);

#define GREY_FEW_CONF                                                                              \
    "[session]\nname=few\n[sample]\nwidth_mm=48\nheight_mm=48\ntexels=8\nreference_mm=4\n"         \
    "depth_mm=4\n[views]\nrings=10:2; 40:2:20; 65:2\n[lights]\nrings=15:2; 45:2\n"                 \
    "offset_deg=50\n[capture]\nexposures_us=4000\ndark_frames=2\n"

/* What a session says of a rig in which something may have moved. */
char *grey_pause(int seed, const char *world_keys, const char *turntable_keys,
                 enum capture_state *ret_state);

/* Squared errors of what was found, by their standard errors. Of lamps' intensities the tile's own
 * drift is not known here; the products with it are the grey scale's. */
struct grey_chi2 {
    double sum;
    int n;
};

void grey_compare(const struct calibration *found, struct grey_chi2 *to);
