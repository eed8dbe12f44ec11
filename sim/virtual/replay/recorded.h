/* Reads a recording of what devices have said (docs/build-a-rig/recordings.md). Any thread
 * may call the functions. */
#pragma once

#include <glib.h>

struct recorded_line {
    int number; /* line of the file, from 1 on */
    gint64 at_us;
    /* For a message or a note, `bus` is the number of the bus, from 1 on. `way` is '>' for a
     * message to the device, '<' for a message from the device, and '-' for a note. `bytes` is the
     * message, or the text of the note. For a line of a device, `bus` and `way` are 0. */
    int bus;
    char way;
    GBytes *bytes;
    char *who, *text; /* for a line of a device, such as "axis turntable" and "move to 5.0000" */
};

struct recorded {
    char *path;
    GPtrArray *kinds; /* of char *: the kind of bus 1 is the first */
    char *sections; /* the sections of the rig file, in which "@1" stands for the place of bus 1 */
    gboolean from_model;
    GPtrArray *lines; /* of struct recorded_line */
};
typedef struct recorded Recorded;

/* Parses the text of a recording. path is the name of the recording in errors. Returns NULL on
 * failure, with G_IO_ERROR_INVALID_DATA and an error that begins with path and line. */
Recorded *recorded_parse(const char *text, const char *path, GError **error);
void recorded_free(Recorded *recorded); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Recorded, recorded_free)
