/* Writes GVariants as JSON. All functions are pure. */
#pragma once

#include <glib.h>

/* Converts a value. Dictionaries with string keys become objects, in their order. Arrays and tuples
 * become arrays, and "ay" becomes an array of numbers. A maybe becomes its value or null. A number
 * that is not finite becomes null. Takes a floating reference. Free the result with g_free(). */
char *json_text(GVariant *value);

/* Appends a string with its quotes. Bytes that are not UTF-8 are replaced. */
void json_append_string(GString *to, const char *text);
