/* Lines that the program of a device sends, and the values that drivers read from them. */
#include "fuzz.h"
#include "program/message.h"

#include <math.h>
#include <string.h>

/* A text that is shown is one line. */
static void check_text(const char *text) {
    g_assert_true(g_utf8_validate(text, -1, NULL));
    for (; *text; text++)
        g_assert_false(g_ascii_iscntrl(*text));
}

static void read_values(JsonObject *values) {
    static const char *const names[] = {"on", "lamps", "version", "deg", "device", "capabilities"};
    GError *error = NULL;
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++) {
        double number = NAN;
        gint64 integer = -1;
        gboolean flags[4] = {2, 2, 2, 2}, flag = 2;
        gboolean ok = message_number(values, names[i], -1e6, 1e6, &number, &error);
        fuzz_check(ok, &error);
        g_assert_true(!ok || fabs(number) <= 1e6);
        ok = message_integer(values, names[i], 1, 1024, &integer, &error);
        fuzz_check(ok, &error);
        g_assert_true(!ok || (integer >= 1 && integer <= 1024));
        ok = message_integer(values, names[i], G_MININT64, G_MAXINT64, &integer, &error);
        fuzz_check(ok, &error);
        ok = message_boolean(values, names[i], &flag, &error);
        fuzz_check(ok, &error);
        g_assert_true(!ok || flag == TRUE || flag == FALSE);
        ok = message_booleans(values, names[i], 4, flags, &error);
        fuzz_check(ok, &error);
        for (int k = 0; ok && k < 4; k++)
            g_assert_true(flags[k] == TRUE || flags[k] == FALSE);
        g_autofree gint64 *integers = NULL;
        int n = 0;
        ok = message_integers(values, names[i], 1, 1024, &integers, &n, &error);
        fuzz_check(ok, &error);
        g_assert_true(!ok || n > 0);
        for (int k = 0; ok && k < n; k++)
            g_assert_true(integers[k] >= 1 && integers[k] <= 1024);
        g_autofree char *text = message_text(values, names[i]);
        check_text(text);
        message_has(values, names[i], "silence");
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *line = (const char *)data, *last = line + size;
    while (line < last) {
        const char *end = memchr(line, '\n', (size_t)(last - line));
        const size_t length = (size_t)((end ? end : last) - line);
        struct message message;
        GError *error = NULL;
        const gboolean ok = message_read(line, length, &message, &error);
        fuzz_check(ok, &error);
        if (ok) {
            /* Without an id it is an event, or the error of a request that could not be read. */
            g_assert_true(message.event ? message.id == 0
                                        : message.id != 0 || message.failure != NULL);
            g_assert_true((message.values == NULL) == (message.failure != NULL));
            check_text(message.event ? message.event : message.failure ? message.failure : "");
            if (message.values)
                read_values(message.values);
            message_clear(&message);
        }
        line += length + 1;
    }
    return 0;
}
