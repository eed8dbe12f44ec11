/*
 * The desktop's dialog for files, by its portal (org.freedesktop.portal.FileChooser) on the session
 * bus, without a toolkit. Belongs to the thread of the default main context, which chooser_poll()
 * iterates; nothing blocks.
 */
#pragma once

#include <glib.h>

typedef struct Chooser Chooser;

enum chooser_what {
    CHOOSER_FILE,   /* one that can be opened */
    CHOOSER_FOLDER, /* the folder of a session */
    CHOOSER_SAVE,   /* a file name to save a picture */
};

enum chooser_state {
    CHOOSER_IDLE,        /* nothing was asked for, or the dialog is open */
    CHOOSER_CHOSEN,      /* *ret_path, g_free() */
    CHOOSER_CANCELLED,   /* by the user */
    CHOOSER_UNAVAILABLE, /* there is no portal here, or it does not answer within seconds */
};

Chooser *chooser_new(void);
void chooser_free(Chooser *chooser); /* closes an open dialog; NULL is ignored */

/* Opens a dialog; closes one that is open. name: for CHOOSER_SAVE, a file's name in folder. */
void chooser_ask(Chooser *chooser, enum chooser_what what, const char *folder, const char *name);
void chooser_close(Chooser *chooser);
gboolean chooser_is_open(const Chooser *chooser);

/* Returns the result of the last dialog, once. */
enum chooser_state chooser_poll(Chooser *chooser, char **ret_path);
