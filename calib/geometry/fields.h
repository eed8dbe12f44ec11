/*
 * Plain structs as groups of a key file: a table says under which name each consecutive run of
 * doubles or integers is kept, and between which bounds it makes sense. Numbers come back bit for
 * bit. For the files of calib/; any thread.
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
    gboolean optional; /* 0 where a file has none */
};

/* "key=value" lines. */
void fields_write(GString *text, const struct field *fields, gconstpointer from);
/* One such line, with the value escaped as GKeyFile reads it. */
void fields_write_string(GString *text, const char *key, const char *value);

/* Every field that is not optional must be there, finite and within its bounds, and no key that is
 * neither a field nor one of others (NULL-terminated). Errors are RIG_ERROR_VALUE and name path,
 * group and key. On failure `to` may be half filled. */
gboolean fields_read(GKeyFile *file, const char *path, const char *group,
                     const struct field *fields, const char *const *others, gpointer to,
                     GError **error);
/* A string of 1 … size − 1 bytes. */
gboolean fields_read_name(GKeyFile *file, const char *path, const char *group, const char *key,
                          char *to, gsize size, GError **error);
/* Sets RIG_ERROR_VALUE "path: [group] key: why"; returns FALSE. */
gboolean fields_refuse(const char *path, const char *group, const char *key, GError **error,
                       const char *why);
