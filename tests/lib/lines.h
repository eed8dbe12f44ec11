/* A rig whose laser, lamps, interlock and axes are virtual Modbus devices, each on a line of its
 * own, so that each can fail only. What goes wrong in here fails the test. */
#pragma once

#include "virtual/modbus.h"

#define LINES_LASER_COIL 3
#define LINES_LAMPS      2

enum line { LASER, BANK, DOOR, TURNTABLE, ARC, SWEEP, N_DEVICES };

#define LINES_DEAD_S 5

/* A closed line; no answer; coils that do not switch although the device answers that they do; and
 * from the next command on, which is carried out, no answer for LINES_DEAD_S. */
enum line_failure { GONE, SILENT, DEAF, LOST };

struct lines {
    VirtualModbus *devices[N_DEVICES]; /* NULL: gone */
    GString *text;                     /* of the rig file */
    const char *world;                 /* file of the camera's world */
};

extern const char *const lines_names[N_DEVICES]; /* as messages name them */
extern const char *const lines_failures[];       /* their names */

gboolean lines_is_axis(enum line line); /* it is on a serial line then, the others on TCP */
int lines_n_failures(enum line line);   /* axes and inputs have no light: neither DEAF nor LOST */

/* Opens the devices, with the interlock closed, and writes the text. */
void lines_open(struct lines *lines, const char *world);
void lines_close(struct lines *lines);

VirtualModbus *lines_new_device(gboolean rtu); /* virtual_modbus_free() */
void lines_write(struct lines *lines);         /* the text again */
void lines_fail(struct lines *lines, enum line line, enum line_failure how);
/* The end of SILENT, DEAF and LOST. */
void lines_repair(struct lines *lines, enum line line);
/* When the line was or will be usable again after LOST, of g_get_monotonic_time(); 0: the command
 * has not come yet. */
gint64 lines_usable_us(const struct lines *lines, enum line line);
gboolean lines_has_light(VirtualModbus *device);
