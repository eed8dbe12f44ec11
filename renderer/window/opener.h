/*
 * Opens files in the background of a window. A thread reads a file and uploads it in a second GL
 * context, which shares textures with the context of the window. Meanwhile the window continues to
 * draw. Jobs run one after the other, in the order of the calls of opener_ask().
 */
#pragma once

#include "codecs/mdf_codecs/mdf_source.h"
#include "drawing/methods/method.h"
#include "scene/environment.h"

/* What a file is opened for: the first material, the second material (with which the first is
 * compared), the MDF, or the environment. */
enum opener_place { OPENER_FIRST, OPENER_SECOND, OPENER_MDF, OPENER_ENVIRONMENT, OPENER_PLACES };

/* The result of a job, or its error. */
struct opened {
    enum opener_place place;
    const struct method *method; /* only for OPENER_FIRST and OPENER_SECOND */
    char *path;
    /* for OPENER_FIRST and OPENER_SECOND: material of the method; NULL with an error */
    gpointer material;
    struct mdf_source *mdf;          /* only for OPENER_MDF; NULL with an error */
    struct environment *environment; /* only for OPENER_ENVIRONMENT; NULL with an error */
    GError *error;
    gint number; /* number of the request */
};

typedef struct Opener Opener; /* belongs to the thread of the window */
struct GLFWwindow;

/* Makes an opener. The context of the window is current before and after the call. */
Opener *opener_new(struct GLFWwindow *window, GError **error);
/* Cancels all jobs and frees the opener. Waits for the job under way, which ends when the next
 * piece of its file has been read. NULL is ignored. */
void opener_free(Opener *opener);

/* Requests to open a file for a place. Cancels and replaces an earlier request for this place.
 * method must be NULL for places other than OPENER_FIRST and OPENER_SECOND. */
void opener_ask(Opener *opener, enum opener_place place, const struct method *method,
                const char *path);

/* Cancels the request for this place. */
void opener_cancel(Opener *opener, enum opener_place place);

/* Returns the next finished job, or NULL if there is none. Does not wait. Jobs that were cancelled
 * or replaced are not returned. A job that finishes wakes the loop of the window.
 *
 * The caller owns the job. A caller that takes ownership of a member must set this member to NULL.
 */
struct opened *opener_poll(Opener *opener);
void opened_free(struct opened *opened); /* NULL is ignored */

gboolean opener_is_busy(const Opener *opener);

/* Returns the progress of the running job as text for the user, or NULL if no job is running. Free
 * it with g_free(). */
char *opener_progress(const Opener *opener);
