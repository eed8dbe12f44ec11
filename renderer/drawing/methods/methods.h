/* The table of all drawing methods. A new method needs a row in methods.c. */
#pragma once

#include "method.h"

#define METHOD_DEMO "fabric-ashikhmin" /* shown while no material is named or open */

extern const struct method *const methods[]; /* NULL-terminated; the first is the default */

const struct method *method_find(const char *name); /* NULL if there is none */

/* Returns the path of a method's file. argument is a file, or the directory of a session, which
 * stands for the method's product in it. It may be NULL if the method needs no file. Free the
 * result with g_free(). */
char *method_path(const struct method *method, const char *argument);

/* Calls the method's open(). If the file does not exist, the error says so. Errors name the file.
 * For a method that needs no file, path is NULL, the name of the method, or a normal map. */
gpointer method_open(const struct method *method, const char *path, GError **error);
