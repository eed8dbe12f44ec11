/*
 * The rig of radiometry_fixture.h as files and simulated devices, with which whole sessions are
 * captured. Its true values are in the fixture, and rig.conf contains nominal values.
 */
#pragma once

#include "capture/capture.h"
#include "radiometry_fixture.h"
#include "session/session.h"

#include <string.h>

static const double rig_marks_mm[][2] = {{32, 0}, {0, 32}, {-32, 0}, {0, -32}};

/* Returns the rig file. turntable_keys are added to the section of the turntable, for instance a
 * position error. */
char *radiometry_rig_text(const char *turntable_keys);
void radiometry_rig_write(const char *folder, const char *name, const char *text);

/* Writes world.conf. objects are the objects between the marks. */
void radiometry_rig_write_world(const char *folder, const char *keys, const char *objects);

/* Writes the world with a white tile of 56 × 56 mm, 4 mm thick, which extends nearly to the marks.
 * The light of the lamps drifts by 3 %. */
void radiometry_rig_write_tile(const char *folder, int seed);

#define TILE_CONF                                                                                  \
    "[session]\nname=tile\n[sample]\nwidth_mm=56\nheight_mm=56\ntexels=8\nreference_mm=4\n"        \
    "depth_mm=4\n[views]\nrings=10:3; 40:3:20; 65:3\n[lights]\nrings=15:3; 45:3; 70:3\n"           \
    "offset_deg=50\n"                                                                              \
    "[capture]\nexposures_us=1000;1000;3000;3000;6000;6000\nkeep_exposures=yes\ndark_frames=2\n"

struct rig_told {
    GString *text; /* events, one per line */
};

/* Captures until the session is done or paused, and returns the state. told may be NULL. ret_reason
 * receives the reason of a pause; g_free(). */
enum capture_state radiometry_rig_capture(const char *folder, const char *conf_text,
                                          const char *name, GString *told, char **ret_reason,
                                          GError **error);
void radiometry_rig_remove(const char *path);
