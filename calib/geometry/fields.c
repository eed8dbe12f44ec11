/* Writes and reads tables of numbers as lines "key=value". g_ascii_dtostr() writes 17 significant
 * digits, which restore a double exactly, and does not depend on the locale. */
#include "fields.h"

#include "rig.h"

#include <string.h>

void fields_write(GString *text, const struct field *fields, gconstpointer from) {
    char number[G_ASCII_DTOSTR_BUF_SIZE];

    for (const struct field *f = fields; f->name; f++) {
        const char *at = (const char *)from + f->offset;
        gboolean zero = TRUE;
        for (int i = 0; i < f->n; i++)
            zero = zero && (f->integer ? ((const int *)at)[i] == 0 : ((const double *)at)[i] == 0);
        if (zero && (f->sparing || (f->integer && f->optional && f->n == 1)))
            continue;
        g_string_append_printf(text, "%s=", f->name);
        for (int i = 0; i < f->n; i++) {
            g_string_append(text, i ? ";" : "");
            if (f->integer)
                g_string_append_printf(text, "%d", ((const int *)at)[i]);
            else
                g_string_append(text,
                                g_ascii_dtostr(number, sizeof number, ((const double *)at)[i]));
        }
        g_string_append_c(text, '\n');
    }
}

void fields_write_string(GString *text, const char *key, const char *value) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_key_file_set_string(file, "x", key, value);
    g_autofree char *escaped = g_key_file_get_value(file, "x", key, NULL);
    g_string_append_printf(text, "%s=%s\n", key, escaped);
}

gboolean fields_refuse(const char *path, const char *group, const char *key, GError **error,
                       const char *why) {
    g_set_error(error, RIG_ERROR, RIG_ERROR_VALUE, "%s: [%s] %s: %s", path, group, key, why);
    return FALSE;
}

/* Reads f->n finite numbers separated by semicolons, checks each against the bounds, and, if
 * f->integer is set, refuses fractions. If the key is missing, an optional field is not changed,
 * and any other field is refused. Returns FALSE with an error if the field is refused. */
static gboolean read_field(GKeyFile *file, const char *path, const char *group,
                           const struct field *f, gpointer to, GError **error) {
    g_autofree char *value = g_key_file_get_string(file, group, f->name, NULL);
    if (!value)
        return f->optional || fields_refuse(path, group, f->name, error,
                                            "is missing; calibrate again or restore the file");
    g_auto(GStrv) words = g_strsplit(value, ";", f->n + 1);
    g_autofree char *why = NULL;
    if ((int)g_strv_length(words) != f->n)
        why = g_strdup_printf("does not have %d numbers, separated by semicolons; calibrate again "
                              "or restore the file",
                              f->n);
    for (int i = 0; i < f->n && !why; i++) {
        char *end;
        const double number = g_ascii_strtod(words[i], &end);
        if (end == words[i] || *end || !isfinite(number))
            why = g_strdup_printf(
                "“%s” is not a finite number; calibrate again or restore the file", words[i]);
        else if (number < f->min || number > f->max)
            why =
                g_strdup_printf("%g is out of range: %g to %g; calibrate again or restore the file",
                                number, f->min, f->max);
        else if (f->integer && number != floor(number))
            why = g_strdup_printf("%g is not a whole number; calibrate again or restore the file",
                                  number);
        else if (f->integer)
            ((int *)((char *)to + f->offset))[i] = (int)number;
        else
            ((double *)((char *)to + f->offset))[i] = number;
    }
    return !why || fields_refuse(path, group, f->name, error, why);
}

gboolean fields_read(GKeyFile *file, const char *path, const char *group,
                     const struct field *fields, const char *const *others, gpointer to,
                     GError **error) {
    g_auto(GStrv) keys = g_key_file_get_keys(file, group, NULL, NULL);

    for (char **key = keys; key && *key; key++) {
        const struct field *f = fields;
        while (f->name && !g_str_equal(f->name, *key))
            f++;
        if (!f->name && !g_strv_contains(others, *key))
            return fields_refuse(
                path, group, *key, error,
                "this key is not known; a newer version of Mesorig may have written the file, so "
                "update Mesorig or calibrate again");
    }
    for (const struct field *f = fields; f->name; f++)
        if (!read_field(file, path, group, f, to, error))
            return FALSE;
    return TRUE;
}

gboolean fields_read_name(GKeyFile *file, const char *path, const char *group, const char *key,
                          char *to, gsize size, GError **error) {
    g_autofree char *value = g_key_file_get_string(file, group, key, NULL);

    if (!value || !*value)
        return fields_refuse(path, group, key, error,
                             "is missing or empty; calibrate again or restore the file");
    if (strlen(value) >= size) {
        g_autofree char *why = g_strdup_printf("“%s” is too long: at most %" G_GSIZE_FORMAT
                                               " bytes; calibrate again or restore the file",
                                               value, size - 1);
        return fields_refuse(path, group, key, error, why);
    }
    g_strlcpy(to, value, size);
    return TRUE;
}
