/*
 * This module writes plain structs to groups of a key file, and reads such groups. A table has a
 * row for each member or array of doubles or integers, with its name and the bounds of valid
 * values. Numbers are restored bit for bit. Calibration files are written in this way. Any thread
 * may call the functions.
 */
#pragma once

#include <glib.h>

/* bound of values that have no narrower bound, such as millimetres and pixels */
#define FIELD_LARGE 1e9

struct field {
    const char *name; /* NULL ends a table */
    gsize offset;
    int n;
    gboolean integer;
    double min, max;
    gboolean optional; /* a file may lack the field; its value is then not changed */
    /* The field is not written if all its values are 0, so that such files equal those of earlier
     * versions, which did not have the field. */
    gboolean sparing;
};

/* Appends lines "key=value" to text. A sparing field that is all 0, and an optional single integer
 * that is 0, are left out. */
void fields_write(GString *text, const struct field *fields, gconstpointer from);
/* Appends one line "key=value", with the value escaped for GKeyFile. */
void fields_write_string(GString *text, const char *key, const char *value);

/* Reads a group into the struct `to`. Every field that is not optional must exist. Every value must
 * be finite and within the bounds of its field. Every key of the group must be the name of a field,
 * or be in the array `others`, which ends with NULL. Errors are RIG_ERROR_VALUE with path, group
 * and key. On failure `to` may be partly set. */
gboolean fields_read(GKeyFile *file, const char *path, const char *group,
                     const struct field *fields, const char *const *others, gpointer to,
                     GError **error);
/* Reads a string of 1 to size − 1 bytes. Returns FALSE with RIG_ERROR_VALUE if the key is
 * missing, or the string is empty or longer. */
gboolean fields_read_name(GKeyFile *file, const char *path, const char *group, const char *key,
                          char *to, gsize size, GError **error);
/* Sets the error RIG_ERROR_VALUE with the text "PATH: [GROUP] KEY: WHY". Always returns FALSE. */
gboolean fields_refuse(const char *path, const char *group, const char *key, GError **error,
                       const char *why);
