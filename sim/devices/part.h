/* A check for drivers of simulated devices: it checks the part of the world file that the device
 * acts on or looks at. */
#pragma once

#include "base/options.h"

/* Adds a mistake if the world file does not exist. Adds a mistake if NAME is not one of `others`
 * (NULL-terminated, or NULL) and the world file has no section [class_name NAME]. name is the value
 * of `key` in the section. NAME is name or, if name is empty, the section's own name. Adds nothing
 * if world_path is empty. A world file with mistakes is not searched, because its mistakes are
 * reported when the world is loaded. */
void sim_part_check(const struct config_section *section, const char *world_path, const char *key,
                    const char *name, const char *class_name, const char *const *others,
                    Mistakes *mistakes);
