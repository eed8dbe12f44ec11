/* Shared by the parts of the virtual board: gcode.c has the port and the motion, gcode_grbl.c and
 * gcode_marlin.c the languages. All functions are called with the mutex locked. */
#pragma once

#include "gcode.h"
#include "terminal.h"

#define GCODE_RX     127 /* bytes that GRBL's receive buffer holds */
#define GCODE_BLOCKS 15

enum gcode_motion { GCODE_STANDING, GCODE_MOVING, GCODE_BRAKING, GCODE_HELD, GCODE_HOMING };

struct gcode_block {
    double to[VIRTUAL_GCODE_AXES], units_s;
};

struct VirtualGcode {
    struct virtual_gcode_options options;
    char *folder, *port;
    struct terminal terminal;
    int wake[2];
    GThread *thread;

    GMutex mutex; /* guards what follows */
    gboolean quit, unplugged, was_open;
    struct virtual_gcode_faults faults;
    struct virtual_gcode_state state;
    guint n_sent, n_received; /* bytes, for the faults */
    GQueue out;               /* of struct gcode_out */
    gint64 deaf_until_us;     /* boots */
    gint64 late_until_us;

    enum gcode_motion motion;
    struct gcode_block blocks[GCODE_BLOCKS];
    int n_blocks;
    double from[VIRTUAL_GCODE_AXES], to[VIRTUAL_GCODE_AXES];
    double way, units_s, units_s2; /* of the motion; braking: units_s is the speed at its start */
    gint64 start_us, end_us;
    guint homing_axes; /* bits */

    GString *rx;        /* received bytes of lines that were not executed */
    int alarm;          /* GRBL: number, 0 if it is not locked; Marlin: 1 after kill() */
    gboolean locked_up; /* answers nothing until Ctrl-X */
    gboolean door, check;
    gboolean waits; /* "G4", M400, "$H" or G28 is under way; its "ok" is due */
    double feed;
    gboolean relative;
    int n_reports, n_unanswered;
    gboolean pressed[VIRTUAL_GCODE_AXES];
    int last_line;  /* Marlin */
    gint64 busy_us; /* Marlin: time of the last "busy" */
};

void gcode_say(VirtualGcode *board, const char *format, ...) G_GNUC_PRINTF(2, 3);
/* Returns the speed along the way. */
double gcode_speed(const VirtualGcode *board, gint64 now_us);
void gcode_add_block(VirtualGcode *board, const double *to, double units_s);
void gcode_brake(VirtualGcode *board);
void gcode_resume(VirtualGcode *board);
/* Ends all motion without a ramp. Returns whether there was any. */
gboolean gcode_abort(VirtualGcode *board);
void gcode_begin_homing(VirtualGcode *board, guint axes);
/* The position at the end of what is planned. */
void gcode_planned(const VirtualGcode *board, double *ret);
gboolean gcode_take_line(VirtualGcode *board, char *ret, gsize size);

void grbl_boot(VirtualGcode *board, gboolean power);
void grbl_receive(VirtualGcode *board, char byte);
void grbl_work(VirtualGcode *board);
void grbl_press(VirtualGcode *board);
void grbl_set_door(VirtualGcode *board);
void grbl_homing_ended(VirtualGcode *board);

void marlin_boot(VirtualGcode *board);
void marlin_receive(VirtualGcode *board, char byte);
void marlin_work(VirtualGcode *board);
void marlin_homing_ended(VirtualGcode *board);
