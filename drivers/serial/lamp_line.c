#include "lamp_line.h"

#include <string.h>

guint16 lamp_line_crc(const char *bytes, gsize n) {
    guint crc = 0xffff;
    for (gsize i = 0; i < n; i++) {
        crc ^= (guint)(guint8)bytes[i] << 8;
        for (int bit = 0; bit < 8; bit++)
            crc = crc & 0x8000 ? crc << 1 ^ 0x1021 : crc << 1;
        crc &= 0xffff;
    }
    return (guint16)crc;
}

char *lamp_line_request(int number, enum lamp_request request, int index, int level) {
    g_autofree char *body = request == LAMP_SET
                                ? g_strdup_printf("L1 %04x s %02x %02x", number, index, level)
                                : g_strdup_printf("L1 %04x %c", number, request ? 'o' : 'p');
    return g_strdup_printf("\n%s*%04x\n", body, lamp_line_crc(body, strlen(body)));
}

/* Parses the given number of hexadecimal digits in lower case. Returns −1 if one of the characters
 * is not such a digit. */
static int read_hex(const char *at, int digits) {
    int value = 0;
    for (int i = 0; i < digits; i++) {
        const int digit = g_ascii_isupper(at[i]) ? -1 : g_ascii_xdigit_value(at[i]);
        if (digit < 0)
            return -1;
        value = 16 * value + digit;
    }
    return value;
}

/* The fields have fixed places: "L1 002a S 07d0 000000ff*99a3". */
#define NUMBER_AT   3
#define KIND_AT     8
#define WATCHDOG_AT 10
#define LEVELS_AT   15

void lamp_line_read(const char *line, struct lamp_answer *ret) {
    static const char kinds[] = "POSER";
    const gsize size = strlen(line);
    *ret = (struct lamp_answer){.kind = LAMP_ANSWER_NONE};
    if (size < LEVELS_AT + 2 + 5 || size >= LAMP_LINE_SIZE || !g_str_has_prefix(line, "L1 ") ||
        line[NUMBER_AT + 4] != ' ' || line[KIND_AT + 1] != ' ' || line[WATCHDOG_AT + 4] != ' ' ||
        line[size - 5] != '*')
        return;
    const char *kind = strchr(kinds, line[KIND_AT]);
    struct lamp_answer answer = {.number = read_hex(line + NUMBER_AT, 4),
                                 .watchdog_ms = read_hex(line + WATCHDOG_AT, 4),
                                 .n = (int)(size - 5 - LEVELS_AT) / 2};
    if (!kind || answer.number < 0 || answer.watchdog_ms <= 0 || (size - 5 - LEVELS_AT) % 2 != 0 ||
        answer.n > LAMP_LINE_MAX_LAMPS ||
        read_hex(line + size - 4, 4) != lamp_line_crc(line, size - 5))
        return;
    for (int i = 0; i < answer.n; i++) {
        const int level = read_hex(line + LEVELS_AT + (gsize)2 * (gsize)i, 2);
        if (level < 0)
            return;
        answer.levels[i] = (guint8)level;
    }
    answer.kind = LAMP_ANSWER_PING + (enum lamp_answer_kind)(kind - kinds);
    if ((answer.kind == LAMP_ANSWER_RESET) == (answer.number == 0))
        *ret = answer;
}
