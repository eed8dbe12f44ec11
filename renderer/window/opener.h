/*
 * Opens materials in the background of a window: a thread reads the file and uploads it in a GL
 * context of its own, which shares textures with the window's, while the window goes on drawing.
 * Jobs run one after the other, in the order of opener_ask().
 */
#pragma once

#include "mdf_codecs/mdf_source.h"
#include "methods/method.h"
#include "scene/environment.h"

enum opener_place { OPENER_FIRST, OPENER_SECOND, OPENER_MDF, OPENER_ENVIRONMENT, OPENER_PLACES };

/* The result of opening a material for a place, or the error. */
struct opened {
    enum opener_place place;
    const struct method *method; /* of OPENER_FIRST and OPENER_SECOND */
    char *path;
    gpointer material; /* of the method; NULL with an error */
    struct mdf_source *mdf;
    struct environment *environment;
    GError *error;
    gint number; /* number of the request */
};

typedef struct Opener Opener; /* belongs to the thread of the window */
struct GLFWwindow;

/* The window's context is current before and after. */
Opener *opener_new(struct GLFWwindow *window, GError **error);
/* Ends the job under way as soon as the next piece of its file is read; NULL is ignored. */
void opener_free(Opener *opener);

/* Cancels and replaces an earlier request for this place. method: NULL for places other than
 * OPENER_FIRST and OPENER_SECOND. */
void opener_ask(Opener *opener, enum opener_place place, const struct method *method,
                const char *path);

/* Cancels the request for this place. */
void opener_cancel(Opener *opener, enum opener_place place);

/* Returns at once: NULL, or the next finished job, owned by the caller, who sets to NULL each
 * member that it takes out of it. A finished job wakes the window's loop. */
struct opened *opener_poll(Opener *opener);
void opened_free(struct opened *opened); /* NULL is ignored */

gboolean opener_is_busy(const Opener *opener);

/* Progress of the job under way as text for the user, g_free(); NULL if there is none. */
char *opener_progress(const Opener *opener);
