/*
 * A virtual board that moves axes by G-code on a pseudo-terminal, in a separate thread and in real
 * time. It speaks the part of GRBL 1.1h, Marlin 2 or Klipper that a program needs to move single
 * axes. It is for tests, and for mesorig-rig.
 *
 * GRBL: the board understands "$H", "$HX" (if single_homing), "$X", "$$", "$I", "$C", G0, G1, G4,
 * G21, G53, G90, G91 and G94, and the characters "?", "!", "~", Ctrl-X and 0x84. Bytes that do not
 * fit into the receive buffer of 127 bytes are lost. The planner has space for 15 blocks. The board
 * raises the alarms 1, 2, 3, 6, 7 and 9. It answers nothing while it homes, and from the alarms 1
 * and 2 until Ctrl-X.
 *
 * Marlin: the board understands line numbers and checksums, G1, G28, G90, M110, M112, M114, M115,
 * M400, M410 and M503. It sends "echo:busy: processing" while a command runs. With
 * emergency_parser, M112 and M410 act even while a command runs.
 *
 * Klipper: the board understands ECHO, FIRMWARE_RESTART, G1, G28, G90, M112, M114, M115, M400,
 * SET_KINEMATIC_POSITION, SET_VELOCITY_LIMIT and STATUS. Consecutive moves in the same direction
 * are made without a stop. The first move begins after 0.25 s. The "ok" of a move comes when at
 * most one second of motion is still to be made. An axis that is not homed does not move.
 *
 * Any thread may call these functions, except virtual_gcode_new() and virtual_gcode_free().
 */
#pragma once

#include <glib.h>

#define VIRTUAL_GCODE_AXES 6

typedef struct VirtualGcode VirtualGcode;

enum virtual_gcode_language { VIRTUAL_GRBL, VIRTUAL_MARLIN, VIRTUAL_KLIPPER };

struct virtual_gcode_options {
    enum virtual_gcode_language language;
    int n_axes;      /* 3 to 6 */
    double units_s;  /* top speed along the path, units/s */
    double units_s2; /* acceleration, units/s² */
    double steps;    /* motor steps per unit */
    double home_at;  /* position after homing */
    /* smallest distance of an axis during homing; the distance determines the duration */
    double switch_way;
    /* soft limits: positions from −max_travel to max_travel are allowed; 0: no soft limits */
    double max_travel;
    gboolean single_homing; /* GRBL: knows "$HX" */
    /* GRBL: homing is switched off ($22=0). Klipper: SET_KINEMATIC_POSITION is unknown. */
    gboolean homing_off;
    gboolean work_positions;   /* GRBL: reports WPos, and its offset in every tenth report */
    gboolean emergency_parser; /* Marlin: acts on M112 and M410 at once */
    /* Klipper: no report of the state after M112, as if M112 came during the start */
    gboolean terse;
    gboolean halted;         /* Klipper: has a mistake in its configuration */
    int boot_ms;             /* time from a reset until the board listens */
    gboolean resets_on_open; /* opening the port resets the board, as on an Arduino */
};

VirtualGcode *virtual_gcode_new(const struct virtual_gcode_options *options, GError **error);
void virtual_gcode_free(VirtualGcode *board); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(VirtualGcode, virtual_gcode_free)

/* Returns the value of "port" for a section of a rig file. The value is the path of a link to the
 * pseudo-terminal, as in /dev/serial/by-id. */
const char *virtual_gcode_port(const VirtualGcode *board);

/* The faults that virtual_gcode_fail() sets. If a member lose_… or damage_… is n, every n-th byte
 * is lost or damaged. 0 means that no byte is lost or damaged. */
struct virtual_gcode_faults {
    gboolean cut;    /* nothing arrives, and nothing is sent */
    gboolean silent; /* obeys, but sends nothing */
    int late_ms;     /* delay of everything that is sent */
    /* Delay of the next "ok". All later lines wait for this "ok". The delay is used once. */
    int late_ok_ms;
    int lose_sent, damage_sent; /* bytes from the board to the program */
    int lose_received;          /* bytes from the program to the board */
    gboolean noise;             /* sends a line of noise before each line */
    /* GRBL: number of the error with which the next line is refused. The error is used once. */
    int error;
    gboolean no_hold;   /* GRBL: "!" has no effect */
    gboolean no_switch; /* homing does not find the switch */
};
void virtual_gcode_fail(VirtualGcode *board, const struct virtual_gcode_faults *faults);

/* Presses or releases the limit switch of an axis. With GRBL, motion then ends in ALARM:1. */
void virtual_gcode_press(VirtualGcode *board, int axis, gboolean pressed);
void virtual_gcode_set_door(VirtualGcode *board, gboolean open); /* GRBL */
void virtual_gcode_press_hold(VirtualGcode *board);              /* GRBL: the feed hold button */
/* Switches the power off and on. With Klipper, restarts Klipper. The positions then count from
 * 0. */
void virtual_gcode_reset(VirtualGcode *board);
/* Closes the pseudo-terminal, or opens a new one at the same link. The board continues to run. */
void virtual_gcode_unplug(VirtualGcode *board);
void virtual_gcode_plug(VirtualGcode *board);
/* Moves an axis that stands still, as the buttons of a pendant do. */
void virtual_gcode_push(VirtualGcode *board, int axis, double units);
/* Sends a line to the program. */
void virtual_gcode_send(VirtualGcode *board, const char *line);
/* Gives the board bytes as if the program had sent them. */
void virtual_gcode_receive(VirtualGcode *board, const char *bytes);

struct virtual_gcode_state {
    double at[VIRTUAL_GCODE_AXES]; /* true positions of the axes */
    gboolean moving;
    gboolean alarm;     /* locked by an alarm (GRBL), or halted or shut down by M112 */
    int max_unanswered; /* largest number of bytes of lines that had no answer yet */
    int n_overflows;    /* number of bytes that were lost because the buffer was full */
    /* Numbers of lines, resets, feed holds, homings, requests to send a line again, and calls of
     * kill() or shutdowns of Klipper. */
    int n_lines, n_resets, n_holds, n_homings, n_resends, n_kills;
    /* number of motions that ended without a ramp because of a reset, an alarm or M410 */
    int n_aborted;
};
void virtual_gcode_state(VirtualGcode *board, struct virtual_gcode_state *ret);
