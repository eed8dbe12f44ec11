/* Sessions that are processed during and after their capture. For each one, a child process
 * `mesorig process DIR --follow` of lower priority does this. A child continues while a later
 * session is captured. All children end with the process that has started them, even if that
 * process is killed. All functions belong to the main loop's thread. */
#pragma once

#include <glib.h>

typedef struct Followers Followers;

/* `changed` is called when the result of followers_directories() has changed. `failed` is called
 * when the child of a session has failed; its argument is the directory of the session. */
Followers *followers_new(void (*changed)(gpointer data),
                         void (*failed)(const char *directory, gpointer data), gpointer data);

/* Asks all children to end. Waits up to 3 s for each one, and kills it if it has not ended then. No
 * callback is called. NULL is ignored. */
void followers_free(Followers *followers);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Followers, followers_free)

/* Starts the child of a session. If the session already has a child, that child is ended first.
 * program_find() finds the program. Returns FALSE with an error if the child cannot be started. */
gboolean followers_start(Followers *followers, const char *directory, GError **error);

/* Returns the directories of the sessions that are being processed, in the order of their start,
 * with NULL at the end. Free the array with g_free(), but not the strings. */
const char **followers_directories(const Followers *followers);
