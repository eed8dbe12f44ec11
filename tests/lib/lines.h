/* A rig whose laser, lamps, interlock and axes are virtual Modbus devices. Each device has its own
 * line, so that it can fail independently of the others. Errors in these functions fail the
 * test. */
#pragma once

#include "virtual/modbus.h"

#define LINES_LASER_COIL 3
#define LINES_LAMPS      2

enum line { LASER, BANK, DOOR, TURNTABLE, ARC, SWEEP, N_DEVICES };

#define LINES_DEAD_S 5

/* GONE: the line is closed. SILENT: no request reaches the device, so it does not answer. DEAF:
 * coils do not switch, although the device answers that they do. LOST: the next command is carried
 * out but not answered, and the device does not answer for LINES_DEAD_S after it. */
enum line_failure { GONE, SILENT, DEAF, LOST };

struct lines {
    VirtualModbus *devices[N_DEVICES]; /* NULL after GONE */
    GString *text;                     /* of the rig file */
    const char *world;                 /* file of the camera's world */
};

extern const char *const lines_names[N_DEVICES]; /* names as in messages */
extern const char *const lines_failures[];       /* names of the failures, by enum line_failure */

gboolean lines_is_axis(enum line line); /* axes are on serial lines, other devices on TCP */
/* Returns the number of failures that apply to a line, which are the first ones of enum
 * line_failure. Axes and inputs have no light, so DEAF and LOST do not apply to them. */
int lines_n_failures(enum line line);

/* Opens the devices, with the interlock closed, and writes the rig file to text. */
void lines_open(struct lines *lines, const char *world);
void lines_close(struct lines *lines);

VirtualModbus *lines_new_device(gboolean rtu); /* virtual_modbus_free() */
void lines_write(struct lines *lines);         /* makes `text` again from the present devices */
void lines_fail(struct lines *lines, enum line line, enum line_failure how);
/* Ends SILENT, DEAF and LOST. */
void lines_repair(struct lines *lines, enum line line);
/* Returns the time of g_get_monotonic_time() at which the line is usable again after LOST. Returns
 * 0 if no command has arrived yet. */
gint64 lines_usable_us(const struct lines *lines, enum line line);
gboolean lines_has_light(VirtualModbus *device);
