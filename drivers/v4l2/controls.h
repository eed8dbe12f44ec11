/*
 * Sets a camera's controls for measuring: manual exposure, and everything off that changes frames
 * by itself. Every value is read back. Main loop's thread.
 */
#pragma once

#include "node.h"

#include "base/options.h"

struct video_range {
    guint32 id; /* 0: the device has no such control */
    gint64 min, max, step;
};

struct video_controls {
    struct video_range exposure;
    double exposure_unit_us; /* of exposure's values; 0: not known */
    struct video_range gain;
    struct video_range white_balance; /* in kelvin */
};

void video_controls_read(const struct video_node *node, struct video_controls *ret);

/* Which of exposure, gain and white balance the camera lacks, as "gain, white balance"; NULL: none.
 * g_free(). */
char *video_controls_lacking(const struct video_controls *controls);

/* Switches off what alters frames: automatic exposure, gain, white balance, focus, …, gamma,
 * sharpening, effects. An automatic control that the camera has and refuses to switch off is an
 * error. */
gboolean video_controls_by_hand(const struct video_node *node, GError **error);

/* The controls that still alter frames and are not among the settings ("gamma=100") that the rig
 * file asks for, one text each. g_strfreev(). */
char **video_controls_left(const struct video_node *node, char **settings);

/* Sets and reads back; a value that the device changes is an error. */
gboolean video_control_set(const struct video_node *node, guint32 id, gint64 value, GError **error);

/* "brightness=10" with a control's name in lower case, words joined by _; a control that does not
 * exist, or a value out of range, is an error that lists the possible ones. */
gboolean video_control_set_named(const struct video_node *node, const char *setting,
                                 GError **error);

/* The value of a range nearest to a wanted one. */
gint64 video_range_nearest(const struct video_range *range, double wanted);
