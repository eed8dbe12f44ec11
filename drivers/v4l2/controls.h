/*
 * Sets the controls of a camera for measuring: the exposure is manual, and everything is off that
 * changes frames automatically. Every value is read back. The functions belong to the main loop's
 * thread.
 */
#pragma once

#include "node.h"

#include "base/options.h"

struct video_range {
    guint32 id; /* 0 if the device has no such control */
    gint64 min, max, step;
};

struct video_controls {
    struct video_range exposure;
    double exposure_unit_us; /* unit of the values of exposure, in µs; 0 if it is not known */
    struct video_range gain;
    struct video_range white_balance; /* in kelvin */
};

/* Reads the ranges of the controls. A control that can only be read counts as lacking. */
void video_controls_read(const struct video_node *node, struct video_controls *ret);

/* Returns the names of the controls among exposure, gain and white balance that the camera lacks,
 * as "gain, white balance". Returns NULL if none is missing. Free it with g_free(). */
char *video_controls_lacking(const struct video_controls *controls);

/* Switches off what alters frames: automatic exposure, gain, white balance, focus and so on, gamma,
 * sharpening and effects. Fails if the camera refuses to switch off a control that changes values
 * from frame to frame, or if the camera was unplugged. */
gboolean video_controls_by_hand(const struct video_node *node, GError **error);

/* Returns one text for each control that still alters frames, or that may alter them because no
 * value without effect is known. `settings` contains the settings of the rig file, such as
 * "gamma=100"; the controls that they set are left out. Free the result with g_strfreev(). */
char **video_controls_left(const struct video_node *node, char **settings);

/* Sets a control and reads it back. Fails if the device refuses the value or has changed it. A
 * control that can only be written is not read back. */
gboolean video_control_set(const struct video_node *node, guint32 id, gint64 value, GError **error);

/* Sets a control from a text such as "brightness=10". The name is in lower case, with words
 * joined by _. If the control does not exist or the value is out of range, the error lists the
 * possible names or values. */
gboolean video_control_set_named(const struct video_node *node, const char *setting,
                                 GError **error);

/* Returns the value of a range, in whole steps, that is nearest to the wanted value. */
gint64 video_range_nearest(const struct video_range *range, double wanted);
