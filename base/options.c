#include "options.h"

#include "nearest.h"

#include "json.h"

#include <errno.h>
#include <math.h>
#include <string.h>

/* Suffixes of keys that give the unit; a _ stands before the suffix. deg_s stands before s, because
 * the first suffix that fits is taken. */
static const char *const units[] = {"deg_s2", "deg_s", "rad_s", "mm_s", "deg", "rad", "us", "ms",
                                    "min",    "mm",    "cm",    "um",   "nm",  "px",  "hz", "db",
                                    "baud",   "s",     "m",     "h",    "rpm", "pct", NULL};

static gboolean is_limited(const struct option *option) {
    return option->min != option->max;
}

static char *range_text(const struct option *option) {
    if (!is_limited(option))
        return g_strdup("any");
    char low[G_ASCII_DTOSTR_BUF_SIZE], high[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(low, sizeof low, "%.10g", option->min);
    g_ascii_formatd(high, sizeof high, "%.10g", option->max);
    if (option->max >= G_MAXDOUBLE)
        return option->min <= -G_MAXDOUBLE ? g_strdup("any") : g_strdup_printf("%s or more", low);
    return option->min <= -G_MAXDOUBLE ? g_strdup_printf("%s or less", high)
                                       : g_strdup_printf("%s to %s", low, high);
}

static gboolean value_error(GError **error, const char *format, ...) G_GNUC_PRINTF(2, 3);
static gboolean value_error(GError **error, const char *format, ...) {
    va_list args;
    va_start(args, format);
    GError *made = g_error_new_valist(CONFIG_ERROR, CONFIG_ERROR_VALUE, format, args);
    va_end(args);
    g_propagate_error(error, made);
    return FALSE;
}

static gboolean check_range(const struct option *option, double value, const char *text,
                            GError **error) {
    if (!is_limited(option) || (value >= option->min && value <= option->max))
        return TRUE;
    g_autofree char *range = range_text(option);
    return value_error(error, "%s is out of range: %s%s%s", text, range, option->unit ? " " : "",
                       option->unit ? option->unit : "");
}

/* Parses a decimal number. strtod() would also accept hexadecimal numbers, "inf" and "nan". */
static gboolean parse_double(const struct option *option, const char *text, double *ret,
                             GError **error) {
    char *end = NULL;
    double value = g_ascii_strtod(text, &end);
    const gboolean number = *text && !*end && strspn(text, "0123456789+-.eE") == strlen(text);
    if (number && !isfinite(value))
        return value_error(error, "the magnitude of %s is too large; give a number nearer to 0",
                           text);
    if (!number)
        return value_error(error, "\"%s\" is not a number%s%s%s", text,
                           option->unit ? " (its unit is " : "", option->unit ? option->unit : "",
                           option->unit ? "; write only the number)" : "; write a number");
    *ret = value;
    return check_range(option, value, text, error);
}

static gboolean parse_int(const struct option *option, const char *text, int *ret, GError **error) {
    char *end = NULL;
    errno = 0;
    gint64 value = g_ascii_strtoll(text, &end, g_str_has_prefix(text, "0x") ? 16 : 10);
    if (!*text || *end || g_ascii_isspace(*text))
        return value_error(error, "\"%s\" is not a whole number", text);
    if (errno == ERANGE || value < G_MININT || value > G_MAXINT)
        return check_range(option, (double)value, text, error) &&
               value_error(error, "%s is out of range: %d to %d", text, G_MININT, G_MAXINT);
    *ret = (int)value;
    return check_range(option, (double)value, text, error);
}

static gboolean parse_share(const char *text, double *ret, GError **error) {
    char *end;
    double value = g_ascii_strtod(text, &end);
    if (end != text && *end == '%') {
        value /= 100;
        end++;
    }
    if (end == text || *end || !(value > 0 && value < 1))
        return value_error(error, "\"%s\" is not a share between 0 and 1, such as 2%% or 0.02",
                           text);
    *ret = value;
    return TRUE;
}

static gboolean parse_bytes(const char *text, gint64 *ret, GError **error) {
    static const char *const suffixes[] = {"", "B", "kB", "KB", "MB", "GB"};
    static const double factors[] = {1, 1, 1e3, 1e3, 1e6, 1e9};
    char *end;
    const double value = g_ascii_strtod(text, &end);
    while (*end == ' ')
        end++;
    for (gsize i = 0; end != text && i < G_N_ELEMENTS(suffixes); i++)
        if (g_str_equal(end, suffixes[i]) && value * factors[i] >= 1 && value * factors[i] < 1e15) {
            *ret = (gint64)(value * factors[i]);
            return TRUE;
        }
    return value_error(error, "\"%s\" is not a size such as 20MB or 500kB, of at least 1 byte",
                       text);
}

static gboolean parse_bool(const char *text, gboolean *ret, GError **error) {
    gboolean yes = g_ascii_strcasecmp(text, "yes") == 0 || g_ascii_strcasecmp(text, "true") == 0;
    if (!yes && g_ascii_strcasecmp(text, "no") != 0 && g_ascii_strcasecmp(text, "false") != 0)
        return value_error(error, "\"%s\" is neither yes nor no", text);
    *ret = yes;
    return TRUE;
}

static gboolean parse_choice(const struct option *option, const char *text, int *ret,
                             GError **error) {
    for (int i = 0; option->choices[i]; i++) {
        if (strcmp(option->choices[i], text) == 0) {
            *ret = i;
            return TRUE;
        }
    }
    g_autofree char *all = g_strjoinv(", ", (char **)option->choices);
    g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN, "there is no \"%s\"; choose from: %s",
                text, all);
    return FALSE;
}

/* Splits a list at ';' and trims its items. As in GKeyFile, the last item may end with ';'. Returns
 * NULL with an error if an item is empty. */
static char **split_list(const char *text, GError **error) {
    g_auto(GStrv) items = g_strsplit(text, ";", -1);
    guint n = g_strv_length(items);
    for (guint i = 0; i < n; i++)
        g_strstrip(items[i]);
    if (n > 0 && !*items[n - 1]) {
        g_free(items[n - 1]);
        items[--n] = NULL;
    }
    for (guint i = 0; i < n; i++) {
        if (!*items[i]) {
            value_error(error, "item %u of the list \"%s\" is empty; remove one ';'", i + 1, text);
            return NULL;
        }
    }
    return g_steal_pointer(&items);
}

static gboolean parse_doubles(const struct option *option, const char *text,
                              struct option_doubles *ret, GError **error) {
    g_auto(GStrv) items = split_list(text, error);
    if (!items)
        return FALSE;
    int n = (int)g_strv_length(items);
    g_autofree double *values = g_new0(double, MAX(n, 1));
    for (int i = 0; i < n; i++) {
        if (!parse_double(option, items[i], &values[i], error))
            return FALSE;
    }
    ret->values = g_steal_pointer(&values);
    ret->n = n;
    return TRUE;
}

static gboolean parse_value(const struct option *option, const char *text, const Config *config,
                            gpointer target, GError **error) {
    gpointer field = (char *)target + option->offset;
    switch (option->type) {
    case OPTION_BOOL:
        return parse_bool(text, field, error);
    case OPTION_INT:
        return parse_int(option, text, field, error);
    case OPTION_DOUBLE:
        return parse_double(option, text, field, error);
    case OPTION_STRING:
        *(char **)field = g_strdup(text);
        return TRUE;
    case OPTION_PATH:
        *(char **)field = *text && config ? config_resolve(config, text) : g_strdup(text);
        return TRUE;
    case OPTION_CHOICE:
        return parse_choice(option, text, field, error);
    case OPTION_DOUBLES:
        return parse_doubles(option, text, field, error);
    case OPTION_STRINGS:
        return (*(char ***)field = split_list(text, error)) != NULL;
    case OPTION_SHARE:
        return parse_share(text, field, error);
    case OPTION_BYTES:
        return parse_bytes(text, field, error);
    }
    g_return_val_if_reached(FALSE);
}

gboolean options_set(const struct option *option, const char *text, gpointer target,
                     GError **error) {
    return parse_value(option, text, NULL, target, error);
}

static gsize stem_length(const char *name) {
    gsize length = strlen(name);
    for (int i = 0; units[i]; i++) {
        gsize unit = strlen(units[i]);
        if (length > unit + 1 && name[length - unit - 1] == '_' &&
            strcmp(name + length - unit, units[i]) == 0)
            return length - unit - 1;
    }
    return length;
}

/* Sets the error for an unknown key. Returns the key that was probably meant, or NULL if none is
 * similar. */
static const char *unknown_key(const struct option_target *targets, gsize n_targets,
                               const struct config_section *section, const char *const *also,
                               const char *key, GError **error) {
    struct nearest nearest = nearest_new(key);
    const gsize stem = stem_length(key);
    for (gsize i = 0; i < n_targets; i++)
        for (const struct option *option = targets[i].table; option && option->name; option++) {
            if (stem == stem_length(option->name) && strncmp(option->name, key, stem) == 0) {
                config_set_error(error, CONFIG_ERROR_UNKNOWN, section, key,
                                 option->unit ? "the unit is part of the name: write %s (in %s)"
                                              : "the name has no unit: write %s",
                                 option->name, option->unit);
                return option->name;
            }
            nearest_consider(&nearest, option->name);
        }
    for (; also && *also; also++)
        nearest_consider(&nearest, *also);
    if (nearest.name)
        config_set_error(error, CONFIG_ERROR_UNKNOWN, section, key,
                         "there is no such key; did you mean %s?", nearest.name);
    else
        config_set_error(error, CONFIG_ERROR_UNKNOWN, section, key,
                         "there is no such key in this section; remove the key");
    return nearest.name;
}

const struct option *options_find(const struct option *table, const char *name) {
    for (; table && table->name; table++)
        if (strcmp(table->name, name) == 0)
            return table;
    return NULL;
}

static gboolean parse_option(const struct option *option, const struct config_section *section,
                             gpointer target, GError **error) {
    const char *text = config_value(section, option->name, NULL);
    if (!text && !option->fallback) {
        config_set_error(error, CONFIG_ERROR_MISSING, section, option->name, "must be given: %s",
                         option->help ? option->help : "it has no default");
        return FALSE;
    }
    GError *failed = NULL;
    if (parse_value(option, text ? text : option->fallback, section->config, target, &failed))
        return TRUE;
    if (!text)
        g_error("option %s: its default is wrong: %s", option->name, failed->message);
    config_set_error(error, failed->code, section, option->name, "%s", failed->message);
    g_error_free(failed);
    return FALSE;
}

gboolean options_check_key(const struct option *table, const struct config_section *section,
                           const char *const *also, const char *key, GError **error) {
    const struct option *option = options_find(table, key);
    if (!option && !(also && g_strv_contains(also, key))) {
        unknown_key(&(struct option_target){table, NULL}, 1, section, also, key, error);
        return FALSE;
    }
    if (!option)
        return TRUE;
    const struct option alone[] = {*option, {NULL}};
    g_autofree char *target = g_malloc0(option->offset + sizeof(struct option_doubles));
    const gboolean good = parse_option(option, section, target, error);
    options_clear(alone, target);
    return good;
}

gboolean options_read(const struct option_target *targets, gsize n_targets,
                      const struct config_section *section, const char *const *also,
                      Mistakes *mistakes) {
    /* names of options that misspelt keys probably meant */
    g_autoptr(GPtrArray) meant = g_ptr_array_new();
    gboolean good = !section->incomplete;
    for (const char *const *key = config_keys(section); *key; key++) {
        gboolean known = also && (g_strv_contains(also, *key) || g_strv_contains(also, "*"));
        for (gsize i = 0; i < n_targets && !known; i++)
            known = options_find(targets[i].table, *key) != NULL;
        if (known)
            continue;
        GError *error = NULL;
        const char *name = unknown_key(targets, n_targets, section, also, *key, &error);
        if (name)
            g_ptr_array_add(meant, (gpointer)name);
        good = mistakes_add(mistakes, error);
    }
    for (gsize i = 0; i < n_targets; i++)
        for (const struct option *option = targets[i].table; option && option->name; option++) {
            GError *error = NULL;
            if (parse_option(option, section, targets[i].target, &error))
                continue;
            good = FALSE;
            if (!config_value(section, option->name, NULL) &&
                (section->incomplete ||
                 g_ptr_array_find_with_equal_func(meant, option->name, g_str_equal, NULL)))
                /* the key seems to be missing only because of a mistake that was already
                 * reported */
                g_error_free(error);
            else
                mistakes_add(mistakes, error);
        }
    for (gsize i = 0; i < n_targets && !good; i++)
        options_clear(targets[i].table, targets[i].target);
    return good;
}

gboolean options_parse(const struct option *table, const struct config_section *section,
                       const char *const *also, gpointer target, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    if (options_read(&(struct option_target){table, target}, 1, section, also, mistakes))
        return TRUE;
    if (mistakes_report(mistakes, error))
        config_set_error(error, CONFIG_ERROR_SYNTAX, section, NULL,
                         "a line of this section is not of the form \"key = value\": correct or "
                         "remove that line");
    return FALSE;
}

void options_defaults(const struct option *table, gpointer target) {
    for (; table && table->name; table++) {
        GError *failed = NULL;
        if (table->fallback && !parse_value(table, table->fallback, NULL, target, &failed))
            g_error("option %s: its default is wrong: %s", table->name,
                    failed ? failed->message : "");
    }
}

void options_clear(const struct option *table, gpointer target) {
    for (; table && table->name; table++) {
        gpointer field = (char *)target + table->offset;
        if (table->type == OPTION_STRING || table->type == OPTION_PATH) {
            g_clear_pointer((char **)field, g_free);
        } else if (table->type == OPTION_STRINGS) {
            g_clear_pointer((char ***)field, g_strfreev);
        } else if (table->type == OPTION_DOUBLES) {
            struct option_doubles *list = field;
            g_clear_pointer(&list->values, g_free);
            list->n = 0;
        }
    }
}

static const char *type_name(enum option_type type) {
    static const char *const names[] = {
        [OPTION_BOOL] = "yes or no",  [OPTION_INT] = "whole number", [OPTION_DOUBLE] = "number",
        [OPTION_STRING] = "text",     [OPTION_PATH] = "path",        [OPTION_CHOICE] = "choice",
        [OPTION_DOUBLES] = "numbers", [OPTION_STRINGS] = "texts",    [OPTION_SHARE] = "share",
        [OPTION_BYTES] = "size",
    };
    return names[type];
}

static gboolean has_range(const struct option *option) {
    return is_limited(option) && (option->type == OPTION_INT || option->type == OPTION_DOUBLE ||
                                  option->type == OPTION_DOUBLES);
}

char *options_range(const struct option *option) {
    return has_range(option) ? range_text(option) : NULL;
}

void options_describe(const struct option *table, GString *to) {
    for (; table && table->name; table++) {
        g_string_append_printf(to, "  %s: %s", table->name, type_name(table->type));
        if (table->type == OPTION_DOUBLES || table->type == OPTION_STRINGS)
            g_string_append(to, " separated by ';'");
        g_autofree char *range = options_range(table);
        if (range)
            g_string_append_printf(to, ", %s", range);
        if (table->unit)
            g_string_append_printf(to, " %s", table->unit);
        if (table->type == OPTION_CHOICE) {
            g_autofree char *all = g_strjoinv(", ", (char **)table->choices);
            g_string_append_printf(to, " of: %s", all);
        }
        if (!table->fallback)
            g_string_append(to, "; must be given");
        else if (*table->fallback)
            g_string_append_printf(to, "; default %s", table->fallback);
        g_string_append_printf(to, "\n      %s\n", table->help ? table->help : "");
    }
}

static void append_json(GString *to, const char *before, const char *text) {
    g_string_append(to, before);
    if (text)
        json_append_string(to, text);
    else
        g_string_append(to, "null");
}

static void append_json_option(GString *to, const struct option *option) {
    char min[G_ASCII_DTOSTR_BUF_SIZE], max[G_ASCII_DTOSTR_BUF_SIZE];
    append_json(to, "{\"name\":", option->name);
    append_json(to, ",\"type\":", type_name(option->type));
    append_json(to, ",\"unit\":", option->unit);
    if (has_range(option))
        g_string_append_printf(to, ",\"min\":%s,\"max\":%s",
                               g_ascii_formatd(min, sizeof min, "%.17g", option->min),
                               g_ascii_formatd(max, sizeof max, "%.17g", option->max));
    for (int i = 0; option->type == OPTION_CHOICE && option->choices[i]; i++) {
        append_json(to, i ? "," : ",\"choices\":[", option->choices[i]);
        g_string_append(to, option->choices[i + 1] ? "" : "]");
    }
    append_json(to, ",\"default\":", option->fallback);
    append_json(to, ",\"help\":", option->help);
    g_string_append_c(to, '}');
}

void options_describe_json(const struct option *table, GString *to) {
    g_string_append_c(to, '[');
    for (const struct option *option = table; option && option->name; option++) {
        if (option != table)
            g_string_append_c(to, ',');
        append_json_option(to, option);
    }
    g_string_append_c(to, ']');
}
