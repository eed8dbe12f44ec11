/*
 * Raw values from a GenICam camera: switches off the functions that alter a frame between the
 * camera's converter and the wire, under all the names that makers give them. The table of names is
 * in raw.c. Calls block: for the thread that made the device.
 */
#pragma once

#include <arv.h>

/* A function that the camera has, such as gamma. */
struct aravis_raw {
    const char *what;   /* "gamma" */
    const char *effect; /* its effect on measured values: a full sentence for messages */
    char *feature;      /* that switched it off, else the first that could; with the position of its
                         * selector: "LUTEnable[Luminance]" */
    char *value;        /* the present value of that feature */
    char *why;          /* NULL: it is off; else why it is not */
    gboolean unsteady;  /* while it is on, the same light gives other values from frame to frame */
};
void aravis_raw_free(struct aravis_raw *raw);

/* Returns all functions of the table that the camera has and that can be in use with its present
 * settings, as struct aravis_raw, to be freed with g_ptr_array_unref(). switch_off: each is
 * switched off first, and every value is read back. Selectors are left where they were. A setting
 * that the camera refuses is no error; NULL with DEVICE_ERROR if the camera no longer answers. */
GPtrArray *aravis_raw_survey(ArvDevice *device, gboolean switch_off, GError **error);

/* Switches and choices whose names sound like such a function, but that the table lacks, and that
 * are not off: as "NAME = VALUE". g_strfreev(). */
char **aravis_raw_unknown(ArvDevice *device);
