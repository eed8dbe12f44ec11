#include "record.h"

#include "base/json.h"
#include "plan/report.h"

#include <stdio.h>
#include <string.h>

#define DEEPEST 8

struct Record {
    GVariantBuilder values;
    gboolean filled;
    GString *text;
    /* `depth` is the number of open records and lists. For each of them, `levels` is the number of
     * GVariant containers that record_end() closes. */
    int depth, levels[DEEPEST];
};

Record *record_new(void) {
    Record *record = g_new0(Record, 1);
    g_variant_builder_init(&record->values, G_VARIANT_TYPE_VARDICT);
    record->text = g_string_new(NULL);
    return record;
}

void record_free(Record *record) {
    if (!record)
        return;
    g_variant_builder_clear(&record->values);
    g_string_free(record->text, TRUE);
    g_free(record);
}

void record_variant(Record *to, const char *key, GVariant *value) {
    to->filled = TRUE;
    g_variant_builder_add(&to->values, "{sv}", key, value);
}

void record_variants(Record *to, GVariant *values) {
    GVariantIter iter;
    const char *key;
    GVariant *value;
    g_variant_iter_init(&iter, values);
    while (g_variant_iter_loop(&iter, "{&sv}", &key, &value))
        record_variant(to, key, value);
}

void record_string(Record *to, const char *key, const char *value) {
    record_variant(to, key, g_variant_new_take_string(g_utf8_make_valid(value ? value : "", -1)));
}

void record_strings(Record *to, const char *key, const GPtrArray *values) {
    GVariantBuilder list;
    g_variant_builder_init(&list, G_VARIANT_TYPE_STRING_ARRAY);
    for (guint i = 0; i < values->len; i++) {
        char *valid = g_utf8_make_valid(values->pdata[i], -1);
        g_variant_builder_add_value(&list, g_variant_new_take_string(valid));
    }
    record_variant(to, key, g_variant_builder_end(&list));
}

void record_say_strings(Record *to, const char *key, const char *before, const GPtrArray *values) {
    record_strings(to, key, values);
    for (guint i = 0; i < values->len; i++)
        record_say(to, "%s%s\n", before, (const char *)values->pdata[i]);
}

void record_int(Record *to, const char *key, gint64 value) {
    record_variant(to, key, g_variant_new_int64(value));
}

void record_double(Record *to, const char *key, double value) {
    record_variant(to, key, g_variant_new_double(value));
}

void record_doubles(Record *to, const char *key, const double *values, int n) {
    record_variant(
        to, key,
        g_variant_new_fixed_array(G_VARIANT_TYPE_DOUBLE, values, (gsize)n, sizeof *values));
}

void record_say_doubles(Record *to, const char *key, const char *format, const double *values,
                        int n) {
    record_doubles(to, key, values, n);
    for (int i = 0; i < n; i++) {
        g_string_append(to->text, i > 0 ? " " : "");
        g_string_append_printf(to->text, format, values[i]);
    }
}

void record_boolean(Record *to, const char *key, gboolean value) {
    record_variant(to, key, g_variant_new_boolean(value));
}

static void record_open(Record *to, const char *key, const GVariantType *type) {
    g_assert(to->depth < DEEPEST);
    to->filled = TRUE;
    to->levels[to->depth++] = key ? 3 : 1;
    if (key) {
        g_variant_builder_open(&to->values, G_VARIANT_TYPE("{sv}"));
        g_variant_builder_add(&to->values, "s", key);
        g_variant_builder_open(&to->values, G_VARIANT_TYPE_VARIANT);
    }
    g_variant_builder_open(&to->values, type);
}

void record_begin_list(Record *to, const char *key) {
    record_open(to, key, G_VARIANT_TYPE("aa{sv}"));
}

void record_begin(Record *to, const char *key) {
    record_open(to, key, G_VARIANT_TYPE_VARDICT);
}

void record_end(Record *to) {
    g_assert(to->depth > 0);
    for (int i = to->levels[--to->depth]; i > 0; i--)
        g_variant_builder_close(&to->values);
}

/* Matches one conversion of a format: %, flags and width and precision, l or ll for 64-bit
 * integers, the letter, and {key:shown}. */
#define CONVERSION "%([-+ 0-9.]*)(l*)([a-zA-Z%])(?:\\{(\\w*)(?::([^}]*))?\\})?"

/* A conversion of a format, from the match with CONVERSION. */
struct conversion {
    const char *flags, *key, *shown;
    char letter;
};

/* Pads the text to its width, which counts characters. */
static void say_string(Record *to, const struct conversion *as, const char *value) {
    const int width = (int)g_ascii_strtoll(as->flags, NULL, 10);
    const int missing = MAX(ABS(width) - (int)g_utf8_strlen(value, -1), 0);
    g_string_append_printf(to->text, "%*s%s%*s", width > 0 ? missing : 0, "", value,
                           width < 0 ? missing : 0, "");
    if (*as->key)
        record_string(to, as->key, value);
}

static void say_integer(Record *to, const struct conversion *as, gint64 value) {
    g_autofree char *format = g_strdup_printf("%%%s%s%c", as->flags, G_GINT64_MODIFIER, as->letter);
    g_autofree char *size = g_str_equal(as->shown, "size") ? g_format_size((guint64)value) : NULL;
    if (size)
        g_string_append(to->text, size);
    else
        g_string_append_printf(to->text, format, value);
    if (*as->key)
        record_int(to, as->key, value);
}

static void say_double(Record *to, const struct conversion *as, double value) {
    g_autofree char *format = g_strdup_printf("%%%s%c", as->flags, as->letter);
    g_autofree char *time = g_str_equal(as->shown, "time") ? report_duration(value) : NULL;
    const gboolean share = g_str_equal(as->shown, "%%");
    if (time)
        g_string_append(to->text, time);
    else
        g_string_append_printf(to->text, format, share ? 100 * value : value);
    g_string_append(to->text, share ? " %" : "");
    if (*as->key)
        record_double(to, as->key, value);
}

static void say_conversion(Record *to, const GMatchInfo *match, va_list *arguments) {
    g_autofree char *flags = g_match_info_fetch(match, 1), *is_long = g_match_info_fetch(match, 2);
    g_autofree char *letter = g_match_info_fetch(match, 3), *key = g_match_info_fetch(match, 4);
    g_autofree char *shown = g_match_info_fetch(match, 5);
    const struct conversion as = {flags, key ? key : "", shown ? shown : "", *letter};
    const char *string;
    switch (*letter) {
    case '%':
        g_string_append_c(to->text, '%');
        break;
    case 's':
        string = va_arg(*arguments, const char *);
        say_string(to, &as, string ? string : "");
        break;
    case 'c':
        g_string_append_c(to->text, (char)va_arg(*arguments, int));
        break;
    case 'f':
    case 'g':
        say_double(to, &as, va_arg(*arguments, double));
        break;
    case 'd':
    case 'i':
        say_integer(to, &as, *is_long ? va_arg(*arguments, gint64) : va_arg(*arguments, int));
        break;
    case 'u':
        say_integer(to, &as, *is_long ? va_arg(*arguments, gint64) : va_arg(*arguments, guint));
        break;
    default:
        g_error("record_say() does not know %%%c", *letter);
    }
}

static void say(Record *to, const char *format, va_list *arguments) {
    g_autoptr(GMatchInfo) match = NULL;
    int begin, end, done = 0;
    static gsize made;
    static GRegex *conversion;
    if (g_once_init_enter(&made)) {
        conversion = g_regex_new(CONVERSION, 0, 0, NULL);
        g_once_init_leave(&made, 1);
    }
    g_regex_match(conversion, format, 0, &match);
    for (; g_match_info_matches(match); g_match_info_next(match, NULL)) {
        g_match_info_fetch_pos(match, 0, &begin, &end);
        g_string_append_len(to->text, format + done, begin - done);
        say_conversion(to, match, arguments);
        done = end;
    }
    g_string_append(to->text, format + done);
}

void record_say(Record *to, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    say(to, format, &arguments);
    va_end(arguments);
}

void record_say_if(Record *to, gboolean said, const char *format, ...) {
    const gsize length = to->text->len;
    va_list arguments;
    va_start(arguments, format);
    say(to, format, &arguments);
    va_end(arguments);
    if (!said)
        g_string_truncate(to->text, length);
}

void record_print(Record *record, gboolean json) {
    if (json && record->filled) {
        g_autofree char *text = json_text(g_variant_builder_end(&record->values));
        puts(text);
        fflush(stdout);
    } else if (!json && record->text->len)
        g_print("%s", record->text->str);
}
