/* Somebody who has the window open on a display without a screen, and reads what its screenshots
 * say of themselves. */
#pragma once

#include "x_display.h"

#include <gio/gio.h>

struct user {
    XDisplay *x;
    char *folder, *session;
    GSubprocess *program;
    GDataInputStream *says;
};

/* Opens the window, of a session that has eigen-maps alone unless one is given, which is removed in
 * the end. FALSE: skipped, where there is no Xvfb. */
gboolean user_sit_down(struct user *u, const char *session, const char *const *options);

/* The program ends by itself, soon, and with this code; what it said on the way, g_free(). */
char *user_stand_up(struct user *u, int code);
char *user_leave(struct user *u); /* the same by the key Escape, with code 0 */

/* What a screenshot says that is taken by key; that it is there means that all keys and drags
 * before it were dealt with. g_hash_table_unref() */
GHashTable *user_look(struct user *u);
const char *user_said(GHashTable *texts, const char *name); /* which has to be there */

/* Until the window's title begins with this, a minute at most. */
void user_wait_for_title(struct user *u, const char *start_of_title);
