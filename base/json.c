#include "json.h"

#include <math.h>

void json_append_string(GString *to, const char *text) {
    g_autofree char *valid = g_utf8_make_valid(text, -1);
    g_string_append_c(to, '"');
    for (const char *at = valid; *at; at++) {
        if (*at == '"' || *at == '\\')
            g_string_append_printf(to, "\\%c", *at);
        else if (*at == '\n')
            g_string_append(to, "\\n");
        else if ((unsigned char)*at < 0x20 || *at == 0x7f)
            g_string_append_printf(to, "\\u%04x", (unsigned)*at);
        else if ((unsigned char)*at == 0xc2 && (unsigned char)at[1] < 0xa0) /* U+0080 … U+009F */
            g_string_append_printf(to, "\\u%04x", (unsigned)(unsigned char)*++at);
        else
            g_string_append_c(to, *at);
    }
    g_string_append_c(to, '"');
}

static void append_double(GString *to, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    if (!isfinite(value)) {
        g_string_append(to, "null");
        return;
    }
    /* Finds the shortest text that reads back as the same number. */
    for (int digits = 6; digits <= 17; digits++) {
        char format[8];
        g_snprintf(format, sizeof(format), "%%.%dg", digits);
        g_ascii_formatd(text, sizeof(text), format, value);
        if (g_ascii_strtod(text, NULL) == value)
            break;
    }
    g_string_append(to, text);
}

static void append(GString *to, GVariant *value);

static void append_children(GString *to, GVariant *value) {
    const gboolean object = g_variant_is_of_type(value, G_VARIANT_TYPE("a{s*}"));
    const gsize n = g_variant_n_children(value);
    g_string_append_c(to, object ? '{' : '[');
    for (gsize i = 0; i < n; i++) {
        g_autoptr(GVariant) child = g_variant_get_child_value(value, i);
        if (i > 0)
            g_string_append(to, ", ");
        if (object) {
            g_autoptr(GVariant) key = g_variant_get_child_value(child, 0);
            g_autoptr(GVariant) member = g_variant_get_child_value(child, 1);
            json_append_string(to, g_variant_get_string(key, NULL));
            g_string_append(to, ": ");
            append(to, member);
        } else {
            append(to, child);
        }
    }
    g_string_append_c(to, object ? '}' : ']');
}

static void append(GString *to, GVariant *value) {
    switch (g_variant_classify(value)) {
    case G_VARIANT_CLASS_BOOLEAN:
        g_string_append(to, g_variant_get_boolean(value) ? "true" : "false");
        break;
    case G_VARIANT_CLASS_STRING:
    case G_VARIANT_CLASS_OBJECT_PATH:
    case G_VARIANT_CLASS_SIGNATURE:
        json_append_string(to, g_variant_get_string(value, NULL));
        break;
    case G_VARIANT_CLASS_DOUBLE:
        append_double(to, g_variant_get_double(value));
        break;
    case G_VARIANT_CLASS_VARIANT:
    case G_VARIANT_CLASS_MAYBE: {
        g_autoptr(GVariant) inner = g_variant_classify(value) == G_VARIANT_CLASS_MAYBE
                                        ? g_variant_get_maybe(value)
                                        : g_variant_get_variant(value);
        if (inner)
            append(to, inner);
        else
            g_string_append(to, "null");
        break;
    }
    case G_VARIANT_CLASS_ARRAY:
    case G_VARIANT_CLASS_TUPLE:
        append_children(to, value);
        break;
    /* For integers, g_variant_print() without the type gives JSON. For bytes it would print
     * hexadecimal numbers. */
    default: {
        g_autofree char *text = g_variant_get_type_string(value)[0] == 'y'
                                    ? g_strdup_printf("%u", g_variant_get_byte(value))
                                    : g_variant_print(value, FALSE);
        g_string_append(to, text);
    }
    }
}

char *json_text(GVariant *value) {
    g_autoptr(GVariant) owned = g_variant_ref_sink(value);
    GString *text = g_string_new(NULL);
    append(text, owned);
    return g_string_free(text, FALSE);
}
