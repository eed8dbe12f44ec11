/* A user of the window on a display without a screen, who reads the metadata of its screenshots. */
#pragma once

#include "x_display.h"

#include <gio/gio.h>

struct user {
    XDisplay *x;
    /* folder: current directory and $XDG_DATA_HOME of the window. session: MATERIAL, or "" */
    char *folder, *session;
    const char *bus; /* address of the session bus of the window; NULL if there is none */
    gboolean keeps_folder;
    GSubprocess *program;
    GDataInputStream *says;
};

/* Opens the window with a session, which user_stand_up() removes. If session is NULL, a session is
 * made that only contains eigen-maps. If session is "", the window opens no material. Returns FALSE
 * if the test is skipped because there is no Xvfb or no mesorig-view. */
gboolean user_sit_down(struct user *u, const char *session, const char *const *options);

/* Does the same with a session bus, and in an existing folder. Both stay the caller's, and either
 * may be NULL. */
gboolean user_sit_down_on(struct user *u, const char *bus, const char *folder, const char *session,
                          const char *const *options);

/* Waits until the program ends by itself. It must end soon and with this exit code. Returns its
 * standard error; g_free(). */
char *user_stand_up(struct user *u, int code);
char *user_leave(struct user *u); /* ends the program with Ctrl+Q; the exit code must be 0 */

char *user_read_line(struct user *u); /* returns the next line that the program prints; g_free() */

/* Takes a screenshot with a key and returns its texts; g_hash_table_unref(). When the screenshot
 * exists, all earlier keys and drags have been handled. */
GHashTable *user_look(struct user *u);
const char *user_said(GHashTable *texts, const char *name); /* returns a text, which must exist */

/* Waits until the title of the window begins with this text, at most a minute. */
void user_wait_for_title(struct user *u, const char *start_of_title);
