/* Searches all buses of this machine for devices that have a driver. */
#pragma once

#include "drivers/found.h"

#include <glib.h>

/* A Modbus line to search. A member that is NULL or 0 stands for the default of the drivers. */
struct finder_modbus {
    const char *bus; /* "/dev/ttyUSB0" or "tcp:HOST:PORT"; NULL if no line is searched */
    int baud;
    const char *parity; /* "none", "even", "odd" */
    int first, last;    /* range of unit numbers */
};

/* Returns all devices that were found, as struct found. Free the array with g_ptr_array_unref().
 * For a bus that cannot be searched, a sentence is appended to ret_problems, and the search
 * continues with the others. The search takes one or two seconds, and up to 5 s more if libgphoto2
 * does not answer. A Modbus line takes a further tenth of a second for each unit number without a
 * device. Returns NULL with an error if the parity is wrong. */
GPtrArray *finder_scan(const struct finder_modbus *modbus, GPtrArray *ret_problems, GError **error);

/* Asks the G-code board at a serial port which language it speaks (serial/detect.h). *ret_dialect
 * and *ret_baud are the values for the keys `dialect` and `baud` of the board's section.
 * *ret_dialect is a static string. *ret_firmware is freed with g_free(). Opening the port resets
 * most boards. Blocks for at most 7 s. */
gboolean finder_gcode(const char *port, const char **ret_dialect, int *ret_baud,
                      char **ret_firmware, GError **error);

/* Opens the camera that a section of a rig file describes. `section` is the text of the section, as
 * in struct found. Gives the size of the camera's pictures in pixels and their bits per pixel. A
 * still camera takes a picture. Blocks until the camera is open. Returns FALSE with an error if the
 * camera cannot be opened. */
gboolean finder_picture_size(const char *section, int *ret_width, int *ret_height, int *ret_bits,
                             GError **error);
