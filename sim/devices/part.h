/* A check for drivers of simulated devices: it checks the part of the world file that the device
 * acts on or looks at. */
#pragma once

#include "base/options.h"

/* Adds a mistake if the world file does not exist, or if it has no section [class_name NAME] and
 * NAME is not one of others (NULL-terminated, or NULL). NAME is the value of the section's key or,
 * if that is empty, the section's own name. Adds nothing if world_path is empty. Other mistakes of
 * the world file are reported when the world is loaded, and a file with such mistakes is not
 * searched. */
void sim_part_check(const struct config_section *section, const char *world_path, const char *key,
                    const char *name, const char *class_name, const char *const *others,
                    Mistakes *mistakes);
