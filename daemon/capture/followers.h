/* Sessions that are processed during and after their capture, each by a child process `mesorig
 * process DIR --follow` of lower priority. A child goes on while a later session is captured. All
 * children end with the process that started them, even if that process is killed. Main loop's
 * thread. */
#pragma once

#include <glib.h>

typedef struct Followers Followers;

/* changed is called when followers_directories() has changed. failed is called when the child of a
 * session has failed; directory is the directory of that session. */
Followers *followers_new(void (*changed)(gpointer data),
                         void (*failed)(const char *directory, gpointer data), gpointer data);

/* Asks all children to end, waits up to 3 s for each, and then kills it if it has not ended. No
 * callback is called. NULL is ignored. */
void followers_free(Followers *followers);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Followers, followers_free)

/* Starts the child of a session. An earlier child of the same session is ended first. The program
 * is found by program_find(). */
gboolean followers_start(Followers *followers, const char *directory, GError **error);

/* Returns the directories of the sessions that are processed, in the order of their start, ended
 * by NULL; g_free() the array, not the strings. */
const char **followers_directories(const Followers *followers);
