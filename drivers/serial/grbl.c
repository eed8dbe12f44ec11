/*
 * GRBL 1.1, FluidNC and grblHAL.
 *
 * "ok" says that a line was accepted. "G4 P0" is accepted when all earlier motions have ended, so a
 * report that follows its "ok" shows where they have ended. Characters such as "?" act at once.
 * They have no "ok" and take no space in the buffer of the board, which has 128 bytes.
 *
 * A stop is "!", which brakes without loss of the position, and then Ctrl-X, which makes the board
 * forget what it has not carried out. Ctrl-X during a motion loses the position (ALARM:3). "~"
 * would be ignored in Hold:1.
 *
 * After ALARM:1 and ALARM:2 the board answers nothing until it gets Ctrl-X. While GRBL homes, it
 * answers no "?", and only Ctrl-X stops it.
 */
#include "board_private.h"

#include <math.h>
#include <string.h>

#define WINDOW    127
#define ASK_MS    100  /* time between two questions while the board boots */
#define WATCH_MS  250  /* time between two questions to a board that stands */
#define HOLD_MS   1000 /* time that a feed hold may take in addition to the braking */
#define N_FINAL   2    /* number of equal reports that show where a motion has ended */
#define N_OTHER   4
#define MOVE_LINE "G21G90G94G53G1%c%.4fF%.4f"

/* Stages of a phase (enum phase). A phase is named where a stage belongs to this phase only. */
enum stage {
    ASKING,    /* GREETING: the first answer is due */
    SETTINGS,  /* GREETING: the settings are read */
    HOLDING,   /* "!" was sent */
    RESETTING, /* Ctrl-X was sent; the banner is due */
    CHECKING,  /* the banner has come; a report is due */
    MOVING,
    HOMING,
    RESTORING, /* other axes are moved back after homing */
};

static void ask(GcodeBoard *board) {
    board->asked = TRUE;
    board->asked_us = clock_now_us(board->clock);
    gcode_board_write(board, "?", 1);
}

static void send_reset(GcodeBoard *board) {
    board->n_owed++;
    gcode_board_write(board, "\x18", 1);
}

static void begin_reset(GcodeBoard *board) {
    send_reset(board);
    gcode_board_forget_lines(board);
    board->n_wco = board->alarm = 0;
    board->n_resets = 1;
    gcode_board_begin(board, RESETTING, board->link.answer_ms);
}

static void begin_check(GcodeBoard *board) {
    gcode_board_forget_lines(board);
    gcode_board_begin(board, CHECKING, board->link.answer_ms);
    ask(board);
}

static void begin_hold(GcodeBoard *board) {
    board->held = FALSE;
    board->n_final = 0;
    gcode_board_write(board, "!", 1);
    gcode_board_begin(board, HOLDING, 1500 * gcode_board_brake_s(board) + HOLD_MS);
    ask(board);
}

static void greet(GcodeBoard *board) {
    board->reset_once = FALSE;
    gcode_board_begin(board, ASKING, board->link.boot_ms);
    ask(board);
}

static void read_settings(GcodeBoard *board) {
    gcode_board_begin(board, SETTINGS, 2 * board->link.answer_ms);
    gcode_board_send(board, "$I", FALSE);
    gcode_board_send(board, "$$", FALSE);
}

static void send_move(GcodeBoard *board, int letter, double units, double units_s) {
    g_autofree char *line = g_strdup_printf(MOVE_LINE, GCODE_LETTERS[letter], units, units_s * 60);
    gcode_board_send(board, line, FALSE);
}

static void send_homing(GcodeBoard *board) {
    const GcodeClient *active = board->active;
    char line[] = "$H?";
    line[2] = active->request == HOME_AXIS ? GCODE_LETTERS[active->letter] : 0;
    board->n_final = 0;
    gcode_board_begin(board, HOMING, 0);
    if (active->request != HOME_HERE)
        gcode_board_send(board, line, TRUE);
    else if (board->alarm)
        gcode_board_send(board, "$X", FALSE);
    board->alarm = 0;
}

static void start(GcodeBoard *board) {
    const GcodeClient *active = board->active;
    board->n_final = 0;
    if (active->request == MOVE) {
        gcode_board_begin(board, MOVING, 0);
        send_move(board, active->letter, active->target, active->units_s);
        gcode_board_send(board, "G4P0", TRUE);
        ask(board);
        return;
    }
    board->n_before = board->n_at;
    memcpy(board->before, board->at, sizeof board->before);
    /* A board that is locked, in a feed hold or asleep refuses "$H" until it is reset. */
    board->held = FALSE;
    begin_reset(board);
}

static void stop(GcodeBoard *board) {
    if (board->stage == HOMING && !gcode_board_is_answered(board)) {
        board->held = FALSE;
        begin_reset(board);
    } else {
        begin_hold(board);
    }
}

/* Ends the request with an error. The class then stops the axis, which resets the board. */
static void fail_request(GcodeBoard *board, enum device_error code, const char *text) {
    gcode_board_end_request(board, device_error_new(code, NULL, "%s: %s", board->link.port, text));
}

static void lose(GcodeBoard *board, enum device_error code, const char *text) {
    gcode_board_lose(board, device_error_new(code, NULL, "%s: %s", board->link.port, text));
}

static char *alarm_words(const GcodeBoard *board, int number) {
    const char *text = gcode_alarm_text(number);
    return text ? g_strdup_printf("alarm %d: %s", number, text)
           : number > 0
               ? g_strdup_printf("alarm %d" ERROR_ADVICE "see the manual of %s, then home it",
                                 number, *board->firmware ? board->firmware : "the firmware")
               : g_strdup("the board is locked by an alarm" ERROR_ADVICE "home it");
}

static void alarmed(GcodeBoard *board) {
    g_autofree char *words = alarm_words(board, board->alarm);
    lose(board, DEVICE_ERROR_STALLED, words);
}

/* Returns whether an unknown state was reported N_OTHER times in a row. A name that comes less
 * often may be a damaged one. */
static gboolean is_other_state(GcodeBoard *board, const struct gcode_report *report) {
    board->n_other = strcmp(board->other, report->name) == 0 ? board->n_other + 1 : 1;
    g_strlcpy(board->other, report->name, sizeof board->other);
    return board->n_other >= N_OTHER;
}

/* Ends the request with an error if the state shows that the motion was stopped by something other
 * than this program, such as an alarm, a button or a door. Returns whether the request has ended.
 */
static gboolean is_disturbed(GcodeBoard *board, const struct gcode_report *report) {
    g_autofree char *words = NULL;
    if (report->state != GCODE_OTHER)
        board->n_other = 0;
    switch (report->state) {
    case GCODE_IDLE:
    case GCODE_RUN:
    case GCODE_JOG:
    case GCODE_HOME:
        return FALSE;
    case GCODE_ALARM:
        if (board->stage == HOMING && !gcode_board_is_answered(board))
            return FALSE; /* the alarm lasts until the answer to "$H" or "$X" */
        alarmed(board);
        return TRUE;
    case GCODE_HOLD:
        words = g_strdup("a feed hold stopped it" ERROR_ADVICE
                         "check who pressed the button, then home it");
        break;
    case GCODE_DOOR:
        words = g_strdup("the safety door is open" ERROR_ADVICE "close it, then home it");
        break;
    case GCODE_CHECK:
        words =
            g_strdup("the board is in check mode, in which nothing moves" ERROR_ADVICE "home it");
        break;
    default:
        if (report->state == GCODE_OTHER && !is_other_state(board, report))
            return FALSE;
        words = g_strdup_printf("the board is in the state “%s”" ERROR_ADVICE
                                "see the manual of its firmware, then home it",
                                report->name);
        break;
    }
    fail_request(board, DEVICE_ERROR_STALLED, words);
    return TRUE;
}

/* Counts equal reports that came after the "ok" of the last line. Returns whether there are enough
 * of them. */
static gboolean is_final(GcodeBoard *board) {
    const gsize size = (gsize)board->n_at * sizeof *board->at;
    if (!gcode_board_is_answered(board) || board->n_at == 0)
        return FALSE;
    board->n_final = board->n_final > 0 && memcmp(board->final_at, board->at, size) == 0
                         ? board->n_final + 1
                         : 1;
    memcpy(board->final_at, board->at, size);
    return board->n_final >= N_FINAL;
}

/* Moves back the watched axes that homing has moved. Returns FALSE if there are none. */
static gboolean restore(GcodeBoard *board) {
    gboolean any = FALSE;
    for (guint i = 0; i < board->clients->len; i++) {
        const GcodeClient *client = board->clients->pdata[i];
        if (!gcode_board_was_dragged(board, client))
            continue;
        send_move(board, client->letter, board->before[client->letter], client->last_units_s);
        any = TRUE;
    }
    return any;
}

static void check_request(GcodeBoard *board, const struct gcode_report *report) {
    if (is_disturbed(board, report))
        return;
    if (report->state != GCODE_IDLE) {
        board->n_final = 0;
    } else if (is_final(board)) {
        if (board->stage == HOMING && restore(board)) {
            board->n_final = 0;
            gcode_board_begin(board, RESTORING, 0);
            gcode_board_send(board, "G4P0", TRUE);
        } else {
            gcode_board_end_request(board, NULL);
            return;
        }
    }
    if (gcode_board_is_answered(board))
        ask(board);
}

/* Called after a reset. Reports the positions as lost if the reset has changed them, or if the
 * board moved when it was reset. */
static void check_kept(GcodeBoard *board, gboolean moved) {
    gboolean same = board->held && board->n_at > 0;
    for (int i = 0; i < board->n_at; i++)
        same &= fabs(board->at[i] - board->held_at[i]) < GCODE_SAME;
    if (!same || moved)
        lose(board, DEVICE_ERROR_STALLED,
             "the board had to be reset while it moved, so its position is lost" ERROR_ADVICE
             "home it");
}

static void end_check(GcodeBoard *board, const struct gcode_report *report) {
    if (!gcode_report_stands(report))
        return;                    /* reports are taken until the deadline */
    if (board->phase == RUNNING) { /* begins to home */
        board->alarm = report->state == GCODE_ALARM ? MAX(board->alarm, 1) : 0;
        send_homing(board);
    } else if (board->phase == GREETING) {
        read_settings(board);
    } else {
        check_kept(board, board->alarm == 3);
        gcode_board_ready(board);
    }
}

static void check_hold(GcodeBoard *board, const struct gcode_report *report) {
    /* A board that stands answers "!" with Hold:0. If Idle is reported, the report was sent before
     * "!" came, or the firmware ignores "!" while it stands. */
    const gboolean idle = report->state == GCODE_IDLE;
    board->n_final = idle ? board->n_final + 1 : 0;
    if (!gcode_report_stands(report) || (idle && board->n_final < 3)) {
        ask(board);
        return;
    }
    board->held = report->state != GCODE_ALARM && board->n_at > 0;
    memcpy(board->held_at, board->at, sizeof board->held_at);
    begin_reset(board);
}

static void check_standing(GcodeBoard *board, const struct gcode_report *report) {
    if (report->state == GCODE_ALARM && gcode_board_is_watched(board))
        alarmed(board);
}

/* Converts the positions of a report to machine coordinates. Returns FALSE if they are work
 * coordinates and their offset is not known yet. */
static gboolean read_position(GcodeBoard *board, const struct gcode_report *report, double *ret) {
    if (report->n_wco > 0) {
        board->n_wco = report->n_wco;
        memcpy(board->wco, report->wco, sizeof board->wco);
    }
    if (report->is_work && board->n_wco < report->n_at)
        return FALSE;
    for (int i = 0; i < report->n_at; i++)
        ret[i] = report->at[i] + (report->is_work ? board->wco[i] : 0);
    return TRUE;
}

static void take_report(GcodeBoard *board, const struct gcode_report *report) {
    double at[GCODE_MAX_AXES];
    if (board->stage == RESETTING && board->phase != READY)
        return; /* it was sent before the reset */
    if (board->n_at > 0 && report->n_at != board->n_at)
        return; /* damaged */
    board->asked = FALSE;
    if (read_position(board, report, at))
        gcode_board_moved(board, at, report->n_at);
    switch (board->phase) {
    case READY:
        check_standing(board, report);
        break;
    case RUNNING:
        gcode_board_check_still(board);
        if (board->stage == CHECKING)
            end_check(board, report);
        else
            check_request(board, report);
        break;
    case GREETING:
    case STOPPING:
        if (board->stage == CHECKING)
            end_check(board, report);
        else if (board->stage == HOLDING)
            check_hold(board, report);
        else if (board->stage == ASKING && !gcode_report_stands(report))
            begin_hold(board); /* a program that has ended has left it moving */
        else if (board->stage == ASKING && report->state != GCODE_IDLE &&
                 report->state != GCODE_DOOR && report->state != GCODE_ALARM)
            begin_reset(board);
        else if (board->stage == ASKING)
            read_settings(board);
        break;
    case CLOSED:
        break;
    }
}

static void take_banner(GcodeBoard *board) {
    const gboolean expected =
        board->phase != READY &&
        (board->stage == RESETTING || (board->stage == CHECKING && board->n_resets > 1));
    gcode_board_forget_lines(board);
    board->n_wco = 0;
    board->n_owed = MAX(0, board->n_owed - 1);
    if (board->phase == GREETING && !expected) {
        gcode_board_begin(board, ASKING, board->link.boot_ms);
        ask(board);
    } else if (expected || board->phase == STOPPING) {
        /* A board that resets itself during a hold has lost its position. */
        board->held &= expected;
        begin_check(board);
    } else {
        lose(board, DEVICE_ERROR_DISCONNECTED,
             "the board was reset, so its position is lost" ERROR_ADVICE
             "check its power and its reset button, then home it");
    }
}

static void take_alarm(GcodeBoard *board, int number) {
    board->alarm = number;
    if (board->phase == READY || (board->phase == RUNNING && board->stage != RESETTING)) {
        alarmed(board);
    } else if (board->phase == STOPPING && board->stage == HOLDING) {
        board->held = FALSE;
        begin_reset(board);
    }
}

static void take_error(GcodeBoard *board, int number) {
    const char *text = gcode_error_text(number);
    if (!gcode_board_answered(board))
        return;
    if (board->phase == GREETING && board->stage == SETTINGS && gcode_board_is_answered(board))
        gcode_board_ready(board); /* the settings are not needed */
    if (board->phase != RUNNING)
        return;
    g_autofree char *words =
        text ? g_strdup_printf("error %d: %s", number, text)
             : g_strdup_printf("error %d" ERROR_ADVICE "see the manual of %s, then home it", number,
                               *board->firmware ? board->firmware : "the firmware");
    fail_request(board, DEVICE_ERROR_PROTOCOL, words);
}

static void take_ok(GcodeBoard *board) {
    if (board->stage == RESETTING || !gcode_board_answered(board) ||
        !gcode_board_is_answered(board))
        return;
    if (board->phase == RUNNING)
        ask(board);
    else if (board->phase == GREETING && board->stage == SETTINGS)
        gcode_board_ready(board);
}

static void take_setting(GcodeBoard *board, int number, double value) {
    struct gcode_limits *limits = board->limits;
    const int letter = number % 10;
    if (number == 13 || number == 22)
        for (int i = 0; i < GCODE_MAX_AXES; i++)
            *(number == 13 ? &limits[i].inches : &limits[i].homing) = value > 0 ? 1 : -1;
    if (number < 100 || number >= 130 || letter >= GCODE_MAX_AXES)
        return;
    if (number < 110)
        limits[letter].steps = value;
    else if (number < 120)
        limits[letter].units_s = value / 60; /* the board has units per minute */
    else
        limits[letter].units_s2 = value;
}

static void take(GcodeBoard *board, const struct gcode_answer *answer) {
    switch (answer->kind) {
    case GCODE_REPORT:
        take_report(board, &answer->report);
        break;
    case GCODE_BANNER:
        take_banner(board);
        break;
    case GCODE_ALARM_NOW:
        take_alarm(board, answer->number);
        break;
    case GCODE_ERROR:
        take_error(board, answer->number);
        break;
    case GCODE_OK:
        take_ok(board);
        break;
    case GCODE_SETTING:
        take_setting(board, answer->number, answer->value);
        break;
    case GCODE_VERSION:
        g_strlcpy(board->firmware, answer->text, sizeof board->firmware);
        break;
    default:
        break;
    }
}

/* Sends "?" if it is due. A question without an answer is repeated, because one of the two may be
 * lost. */
static void poll_board(GcodeBoard *board) {
    const gboolean ready = board->phase == READY;
    const double ms = board->phase == GREETING ? ASK_MS
                      : ready                  ? WATCH_MS
                                               : gcode_board_poll_ms(board, WATCH_MS);
    const double again_ms = MAX(ms, board->link.answer_ms / 4);
    if (board->stage == RESETTING && !ready)
        return;
    if ((!ready || gcode_board_is_watched(board)) &&
        gcode_board_is_past(board, board->asked_us, board->asked ? again_ms : ms))
        ask(board);
}

/* A motion fails if a line is not accepted in time, or if no report comes in time. GRBL reports
 * nothing while it homes, so there only the deadline of the class counts. */
static void check_running(GcodeBoard *board) {
    const struct gcode_line *line = g_queue_peek_head(&board->sent);
    const double ms = board->link.answer_ms;
    const gboolean unaccepted =
        line && !line->is_long && gcode_board_is_past(board, line->sent_us, ms);
    const gboolean homes = line && board->stage == HOMING;
    const gint64 since = MAX(board->heard_us, board->stage_us);
    if (unaccepted || (!homes && gcode_board_is_past(board, since, ms)))
        gcode_board_end_request(board, gcode_board_silence(board, ms));
}

/* Repeats Ctrl-X, because it may have been lost. */
static void repeat_reset(GcodeBoard *board) {
    if (board->stage != RESETTING || board->phase == READY ||
        !gcode_board_is_past(board, board->stage_us, board->n_resets * board->link.answer_ms / 4))
        return;
    board->n_resets++;
    send_reset(board);
}

static void tick(GcodeBoard *board, gint64 now_us) {
    poll_board(board);
    repeat_reset(board);
    const gboolean late = board->until_us < now_us;
    if (board->phase == RUNNING && board->stage != RESETTING && board->stage != CHECKING) {
        check_running(board);
    } else if (board->phase == RUNNING && late) {
        gcode_board_end_request(board, gcode_board_silence(board, board->link.answer_ms));
    } else if (board->phase == STOPPING && board->stage == HOLDING &&
               (late || gcode_board_is_past(board, MAX(board->heard_us, board->stage_us),
                                            board->link.answer_ms))) {
        begin_reset(board); /* silent: perhaps it is locked by an alarm */
    } else if (board->phase == GREETING && board->stage == ASKING && !board->reset_once &&
               gcode_board_is_past(board, board->stage_us, board->link.boot_ms / 2)) {
        /* after an alarm that came before the port was opened, the board is silent */
        board->reset_once = TRUE;
        send_reset(board);
    } else if (board->phase == GREETING && board->stage == HOLDING && late) {
        begin_reset(board);
    } else if (board->phase == GREETING && board->stage == SETTINGS && late) {
        gcode_board_ready(board); /* the settings are not needed */
    } else if ((board->phase == GREETING || board->phase == STOPPING) && late) {
        gcode_board_fail(board, gcode_board_silence(board, board->stage == ASKING
                                                               ? board->link.boot_ms
                                                               : board->link.answer_ms));
    }
}

const struct dialect gcode_grbl = {
    .greet = greet,
    .take = take,
    .read = gcode_grbl_read,
    .tick = tick,
    .start = start,
    .stop = stop,
    .window = WINDOW,
};
