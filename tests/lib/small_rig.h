/* The small simulated rig's files (tests/small), written with changes: faults, mistakes, other
 * devices. */
#pragma once

#include <glib.h>

/* A line put below a section's head, instead of one for the same key. A list ends with an empty
 * one. */
struct change {
    const char *head; /* "[lamps bank]" */
    const char *line; /* "key = value"; NULL: the whole section goes */
};

/* The caller's. Fails the test where there is no such section. */
char *small_rig_changed(const char *text, const struct change *change);

/* Writes rig.conf, world.conf or session.conf with those changes (NULL: none) whose section it has.
 * Devices have faults: keys that begin with fault_ are only put into rig.conf. */
void small_rig_write(const char *directory, const char *name, const struct change *changes);
