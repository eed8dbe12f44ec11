/* Writes the files of the small simulated rig (tests/small) with changes: faults, mistakes, or
 * other devices. */
#pragma once

#include <glib.h>

/* A line that is added below the head of a section and replaces a line with the same key. A list of
 * changes ends with an empty element. */
struct change {
    const char *head; /* "[lamps bank]" */
    const char *line; /* "key = value"; NULL removes the whole section */
};

/* Returns the changed text; g_free(). Fails the test if there is no such section. */
char *small_rig_changed(const char *text, const struct change *change);

/* Writes rig.conf, world.conf or session.conf with the changes, of which there are none if changes
 * is NULL. Changes of sections that the file does not have are left out. Keys that begin with
 * fault_ are only written to rig.conf, because only devices have faults. */
void small_rig_write(const char *directory, const char *name, const struct change *changes);
