/* A check for drivers of simulated devices: whether the world file has the part that the device
 * acts on or looks at. */
#pragma once

#include "base/options.h"

/* Checks the section of a simulated device in a rig file: the world file must have the part that
 * the section names. world_path is the path of the world file. `key` is the key of the section that
 * names the part, and `name` is its value. If `name` is empty, the part has the name of the
 * section.
 *
 * Adds a mistake if the world file does not exist, or if it has no section of the class class_name
 * with the name of the part. The names in `others` are also allowed. `others` ends with NULL, or is
 * NULL if there are none.
 *
 * Adds no mistake if world_path is empty, or if the world file itself has mistakes. These are
 * reported when the world is loaded. */
void sim_part_check(const struct config_section *section, const char *world_path, const char *key,
                    const char *name, const char *class_name, const char *const *others,
                    Mistakes *mistakes);
