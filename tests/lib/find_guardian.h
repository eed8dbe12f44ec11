/* The guardian of a rig that a daemon has opened (rig/guardian.h). */
#pragma once

#include <gio/gio.h>
#include <string.h>
#include <sys/types.h>

/* Its process id, or 0. */
pid_t find_guardian(const char *rig);

/* Kills it. A test calls this when its devices are gone: the guardian would look for them forever.
 */
void end_guardian(const char *rig);
