/* Reads a recording of the messages of devices (docs/build-a-rig/recordings.md). Any thread may
 * call the functions. */
#pragma once

#include <glib.h>

struct recorded_line {
    int number; /* line of the file, from 1 on */
    gint64 at_us;
    /* A line has either a message or note of a bus, or a text of a device.
     *
     * For a message or note, `bus` is the number of the bus, from 1 on. `way` is '>' for a message
     * to the device, '<' for a message from the device, and '-' for a note. `bytes` is the message,
     * or the text of the note. For a text of a device, `bus` and `way` are 0. */
    int bus;
    char way;
    GBytes *bytes;
    char *who, *text; /* for a text of a device: such as "axis turntable" and "move to 5.0000" */
};

struct recorded {
    char *path;
    GPtrArray *kinds; /* of char *: the kind of each bus; element 0 is for bus 1 */
    /* The sections of the rig file. "@1" in the text stands for the place of bus 1. */
    char *sections;
    gboolean from_model;
    GPtrArray *lines; /* of struct recorded_line */
};
typedef struct recorded Recorded;

/* Parses the text of a recording. path is the name of the recording in errors. On failure, returns
 * NULL with G_IO_ERROR_INVALID_DATA. The text of the error begins with path and line. */
Recorded *recorded_parse(const char *text, const char *path, GError **error);
void recorded_free(Recorded *recorded); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Recorded, recorded_free)
