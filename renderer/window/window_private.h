/* Shared by the files of the window. */
#pragma once

#include "live.h"
#include "opener.h"
#include "scene/measured.h"
#include "ui.h"
#include "window.h"

#include "gl/gpu.h"

#define WINDOW_BINS 64

struct GLFWwindow;

struct window {
    struct GLFWwindow *glfw;
    const struct viewer_options *options;
    const struct environment *environment; /* or NULL */
    Ui *ui;
    Compose *compose;
    struct gpu_target scene; /* the picture without the panel */
    Viewer *viewer, *second;
    const struct method *method, *second_method;
    struct compose how;
    struct viewer_settings settings;
    struct mesh *mesh;
    const char *shape;
    char *session; /* directory, or NULL */
    char *material, *second_material;
    char *message; /* the last error, or NULL */
    char *title;   /* the present title of the window */
    double x, y;   /* of the mouse */
    double frame_ms;
    float histogram[3 * WINDOW_BINS];
    gboolean stale;       /* must be drawn again */
    int frames_due;       /* in which the panel follows what has happened */
    gboolean panel, help; /* shown */
    gint64 file_time,
        asked_time; /* of the file that is shown, and of the one that is being opened */
    gint64 mdf_time, looked_us, views_us;
    int n_screenshots;
    Live *live; /* NULL: there is nothing to follow */
    int n_live;
    struct eigenmaps *live_maps; /* the last that came; NULL: none yet */
    GArray *planned;             /* of struct planned_view, or NULL */
    Opener *opener;
    gboolean first_open;           /* the material given at the start was opened, or has failed */
    enum compose_mode second_mode; /* once what is being opened as the second is there */
    gboolean outlines;             /* silhouettes, once the MDF is there */
    struct mdf_source *mdf;        /* NULL: none was opened */
    gboolean show_measured;
    struct measured measured;
    guint measured_texture;
};

/* window_source.c: what is shown. Errors become the message, and what was shown stays. */
void window_say(struct window *w, const char *message); /* NULL: nothing is wrong */
void window_set_method(struct window *w, const struct method *method);
void window_set_second(struct window *w, const struct method *method, enum compose_mode mode);
void window_set_shape(struct window *w, const char *shape, const struct viewer_settings *tiles);
void window_scale_tiles(struct window *w, double factor);
gboolean window_set_environment(const struct window *w, Viewer *viewer, GError **error);
void window_toggle_backdrop(struct window *w);
void window_toggle_silhouettes(struct window *w);
void window_compare_measured(struct window *w);
void window_follow(struct window *w); /* once a second looks at the files */
void window_open_first(struct window *w);
/* Takes materials opened meanwhile. FALSE: the one given at the start cannot be opened. */
gboolean window_take_opened(struct window *w, GError **error);
void window_clear_sources(struct window *w);

/* Of the panel, after an event: its windows take their size from what the frame before had in them.
 */
#define WINDOW_FRAMES 3

/* window_input.c */
extern const char window_help[];
void window_listen(struct window *w);
void window_screenshot(struct window *w);

/* window_panel.c */
void window_panel(struct window *w);

/* window.c */
gboolean window_save(struct window *w, const char *path, GError **error);
