/* The text of a first rig file, for `mesorig new-rig`. */
#pragma once

#include <glib.h>

/* In the order of new_rig_kinds. */
enum new_rig_kind {
    NEW_RIG_DOME,      /* fixed lamps in a dome, and one camera overhead; nothing moves */
    NEW_RIG_TURNTABLE, /* a turntable under fixed lamps in two rings, and fixed cameras */
    NEW_RIG_ARC,       /* a turntable under an arc that turns and carries the lamps */
    NEW_RIG_KINDS,
};
extern const char *const new_rig_kinds[]; /* their names, NULL-terminated */

/* A way to operate axes, lamps or cameras. */
struct new_rig_way {
    const char *name;
    /* The question for the place of the device, and the usual answer. `question` is NULL if there
     * is no such question. The place of a program is its path and its arguments, separated by
     * “;”. */
    const char *question, *usual;
    int max_lamps; /* maximum number of lamps of one device; only in new_rig_banks */
};

/* The enums below are indices of the tables new_rig_axes, new_rig_banks and new_rig_cameras. Each
 * table ends with a name of NULL. */
enum new_rig_axes { NEW_RIG_TIC, NEW_RIG_GCODE, NEW_RIG_AXIS_PROGRAM };
enum new_rig_bank {
    NEW_RIG_RELAYS,
    NEW_RIG_SERIAL, /* an LED controller on a serial port */
    NEW_RIG_ARTNET,
    NEW_RIG_SACN,
    NEW_RIG_WLED, /* the place may have a port: 10.0.0.7:8080 */
    NEW_RIG_LAMP_PROGRAM,
};
enum new_rig_camera { NEW_RIG_FOUND, NEW_RIG_STILL, NEW_RIG_CAMERA_PROGRAM };
extern const struct new_rig_way new_rig_axes[], new_rig_banks[], new_rig_cameras[];

#define NEW_RIG_MIN_RADIUS_MM 10.0
#define NEW_RIG_MAX_RADIUS_MM 10000.0

struct new_rig {
    const char *id; /* name of the rig, not empty */
    enum new_rig_kind kind;
    int n_lamps; /* 1 to max_lamps of the bank */
    double radius_mm;
    enum new_rig_axes axes;
    enum new_rig_bank bank;
    enum new_rig_camera camera;
    /* Places of the devices. An empty place of NEW_RIG_SACN means multicast. */
    const char *axes_at, *bank_at, *camera_at;
    /* What the G-code board at axes_at has answered to a question for its language. dialect is NULL
     * if the board was not asked, and “” if it did not answer. */
    const char *dialect, *firmware;
    int baud;
    /* The file with the positions of the lamps (rig/lamp_places.h), or NULL. If `far` is TRUE, the
     * file has only directions, and radius_mm is the assumed distance of the lamps. */
    const char *positions;
    gboolean far;
    /* Size of the pictures of the camera at camera_at in pixels, and number of bits of a pixel.
     * Each is 0 if it is not known. */
    int width, height, bits;
};

/* Returns the usual number of lamps of a kind. */
int new_rig_lamps(enum new_rig_kind kind);

/* Returns the section of the camera at camera_at, in the form of struct found. Returns NULL for
 * NEW_RIG_FOUND. Free the text with g_free(). */
char *new_rig_camera(const struct new_rig *rig);

/* Returns a rig file that can be read without a mistake. The devices are taken from `found` (of
 * struct found). A device that was not found gets a section with an invented address, and a line
 * about it, such as “a camera, for [camera cam]”, is appended to `missing` (of char *, with a free
 * function). Free the result with g_free(). */
char *new_rig_text(const struct new_rig *rig, const GPtrArray *found, GPtrArray *missing);
