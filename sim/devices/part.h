/* A check for drivers of simulated devices: it checks the part of the world file that the device
 * acts on or looks at. */
#pragma once

#include "base/options.h"

/* Adds a mistake unless the world file exists and has a section [class_name NAME], or NAME is one
 * of others (NULL-terminated, or NULL). NAME is the value of the section's key or, if that is
 * empty, the section's own name. Other mistakes of the world file are reported when the world is
 * loaded. */
void sim_part_check(const struct config_section *section, const char *world_path, const char *key,
                    const char *name, const char *class_name, const char *const *others,
                    Mistakes *mistakes);
