/* Writes and reads tables of numbers as key=value lines. g_ascii_dtostr() writes 17 significant
 * digits, which restore a double exactly whatever the locale. */
#include "fields.h"

#include "rig.h"

#include <string.h>

void fields_write(GString *text, const struct field *fields, gconstpointer from) {
    char number[G_ASCII_DTOSTR_BUF_SIZE];

    for (const struct field *f = fields; f->name; f++) {
        const char *at = (const char *)from + f->offset;
        g_string_append_printf(text, "%s=", f->name);
        for (int i = 0; i < f->n; i++) {
            if (f->integer)
                g_snprintf(number, sizeof number, "%d", ((const int *)at)[i]);
            else
                g_ascii_dtostr(number, sizeof number, ((const double *)at)[i]);
            g_string_append_printf(text, "%s%s", i ? ";" : "", number);
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

struct reader {
    GKeyFile *file;
    const char *path;
};

gboolean fields_refuse(const char *path, const char *group, const char *key, GError **error,
                       const char *why) {
    g_set_error(error, RIG_ERROR, RIG_ERROR_VALUE, "%s: [%s] %s: %s", path, group, key, why);
    return FALSE;
}

static gboolean fields_do_refuse(const struct reader *r, const char *group, const char *key,
                                 GError **error, const char *why) {
    return fields_refuse(r->path, group, key, error, why);
}

/* The whole text must be one finite number. */
static gboolean parse_number(const char *text, double *ret) {
    char *end;

    *ret = g_ascii_strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*ret);
}

/* Reads f->n numbers separated by semicolons and checks each against the bounds. */
static gboolean read_field(const struct reader *r, const char *group, const struct field *f,
                           gpointer to, GError **error) {
    g_autofree char *value = g_key_file_get_string(r->file, group, f->name, NULL);
    if (!value && f->optional)
        return TRUE;
    if (!value)
        return fields_do_refuse(r, group, f->name, error,
                                "missing; calibrate again or restore the file");
    g_auto(GStrv) words = g_strsplit(value, ";", f->n + 1);
    if ((int)g_strv_length(words) != f->n)
        return fields_do_refuse(r, group, f->name, error,
                                "has not as many numbers as it should have");
    for (int i = 0; i < f->n; i++) {
        double number;
        if (!parse_number(words[i], &number))
            return fields_do_refuse(r, group, f->name, error, "is not a finite number");
        if (number < f->min || number > f->max)
            return fields_do_refuse(r, group, f->name, error, "is out of range");
        if (f->integer && number != floor(number))
            return fields_do_refuse(r, group, f->name, error, "is not a whole number");
        if (f->integer)
            ((int *)((char *)to + f->offset))[i] = (int)number;
        else
            ((double *)((char *)to + f->offset))[i] = number;
    }
    return TRUE;
}

static gboolean fields_known_keys(const struct reader *r, const char *group,
                                  const struct field *fields, const char *const *others,
                                  GError **error) {
    g_auto(GStrv) keys = g_key_file_get_keys(r->file, group, NULL, NULL);

    for (char **key = keys; key && *key; key++) {
        const struct field *f = fields;
        while (f->name && !g_str_equal(f->name, *key))
            f++;
        if (!f->name && !g_strv_contains(others, *key))
            return fields_do_refuse(r, group, *key, error,
                                    "is not known; a newer version may have written it");
    }
    return TRUE;
}

gboolean fields_read(GKeyFile *file, const char *path, const char *group,
                     const struct field *fields, const char *const *others, gpointer to,
                     GError **error) {
    const struct reader r = {file, path};

    if (!fields_known_keys(&r, group, fields, others, error))
        return FALSE;
    for (const struct field *f = fields; f->name; f++)
        if (!read_field(&r, group, f, to, error))
            return FALSE;
    return TRUE;
}

gboolean fields_read_name(GKeyFile *file, const char *path, const char *group, const char *key,
                          char *to, gsize size, GError **error) {
    g_autofree char *value = g_key_file_get_string(file, group, key, NULL);

    if (!value || !*value)
        return fields_refuse(path, group, key, error, "missing");
    if (strlen(value) >= size)
        return fields_refuse(path, group, key, error, "is too long");
    g_strlcpy(to, value, size);
    return TRUE;
}
