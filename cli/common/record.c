#include "record.h"

#include "base/json.h"

#include <stdio.h>

#define DEEPEST 8

struct Record {
    GVariantBuilder values;
    gboolean filled;
    GString *text;
    int depth, levels[DEEPEST]; /* number of containers that each record_end() closes */
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

void record_say(Record *to, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_string_append_vprintf(to->text, format, arguments);
    va_end(arguments);
}

void record_print(Record *record, gboolean json) {
    if (json && record->filled) {
        g_autofree char *text = json_text(g_variant_builder_end(&record->values));
        puts(text);
        fflush(stdout);
    } else if (!json && record->text->len)
        g_print("%s", record->text->str);
}
