/* Finds the guardian of a rig that a daemon has opened (rig/guardian.h). */
#pragma once

#include <glib.h>
#include <string.h>
#include <sys/types.h>

/* Returns the process id of the guardian, or 0 if there is none. */
pid_t find_guardian(const char *rig);

/* Kills the guardian. A test calls this function when its devices no longer exist, because the
 * guardian would look for them forever. */
void end_guardian(const char *rig);
