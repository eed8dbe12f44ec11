/* Writes GVariants as JSON: what the command line prints with --json. Pure functions. */
#pragma once

#include <glib.h>

/* Converts a value: dictionaries with string keys become objects, in their order; arrays and tuples
 * become arrays; "ay" becomes an array of numbers; a maybe becomes its value or null; a number that
 * is not finite becomes null. Takes a floating reference. g_free(). */
char *json_text(GVariant *value);

/* A string with its quotes; what is not UTF-8 is replaced. */
void json_append_string(GString *to, const char *text);
