/*
 * The lines between this program and a serial LED controller (docs/build-a-rig/led-controller.md).
 * Plain data. Any thread may call these functions.
 *
 *     request  L1 002a s 03 ff*91de     lamp 3 to level 255
 *     request  L1 002b o*1105           all lamps off
 *     request  L1 002c p*c5eb           ping
 *     answer   L1 002a S 07d0 000000ff*99a3
 *
 * Every answer has the number of its request and the levels of all lamps. The checksum after the
 * asterisk is CRC-16/CCITT-FALSE of everything before the asterisk.
 */
#pragma once

#include <glib.h>

#define LAMP_LINE_MAX_LAMPS 64
#define LAMP_LINE_SIZE      256 /* a line of this length or more is noise */

enum lamp_request { LAMP_PING, LAMP_OFF, LAMP_SET };

enum lamp_answer_kind {
    LAMP_ANSWER_NONE, /* noise, or a damaged line */
    LAMP_ANSWER_PING,
    LAMP_ANSWER_OFF,
    LAMP_ANSWER_SET,
    LAMP_ANSWER_ERROR, /* the board has refused the request, for example because it has no such
                        * lamp */
    LAMP_ANSWER_RESET, /* the board has started; this line answers no request */
};

struct lamp_answer {
    enum lamp_answer_kind kind;
    int number;      /* number of the request, 1 to 65535; 0 for LAMP_ANSWER_RESET */
    int watchdog_ms; /* the lamps go off when no request has come for this time, in ms; above 0 */
    int n;           /* number of lamps, 1 to LAMP_LINE_MAX_LAMPS */
    guint8 levels[LAMP_LINE_MAX_LAMPS]; /* 0: off */
};

guint16 lamp_line_crc(const char *bytes, gsize n);

/* Returns a request with its end of line. It begins with an end of line, which separates it from
 * noise before it. index and level are used for LAMP_SET only. g_free() */
char *lamp_line_request(int number, enum lamp_request request, int index, int level);

/* Parses a line without its end. */
void lamp_line_read(const char *line, struct lamp_answer *ret);
