/*
 * The desktop's file dialog, through its portal (org.freedesktop.portal.FileChooser) on the session
 * bus, without a toolkit. A Chooser belongs to the thread of the default main context, which
 * chooser_poll() iterates. No function blocks.
 */
#pragma once

#include <glib.h>

typedef struct Chooser Chooser;

enum chooser_what {
    CHOOSER_FILE,   /* a file that can be opened */
    CHOOSER_FOLDER, /* the folder of a session */
    CHOOSER_SAVE,   /* a file name under which a picture is saved */
};

enum chooser_state {
    /* there is no new result: no dialog was requested, or the dialog is still open */
    CHOOSER_IDLE,
    CHOOSER_CHOSEN,      /* the user has chosen *ret_path; free it with g_free() */
    CHOOSER_CANCELLED,   /* the user has cancelled the dialog */
    CHOOSER_UNAVAILABLE, /* there is no portal, or it does not answer within seconds */
};

Chooser *chooser_new(void);
void chooser_free(Chooser *chooser); /* closes an open dialog; NULL is ignored */

/* Opens a dialog in folder. An open dialog is closed first. name is the suggested file name for
 * CHOOSER_SAVE. */
void chooser_ask(Chooser *chooser, enum chooser_what what, const char *folder, const char *name);
void chooser_close(Chooser *chooser);
gboolean chooser_is_open(const Chooser *chooser);

/* Returns the result of the last dialog once. Later calls return CHOOSER_IDLE. */
enum chooser_state chooser_poll(Chooser *chooser, char **ret_path);
