/* A check for drivers of simulated devices: whether the world file has the part that the device
 * acts on or looks at. */
#pragma once

#include "base/options.h"

/* Checks the section of a device in a rig file. world_path is the path of the world file. If this
 * path is empty, the function adds no mistake. `key` is the key of the section that names the part,
 * and `name` is its value. If `name` is empty, the part has the name of the section. Adds a mistake
 * if the world file does not exist. Adds a mistake if the world file has no section of the class
 * class_name with the name of the part, unless the name is one of `others`. others ends with NULL,
 * or is NULL if there are no such names. A world file with mistakes is not searched, because its
 * mistakes are reported when the world is loaded. */
void sim_part_check(const struct config_section *section, const char *world_path, const char *key,
                    const char *name, const char *class_name, const char *const *others,
                    Mistakes *mistakes);
