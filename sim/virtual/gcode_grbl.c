/* This file implements the language of GRBL 1.1h. */
#include "gcode_private.h"

#include <math.h>
#include <string.h>

#define OFFSET 10 /* work coordinates are machine coordinates minus this number of units */

static const char letters[] = "XYZABC";

static void answer(VirtualGcode *board, int length, int error) {
    board->n_unanswered -= length;
    board->state.n_lines++;
    if (error)
        gcode_say(board, "error:%d", error);
    else
        gcode_say(board, "ok");
}

static void alarm_now(VirtualGcode *board, int number) {
    board->alarm = number;
    board->waits = FALSE;
    gcode_say(board, "ALARM:%d", number);
    if (number == 1 || number == 2) {
        board->locked_up = TRUE;
        gcode_say(board, "[MSG:Reset to continue]");
    }
}

static void boot(VirtualGcode *board, gboolean power) {
    if (power) {
        memset(board->state.at, 0, sizeof board->state.at);
        board->alarm = !board->options.homing_off;
    }
    board->locked_up = board->check = board->relative = FALSE;
    board->feed = 0;
    board->n_reports = 0;
    board->state.n_resets++;
    gcode_say(board, "%s", "");
    gcode_say(board, "Grbl 1.1h ['$' for help]");
    if (board->alarm)
        gcode_say(board, "[MSG:'$H'|'$X' to unlock]");
}

static void soft_reset(VirtualGcode *board) {
    const gboolean homes = board->motion == GCODE_HOMING;
    g_string_truncate(board->rx, 0);
    board->n_unanswered = 0;
    board->waits = FALSE;
    if (gcode_abort(board))
        alarm_now(board, homes ? 6 : 3);
    boot(board, FALSE);
    if (board->door)
        grbl_set_door(board);
}

void grbl_press(VirtualGcode *board) {
    if (board->motion != GCODE_HOMING && gcode_abort(board))
        alarm_now(board, 1);
}

void grbl_set_door(VirtualGcode *board) {
    if (board->door && board->motion == GCODE_HOMING) {
        gcode_abort(board);
        alarm_now(board, 7);
        boot(board, FALSE);
    } else if (board->door) {
        gcode_brake(board);
    }
}

static const char *state_text(const VirtualGcode *board) {
    if (board->door)
        return board->motion == GCODE_BRAKING ? "Door:2" : "Door:1";
    if (board->alarm)
        return "Alarm";
    switch (board->motion) {
    case GCODE_MOVING:
        return "Run";
    case GCODE_BRAKING:
        return "Hold:1";
    case GCODE_HELD:
        return "Hold:0";
    case GCODE_HOMING:
        return "Home";
    default:
        return board->check ? "Check" : "Idle";
    }
}

static void append_positions(const VirtualGcode *board, const char *key, double offset,
                             GString *to) {
    g_string_append(to, key);
    for (int i = 0; i < board->options.n_axes; i++)
        g_string_append_printf(
            to, "%s%.3f", i ? "," : "",
            round(board->state.at[i] * board->options.steps) / board->options.steps - offset);
}

static void report(VirtualGcode *board) {
    g_autoptr(GString) text = g_string_new("<");
    const gboolean work = board->options.work_positions;
    g_string_append(text, state_text(board));
    append_positions(board, work ? "|WPos:" : "|MPos:", work ? OFFSET : 0, text);
    g_string_append_printf(text, "|FS:%.0f,0", gcode_speed(board, g_get_monotonic_time()) * 60);
    if (board->pressed[0])
        g_string_append(text, "|Pn:X");
    if (board->n_reports % 10 == 0) {
        g_string_append(text, "|WCO:");
        for (int i = 0; i < board->options.n_axes; i++)
            g_string_append_printf(text, "%s%.3f", i ? "," : "", work ? (double)OFFSET : 0);
    } else if (board->n_reports % 10 == 1) {
        g_string_append(text, "|Ov:100,100,100");
    }
    board->n_reports++;
    gcode_say(board, "%s>", text->str);
}

/* Acts on a real-time character. Returns FALSE if the byte is not such a character. */
static gboolean act(VirtualGcode *board, char byte) {
    switch ((guint8)byte) {
    case 0x18:
        soft_reset(board);
        return TRUE;
    case '?':
        if (!board->locked_up && board->motion != GCODE_HOMING)
            report(board);
        return TRUE;
    case '!':
        if (!board->faults.no_hold && !board->alarm && !board->check &&
            board->motion != GCODE_HOMING && board->motion != GCODE_HELD) {
            board->state.n_holds++;
            gcode_brake(board);
        }
        return TRUE;
    case '~':
        if (!board->door)
            gcode_resume(board); /* “~” has no effect while the board brakes (Hold:1) */
        return TRUE;
    case 0x84:
        board->door = TRUE;
        grbl_set_door(board);
        return TRUE;
    default:
        return (guint8)byte >= 0x80;
    }
}

static void receive(VirtualGcode *board, char byte) {
    if (act(board, byte))
        return;
    if (board->rx->len >= GCODE_RX) {
        board->state.n_overflows++;
        return;
    }
    g_string_append_c(board->rx, byte);
    board->n_unanswered++;
    board->state.max_unanswered = MAX(board->state.max_unanswered, board->n_unanswered);
}

static void homing_ended(VirtualGcode *board) {
    board->waits = FALSE;
    if (board->faults.no_switch) {
        alarm_now(board, 9);
        boot(board, FALSE);
        return;
    }
    for (int i = 0; i < board->options.n_axes; i++)
        if (board->homing_axes >> i & 1)
            board->state.at[i] = board->options.home_at;
    board->alarm = 0;
    gcode_say(board, "ok");
}

static void list_settings(VirtualGcode *board) {
    gcode_say(board, "$10=%d", board->options.work_positions ? 0 : 1);
    gcode_say(board, "$13=0");
    gcode_say(board, "$20=%d", board->options.max_travel > 0);
    gcode_say(board, "$21=1");
    gcode_say(board, "$22=%d", !board->options.homing_off);
    for (int i = 0; i < board->options.n_axes; i++) {
        gcode_say(board, "$%d=%.3f", 100 + i, board->options.steps);
        gcode_say(board, "$%d=%.3f", 110 + i, board->options.units_s * 60);
        gcode_say(board, "$%d=%.3f", 120 + i, board->options.units_s2);
    }
}

/* Carries out a line that begins with "$". Returns 0 for "ok", the number of the error, or −1 if
 * the answer comes later. */
static int command(VirtualGcode *board, const char *line) {
    const char *letter = line[2] ? strchr(letters, line[2]) : NULL;
    const gboolean one = line[2] && letter && !line[3] && board->options.single_homing;
    if (strcmp(line, "$$") == 0) {
        if (board->motion != GCODE_STANDING)
            return 8;
        list_settings(board);
        return 0;
    }
    if (strcmp(line, "$I") == 0) {
        gcode_say(board, "[VER:1.1h.20190825:]");
        gcode_say(board, "[OPT:V,15,128]");
        return 0;
    }
    if (strcmp(line, "$X") == 0) {
        if (board->door)
            return 13;
        board->alarm = 0;
        gcode_say(board, "[MSG:Caution: Unlocked]");
        return 0;
    }
    if (strcmp(line, "$C") == 0) {
        board->check = !board->check;
        gcode_say(board, board->check ? "[MSG:Enabled]" : "[MSG:Disabled]");
        return 0;
    }
    if (strcmp(line, "$H") != 0 && !(g_str_has_prefix(line, "$H") && one))
        return 3;
    if (board->options.homing_off)
        return 5;
    if (board->door)
        return 13;
    if (board->motion != GCODE_STANDING)
        return 8;
    board->waits = TRUE;
    gcode_begin_homing(board,
                       line[2] ? 1u << (letter - letters) : (1u << board->options.n_axes) - 1);
    return -1;
}

/* Parses and carries out a block of G-code. Returns the same values as command(). */
static int execute(VirtualGcode *board, const char *line) {
    double to[VIRTUAL_GCODE_AXES];
    gboolean moves = FALSE, dwells = FALSE, machine = FALSE, straight = FALSE;
    gcode_planned(board, to);
    for (const char *at = line; *at;) {
        char *end = NULL;
        const char letter = *at++;
        const double value = g_ascii_strtod(at, &end);
        const char *axis = strchr(letters, letter);
        if (!g_ascii_isalpha(letter))
            return 1;
        if (end == at)
            return 2;
        at = end;
        if (letter == 'G' && value == 53)
            machine = TRUE;
        else if (letter == 'G' && value == 4)
            dwells = TRUE;
        else if (letter == 'G' && (value == 90 || value == 91))
            board->relative = value == 91;
        else if (letter == 'G' && (value == 0 || value == 1))
            straight = value == 1;
        else if (letter == 'F')
            board->feed = value / 60;
        else if (axis && axis - letters < board->options.n_axes) {
            to[axis - letters] = value;
            moves = TRUE;
        } else if (letter != 'P' && !(letter == 'G' && (value == 21 || value == 94)))
            return 20;
    }
    if (moves && (!machine || board->relative))
        return 20; /* moves other than to absolute machine coordinates are not modelled */
    if (moves && straight && board->feed <= 0)
        return 22;
    for (int i = 0; moves && board->options.max_travel > 0 && i < board->options.n_axes; i++)
        if (fabs(to[i]) > board->options.max_travel) {
            gcode_abort(board);
            alarm_now(board, 2);
            return -1;
        }
    if (moves && !board->check)
        gcode_add_block(board, to, straight ? board->feed : board->options.units_s);
    board->waits = dwells && !board->check;
    return board->waits ? -1 : 0;
}

static void work(VirtualGcode *board) {
    char line[256];
    if (board->waits && board->motion == GCODE_STANDING && board->n_blocks == 0) {
        board->waits = FALSE;
        gcode_say(board, "ok");
    }
    /* One line is executed per call. Calls are about a millisecond apart. */
    if (!board->waits && !board->locked_up && !board->door && board->motion != GCODE_HELD &&
        board->motion != GCODE_BRAKING && board->n_blocks < GCODE_BLOCKS &&
        gcode_take_line(board, line, sizeof line)) {
        const int length = (int)strlen(line) + 1;
        int error = 0;
        if (board->faults.error) {
            error = board->faults.error;
            board->faults.error = 0;
        } else if (length > 81) {
            error = 11;
        } else if (line[0] == '$') {
            error = command(board, line);
        } else if (line[0] && board->alarm) {
            error = 9;
        } else if (line[0]) {
            error = execute(board, line);
        }
        if (error >= 0)
            answer(board, length, error);
        else
            board->n_unanswered -= length; /* answered when the motion has ended */
    }
}

const struct gcode_language gcode_language_grbl = {boot, receive, work, homing_ended};
