/* Writes GVariants as JSON: what the command line prints with --json. Pure functions. */
#pragma once

#include <glib.h>

/* Dictionaries with string keys become objects, in their order; arrays and tuples become arrays;
 * "ay" a string of bytes as numbers; maybes their value or null; numbers that are not finite null.
 * Takes a floating reference. g_free(). */
char *json_text(GVariant *value);

/* A string with its quotes; what is not UTF-8 is replaced. */
void json_append_string(GString *to, const char *text);
