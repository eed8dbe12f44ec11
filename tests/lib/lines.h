/* A rig whose laser, lamps, interlock and axes are virtual Modbus devices, each on a line of its
 * own, so that each can fail alone. What goes wrong in here fails the test. */
#pragma once

#include "virtual/modbus.h"

#define LINES_LASER_COIL 3
#define LINES_LAMPS      2

enum line { LASER, BANK, DOOR, TURNTABLE, ARC, SWEEP, N_DEVICES };

/* A closed line, no answer, and coils that do not switch although the device answers that they do.
 */
enum line_failure { GONE, SILENT, DEAF };

struct lines {
    VirtualModbus *devices[N_DEVICES]; /* NULL: gone */
    GString *text;                     /* of the rig file */
    const char *world;                 /* file of the camera's world */
};

extern const char *const lines_names[N_DEVICES]; /* as messages name them */
extern const char *const lines_failures[];       /* their names */

gboolean lines_is_axis(enum line line); /* it is on a serial line then, the others on TCP */
int lines_n_failures(enum line line);   /* axes and inputs have no coil to be deaf with */

/* Opens the devices, with the interlock closed, and writes the text. */
void lines_open(struct lines *lines, const char *world);
void lines_close(struct lines *lines);

VirtualModbus *lines_new_device(gboolean rtu); /* virtual_modbus_free() */
void lines_write(struct lines *lines);         /* the text again */
void lines_fail(struct lines *lines, enum line line, enum line_failure how);
gboolean lines_has_light(VirtualModbus *device);
