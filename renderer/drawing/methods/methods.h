/* The table of all drawing methods. A new method needs a row in methods.c. */
#pragma once

#include "method.h"

#define METHOD_DEMO "fabric-ashikhmin" /* shown while no material is named or open */

/* NULL-terminated. The first draws the product of “mesorig process”. */
extern const struct method *const methods[];

const struct method *method_find(const char *name); /* NULL if there is none */

/* Returns the method that draws a session if the user names none. This is lpca if the session has a
 * local PCA that is not older than its eigen-maps. If not, it is the first method of the table for
 * which the session has a product. Returns NULL if the session has no product. */
const struct method *method_of_session(const char *session);

/* Returns the path of a method's file; g_free(). argument is a file or the directory of a session.
 * A directory stands for the method's product in this session. argument may be NULL if the method
 * needs no file. */
char *method_path(const struct method *method, const char *argument);

/* Calls the method's open(). The message of an error has the path of the file; if the file does not
 * exist, it says so. For a method that needs no file, path is NULL, the name of the method, or a
 * normal map. */
gpointer method_open(const struct method *method, const char *path, GError **error);
