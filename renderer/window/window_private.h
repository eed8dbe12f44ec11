/* The state of the window, and the functions that the files window*.c call in each other. */
#pragma once

#include "chooser.h"
#include "drawing/methods/methods.h"
#include "live.h"
#include "opener.h"
#include "scene/file_kind.h"
#include "scene/measured.h"
#include "settings.h"
#include "ui.h"
#include "window.h"

#include "drawing/gl/gpu.h"

#define WINDOW_BINS 64

struct GLFWwindow;

/* A dialog over the picture. Only one is open at a time. */
enum window_page { WINDOW_NO_PAGE, WINDOW_START, WINDOW_KEYS, WINDOW_FILES };

struct window {
    struct GLFWwindow *glfw;
    const struct viewer_options *start; /* options with which the program was started */
    /* The settings, methods and files of the picture that is shown. The strings belong to `start`
     * or to `texts`, and exist as long as the window. */
    struct viewer_options now;
    GStringChunk *texts;
    Ui *ui;
    Compose *compose;
    struct gpu_target scene; /* the picture without the panel */
    /* Aspect (width / height) of the picture to which the camera's distance was fitted; 0 if no
     * picture was drawn yet. */
    double aspect;
    Viewer *viewer, *second; /* `second` is NULL until a second material has been opened */
    struct mesh *mesh;
    /* The shape that was given at the start or opened later: a file, or the name of a computed
     * shape. */
    const char *own_shape;
    char *session; /* directory of the session, or NULL */
    /* Paths of the files that are shown. While a method that needs no file is shown, `material` is
     * the name of that method. */
    char *material, *second_material;
    char *message;                    /* sentence that is shown to the user, or NULL */
    gboolean is_error;                /* message is an error, which stays until it is closed */
    char *title;                      /* the present title of the window */
    double x, y;                      /* position of the mouse */
    double frame_ms;                  /* time that the last picture took */
    float histogram[3 * WINDOW_BINS]; /* of the picture; see ui_histogram() */
    gboolean stale;                   /* the picture must be drawn again */
    int frames_due;                   /* number of frames still to be drawn after an event */
    gboolean panel;                   /* the panel is unfolded */
    enum window_page page;
    /* Position and size of the window before full screen: x, y, width, height. */
    int before_full_screen[4];
    /* Modification times in µs of three files: `file_time` of the file that is shown, `asked_time`
     * of the file that is being opened, and `mdf_time` of the MDF. */
    gint64 file_time, asked_time, mdf_time;
    gint64 looked_us; /* time at which window_follow() last checked the files */
    Live *live; /* computes eigen-maps of a session that is being captured; NULL if there is none */
    int n_live; /* number of views of live_maps */
    struct eigenmaps *live_maps; /* the latest eigen-maps of live; NULL if there are none yet */
    GArray *planned;             /* of struct planned_view, or NULL */
    Opener *opener;
    /* MATERIAL that is being opened. NULL stands for the MATERIAL of `now`. */
    const char *asked_argument;
    /* the material given at the start has been opened, or could not be opened */
    gboolean first_open;
    enum compose_mode second_mode; /* mode that is set when the second material has been opened */
    gboolean outlines;             /* silhouettes are switched on when the MDF has been opened */
    struct mdf_source *mdf;        /* NULL if none was opened */
    gboolean show_measured; /* the panel shows `measured`; its picture is in `measured_texture` */
    struct measured measured;
    guint measured_texture;          /* 0 until a frame has been compared */
    struct environment *environment; /* NULL if there is none */
    /* path of the environment map that was opened last, or NULL */
    const char *own_environment;
    /* Number of further lamps that do not come from the environment. */
    int n_lamps;
    /* The chosen lamp: 0 is the first lamp, 1 … n_lamps are further lamps, and n_lamps + 1 is the
     * environment. */
    int lamp;
    Chooser *chooser;
    enum chooser_what chooser_what; /* what the last dialog was opened for */
    struct window_files *files;     /* list of WINDOW_FILES */
    GPtrArray *recent;              /* list of WINDOW_START */
};

/* window_source.c: changes the materials, the MDF and the environment of the picture. If something
 * cannot be opened, the window shows a message, and the picture stays as it was. */
void window_set_method(struct window *w, const struct method *method);
void window_set_second(struct window *w, const struct method *method, enum compose_mode mode);
void window_toggle_silhouettes(struct window *w);
void window_compare_measured(struct window *w);
void window_follow(struct window *w); /* checks at most once a second whether files have changed */
void window_ask_material(struct window *w, const char *argument, const struct method *method);
void window_ask_mdf(struct window *w, const char *path);
void window_ask_environment(struct window *w, const char *name);
/* Shows a session that is being captured: first a material that needs no file, then eigen-maps of
 * the session's views. */
void window_watch_session(struct window *w, const char *session);
/* Shows files that the opener has opened since the last call. Returns FALSE with an error if a file
 * given at the start cannot be opened and the window has to close because of this (close_after). */
gboolean window_take_opened(struct window *w, GError **error);
void window_clear_sources(struct window *w);

/* window_open.c: opens a file that the user has chosen. */
void window_open(struct window *w, const char *path);
void window_open_first(struct window *w);
/* Replaces the mesh by that of a shape. If tiles is not NULL, the numbers of tiles are those of
 * these settings. Otherwise they are those of the shape. */
void window_set_shape(struct window *w, const char *shape, const struct viewer_settings *tiles);
void window_scale_tiles(struct window *w, double factor);
void window_ask_file(struct window *w, enum chooser_what what); /* opens a dialog */
void window_follow_chooser(struct window *w);

/* window_lamps.c */
/* Makes the environment's lamps again, after a change of the environment or of n_lamps. */
void window_relight(struct window *w);
void window_set_environment(struct window *w, struct environment *environment, const char *name);
void window_add_lamp(struct window *w);
void window_remove_lamp(struct window *w);
void window_move_lamp(struct window *w, double by_theta_deg, double by_phi_deg);
void window_toggle_backdrop(struct window *w);
void window_draw_lamps(struct window *w); /* draws the panel's part for lamps */

/* The number of frames that are drawn after an event. Several frames are needed, because a window
 * of controls takes its size from the contents that it had in the frame before. */
#define WINDOW_FRAMES 3

/* window_input.c */
struct window_key {
    const char *keys, *does;
};
extern const struct window_key window_keys[]; /* ends with NULL */
void window_listen(struct window *w);

/* window_panel.c */
#define WINDOW_PANEL 300.0F /* width of the panel, multiplied by ui_scale() */
void window_draw_panel(struct window *w, struct ui_box box);
/* Draws the control of a setting. If the user has changed the setting, returns TRUE, and the
 * picture will be drawn again. */
gboolean window_draw_setting(struct window *w, enum setting_id id);

/* window_pages.c: dialogs, and the line of text at the bottom. */
/* Shows an error and also prints it on stderr. NULL removes the message. */
void window_say(struct window *w, const char *error);
void window_tell(struct window *w, const char *sentence);
void window_show_page(struct window *w, enum window_page page);
void window_draw_pages(struct window *w, struct ui_box picture);

/* window_files.c: a list of folders and files, for desktops without a dialog. */
void window_files_begin(struct window *w, enum chooser_what what, const char *folder,
                        const char *name);
void window_files_enter(struct window *w); /* call it when Enter was pressed */
void window_files_draw(struct window *w, struct ui_box picture);
void window_files_clear(struct window *w);

/* window_save.c */
/* Saves the picture. If force is TRUE, an existing file is replaced, because the user has agreed to
 * this. */
gboolean window_save(struct window *w, const char *path, gboolean force, GError **error);
/* Saves the picture like window_save(), and shows the path or the error to the user. */
void window_save_named(struct window *w, const char *path, gboolean force);
void window_screenshot(struct window *w); /* saves the picture under the next free name */
/* Returns the next free name for a picture, without its folder. *ret_folder receives the folder.
 * Free both with g_free(). */
char *window_picture_name(const struct window *w, char **ret_folder);
void window_copy_command(struct window *w);

/* window.c: draws the picture and the panel into the window's back buffer. */
void window_paint(struct window *w);
/* Returns whether the panel is unfolded and the window is wide enough for it. */
gboolean window_has_panel(const struct window *w);
