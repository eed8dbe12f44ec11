/* The command line of mesorig-view. */
#pragma once

#include "scene/compose.h"
#include "series.h"
#include "shapes/scene.h"
#include "shapes/scene_parts.h"

struct viewer_options {
    const struct method *method;
    char *method_name;
    /* `mdf` is the argument of --mdf as given. `mdf_path` is the path of the file that is read.
     * This file may not exist. */
    char *mdf, *mdf_path;
    /* `index` is the argument of --index as given: a file or the directory of a session.
     * `index_path` is the path of the file. */
    char *index, *index_path;
    /* normal map for methods that accept one; NULL keeps the normals of the method */
    char *normal_map;
    char *render, *shape, *size, *tiles, *up, *screenshot;
    char *environment;
    char **materials; /* as given */
    struct scene_binding bindings[VIEWER_MAX_MATERIALS - 1];
    int n_bindings;
    /* names of the second method, as given by --split or by --difference; at least one of them is
     * NULL */
    char *split, *difference;
    const struct method *second;
    struct compose compose;
    enum scene_up upward;                /* parsed from up */
    gboolean measured, live, with_panel; /* options of these names */
    gint64 started_us;                   /* g_get_monotonic_time() at the start of the program */
    char *series_text;                   /* the text of --series as given */
    int series[SERIES_MAX], n_series;    /* n_series percentages of the planned views */
    double wait_s;                       /* longest time in s without a new view in a series */
    /* Numbers as given, or 0: `frames` is the number of pictures, `close_after` the number of
     * frames after which the window closes, `supersample` the number of samples of a pixel in each
     * direction, and `sheet` the number of columns of a sheet. */
    int frames, close_after, supersample, sheet;
    gboolean floor, reference, light_turn, camera_turn, json, sample, force;
    struct viewer_settings settings;
    char **rest; /* arguments that are not options */
    /* MATERIAL: the directory of a session, or a file. NULL if the method needs none. */
    const char *argument;
    int width, height; /* of a picture, or of the window; parsed from size */
};

/* Initializes options before parsing. */
void viewer_options_init(struct viewer_options *options);

/* Sets the brightness of the first lamp and of the even sky to their defaults. The defaults are 0
 * if `environment` is TRUE. */
void viewer_options_default_light(struct viewer_settings *settings, gboolean environment);

/* Returns the entries of an option group. The data of this group must be the options. Free the
 * entries with g_free(). */
GOptionEntry *viewer_options_entries(struct viewer_options *options);

/* Sets defaults, and checks that no options are given that exclude each other. Call this function
 * after parsing. The error names the options. */
gboolean viewer_options_check(struct viewer_options *options, GError **error);
void viewer_options_clear(struct viewer_options *options);

/* Returns the number of rows of the sheet, or 1 without --sheet. */
int viewer_options_sheet_rows(const struct viewer_options *options);

/* Returns the material of --sample. It comes with the package, or is the material of the demo in a
 * source tree. Returns NULL if neither exists. */
const char *viewer_options_sample(void);

/* Returns the path of the file that a method opens. */
char *viewer_options_path(const struct viewer_options *options, const struct method *method);

/* Returns the path of the index map of --index. The argument of --index may be a file or the
 * directory of a session. Returns NULL if --index was not given. Free it with g_free(). */
char *viewer_options_index(const struct viewer_options *options);

/* Returns whether --render writes linear light (.exr). Otherwise it writes a picture with a tone
 * curve (.png). */
gboolean viewer_options_light(const struct viewer_options *options);
