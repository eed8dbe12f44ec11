/* Lines between the driver and a serial LED controller. */
#include "lib/test.h"
#include "serial/lamp_line.h"

#include <string.h>

/* The check value of CRC-16/CCITT-FALSE in the catalogues of checksums. */
TEST(crc) {
    g_assert_cmphex(lamp_line_crc("123456789", 9), ==, 0x29b1);
}

/* The checksums are from Python: binascii.crc_hqx(text, 0xffff). */
TEST(requests) {
    static const struct {
        int number;
        enum lamp_request request;
        int index, level;
        const char *text;
    } cases[] = {{0x2a, LAMP_SET, 3, 255, "\nL1 002a s 03 ff*91de\n"},
                 {0x2b, LAMP_OFF, -1, 0, "\nL1 002b o*1105\n"},
                 {0x2c, LAMP_PING, -1, 0, "\nL1 002c p*c5eb\n"}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        struct lamp_answer answer;
        g_autofree char *text =
            lamp_line_request(cases[i].number, cases[i].request, cases[i].index, cases[i].level);
        g_assert_cmpstr(text, ==, cases[i].text);
        /* A port that sends back what it gets does not look like a controller. */
        lamp_line_read(g_strstrip(text), &answer);
        g_assert_cmpint(answer.kind, ==, LAMP_ANSWER_NONE);
    }
}

TEST(answer) {
    struct lamp_answer answer;
    lamp_line_read("L1 002a S 07d0 000000ff*99a3", &answer);
    g_assert_cmpint(answer.kind, ==, LAMP_ANSWER_SET);
    g_assert_cmpint(answer.number, ==, 0x2a);
    g_assert_cmpint(answer.watchdog_ms, ==, 2000);
    g_assert_cmpint(answer.n, ==, 4);
    g_assert_cmpint(answer.levels[2], ==, 0);
    g_assert_cmpint(answer.levels[3], ==, 255);
}

/* No answer that differs from a true one in one byte, or is cut off, is taken. */
TEST(damage) {
    static const char line[] = "L1 002a S 07d0 000000ff*99a3";
    for (gsize i = 0; i < strlen(line); i++) {
        for (int byte = 0; byte < 256; byte++) {
            struct lamp_answer answer;
            char damaged[sizeof line];
            strcpy(damaged, line);
            damaged[i] = (char)byte;
            lamp_line_read(damaged, &answer);
            g_assert_cmpint(answer.kind != LAMP_ANSWER_NONE, ==, damaged[i] == line[i]);
        }
    }
}

static void expect(const char *body, enum lamp_answer_kind kind) {
    struct lamp_answer answer;
    g_autofree char *line = g_strdup_printf("%s*%04x", body, lamp_line_crc(body, strlen(body)));
    lamp_line_read(line, &answer);
    g_assert_cmpint(answer.kind, ==, kind);
    if (kind == LAMP_ANSWER_NONE)
        g_assert_cmpint(answer.number, ==, 0);
}

/* Lines with a correct checksum that are not answers. */
TEST(mistakes) {
    g_autofree char *many = g_strnfill((gsize)2 * LAMP_LINE_MAX_LAMPS, '0');
    g_autofree char *most = g_strconcat("L1 0001 P 07d0 ", many, NULL);
    g_autofree char *more = g_strconcat(most, "00", NULL);
    expect("L1 0001 P 07d0 00", LAMP_ANSWER_PING);
    expect("L1 0001 O 07d0 00", LAMP_ANSWER_OFF);
    expect("L1 0001 E 07d0 00", LAMP_ANSWER_ERROR);
    expect("L1 0000 R 07d0 00", LAMP_ANSWER_RESET);
    expect(most, LAMP_ANSWER_PING);
    expect(more, LAMP_ANSWER_NONE);
    expect("L1 0000 P 07d0 00", LAMP_ANSWER_NONE);
    expect("L1 0001 R 07d0 00", LAMP_ANSWER_NONE);
    expect("L1 0001 Q 07d0 00", LAMP_ANSWER_NONE);
    expect("L1 0001 P 0000 00", LAMP_ANSWER_NONE);
    expect("L1 0001 P 07D0 00", LAMP_ANSWER_NONE);
    expect("L1 0001 P 07d0 000", LAMP_ANSWER_NONE);
    expect("L1 0001 P 07d0 0g", LAMP_ANSWER_NONE);
    expect("L1 0001 P 07d0 ", LAMP_ANSWER_NONE);
    expect("L2 0001 P 07d0 00", LAMP_ANSWER_NONE);
    expect("L1 0001_P 07d0 00", LAMP_ANSWER_NONE);
}
