/* This file implements the language of Marlin 2. */
#include "gcode_private.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

/* interval in µs of "busy" messages; Marlin's default (HOST_KEEPALIVE_INTERVAL) is 2 s */
#define BUSY_US 500000

static const char letters[] = "XYZABC";

static void boot(VirtualGcode *board, gboolean power) {
    memset(board->state.at, 0, sizeof board->state.at);
    board->alarm = 0;
    board->feed = 0;
    board->last_line = 0;
    board->state.n_resets++;
    gcode_say(board, "start");
    gcode_say(board, "echo:Marlin 2.1.2");
    gcode_say(board, "echo:  M92 X80.00 Y80.00 Z400.00 E93.00");
}

static void kill_board(VirtualGcode *board) {
    gcode_abort(board);
    board->waits = FALSE;
    board->alarm = 1;
    board->state.n_kills++;
    g_string_truncate(board->rx, 0);
    gcode_say(board, "Error:Printer halted. kill() called!");
}

static void quickstop(VirtualGcode *board) {
    const gboolean homes = board->motion == GCODE_HOMING;
    gcode_abort(board);
    if (homes)
        kill_board(board); /* Marlin halts if homing is interrupted */
}

/* The emergency parser acts on a line when it is complete, even if earlier lines still wait. */
static void receive(VirtualGcode *board, char byte) {
    if (board->alarm)
        return;
    g_string_append_c(board->rx, byte);
    if (byte != '\n' || !board->options.emergency_parser)
        return;
    if (g_str_has_suffix(board->rx->str, "M112\n"))
        kill_board(board);
    else if (g_str_has_suffix(board->rx->str, "M410\n"))
        quickstop(board);
}

static void homing_ended(VirtualGcode *board) {
    if (board->faults.no_switch) {
        gcode_say(board, "Error:Homing Failed");
        kill_board(board);
        return;
    }
    for (int i = 0; i < board->options.n_axes; i++)
        if (board->homing_axes >> i & 1)
            board->state.at[i] = board->options.home_at;
}

static void report(VirtualGcode *board) {
    g_autoptr(GString) text = g_string_new(NULL);
    double planned[VIRTUAL_GCODE_AXES];
    gcode_planned(board, planned);
    for (int i = 0; i < board->options.n_axes; i++)
        g_string_append_printf(text, "%c:%.2f ", letters[i], planned[i]);
    g_string_append(text, "E:0.00 Count");
    for (int i = 0; i < board->options.n_axes; i++)
        g_string_append_printf(text, " %c:%ld", letters[i],
                               lround(board->state.at[i] * board->options.steps));
    gcode_say(board, "%s", text->str);
}

static void list_settings(VirtualGcode *board) {
    static const int codes[] = {92, 203, 201};
    const double values[] = {board->options.steps, board->options.units_s, board->options.units_s2};
    gcode_say(board, "echo:; Steps per unit:");
    for (int k = 0; k < 3; k++) {
        g_autoptr(GString) text = g_string_new(NULL);
        for (int i = 0; i < board->options.n_axes; i++)
            g_string_append_printf(text, " %c%.2f", letters[i], values[k]);
        gcode_say(board, "echo:  M%d%s E93.00", codes[k], text->str);
    }
}

static void go(VirtualGcode *board, const char *words) {
    double to[VIRTUAL_GCODE_AXES];
    gcode_planned(board, to);
    for (const char *at = words; *at; at++) {
        const char *axis = strchr(letters, *at);
        if (*at == 'F')
            board->feed = g_ascii_strtod(at + 1, NULL) / 60;
        else if (axis && axis - letters < board->options.n_axes)
            to[axis - letters] = g_ascii_strtod(at + 1, NULL);
    }
    gcode_add_block(board, to, MAX(board->feed, 1e-6));
}

/* Carries out a command. Returns TRUE if the "ok" follows at once, or FALSE if it comes later. */
static gboolean execute(VirtualGcode *board, const char *line) {
    if (g_str_has_prefix(line, "G1 ")) {
        go(board, line + 3);
    } else if (g_str_has_prefix(line, "G28")) {
        const char *axis = line[3] && line[4] ? strchr(letters, line[4]) : NULL;
        gcode_begin_homing(board, axis ? 1u << (axis - letters) : 7);
        board->waits = TRUE;
    } else if (strcmp(line, "M400") == 0) {
        board->waits = TRUE;
    } else if (strcmp(line, "M114") == 0) {
        report(board);
    } else if (strcmp(line, "M410") == 0) {
        if (!board->options.emergency_parser)
            quickstop(board);
    } else if (strcmp(line, "M112") == 0) {
        kill_board(board);
        return FALSE;
    } else if (strcmp(line, "M115") == 0) {
        gcode_say(board, "FIRMWARE_NAME:Marlin 2.1.2 (Jan 1 2023) SOURCE_CODE_URL:github.com/x "
                         "PROTOCOL_VERSION:1.0");
    } else if (strcmp(line, "M503") == 0) {
        list_settings(board);
    } else if (strcmp(line, "G90") != 0) {
        gcode_say(board, "echo:Unknown command: \"%s\"", line);
    }
    board->busy_us = g_get_monotonic_time();
    return !board->waits;
}

static void ask_again(VirtualGcode *board, const char *why) {
    g_string_truncate(board->rx, 0);
    board->state.n_resends++;
    gcode_say(board, "Error:%s, Last Line: %d", why, board->last_line);
    gcode_say(board, "Resend: %d", board->last_line + 1);
    gcode_say(board, "ok");
}

/* Checks and removes the line number and the checksum of a line that begins with N. “M110 N” sets
 * the number of the last line. Other lines are not changed. Returns FALSE if the program must send
 * the line again. */
static gboolean unwrap(VirtualGcode *board, char *line) {
    int number, sum;
    char *star = strrchr(line, '*'), *blank = strchr(line, ' ');
    if (g_str_has_prefix(line, "M110 N")) {
        board->last_line = (int)g_ascii_strtoll(line + 6, NULL, 10);
        strcpy(line, "G90");
        return TRUE;
    }
    if (line[0] != 'N')
        return TRUE;
    if (!star || !blank || sscanf(line + 1, "%d", &number) != 1 ||
        sscanf(star + 1, "%d", &sum) != 1) {
        ask_again(board, "No Checksum with line number");
        return FALSE;
    }
    *star = 0;
    guint8 is = 0;
    for (const char *at = line; *at; at++)
        is ^= (guint8)*at;
    if (is != sum) {
        ask_again(board, "checksum mismatch");
        return FALSE;
    }
    if (number != board->last_line + 1) {
        ask_again(board, "Line Number is not Last Line Number+1");
        return FALSE;
    }
    board->last_line = number;
    memmove(line, blank + 1, strlen(blank + 1) + 1);
    return TRUE;
}

static void work(VirtualGcode *board) {
    char line[128];
    const gint64 now = g_get_monotonic_time();
    if (board->waits && board->motion == GCODE_STANDING && board->n_blocks == 0) {
        board->waits = FALSE;
        gcode_say(board, "ok");
    } else if (board->waits && now > board->busy_us + BUSY_US) {
        board->busy_us = now;
        gcode_say(board, "echo:busy: processing");
    }
    while (!board->waits && !board->alarm && board->n_blocks < GCODE_BLOCKS &&
           gcode_take_line(board, line, sizeof line)) {
        board->state.n_lines++;
        if (line[0] && unwrap(board, line) && execute(board, line))
            gcode_say(board, "ok");
    }
}

const struct gcode_language gcode_language_marlin = {boot, receive, work, homing_ended};
