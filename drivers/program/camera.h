/*
 * A camera that is a program (program.h). Drivers in other folders that start a program of their
 * own use these functions. The private struct of such a driver begins with a struct program_camera.
 * The driver's open() fills `command` and calls program_camera_open(). The other functions of the
 * struct camera_driver (drivers/camera.h) are functions of this header.
 */
#pragma once

#include "program.h"

#include "drivers/camera.h"

struct program_camera {
    struct program_command command; /* must live until the camera is closed */
    Program *program;
    char *folder;         /* temporary folder into which the program writes its pictures */
    gint64 *exposures_us; /* the list to which camera->format points */
    struct camera_settings settings;
    guint64 shot;
    gint64 triggered_us;
    int n_triggers;    /* number of triggers so far; the tag of the last one */
    gboolean is_asked; /* the last trigger is not answered yet */
};

/* Reads the answer to "open" into *ret. *ret_exposures_us is the list to which ret->exposures_us
 * points, or NULL; free it with g_free(). */
gboolean program_camera_read_format(JsonObject *values, struct camera_format *ret,
                                    gint64 **ret_exposures_us, GError **error);

/* Returns the longest time, in µs, that the program may take to answer "trigger". */
gint64 program_camera_wait_us(const struct camera_format *format, gint64 exposure_us);

/* program_camera_open() makes the folder and starts the program. program_camera_opened() waits for
 * the answer to "open" and sets camera->format. program_camera_close() ends the program and removes
 * the folder with its pictures. */
gboolean program_camera_open(Camera *camera, GError **error);
gboolean program_camera_opened(Camera *camera, GError **error);
void program_camera_close(Camera *camera);
gboolean program_camera_configure(Camera *camera, const struct camera_settings *settings,
                                  GError **error);
gboolean program_camera_arm(Camera *camera, GError **error);
void program_camera_disarm(Camera *camera);
gboolean program_camera_trigger(Camera *camera, guint64 shot, GError **error);
