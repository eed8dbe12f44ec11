/* This file implements the language of Klipper. */
#include "gcode_private.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define START_US 250000 /* time from the first move until the motion begins */
/* the "ok" of a move comes when at most this time of motion is still to be made */
#define AHEAD_US 1000000

static const char letters[] = "XYZ";

static void boot(VirtualGcode *board, gboolean power) {
    board->ready = board->waits = board->is_ahead = FALSE;
    board->state.n_resets++;
    gcode_say(board, "// Klipper state: Disconnect");
}

/* Klipper has connected to its controllers. */
static void become_ready(VirtualGcode *board) {
    memset(board->state.at, 0, sizeof board->state.at);
    board->ready = TRUE;
    board->alarm = 0;
    board->homed = 0;
    board->feed = 25;
    if (!board->options.halted)
        gcode_say(board, "// Klipper state: Ready");
}

/* Refuses a command with an error that consists of several lines. */
static void refuse(VirtualGcode *board, gboolean is_status) {
    const char *why =
        board->alarm ? "Shutdown due to M112 command" : "Option 'step_pin' is not specified";
    gcode_say(board, "// %s", why);
    if (!board->alarm) {
        gcode_say(board, "// Once the underlying issue is corrected, use the \"RESTART\"");
        gcode_say(board, "// command to reload the config and restart the host software.");
        gcode_say(board, "// Printer is halted");
    } else if (!board->options.terse) {
        gcode_say(board, "// Once the underlying issue is corrected, use the");
        gcode_say(board, "// \"FIRMWARE_RESTART\" command to reset the firmware, reload the");
        gcode_say(board, "// config, and restart the host software.");
        gcode_say(board, "// Printer is shutdown");
    }
    if (is_status)
        gcode_say(board, "// Klipper state: Not ready");
    gcode_say(board, "!! %s", why);
}

static void shut_down(VirtualGcode *board) {
    const gboolean homes = board->motion == GCODE_HOMING;
    if (board->alarm)
        return;
    gcode_abort(board);
    board->alarm = 1;
    board->state.n_kills++;
    gcode_say(board, "// Klipper state: Shutdown");
    if (homes)
        gcode_say(board, "!! Homing failed due to printer shutdown");
}

/* M112 acts as soon as its line is complete, even if earlier lines still wait. */
static void receive(VirtualGcode *board, char byte) {
    g_string_append_c(board->rx, byte);
    if (byte == '\n' && g_str_has_suffix(board->rx->str, "M112\n"))
        shut_down(board);
}

static void homing_ended(VirtualGcode *board) {
    if (board->faults.no_switch) {
        gcode_say(board, "!! No trigger on x after full movement");
        return;
    }
    for (int i = 0; i < board->options.n_axes; i++)
        if (board->homing_axes >> i & 1)
            board->state.at[i] = board->options.home_at;
    board->homed |= board->homing_axes;
}

/* Begins a move, or prolongs the motion that is being made. Returns FALSE if the line must wait,
 * because neither is possible now. */
static gboolean go(VirtualGcode *board, const char *words) {
    double to[VIRTUAL_GCODE_AXES], from[VIRTUAL_GCODE_AXES];
    gcode_planned(board, to);
    memcpy(from, to, sizeof from);
    for (const char *at = words; *at; at++) {
        const char *axis = strchr(letters, *at);
        if (*at == 'F')
            board->feed = g_ascii_strtod(at + 1, NULL) / 60;
        else if (axis)
            to[axis - letters] = g_ascii_strtod(at + 1, NULL);
    }
    gboolean moves = FALSE;
    for (int i = 0; i < 3; i++) {
        const gboolean beyond =
            board->options.max_travel > 0 && fabs(to[i]) > board->options.max_travel;
        moves |= to[i] != from[i];
        if (to[i] == from[i] || (board->homed >> i & 1 && !beyond))
            continue;
        gcode_say(board, "!! %s: %.3f %.3f %.3f [0.000]",
                  beyond ? "Move out of range" : "Must home axis first", to[0], to[1], to[2]);
        return TRUE;
    }
    return !moves || gcode_extend(board, to, board->feed, START_US);
}

static void report(VirtualGcode *board) {
    double planned[VIRTUAL_GCODE_AXES];
    gcode_planned(board, planned);
    gcode_say(board, "X:%.3f Y:%.3f Z:%.3f E:0.000", planned[0], planned[1], planned[2]);
}

static void list_limits(VirtualGcode *board) {
    gcode_say(board, "// max_velocity: %.6f", board->options.units_s);
    gcode_say(board, "// max_accel: %.6f", board->options.units_s2);
    gcode_say(board, "// minimum_cruise_ratio: 0.500000");
    gcode_say(board, "// square_corner_velocity: 5.000000");
}

/* Carries out a command that Klipper knows even before it is ready. Returns FALSE for other
 * commands. */
static gboolean execute_always(VirtualGcode *board, const char *line) {
    if (g_str_has_prefix(line, "ECHO ")) {
        gcode_say(board, "// %s", line);
    } else if (strcmp(line, "M112") == 0) {
        shut_down(board);
    } else if (strcmp(line, "M114") == 0) {
        report(board);
    } else if (strcmp(line, "STATUS") == 0 && !board->alarm && !board->options.halted) {
        gcode_say(board, "// Klipper state: Ready");
    } else if (strcmp(line, "STATUS") == 0) {
        refuse(board, TRUE);
    } else {
        return FALSE;
    }
    return TRUE;
}

/* Returns FALSE if the line must wait. */
static gboolean execute(VirtualGcode *board, const char *line) {
    const char *axis = NULL;
    if (g_str_has_prefix(line, "G1 "))
        return go(board, line + 3);
    if (g_str_has_prefix(line, "G28")) {
        axis = line[3] && line[4] ? strchr(letters, line[4]) : NULL;
        gcode_begin_homing(board, axis ? 1u << (axis - letters) : 7);
        board->waits = TRUE;
    } else if (strcmp(line, "M400") == 0) {
        board->waits = TRUE;
    } else if (g_str_has_prefix(line, "SET_KINEMATIC_POSITION ") && !board->options.homing_off) {
        axis = strchr(letters, line[23]);
        board->state.at[axis - letters] = g_ascii_strtod(line + 25, NULL);
        board->homed |= 1u << (axis - letters);
    } else if (strcmp(line, "SET_VELOCITY_LIMIT") == 0) {
        list_limits(board);
    } else if (line[0] && strcmp(line, "G90") != 0) {
        g_autofree char *word = g_strndup(line, strcspn(line, " "));
        gcode_say(board, "// Unknown command:\"%s\"", word);
    }
    return TRUE;
}

static void restart(VirtualGcode *board) {
    gcode_abort(board);
    g_string_truncate(board->rx, 0);
    boot(board, TRUE);
    board->deaf_until_us = g_get_monotonic_time() + board->options.boot_ms * (gint64)1000;
}

/* Carries out a line. Returns FALSE if the line must wait. */
static gboolean take(VirtualGcode *board, const char *line) {
    const gboolean moves = g_str_has_prefix(line, "G1 ");
    if (strcmp(line, "M115") == 0) {
        gcode_say(board, "ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.13.0-300-g1234567");
        return TRUE;
    }
    if (strcmp(line, "FIRMWARE_RESTART") == 0) {
        gcode_say(board, "ok");
        restart(board);
        return TRUE;
    }
    if (!execute_always(board, line)) {
        if (board->alarm || board->options.halted) {
            refuse(board, FALSE);
        } else if (!execute(board, line)) {
            return FALSE;
        }
    }
    board->is_ahead = moves;
    if (!board->waits && !board->is_ahead)
        gcode_say(board, "ok");
    return TRUE;
}

static void work(VirtualGcode *board) {
    char line[256];
    if (!board->ready)
        become_ready(board);
    const gboolean stands = board->motion == GCODE_STANDING && board->n_blocks == 0;
    const gboolean ahead =
        !stands && board->end_us - g_get_monotonic_time() > AHEAD_US && !board->alarm;
    if ((board->waits && stands) || (board->is_ahead && !ahead)) {
        board->waits = board->is_ahead = FALSE;
        gcode_say(board, "ok");
    }
    /* One line is executed per call. Calls are about a millisecond apart. */
    if (board->waits || board->is_ahead || !gcode_take_line(board, line, sizeof line))
        return;
    board->state.n_lines++;
    if (!take(board, line)) {
        g_string_prepend_c(board->rx, '\n');
        g_string_prepend(board->rx, line);
    }
}

const struct gcode_language gcode_language_klipper = {boot, receive, work, homing_ended};
