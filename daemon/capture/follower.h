/* Runs `mesorig process DIR --follow` as a child of lower priority, which makes the products while
 * frames are captured. The child ends with the process that started it, even if that process is
 * killed. Main loop's thread. */
#pragma once

#include <gio/gio.h>

typedef struct Follower Follower;

/* Starts the child. The program is looked for next to this executable, then in PATH. */
Follower *follower_start(const char *directory, GError **error);

/* Asks the child to end, waits briefly, and kills it if it has not ended. NULL is ignored. */
void follower_free(Follower *follower);
