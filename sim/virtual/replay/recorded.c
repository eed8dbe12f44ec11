#include "recorded.h"

#include "drivers/recording.h"

#include <gio/gio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_MESSAGE (1 << 20)
#define MAX_BUSES   64
#define MAX_TIME_US (G_GUINT64_CONSTANT(1) << 50)

static void line_free(gpointer data) {
    struct recorded_line *line = data;
    g_clear_pointer(&line->bytes, g_bytes_unref);
    g_free(line->who);
    g_free(line->text);
    g_free(line);
}

void recorded_free(Recorded *recorded) {
    if (!recorded)
        return;
    g_ptr_array_unref(recorded->kinds);
    g_ptr_array_unref(recorded->lines);
    g_free(recorded->path);
    g_free(recorded->sections);
    g_free(recorded);
}

static gboolean refuse(const Recorded *in, int number, GError **error, const char *what) {
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA, "%s:%d: %s", in->path, number, what);
    return FALSE;
}

/* Reads a text in quotation marks to its end. */
static GBytes *read_quoted(const char *at) {
    g_autoptr(GByteArray) to = g_byte_array_new();
    for (at++; *at && *at != '"'; at++) {
        guint8 c = (guint8)*at;
        if (c == '\\') {
            static const char names[] = "nrt\"\\", values[] = "\n\r\t\"\\";
            const char *name = *++at ? strchr(names, *at) : NULL;
            if (name) {
                c = (guint8)values[name - names];
            } else if (*at == 'x' && g_ascii_isxdigit(at[1]) && g_ascii_isxdigit(at[2])) {
                c = (guint8)(g_ascii_xdigit_value(at[1]) << 4 | g_ascii_xdigit_value(at[2]));
                at += 2;
            } else {
                return NULL;
            }
        }
        g_byte_array_append(to, &c, 1);
    }
    if (strcmp(at, "\"") != 0)
        return NULL;
    return g_byte_array_free_to_bytes(g_steal_pointer(&to));
}

/* Reads bytes. Each is written as two hexadecimal digits. "*N" after a byte means that it comes N
 * times. */
static GBytes *read_hex(const char *at) {
    g_autoptr(GByteArray) to = g_byte_array_new();
    while (*at) {
        if (!g_ascii_isxdigit(at[0]) || !g_ascii_isxdigit(at[1]))
            return NULL;
        const guint8 c = (guint8)(g_ascii_xdigit_value(at[0]) << 4 | g_ascii_xdigit_value(at[1]));
        guint64 n = 1;
        at += 2;
        if (*at == '*') {
            char *end;
            n = g_ascii_strtoull(at + 1, &end, 10);
            if (end == at + 1)
                return NULL;
            at = end;
        }
        if (n < 1 || n > MAX_MESSAGE || to->len + n > MAX_MESSAGE)
            return NULL;
        const guint from = to->len;
        g_byte_array_set_size(to, from + (guint)n);
        memset(to->data + from, c, n);
        if (*at == ' ')
            at++;
        else if (*at)
            return NULL;
    }
    return g_byte_array_free_to_bytes(g_steal_pointer(&to));
}

/* Reads the part of a line after the time, such as "@1 > …" or "[axis turntable] …". */
static gboolean read_body(const Recorded *in, struct recorded_line *line, const char *at,
                          GError **error) {
    if (*at == '[') {
        const char *end = strstr(at, "] ");
        if (!end)
            return refuse(in, line->number, error, "“]” and a text must follow the device");
        line->who = g_strndup(at + 1, (gsize)(end - at - 1));
        line->text = g_strdup(end + 2);
        return TRUE;
    }
    char *end;
    const guint64 bus = *at == '@' ? g_ascii_strtoull(at + 1, &end, 10) : 0;
    if (bus < 1 || bus > in->kinds->len)
        return refuse(in, line->number, error,
                      "a bus that the head lists, such as @1, or a [device] must follow the time");
    if (end[0] != ' ' || !end[1] || !strchr("><-", end[1]) || (end[2] && end[2] != ' '))
        return refuse(in, line->number, error, "“ > ”, “ < ” or “ - ” must follow the bus");
    line->bus = (int)bus;
    line->way = end[1];
    const char *message = end[2] ? end + 3 : "";
    line->bytes = *message == '"' ? read_quoted(message) : read_hex(message);
    return line->bytes || refuse(in, line->number, error,
                                 "the message is neither a text in quotation marks nor "
                                 "hexadecimal bytes");
}

static gboolean read_line(Recorded *in, int number, const char *text, GError **error) {
    char *end;
    struct recorded_line *line = g_new0(struct recorded_line, 1);
    line->number = number;
    g_ptr_array_add(in->lines, line);
    line->at_us = (gint64)MIN(g_ascii_strtoull(text, &end, 10), MAX_TIME_US);
    return (end > text && *end == ' ')
               ? read_body(in, line, end + 1, error)
               : refuse(in, number, error, "the line must begin with a time in µs");
}

/* Reads a line "@1 = serial" of the head. */
static gboolean read_bus(Recorded *in, int number, const char *text, GError **error) {
    g_autofree char *start = g_strdup_printf("@%u = ", in->kinds->len + 1);
    if (in->kinds->len >= MAX_BUSES || !g_str_has_prefix(text, start))
        return refuse(in, number, error, "the buses must be numbered from @1 on");
    g_ptr_array_add(in->kinds, g_strdup(text + strlen(start)));
    return TRUE;
}

static gboolean is_message(const char *text) {
    while (*text == ' ')
        text++;
    return g_ascii_isdigit(*text);
}

Recorded *recorded_parse(const char *text, const char *path, GError **error) {
    g_autoptr(Recorded) in = g_new0(Recorded, 1);
    g_autoptr(GString) sections = g_string_new(NULL);
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    gboolean in_head = TRUE, good = TRUE;
    in->path = g_strdup(path);
    in->kinds = g_ptr_array_new_with_free_func(g_free);
    in->lines = g_ptr_array_new_with_free_func(line_free);
    if (g_strcmp0(lines[0], "mesorig-recording " G_STRINGIFY(RECORDING_VERSION)) != 0) {
        refuse(in, 1, error,
               "it is not a recording of version " G_STRINGIFY(
                   RECORDING_VERSION) ": its first "
                                      "line must be “mesorig-recording " G_STRINGIFY(
                                          RECORDING_VERSION) "”");
        return NULL;
    }
    for (int i = 1; lines[i] && good; i++) {
        in_head &= *lines[i] != '[';
        in->from_model |= in_head && g_str_has_prefix(lines[i], "made from = a model");
        if (*lines[i] == '#' || !*lines[i])
            continue;
        if (is_message(lines[i]))
            good = read_line(in, i + 1, g_strchug(lines[i]), error);
        else if (in_head && *lines[i] == '@')
            good = read_bus(in, i + 1, lines[i], error);
        else if (!in_head)
            g_string_append_printf(sections, "%s\n", lines[i]);
    }
    if (!good)
        return NULL;
    in->sections = g_string_free(g_steal_pointer(&sections), FALSE);
    return g_steal_pointer(&in);
}
