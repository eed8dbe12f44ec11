/*
 * Klipper, by the pseudo-terminal of its G-code (/tmp/printer). Klipper is a program on a computer.
 * It queues motions and says "ok" as soon as a line is accepted. It has no command that brakes:
 * M112 stops the motors without a ramp, shuts Klipper down and loses all positions, and only
 * FIRMWARE_RESTART helps then.
 *
 * A move is therefore sent in pieces of 0.1 s. Klipper always plans to stand at the end of the
 * pieces that it has, and it accepts no more than about one second of motion in advance. A stop
 * sends no further pieces. The axis then brakes with its ramp within about 1.5 s and keeps its
 * position. The motion of a program that has died ends in the same way. M112 follows only if the
 * end of the motion is not confirmed. M112 also stops a homing, which has no position to lose.
 *
 * M114 answers where the axes were sent, and not where they are. The answer to M400 comes when all
 * motions have ended. Until then, and while another long command runs, Klipper answers nothing, but
 * it acts on M112.
 *
 * After a stop, answers to earlier lines may be on their way. "ECHO MESORIG=" with a new number is
 * sent, and the "ok" after its echo is the first that counts.
 */
#include "board_private.h"

#include <math.h>
#include <string.h>

#define ASK_MS   500  /* time between two questions while Klipper starts */
#define WATCH_MS 250  /* time between two questions for the position while the axes stand */
#define POLL_MS  100  /* the same, while one of them moves */
#define AHEAD_MS 3000 /* longer than the motion that Klipper accepts in advance */
/* after a silence of this time, a motion that another program has left is stopped */
#define LEFT_MS 3000
#define PIECE_S 0.1 /* duration of a piece of a move at its top speed */

#define UNKNOWN (-1) /* instead of an enum klipper_state */

/* Stages of a phase (enum phase). The phases are named where a stage belongs to these phases
 * only. */
enum stage {
    SYNCING,    /* the echo is due */
    CHECKING,   /* STATUS was sent */
    SETTINGS,   /* GREETING */
    SETTLING,   /* GREETING, STOPPING: M400 was sent, then M114 */
    KILLING,    /* M112 was sent */
    RESTARTING, /* RUNNING: FIRMWARE_RESTART was sent */
    STARTING,   /* in the phase RUNNING: M114 was sent to learn where the motion begins */
    MOVING,     /* pieces are sent */
    HOMING,
    FINISHING, /* M400 was sent, then M114 */
};

static void ask(GcodeBoard *board) {
    board->asked = TRUE;
    board->asked_us = clock_now_us(board->clock);
    gcode_board_send(board, "M114", FALSE);
}

/* Drops the lines that wait, and sends an echo with a new number. */
static void send_token(GcodeBoard *board) {
    g_autofree char *line = g_strdup_printf("\nECHO MESORIG=%d\n", ++board->token);
    gcode_board_forget_lines(board);
    board->synced = board->echoed = FALSE;
    board->asked_us = clock_now_us(board->clock);
    gcode_board_write(board, line, strlen(line));
}

static void resync(GcodeBoard *board, double ms) {
    *board->reason = 0;
    gcode_board_begin(board, SYNCING, ms);
    send_token(board);
}

static void check(GcodeBoard *board) {
    board->stage = CHECKING; /* the deadline stays */
    board->state = UNKNOWN;
    *board->reason = 0;
    board->asked_us = clock_now_us(board->clock);
    gcode_board_send(board, "STATUS", FALSE);
}

static void greet(GcodeBoard *board) {
    board->reset_once = board->killed = FALSE;
    resync(board, board->link.boot_ms);
}

/* Sends M400, which is answered after the end of all motions, and asks for the position. A stop
 * keeps its deadline. */
static void settle(GcodeBoard *board, int stage, double ms) {
    if (board->phase == STOPPING)
        board->stage = stage;
    else
        gcode_board_begin(board, stage, ms);
    board->n_final = 0;
    gcode_board_send(board, "M400", TRUE);
    ask(board);
}

/* Returns how long Klipper may take to carry out what it has accepted. */
static double longest_ms(const GcodeBoard *board) {
    double ramp_s = gcode_board_brake_s(board);
    const GcodeClient *active = board->active;
    if (active && board->limits[active->letter].units_s2 > 0)
        ramp_s = MAX(ramp_s, active->last_units_s / board->limits[active->letter].units_s2);
    return AHEAD_MS + 1500 * ramp_s;
}

static void send_piece(GcodeBoard *board) {
    const double left = board->way_to - board->way_at, piece = PIECE_S * board->way_units_s;
    board->way_at =
        fabs(left) < 1.5 * piece ? board->way_to : board->way_at + copysign(piece, left);
    g_autofree char *line = g_strdup_printf("G1 %c%.4f F%.4f", GCODE_LETTERS[board->way_letter],
                                            board->way_at, board->way_units_s * 60);
    gcode_board_send(board, line, TRUE);
}

/* Moves an axis from where it stands. */
static void begin_way(GcodeBoard *board, int letter, double to, double units_s) {
    gcode_board_begin(board, MOVING, 0);
    board->way_letter = letter;
    board->way_at = board->at[letter];
    board->way_to = to;
    board->way_units_s = units_s;
    send_piece(board);
}

static void home(GcodeBoard *board) {
    const GcodeClient *active = board->active;
    const char letter = GCODE_LETTERS[active->letter];
    board->n_before = board->n_at;
    memcpy(board->before, board->at, sizeof board->before);
    gcode_board_begin(board, HOMING, 0);
    g_autofree char *line =
        active->request == HOME_HERE
            ? g_strdup_printf("SET_KINEMATIC_POSITION %c=0 SET_HOMED=%c", letter, letter)
        : active->request == HOME_AXIS ? g_strdup_printf("G28 %c", letter)
                                       : g_strdup("G28");
    gcode_board_send(board, line, TRUE);
}

static void start(GcodeBoard *board) {
    if (board->killed) {
        gcode_board_forget_lines(board);
        gcode_board_begin(board, RESTARTING, board->link.boot_ms);
        board->synced = board->echoed = FALSE;
        *board->reason = 0;
        board->asked_us = clock_now_us(board->clock);
        gcode_board_write(board, "\nFIRMWARE_RESTART\n", 18);
    } else if (!board->synced) {
        resync(board, board->link.boot_ms);
    } else {
        gcode_board_begin(board, STARTING, 0);
        gcode_board_send(board, "G90", FALSE);
        ask(board);
    }
}

static void kill_motion(GcodeBoard *board) {
    gcode_board_forget_lines(board);
    gcode_board_begin(board, KILLING, board->link.answer_ms);
    gcode_board_write(board, "\nM112\n", 6);
}

static void stop(GcodeBoard *board) {
    const gboolean homes = board->stage == HOMING && !gcode_board_is_answered(board);
    if (board->killed)
        gcode_board_ready(board); /* it stands */
    else if (homes)
        kill_motion(board);
    else
        resync(board, longest_ms(board));
}

static GError *reported(const GcodeBoard *board, enum device_error code, const char *advice) {
    return device_error_new(code, NULL, "%s: Klipper reports: %s" ERROR_ADVICE "%s",
                            board->link.port, board->reason, advice);
}

static void lose(GcodeBoard *board, enum device_error code, const char *text) {
    gcode_board_lose(board, device_error_new(code, NULL, "%s: %s", board->link.port, text));
}

/* Klipper has stopped its motors. */
static void shut_down(GcodeBoard *board) {
    const gboolean asked = board->phase == STOPPING && board->stage == KILLING;
    board->killed = TRUE;
    board->synced = board->echoed = FALSE;
    gcode_board_forget_lines(board);
    lose(board, DEVICE_ERROR_STALLED,
         asked ? "Klipper was shut down by M112, so the position is lost" ERROR_ADVICE
                 "home it, which restarts Klipper"
               : "Klipper has shut down, so the position is lost" ERROR_ADVICE
                 "see its log for the reason, then home it, which restarts Klipper");
    if (board->phase == STOPPING)
        gcode_board_ready(board);
    else if (board->phase == GREETING)
        resync(board, board->link.answer_ms);
}

/* Klipper restarts, or has restarted. All motions have ended then. */
static void restarted(GcodeBoard *board) {
    board->synced = board->echoed = FALSE;
    gcode_board_forget_lines(board);
    lose(board, DEVICE_ERROR_DISCONNECTED,
         "Klipper was restarted, so the position is lost" ERROR_ADVICE "home it");
    if (board->phase == STOPPING)
        gcode_board_ready(board);
}

/* Klipper has no connection to its controllers, so nothing moves. */
static void not_ready(GcodeBoard *board, const char *advice) {
    if (board->phase == GREETING)
        gcode_board_fail(board, reported(board, DEVICE_ERROR_UNSUPPORTED, advice));
    else if (board->phase == RUNNING)
        gcode_board_end_request(board, reported(board, DEVICE_ERROR_UNSUPPORTED, advice));
    else
        restarted(board);
}

/* Takes the state that STATUS has answered. */
static void take_status(GcodeBoard *board) {
    const gboolean greeting = board->phase == GREETING;
    /* Klipper does not name its state if M112 came while it started. */
    if (board->state == UNKNOWN)
        board->state = *board->reason ? (int)KLIPPER_SHUTDOWN : (int)KLIPPER_STARTING;
    switch ((enum klipper_state)board->state) {
    case KLIPPER_READY:
        board->killed = FALSE;
        if (greeting) {
            gcode_board_begin(board, SETTINGS, 3 * board->link.answer_ms);
            gcode_board_send(board, "M115", FALSE);
            gcode_board_send(board, "SET_VELOCITY_LIMIT", FALSE);
        } else if (board->phase == STOPPING) {
            settle(board, SETTLING, 0);
        } else {
            start(board);
        }
        break;
    case KLIPPER_SHUTDOWN:
        if (!greeting) {
            shut_down(board);
            break;
        }
        board->killed = TRUE;
        settle(board, SETTLING, board->link.answer_ms);
        break;
    case KLIPPER_HALTED:
        not_ready(board, "correct its configuration, then restart it");
        break;
    default:
        if (board->phase == STOPPING)
            restarted(board);
        break; /* asked again until the deadline */
    }
}

/* All lines of a motion were answered. */
static void finish(GcodeBoard *board) {
    for (guint i = 0; board->n_before > 0 && i < board->clients->len; i++) {
        const GcodeClient *client = board->clients->pdata[i];
        if (!gcode_board_was_dragged(board, client))
            continue;
        begin_way(board, client->letter, board->before[client->letter], client->last_units_s);
        return;
    }
    gcode_board_end_request(board, NULL);
}

/* Goes on when all lines of the stage were answered. */
static void take_end_of_lines(GcodeBoard *board) {
    switch ((enum stage)board->stage) {
    case CHECKING:
        take_status(board);
        break;
    case SETTINGS:
        settle(board, SETTLING, longest_ms(board));
        break;
    case SETTLING:
        if (board->n_final > 0)
            gcode_board_ready(board);
        break;
    case STARTING:
        board->n_before = 0;
        if (board->active->request != MOVE)
            home(board);
        else
            begin_way(board, board->active->letter, board->active->target, board->active->units_s);
        break;
    case MOVING:
        if (board->way_at == board->way_to)
            settle(board, FINISHING, 0);
        else
            send_piece(board);
        break;
    case HOMING:
        settle(board, FINISHING, 0);
        break;
    case FINISHING:
        if (board->n_final > 0)
            finish(board);
        break;
    default:
        break;
    }
}

static void take_ok(GcodeBoard *board) {
    if (!board->synced) {
        if (!board->echoed)
            return; /* this answers a line before the stop */
        board->synced = TRUE;
        if (board->phase != READY)
            check(board);
    } else if (gcode_board_answered(board) && gcode_board_is_answered(board) &&
               board->phase != READY) {
        take_end_of_lines(board);
    }
}

static void take_position(GcodeBoard *board, const struct gcode_answer *answer) {
    int n = 0;
    if (!board->synced)
        return;
    while (n < GCODE_MAX_AXES && answer->has_at[n])
        n++;
    board->asked = FALSE;
    board->n_final = 1;
    gcode_board_moved(board, answer->at, n);
    gcode_board_check_still(board);
}

/* Klipper has refused a line. The "ok" of the line follows. */
static void take_refusal(GcodeBoard *board) {
    const gboolean here = board->phase == RUNNING && board->active->request == HOME_HERE;
    if (board->phase == RUNNING && board->stage >= STARTING)
        gcode_board_end_request(
            board, reported(board, DEVICE_ERROR_STALLED,
                            here ? "set enable_force_move: True in [force_move] of its "
                                   "configuration, then home it"
                                 : "check its switches and its configuration, then home it"));
}

static void take_state(GcodeBoard *board, enum klipper_state state) {
    const gboolean restarts = board->phase == RUNNING && board->stage == RESTARTING;
    const gboolean asked = board->phase != READY && board->stage == CHECKING;
    board->state = (int)state;
    if (restarts && state == KLIPPER_READY) {
        board->killed = FALSE;
        resync(board, board->link.answer_ms);
    } else if (restarts || asked) {
        return; /* an answer to STATUS */
    } else if (state == KLIPPER_READY) {
        board->killed = FALSE;
    } else if (state == KLIPPER_SHUTDOWN && !board->killed) {
        shut_down(board);
    } else if (state == KLIPPER_LEAVES && !board->killed) {
        restarted(board);
    }
}

static void take(GcodeBoard *board, const struct gcode_answer *answer) {
    switch (answer->kind) {
    case GCODE_OK:
        if (*answer->text)
            g_strlcpy(board->firmware, answer->text, sizeof board->firmware);
        take_ok(board);
        break;
    case GCODE_ECHO:
        board->echoed |= answer->number == board->token;
        break;
    case GCODE_POSITION:
        take_position(board, answer);
        break;
    case GCODE_STATE:
        take_state(board, (enum klipper_state)answer->number);
        break;
    case GCODE_FAILURE:
        g_strlcpy(board->reason, answer->text, sizeof board->reason);
        take_refusal(board);
        break;
    case GCODE_UNKNOWN:
        g_snprintf(board->reason, sizeof board->reason, "unknown command %s", answer->text);
        take_refusal(board);
        break;
    case GCODE_LIMIT:
        for (int i = 0; i < GCODE_MAX_AXES; i++)
            *(answer->number == 203 ? &board->limits[i].units_s : &board->limits[i].units_s2) =
                answer->value;
        break;
    default:
        break;
    }
}

/* Asks a Klipper that starts for its state, and tells the class that the motion has not begun. */
static void wait_for_start(GcodeBoard *board) {
    if (board->phase == RUNNING)
        board->active->listener->waits(board->active->data);
    if (!gcode_board_is_past(board, board->asked_us, ASK_MS) || !gcode_board_is_answered(board))
        return;
    board->asked_us = clock_now_us(board->clock);
    if (board->stage == RESTARTING)
        gcode_board_write(board, "STATUS\n", 7);
    else if (board->stage == SYNCING)
        send_token(board);
    else
        check(board);
}

static void tick_stop(GcodeBoard *board) {
    if (board->stage != KILLING) {
        kill_motion(board);
        return;
    }
    gcode_board_fail(board, gcode_board_silence(board, longest_ms(board)));
    gcode_board_lose(board, gcode_board_silence(board, longest_ms(board)));
}

static void tick_greeting(GcodeBoard *board, gboolean late) {
    const double boot_ms = board->link.boot_ms;
    /* A program that has ended may have left a motion or a homing that still runs. Klipper does not
     * answer during that time, so it is stopped by M112. */
    const gboolean silent = board->stage == SYNCING && board->n_noise == 0 &&
                            board->heard_us <= board->stage_us &&
                            gcode_board_is_past(board, board->stage_us, MIN(boot_ms / 2, LEFT_MS));
    if (!board->reset_once && (silent || (board->stage == SETTLING && late))) {
        board->reset_once = TRUE;
        gcode_board_write(board, "\nM112\n", 6);
        resync(board, boot_ms);
    } else if (late) {
        gcode_board_fail(board, *board->reason
                                    ? reported(board, DEVICE_ERROR_DISCONNECTED, "see its log")
                                    : gcode_board_silence(board, boot_ms));
    } else if (board->stage == SYNCING || board->stage == CHECKING) {
        wait_for_start(board);
    }
}

static void tick(GcodeBoard *board, gint64 now_us) {
    const struct gcode_line *line = g_queue_peek_head(&board->sent);
    const double ms = board->link.answer_ms;
    const gboolean late = board->until_us < now_us;
    const gboolean waits =
        board->stage == RESTARTING || board->stage == SYNCING || board->stage == CHECKING;
    /* A homing may take any time, and Klipper is silent until its end. The class has a deadline. */
    const gboolean silent =
        line && !(line->is_long && board->stage == HOMING) &&
        gcode_board_is_past(board, line->sent_us, line->is_long ? ms + longest_ms(board) : ms);
    if (board->phase == GREETING) {
        tick_greeting(board, late);
    } else if (board->phase == STOPPING && late) {
        tick_stop(board);
    } else if (board->phase == RUNNING && waits && late) {
        gcode_board_end_request(
            board, *board->reason
                       ? reported(board, DEVICE_ERROR_DISCONNECTED, "see its log, then home it")
                       : gcode_board_silence(board, board->link.boot_ms));
    } else if (board->phase == RUNNING && waits) {
        wait_for_start(board);
    } else if (board->phase == RUNNING && silent) {
        gcode_board_end_request(board, gcode_board_silence(board, ms));
    } else if (board->phase == READY && !board->killed &&
               (silent || (!board->synced && gcode_board_is_past(board, board->asked_us, ms)))) {
        send_token(board); /* the silence may come from a long command of another program */
    } else if (board->phase == RUNNING && board->stage == MOVING) {
        if (gcode_board_is_past(board, board->asked_us, POLL_MS))
            ask(board);
    } else if (board->phase == READY && board->synced && !line && gcode_board_is_watched(board)) {
        if (gcode_board_is_past(board, board->asked_us, WATCH_MS))
            ask(board);
    }
}

const struct dialect gcode_klipper = {
    .greet = greet,
    .take = take,
    .read = gcode_klipper_read,
    .tick = tick,
    .start = start,
    .stop = stop,
    .window = 4095, /* size of the buffer of a pseudo-terminal */
    .one_line = TRUE,
    .halted = "Klipper has shut down" ERROR_ADVICE "home it, which restarts Klipper",
};
