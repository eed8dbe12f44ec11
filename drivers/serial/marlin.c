/*
 * Marlin. Lines have numbers and checksums, and one line at a time is under way. A damaged line is
 * asked for again ("Resend:"). "echo:busy: processing" comes while a long command runs.
 *
 * M114 answers where the axes are sent (X:) and where the motors are (Count X:, in steps). A move
 * is over when the motors are where they are sent, or do not turn any more. M400 then waits for the
 * end of what is planned. It comes last, because Marlin without EMERGENCY_PARSER reads no stop
 * before the answer to M400.
 *
 * The stop is M410, which ends all motion without a ramp and keeps the position. If nothing
 * follows, M112 halts the board until it is reset.
 *
 * Marlin answers "ok" to each line and does not say to which. After a stop, oks of earlier lines
 * may be on their way. Therefore a command that Marlin does not know, "L" with a new number, is
 * sent. The "ok" after its echo is the first that counts.
 */
#include "board_private.h"

#include <math.h>
#include <string.h>

#define ASK_MS    500  /* time between two questions while the board boots */
#define WATCH_MS  250  /* time between two questions to a board that stands */
#define BUSY_MS   2500 /* longer than the time between two lines that say that Marlin is busy */
#define STILL_MS  300  /* longer than Marlin may plan before a motion begins */
#define N_HISTORY 8
#define NEAR      0.02 /* largest distance from Count to the target after a move, in units */

/* Stages of a phase (enum phase). The phases are named where a stage belongs to these phases
 * only. */
enum stage {
    ASKING,   /* the echo of "L" is due */
    SETTINGS, /* GREETING */
    WATCHING, /* the motors are watched until they stand; in the phases GREETING and STOPPING */
    MOVING,
    FINISHING, /* M400 was sent */
    HOMING,
    KILLING, /* M112 was sent */
};

static void send(GcodeBoard *board, const char *command, gboolean is_long) {
    g_autofree char *line = g_strdup_printf("N%d %s", ++board->n_line, command);
    guint8 sum = 0;
    for (const char *at = line; *at; at++)
        sum ^= (guint8)*at;
    char *whole = g_strdup_printf("%s*%u", line, sum);
    gcode_board_send(board, whole, is_long);
    g_queue_push_tail(&board->history, whole);
    if (g_queue_get_length(&board->history) > N_HISTORY)
        g_free(g_queue_pop_head(&board->history));
}

/* Sends the line of this number and all later lines again. Returns FALSE if the line is not kept
 * any more. The history also keeps lines that were answered, because Marlin may ask for one of
 * them. This happens after the number of a line was damaged on its way. */
static gboolean send_again(GcodeBoard *board, int number) {
    const int first = board->n_line + 1 - (int)g_queue_get_length(&board->history);
    if (number < first || number > board->n_line)
        return FALSE;
    gcode_board_forget_lines(board);
    for (int i = number - first; i <= board->n_line - first; i++) {
        const char *text = g_queue_peek_nth(&board->history, (guint)i);
        gcode_board_send(board, text, strstr(text, " M400") || strstr(text, " G28"));
    }
    return TRUE;
}

/* Sends "L" with a new number at once, in a line without a line number. Drops the lines that
 * wait. */
static void send_token(GcodeBoard *board) {
    g_autofree char *line = g_strdup_printf("\nL%d\n", ++board->token);
    gcode_board_forget_lines(board);
    board->synced = board->echoed = FALSE;
    board->resends = 0;
    board->asked_us = clock_now_us(board->clock);
    gcode_board_write(board, line, strlen(line));
}

static void ask(GcodeBoard *board) {
    if (!gcode_board_is_answered(board))
        return;
    board->asked = TRUE;
    board->asked_us = clock_now_us(board->clock);
    send(board, "M114", FALSE);
}

static void greet(GcodeBoard *board) {
    gcode_board_begin(board, ASKING, board->link.boot_ms);
    send_token(board);
}

static void watch_motors(GcodeBoard *board, double ms) {
    gcode_board_begin(board, WATCHING, ms);
    board->n_steps_same = 0;
    ask(board);
}

static void on_synced(GcodeBoard *board) {
    board->n_line = 0;
    board->killed = FALSE;
    g_queue_clear_full(&board->history, g_free);
    gcode_board_send(board, "M110 N0", FALSE);
    if (board->phase == GREETING) {
        gcode_board_begin(board, SETTINGS, 5 * board->link.answer_ms);
        send(board, "M115", FALSE);
        send(board, "M503", FALSE);
    } else {
        watch_motors(board, 1500 * gcode_board_brake_s(board) + BUSY_MS);
    }
}

static void start(GcodeBoard *board) {
    const GcodeClient *active = board->active;
    const char letter = GCODE_LETTERS[active->letter];
    board->n_final = board->n_steps_same = 0;
    board->same_us = clock_now_us(board->clock);
    board->n_before = active->request == MOVE ? 0 : board->n_at;
    memcpy(board->before, board->at, sizeof board->before);
    if (active->request == MOVE) {
        g_autofree char *line =
            g_strdup_printf("G1 %c%.4f F%.4f", letter, active->target, active->units_s * 60);
        gcode_board_begin(board, MOVING, 0);
        send(board, "G90", FALSE);
        send(board, line, FALSE);
    } else if (active->request == HOME_HERE) {
        gcode_board_begin(board, FINISHING, 0);
        send(board, "M400", TRUE);
    } else {
        char line[] = "G28 ?";
        line[active->request == HOME_ALL ? 3 : 4] = active->request == HOME_ALL ? 0 : letter;
        gcode_board_begin(board, HOMING, 0);
        send(board, line, TRUE);
    }
}

static void stop(GcodeBoard *board) {
    gcode_board_write(board, "\nM410\n", 6);
    gcode_board_begin(board, ASKING, board->link.answer_ms + BUSY_MS);
    send_token(board);
}

static void fail_request(GcodeBoard *board, const char *text) {
    gcode_board_end_request(board, device_error_new(DEVICE_ERROR_STALLED, NULL,
                                                    "%s: the board reports: %s" ERROR_ADVICE
                                                    "check its switches and settings, then home it",
                                                    board->link.port, text));
}

/* Compares the positions of the motors with their last report. Returns the number of reports in a
 * row without a change. */
static int count_same(GcodeBoard *board, const struct gcode_answer *answer) {
    gboolean same = board->n_steps_same > 0;
    for (int i = 0; i < GCODE_MAX_AXES; i++) {
        same &= !answer->has_steps[i] || answer->steps[i] == board->steps[i];
        board->steps[i] = answer->steps[i];
    }
    if (!same)
        board->same_us = clock_now_us(board->clock);
    board->n_steps_same = same ? board->n_steps_same + 1 : 1;
    return board->n_steps_same;
}

/* Takes the positions of the motors if the board has reported its steps per unit, and otherwise the
 * positions to which the axes were sent. */
static void take_position(GcodeBoard *board, const struct gcode_answer *answer) {
    double at[GCODE_MAX_AXES] = {0};
    int n = 0;
    for (int i = 0; i < GCODE_MAX_AXES && answer->has_at[i]; i++, n++) {
        const double steps = board->limits[i].steps;
        at[i] = answer->has_steps[i] && steps > 0 ? answer->steps[i] / steps : answer->at[i];
    }
    if (n > 0)
        gcode_board_moved(board, at, n);
}

static void finish(GcodeBoard *board) {
    gcode_board_begin(board, FINISHING, 0);
    board->n_final = 0;
    send(board, "M400", TRUE);
}

/* Moves back the watched axes that homing has moved. Returns FALSE if there are none. */
static gboolean restore(GcodeBoard *board) {
    g_autoptr(GString) line = g_string_new("G1");
    double units_s = INFINITY;
    for (guint i = 0; i < board->clients->len; i++) {
        const GcodeClient *client = board->clients->pdata[i];
        if (!gcode_board_was_dragged(board, client))
            continue;
        g_string_append_printf(line, " %c%.4f", GCODE_LETTERS[client->letter],
                               board->before[client->letter]);
        units_s = MIN(units_s, client->last_units_s);
    }
    board->n_before = 0; /* only one attempt; if it fails, the axis is reported as moved */
    if (isinf(units_s))
        return FALSE;
    g_string_append_printf(line, " F%.4f", units_s * 60);
    send(board, "G90", FALSE);
    send(board, line->str, FALSE);
    finish(board);
    return TRUE;
}

static void take_report(GcodeBoard *board, const struct gcode_answer *answer) {
    const GcodeClient *active = board->active;
    board->asked = FALSE;
    take_position(board, answer);
    const int n_same = count_same(board, answer);
    gcode_board_check_still(board);
    if (board->stage == MOVING && board->phase == RUNNING) {
        const gboolean there =
            active->letter < board->n_at && fabs(board->at[active->letter] - active->target) < NEAR;
        if ((there && n_same > 1) || gcode_board_is_past(board, board->same_us, STILL_MS + BUSY_MS))
            finish(board);
    } else if (board->stage == FINISHING && board->phase == RUNNING) {
        board->n_final = 1; /* its "ok" ends the request */
    }
}

static void take_end_of_line(GcodeBoard *board) {
    if (board->phase == RUNNING && board->stage == HOMING && gcode_board_is_answered(board)) {
        finish(board);
    } else if (board->phase == RUNNING && board->stage == FINISHING &&
               gcode_board_is_answered(board)) {
        if (board->n_final == 0)
            ask(board);
        else if (!restore(board))
            gcode_board_end_request(board, NULL);
    } else if (board->phase == GREETING && board->stage == SETTINGS &&
               gcode_board_is_answered(board)) {
        watch_motors(board, 5 * board->link.answer_ms);
    } else if (board->stage == WATCHING && board->phase != READY && board->n_steps_same > 0) {
        const gboolean still =
            board->n_steps_same > 2 && gcode_board_is_past(board, board->same_us, STILL_MS);
        if (still)
            gcode_board_ready(board);
        else if (board->phase == GREETING && board->n_steps_same == 1 &&
                 gcode_board_is_past(board, board->stage_us, STILL_MS))
            stop(board); /* a program that has ended has left it moving */
    }
}

static void take_ok(GcodeBoard *board) {
    board->nudged = FALSE;
    if (!board->synced) {
        if (!board->echoed)
            return; /* this answers a line before the stop */
        board->synced = TRUE;
        on_synced(board);
    } else if (board->resends > 0) {
        const int number = board->resends;
        board->resends = 0;
        if (!send_again(board, number) && board->phase == RUNNING)
            gcode_board_end_request(
                board,
                device_error_new(
                    DEVICE_ERROR_PROTOCOL, NULL,
                    "%s: the board requests line %d again, but the last line was %d" ERROR_ADVICE
                    "check the cable, then home it",
                    board->link.port, number, board->n_line));
    } else if (gcode_board_answered(board)) {
        take_end_of_line(board);
    }
}

static void take_banner(GcodeBoard *board) {
    const gboolean greeting = board->phase == GREETING;
    board->killed = FALSE;
    if (!greeting) {
        gcode_board_lose(
            board, device_error_new(DEVICE_ERROR_DISCONNECTED, NULL,
                                    "%s: the board was reset, so its position is lost" ERROR_ADVICE
                                    "check its power and its reset button, then home it",
                                    board->link.port));
        board->phase = GREETING;
    }
    greet(board);
}

/* The board stands, and answers nothing until it is reset. */
static void take_killed(GcodeBoard *board, const char *text) {
    const gboolean asked = board->phase == STOPPING && board->stage == KILLING;
    g_autofree char *why = g_strstrip(g_strdup(text));
    board->killed = TRUE;
    gcode_board_lose(board, device_error_new(DEVICE_ERROR_STALLED, NULL,
                                             "%s: the board has halted %s%s" ERROR_ADVICE
                                             "home it, which resets most boards; if that fails, "
                                             "press its reset button",
                                             board->link.port,
                                             asked ? "after M112" : "itself: ", asked ? "" : why));
    gcode_board_ready(board);
    gcode_board_close(board);
}

static void take(GcodeBoard *board, const struct gcode_answer *answer) {
    switch (answer->kind) {
    case GCODE_OK:
        take_ok(board);
        break;
    case GCODE_UNKNOWN:
        board->echoed |= answer->number == board->token;
        break;
    case GCODE_POSITION:
        if (board->synced)
            take_report(board, answer);
        break;
    case GCODE_RESEND:
        if (board->synced)
            board->resends = answer->number; /* an "ok" follows */
        break;
    case GCODE_BANNER:
        take_banner(board);
        break;
    case GCODE_KILLED:
        take_killed(board, answer->text);
        break;
    case GCODE_FAILURE:
        /* The board asks for a damaged line again by "Resend:". */
        if (board->phase == RUNNING && !strstr(answer->text, "ine Number") &&
            !strstr(answer->text, "hecksum"))
            fail_request(board, answer->text);
        break;
    case GCODE_VERSION:
        g_strlcpy(board->firmware, answer->text, sizeof board->firmware);
        break;
    case GCODE_SCALE:
        for (int i = 0; i < GCODE_MAX_AXES; i++) {
            if (!answer->has_at[i] || board->stage != SETTINGS)
                continue;
            *(answer->number == 92    ? &board->limits[i].steps
              : answer->number == 203 ? &board->limits[i].units_s
                                      : &board->limits[i].units_s2) = answer->at[i];
        }
        break;
    default:
        break;
    }
}

static void tick(GcodeBoard *board, gint64 now_us) {
    const struct gcode_line *line = g_queue_peek_head(&board->sent);
    const double ms = board->link.answer_ms;
    const gint64 since = MAX(board->heard_us, line ? line->sent_us : 0);
    const gboolean silent =
        line && gcode_board_is_past(board, since, line->is_long ? ms + BUSY_MS : ms);
    const gboolean late = board->until_us < now_us;
    const double poll_ms = board->phase == READY ? WATCH_MS : gcode_board_poll_ms(board, WATCH_MS);
    /* If the end of the line was lost, this newline ends the line. Otherwise the empty line does
     * nothing. */
    if (line && !board->nudged && gcode_board_is_past(board, since, ms / 2)) {
        board->nudged = TRUE;
        gcode_board_write(board, "\n", 1);
    }
    if (board->phase == RUNNING && silent) {
        gcode_board_end_request(board, gcode_board_silence(board, ms));
    } else if (board->phase == READY && silent) {
        gcode_board_forget_lines(board); /* the next request shows whether the board answers */
    } else if (board->phase == GREETING && board->stage == ASKING && !late) {
        if (gcode_board_is_past(board, board->asked_us, ASK_MS))
            send_token(board);
    } else if (board->phase == STOPPING && board->stage != KILLING && (late || silent)) {
        gcode_board_write(board, "\nM112\n", 6);
        gcode_board_begin(board, KILLING, ms);
    } else if (board->phase == STOPPING && late) {
        gcode_board_fail(board, gcode_board_silence(board, ms + BUSY_MS));
        gcode_board_lose(board, gcode_board_silence(board, ms + BUSY_MS));
        gcode_board_close(board); /* only a reset can help */
    } else if (board->phase == GREETING && late) {
        gcode_board_fail(board, gcode_board_silence(board, board->link.boot_ms));
    } else if (board->synced && gcode_board_is_past(board, board->asked_us, poll_ms) &&
               (board->stage == WATCHING || board->stage == MOVING ||
                (board->phase == READY && gcode_board_is_watched(board)))) {
        ask(board);
    }
}

const struct dialect gcode_marlin = {
    .greet = greet,
    .take = take,
    .read = gcode_marlin_read,
    .tick = tick,
    .start = start,
    .stop = stop,
    .window = 96,
    .one_line = TRUE,
    .halted = "the board has halted itself" ERROR_ADVICE
              "press its reset button or switch it off and on, then home it",
};
