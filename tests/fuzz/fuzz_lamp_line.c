/* Lines of a serial LED controller. The checksum is corrected, so that the fields are reached. */
#include "fuzz.h"
#include "serial/lamp_line.h"

#include <string.h>

static void check(const struct lamp_answer *answer) {
    if (answer->kind == LAMP_ANSWER_NONE)
        return;
    g_assert_cmpint(answer->n, >=, 1);
    g_assert_cmpint(answer->n, <=, LAMP_LINE_MAX_LAMPS);
    g_assert_cmpint(answer->watchdog_ms, >, 0);
    g_assert_cmpint(answer->watchdog_ms, <=, 0xffff);
    g_assert_cmpint(answer->number, <=, 0xffff);
    g_assert_cmpint(answer->number, >=, answer->kind != LAMP_ANSWER_RESET);
    for (int i = answer->n; i < LAMP_LINE_MAX_LAMPS; i++)
        g_assert_cmpint(answer->levels[i], ==, 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    g_auto(GStrv) lines = g_strsplit_set(text, "\r\n", -1);
    for (char **line = lines; *line; line++) {
        struct lamp_answer answer;
        lamp_line_read(*line, &answer);
        check(&answer);
        char *star = strrchr(*line, '*');
        const gsize n = star ? (gsize)(star - *line) : strlen(*line);
        g_autofree char *corrected =
            g_strdup_printf("%.*s*%04x", (int)n, *line, lamp_line_crc(*line, n));
        lamp_line_read(corrected, &answer);
        check(&answer);
    }
    return 0;
}
