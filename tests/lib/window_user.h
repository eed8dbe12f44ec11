/* Somebody who has the window open on a display without a screen, and reads what its screenshots
 * say of themselves. */
#pragma once

#include "x_display.h"

#include <gio/gio.h>

struct user {
    XDisplay *x;
    char *folder, *session; /* the window's current directory and $XDG_DATA_HOME; MATERIAL, or "" */
    const char *bus;        /* address of its session bus, or NULL: none */
    gboolean keeps_folder;
    GSubprocess *program;
    GDataInputStream *says;
};

/* Opens the window, of a session that has eigen-maps only unless one is given, which is removed in
 * the end; "": of nothing. FALSE: skipped, where there is no Xvfb. */
gboolean user_sit_down(struct user *u, const char *session, const char *const *options);

/* The same with a session bus (its address stays the caller's), or in a folder that is there and
 * stays the caller's; NULL: neither. */
gboolean user_sit_down_on(struct user *u, const char *bus, const char *folder, const char *session,
                          const char *const *options);

/* The program ends by itself, soon, and with this code; what it said on the way, g_free(). */
char *user_stand_up(struct user *u, int code);
char *user_leave(struct user *u); /* the same by Ctrl+Q, with code 0 */

char *user_read_line(struct user *u); /* the next that the program prints; g_free() */

/* What a screenshot says that is taken by key; that it is there means that all keys and drags
 * before it were dealt with. g_hash_table_unref() */
GHashTable *user_look(struct user *u);
const char *user_said(GHashTable *texts, const char *name); /* which has to be there */

/* Until the window's title begins with this, a minute at most. */
void user_wait_for_title(struct user *u, const char *start_of_title);
