/*
 * Makes a GenICam camera deliver raw values. This module switches off the functions that alter a
 * frame between the camera's converter and the wire, under all the names that makers give them. The
 * table of names is in raw.c. The calls block and belong to the thread that made the device.
 */
#pragma once

#include <arv.h>

/* A function that the camera has, such as gamma. */
struct aravis_raw {
    const char *what;   /* "gamma" */
    const char *effect; /* its effect on measured values, as a full sentence for messages */
    /* Name of the feature that has switched the function off. If the function is not off, name of
     * the first feature that could switch it off. The name includes the position of the feature's
     * selector: "LUTEnable[Luminance]". */
    char *feature;
    char *value; /* the present value of that feature */
    char *why;   /* reason why the function is not off; NULL if it is off */
    /* While the function is on, the same light gives different values from frame to frame. */
    gboolean unsteady;
};

/* Returns an array of struct aravis_raw, one for each function of the table that the camera has and
 * that can be in use with its present settings. Free the array with g_ptr_array_unref(). If
 * switch_off is TRUE, each function is switched off first, and every value is read back. Selectors
 * keep their positions. A setting that the camera refuses is not an error. Returns NULL with
 * DEVICE_ERROR if the camera no longer answers. */
GPtrArray *aravis_raw_survey(ArvDevice *device, gboolean switch_off, GError **error);

/* For the program genicam_files, which examines files of cameras. Returns the switches and choices
 * that are not off and not in the table, but whose names suggest that they alter frames. Each is
 * written as "NAME = VALUE". Free the result with g_strfreev(). */
char **aravis_raw_unknown(ArvDevice *device);
