/* What board.c shares with the dialects (grbl.c, marlin.c, klipper.c). board.c has the connection
 * and the requests. */
#pragma once

#include "board.h"

#include "drivers/lock.h"

typedef struct GcodeBoard GcodeBoard;

/* Positions that differ by less than this count as the same, in units of the board. Boards report
 * positions with three decimals. */
#define GCODE_SAME 0.0015

enum phase {
    CLOSED,
    GREETING, /* the port is open; the board has not answered yet */
    READY,
    RUNNING,  /* the request of board->active is under way */
    STOPPING, /* the board stops all motion for the clients whose `stops` is TRUE */
};

enum request { NO_REQUEST, MOVE, HOME_ALL, HOME_AXIS, HOME_HERE };

struct GcodeClient {
    GcodeBoard *board;
    int letter;
    double poll_ms;
    const struct gcode_listener *listener;
    gpointer data;
    enum request request;
    double target, units_s; /* MOVE */
    double last_units_s;    /* speed of the last move */
    double brake_s;
    gboolean watched, stops;
    int n_still; /* reports in a row with the same position, during a stop */
    double still_at;
    gboolean has_ended, has_lost; /* a callback is due */
    GError *error;                /* error for that callback; NULL if there is none */
};

struct dialect {
    /* Begins the greeting: the first questions to a board whose port was just opened. */
    void (*greet)(GcodeBoard *board);
    /* Takes a line that the board has sent. */
    void (*take)(GcodeBoard *board, const struct gcode_answer *answer);
    void (*read)(const char *line, struct gcode_answer *ret);
    /* Polls and looks at deadlines. */
    void (*tick)(GcodeBoard *board, gint64 now_us);
    /* Starts the request of board->active. */
    void (*start)(GcodeBoard *board);
    /* Begins to stop all motion. */
    void (*stop)(GcodeBoard *board);
    /* maximum number of bytes of unanswered lines */
    int window;
    /* at most one line may be unanswered */
    gboolean one_line;
    /* Text of the error when the board has halted itself: what has happened, and what to do. */
    const char *halted;
};

extern const struct dialect gcode_grbl, gcode_marlin, gcode_klipper;

struct gcode_line {
    char *text; /* with its end */
    gint64 sent_us;
    gboolean alone;   /* no other line may be unanswered */
    gboolean is_long; /* its answer comes when a motion has ended */
};

struct GcodeBoard {
    int ref_count;
    struct gcode_link link; /* a copy */
    char *key;
    const struct dialect *dialect;
    Clock *clock;
    GPtrArray *clients;
    int fd;
    guint source, timer;
    gint64 due_us; /* time when the timer is due */
    Lock *lock;    /* lock of the port; kept while the board is lost */
    GString *input;
    /* the input up to the next end of line is discarded, because the line is too long */
    gboolean skips;
    int n_noise; /* lines that were not understood since the port was opened */

    enum phase phase;
    GcodeClient *active; /* NULL if the phase is not RUNNING */
    GQueue unsent, sent; /* of struct gcode_line */
    int n_unanswered;    /* number of bytes of the lines in `sent` */
    gint64 heard_us;     /* time of the last line that was understood */
    GError *failure;     /* why the last greeting has failed */

    /* The position that was reported last; n_at is 0 if none is known. */
    int n_at;
    double at[GCODE_MAX_AXES];
    gint64 asked_us; /* time of the last question */
    gboolean asked;  /* the board was asked for its position and has not answered yet */
    struct gcode_limits limits[GCODE_MAX_AXES];
    char firmware[64];

    /* The rest is used by the dialects. */
    int stage;                 /* enum stage of the dialect */
    gint64 stage_us, until_us; /* beginning and deadline of the stage */
    int n_final;               /* reports so far that show that a motion has ended */

    /* GRBL */
    int n_wco; /* number of offsets that are known */
    double wco[GCODE_MAX_AXES];
    int alarm; /* number of the last alarm since the last reset */
    /* held_at is valid: the positions of the axes when the last feed hold had ended */
    gboolean held;
    double held_at[GCODE_MAX_AXES];
    double final_at[GCODE_MAX_AXES]; /* positions in the last of the n_final reports */
    int n_resets;                    /* number of Ctrl-X of the stage */
    int n_owed;                      /* number of Ctrl-X without a banner yet */
    char other[16];                  /* name of the unknown state that was reported last */
    int n_other;                     /* number of reports with this state in a row */

    /* GRBL and Klipper */
    int n_before;
    double before[GCODE_MAX_AXES]; /* where the axes were before homing */
    gboolean reset_once;           /* a silent board was reset during the GREETING (Ctrl-X, M112) */

    /* Marlin and Klipper */
    int token;       /* number in the last command that was sent only for its echo */
    gboolean echoed; /* the echo of that last command has come */
    gboolean synced; /* the "ok" after that echo has come */
    gboolean killed; /* the board has halted itself, and obeys nothing until it is reset */

    /* Marlin */
    int n_line;                   /* number of the last line */
    GQueue history;               /* of char *: the last lines, up to number n_line */
    int resends;                  /* number of the line that the board asks for again; 0 if none */
    gboolean nudged;              /* an empty line was sent, because the last line got no answer */
    double steps[GCODE_MAX_AXES]; /* where the motors were in the last report */
    int n_steps_same;             /* number of reports in a row with these steps */
    gint64 same_us;               /* time of the first of these reports */

    /* Klipper */
    int state;                          /* enum klipper_state, as reported last */
    char reason[64];                    /* text of the last error */
    int way_letter;                     /* axis of the move that is sent in pieces */
    double way_at, way_to, way_units_s; /* end of the pieces sent so far, target, speed */
};

/* Closes the port, drops all lines and forgets the position. A new client and the next request to
 * home or to stop open the port again, which resets most boards. */
void gcode_board_close(GcodeBoard *board);
/* Queues a line and sends it as soon as the board has space. `text` has no end of line. is_long:
 * see struct gcode_line. */
void gcode_board_send(GcodeBoard *board, const char *text, gboolean is_long);
/* Sends bytes now, before all lines that wait. Does nothing if the port is closed. A failure is
 * only logged, because the deadline of the answer shows it. */
void gcode_board_write(GcodeBoard *board, const char *bytes, gsize n);
/* Takes the answer to the oldest unanswered line. Returns FALSE if there is none. */
gboolean gcode_board_answered(GcodeBoard *board);
/* Drops the lines that were not sent. No answers are expected any more to the lines that were
 * sent. */
void gcode_board_forget_lines(GcodeBoard *board);
/* Returns whether no line waits to be sent or answered. */
gboolean gcode_board_is_answered(const GcodeBoard *board);

/* Stores the position and tells the clients. */
void gcode_board_moved(GcodeBoard *board, const double *at, int n);

/* Ends the greeting or the stop without an error. The end of the stop ends the stops of all
 * clients. */
void gcode_board_ready(GcodeBoard *board);
/* Ends the active request. If it is a HOME_ALL, also ends the HOME_ALL requests of all other
 * clients. error is NULL if the request has succeeded. Takes ownership of error. */
void gcode_board_end_request(GcodeBoard *board, GError *error);
/* Ends the stop or the greeting with an error. If it was the greeting, also closes the port and
 * ends all requests. Takes ownership of error. */
void gcode_board_fail(GcodeBoard *board, GError *error);
/* Says that the positions of all axes are unknown. Ends all requests with the error. A stop goes
 * on; when it ends, it reports the error if its axis was watched. Takes ownership of error. */
void gcode_board_lose(GcodeBoard *board, GError *error);
/* Ends the stop of clients whose axes stand while another axis moves. Call it after each report. */
void gcode_board_check_still(GcodeBoard *board);

/* Begins a stage of the phase. The deadline of the stage is after ms. */
void gcode_board_begin(GcodeBoard *board, int stage, double ms);
/* Returns whether more than ms have passed since since_us. */
gboolean gcode_board_is_past(const GcodeBoard *board, gint64 since_us, double ms);
/* Returns the shortest poll_ms of all clients, and idle_ms at most. */
double gcode_board_poll_ms(const GcodeBoard *board, double idle_ms);
/* Returns whether homing has moved a watched axis away from board->before without a request of its
 * client. FALSE for an axis that was never moved, because its speed for the way back is not
 * known. */
gboolean gcode_board_was_dragged(const GcodeBoard *board, const GcodeClient *client);
/* Returns the longest brake_s of all clients. */
double gcode_board_brake_s(const GcodeBoard *board);
/* Returns whether a client is watched. */
gboolean gcode_board_is_watched(const GcodeBoard *board);
/* Returns a new error for one of three cases: the board has halted itself, has sent only noise
 * during the greeting, or has not answered for ms. */
GError *gcode_board_silence(const GcodeBoard *board, double ms);
