/* State and functions that the files of the virtual board share. gcode.c has the port and the
 * motion. gcode_grbl.c, gcode_marlin.c and gcode_klipper.c have the languages. Call all functions
 * with the mutex locked. */
#pragma once

#include "gcode.h"
#include "terminal.h"

#define GCODE_RX     127 /* bytes that GRBL's receive buffer holds */
#define GCODE_BLOCKS 15  /* blocks that the planner holds */

enum gcode_motion { GCODE_STANDING, GCODE_MOVING, GCODE_BRAKING, GCODE_HELD, GCODE_HOMING };

struct gcode_block {
    double to[VIRTUAL_GCODE_AXES], units_s;
};

/* A language of the board. */
struct gcode_language {
    /* Called when the board has been switched on (power is TRUE), and when GRBL has been reset
     * (power is FALSE). */
    void (*boot)(VirtualGcode *board, gboolean power);
    void (*receive)(VirtualGcode *board, char byte);
    /* Carries out lines that were received. It is called about once per millisecond. */
    void (*work)(VirtualGcode *board);
    void (*homing_ended)(VirtualGcode *board);
};

extern const struct gcode_language gcode_language_grbl, gcode_language_marlin,
    gcode_language_klipper;

struct VirtualGcode {
    struct virtual_gcode_options options;
    const struct gcode_language *language;
    char *folder, *port;
    struct terminal terminal;
    int wake[2];
    GThread *thread;

    GMutex mutex; /* guards the following members */
    gboolean quit, was_open;
    struct virtual_gcode_faults faults;
    struct virtual_gcode_state state;
    guint n_sent, n_received; /* numbers of bytes, for the faults */
    GQueue out;               /* of struct gcode_out */
    gint64 deaf_until_us;     /* end of booting; until then, nothing is received */
    gint64 late_until_us;     /* time until which lines wait for a late "ok" */

    enum gcode_motion motion;
    struct gcode_block blocks[GCODE_BLOCKS];
    int n_blocks;
    double from[VIRTUAL_GCODE_AXES], to[VIRTUAL_GCODE_AXES];
    /* Length, top speed and acceleration of the motion. While the board brakes, units_s is the
     * speed at which braking began. */
    double way, units_s, units_s2;
    gint64 start_us, end_us;
    guint homing_axes; /* a bit for each axis that homes */

    GString *rx; /* received bytes of lines that have not been executed */
    /* GRBL: number of the alarm, or 0; other languages: 1 after kill() or a shutdown */
    int alarm;
    gboolean locked_up; /* answers nothing until Ctrl-X */
    /* GRBL: `door` says that the safety door is open. `check` says that moves are checked but not
     * made (“$C”). */
    gboolean door, check;
    gboolean waits; /* "G4", M400, "$H" or G28 is being carried out, and its "ok" comes later */
    double feed;
    gboolean relative;
    int n_reports;    /* number of status reports */
    int n_unanswered; /* number of received bytes of lines that have no answer yet */
    gboolean pressed[VIRTUAL_GCODE_AXES];
    int last_line;  /* Marlin: number of the last line */
    gint64 busy_us; /* Marlin: time of the last "busy" */
    /* Klipper: `ready` says that it is connected to its controllers. `homed` has a bit for each
     * axis that is homed. */
    gboolean ready;
    guint homed;
    gboolean is_ahead; /* Klipper: the "ok" of a move waits until less motion is still to be made */
};

/* Sends a line to the program, changed by the faults that are set. */
void gcode_say(VirtualGcode *board, const char *format, ...) G_GNUC_PRINTF(2, 3);
/* Returns the speed along the path in units/s. */
double gcode_speed(const VirtualGcode *board, gint64 now_us);
/* Appends a move to the planned blocks. There must be fewer than GCODE_BLOCKS blocks before. */
void gcode_add_block(VirtualGcode *board, const double *to, double units_s);
/* If the board stands still, begins a block after delay_us. If the board moves, prolongs its
 * motion: the target of the present block is moved further in the direction of the motion, as if no
 * stop had been planned at the old target. Returns FALSE if neither is possible now. */
gboolean gcode_extend(VirtualGcode *board, const double *to, double units_s, gint64 delay_us);
/* Begins a feed hold: brakes the motion and keeps the planned blocks. */
void gcode_brake(VirtualGcode *board);
/* Ends a feed hold. Does nothing while the board still brakes. */
void gcode_resume(VirtualGcode *board);
/* Ends all motion without a ramp. Returns whether an axis was moving. */
gboolean gcode_abort(VirtualGcode *board);
void gcode_begin_homing(VirtualGcode *board, guint axes);
/* Sets ret to the position at the end of the last planned block. */
void gcode_planned(const VirtualGcode *board, double *ret);
gboolean gcode_take_line(VirtualGcode *board, char *ret, gsize size);

void grbl_press(VirtualGcode *board);
void grbl_set_door(VirtualGcode *board);
