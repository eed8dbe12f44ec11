/*
 * The settings of a picture, in one table. The options of the command line and the controls of the
 * panel are made from this table. The command that draws the window's picture again is also made
 * from it.
 */
#pragma once

#include "viewer_options.h"

enum setting_kind {
    SETTING_NUMBER, /* double */
    SETTING_WHOLE,  /* int */
    SETTING_FLAG,   /* gboolean */
    SETTING_OTHER,  /* option, control and command have separate code */
};

enum setting_id {
    SETTING_METHOD,
    SETTING_SPLIT,
    SETTING_SPLIT_AT,
    SETTING_DIFFERENCE,
    SETTING_DIFFERENCE_GAIN,
    SETTING_ROTATION,
    SETTING_PLAIN,
    SETTING_NEAREST,
    SETTING_SHAPE,
    SETTING_TILES,
    SETTING_ENDLESS,
    SETTING_SILHOUETTES,
    SETTING_SHADOWS,
    SETTING_FLOOR,
    SETTING_LAYERS,
    SETTING_STRAIGHT,
    SETTING_MDF_VOLUME,
    SETTING_MDF_VIEWS,
    SETTING_ALONG_SURFACE,
    SETTING_SHADOW_MAP,
    SETTING_LIGHT_SIZE,
    SETTING_LIGHT_THETA,
    SETTING_LIGHT_PHI,
    SETTING_LIGHT_BRIGHTNESS,
    SETTING_LIGHT_DISTANCE,
    SETTING_LIGHT_CONE,
    SETTING_LIGHT_INNER,
    SETTING_LAMP,
    SETTING_ENVIRONMENT,
    SETTING_ENVIRONMENT_TURN,
    SETTING_ENVIRONMENT_LAMPS,
    SETTING_BACKDROP,
    SETTING_AMBIENT,
    SETTING_EXPOSURE,
    SETTING_CAMERA_AZIMUTH,
    SETTING_CAMERA_ELEVATION,
    SETTING_CAMERA_DISTANCE,
    SETTING_CAMERA_PAN,
    SETTING_CAMERA_FOV,
    SETTING_MEASURED,
    SETTINGS
};

struct setting {
    const char *option; /* name on the command line, without dashes */
    const char *label;  /* label in the panel; NULL if the setting is not in the panel */
    enum setting_kind kind;
    /* offset of the member in struct viewer_options; unused for SETTING_OTHER */
    gsize offset;
    double low, high;   /* range of the slider */
    const char *format; /* format of the slider, for printf() with a double */
    /* texts of the option in --help; `help` is NULL for SETTING_OTHER */
    const char *argument, *help;
};

extern const struct setting settings_table[SETTINGS]; /* indexed by enum setting_id */

/* Fills ret with the option entries of all rows except SETTING_OTHER. Returns the number of
 * entries. The entries set members of options. ret must have space for SETTINGS entries. The caller
 * must add the entry that ends the list. */
int settings_entries(struct viewer_options *options, GOptionEntry *ret);

/* A picture for settings_command(). `width` and `height` are its size in pixels. `samples` is the
 * number of samples per pixel in each direction. `n_lamps` is the number of further lamps that do
 * not come from the environment. `live`: the picture shows eigen-maps of a session that is still
 * being captured. */
struct settings_picture {
    int width, height, samples, n_lamps;
    gboolean live;
};
/* Returns the command that writes this picture to picture.png, quoted for a shell. Free it with
 * g_free(). */
char *settings_command(const struct viewer_options *options,
                       const struct settings_picture *picture);
