/* The text of a first rig file, for `mesorig new-rig`. */
#pragma once

#include <glib.h>

/* In the order of new_rig_kinds. */
enum new_rig_kind {
    NEW_RIG_DOME,      /* fixed lamps in a dome, and one camera overhead; nothing moves */
    NEW_RIG_TURNTABLE, /* a turntable under fixed lamps, in two rings, and fixed cameras */
    NEW_RIG_ARC,       /* a turntable under an arc that turns and carries the lamps */
    NEW_RIG_KINDS,
};
extern const char *const new_rig_kinds[]; /* their names, NULL-terminated */

/* Maximum number of lamps: the bank is one board on a Modbus line. */
#define NEW_RIG_MAX_LAMPS     64
#define NEW_RIG_MIN_RADIUS_MM 10.0
#define NEW_RIG_MAX_RADIUS_MM 10000.0

struct new_rig {
    const char *id; /* name of the rig, not empty */
    enum new_rig_kind kind;
    int n_lamps; /* 1 to NEW_RIG_MAX_LAMPS */
    double radius_mm;
};

/* Returns the usual number of lamps of a kind. */
int new_rig_lamps(enum new_rig_kind kind);

/* Returns a rig file that can be read without a mistake. The devices are those of found (of struct
 * found). A device that is not found gets a section with an invented address, and a line about it,
 * such as “a camera, for [camera cam]”, is appended to missing (of char *, with a free function).
 * Free the result with g_free().
 */
char *new_rig_text(const struct new_rig *rig, const GPtrArray *found, GPtrArray *missing);
