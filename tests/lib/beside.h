/* Replaces the programs that a program finds in its own folder by scripts. A test program is copied
 * into a folder, and the copy runs one of its cases there. Errors in these functions fail the
 * test. */
#pragma once

#include <glib.h>

/* Runs the case test_path of this program in a copy. The name of the case must end with
 * "/subprocess". PATH begins with an empty folder. Returns the output of the copy; g_free(). */
char *beside_run(const char *test_path);

/* Called in the copy: writes a shell script with these commands next to the program. If text is
 * NULL, removes the script. Returns the folder, which belongs to this function. */
const char *beside_write(const char *program, const char *text);

/* Does the same in the first folder of PATH. */
void beside_write_in_path(const char *program, const char *text);

/* Does the same without "#!/bin/sh". The text contains its own first line, for example
 * “#!/no/such”. */
void beside_write_raw(const char *program, const char *text);
