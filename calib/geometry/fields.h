/*
 * Plain structs as groups of a key file: a table has the name of each consecutive run of doubles
 * or integers and the bounds of valid values. Numbers are restored bit for bit. For the files of
 * calib/; any thread.
 */
#pragma once

#include <glib.h>

#define FIELD_LARGE 1e9 /* a bound for millimetres, pixels and the like */

struct field {
    const char *name; /* NULL ends a table */
    gsize offset;
    int n;
    gboolean integer;
    double min, max;
    gboolean optional; /* a file may lack the field; its value is then 0 */
    gboolean sparing; /* not written if all values are 0, since files of earlier versions lack it */
};

/* "key=value" lines. An optional integer that is 0 is left out. */
void fields_write(GString *text, const struct field *fields, gconstpointer from);
/* Writes one such line with the value escaped for GKeyFile. */
void fields_write_string(GString *text, const char *key, const char *value);

/* Reads a group. Every field that is not optional must exist, be finite and within its bounds;
 * keys must be fields or one of others (NULL-terminated). Errors are RIG_ERROR_VALUE with path,
 * group and key. On failure `to` may be partly set. */
gboolean fields_read(GKeyFile *file, const char *path, const char *group,
                     const struct field *fields, const char *const *others, gpointer to,
                     GError **error);
/* A string of 1 … size − 1 bytes. */
gboolean fields_read_name(GKeyFile *file, const char *path, const char *group, const char *key,
                          char *to, gsize size, GError **error);
/* Sets RIG_ERROR_VALUE "path: [group] key: why"; returns FALSE. */
gboolean fields_refuse(const char *path, const char *group, const char *key, GError **error,
                       const char *why);
