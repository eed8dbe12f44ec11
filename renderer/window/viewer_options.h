/* The command line of mesorig-view. */
#pragma once

#include "scene/compose.h"
#include "series.h"
#include "shapes/scene.h"
#include "shapes/scene_parts.h"

struct viewer_options {
    const struct method *method;
    char *method_name;
    char *mdf, *mdf_path;     /* as given, and what is read; the file need not be there */
    char *index, *index_path; /* index map as given: a file or a session's directory; its file */
    char *normal_map;         /* for methods that take one; NULL: their own */
    char *render, *shape, *size, *tiles, *up, *screenshot;
    char *environment;
    char **materials; /* as given */
    struct scene_binding bindings[VIEWER_MAX_MATERIALS - 1];
    int n_bindings;
    char *split, *difference; /* names of a second method */
    const struct method *second;
    struct compose compose;
    enum scene_up upward;
    gboolean measured, live, with_panel;
    gint64 started_us; /* the program */
    char *series_text;
    int series[SERIES_MAX], n_series; /* percentages of the views */
    double wait_s;
    int frames, close_after, supersample, sheet;
    gboolean floor, reference, along_surface, light_turn, camera_turn, json, version, sample, force;
    struct viewer_settings settings;
    char **rest;
    const char
        *argument; /* MATERIAL: a session's directory or a file; NULL: the method needs none */
    int width, height;
};

/* Before parsing. */
void viewer_options_init(struct viewer_options *options);

/* The brightness of the first lamp and of the even sky where none is given. */
void viewer_options_default_light(struct viewer_settings *settings, gboolean environment);

/* For an option group whose data are the options; g_free(). */
GOptionEntry *viewer_options_entries(struct viewer_options *options);

/* To be called after parsing: sets defaults; if options exclude each other, the error says
 * which. */
gboolean viewer_options_check(struct viewer_options *options, GError **error);
void viewer_options_clear(struct viewer_options *options);

int viewer_options_sheet_rows(const struct viewer_options *options);

/* The material of --sample: that of the package, or the demo of a source tree; NULL: neither is
 * there. */
const char *viewer_options_sample(void);

/* Path of the file that a method opens. */
char *viewer_options_path(const struct viewer_options *options, const struct method *method);

/* The file of --index, which may name a session's directory; NULL: none was given. g_free() */
char *viewer_options_index(const struct viewer_options *options);

/* Whether --render writes linear light (.exr) and not a toned picture (.png). */
gboolean viewer_options_light(const struct viewer_options *options);
