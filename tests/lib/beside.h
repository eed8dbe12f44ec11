/* What a program finds next to itself, replaced by scripts: a test program is copied into a folder
 * and runs one of its cases there. What goes wrong in here fails the test. */
#pragma once

#include <glib.h>

/* Runs the case test_path of this program, whose name ends with "/subprocess", in a copy, where
 * PATH begins with an empty folder. Returns what it printed, g_free(). */
char *beside_run(const char *test_path);

/* In the copy: a shell script next to it that runs these commands; text NULL: there is none.
 * Returns the folder, which belongs to this function. */
const char *beside_write(const char *program, const char *text);

/* The same in the folder that PATH begins with. */
void beside_write_in_path(const char *program, const char *text);

/* The same with a first line of its own (“#!/no/such”). */
void beside_write_raw(const char *program, const char *text);
