/*
 * The lines that a G-code board sends: GRBL 1.1 (also FluidNC and grblHAL), Marlin and Klipper.
 * Plain data. Any thread may call these functions.
 *
 * GRBL: https://github.com/gnea/grbl/wiki/Grbl-v1.1-Interface. A status report is
 * "<Idle|MPos:0.000,0.000,0.000|FS:0,0>". Its fields come in any order, and most are optional.
 * Marlin: https://marlinfw.org/meta/gcode.
 * Klipper: https://www.klipper3d.org/G-Codes.html. "ok" ends the answer to each line. Errors begin
 * with "!! ", other text with "// ".
 */
#pragma once

#include <glib.h>

/* Letters of the axes, in the order in which GRBL reports their positions. */
#define GCODE_LETTERS  "XYZABC"
#define GCODE_MAX_AXES 6

enum gcode_state {
    GCODE_IDLE,
    GCODE_RUN,
    GCODE_HOLD, /* sub is 0: the axes stand; 1: they still brake */
    GCODE_JOG,
    GCODE_ALARM,
    GCODE_DOOR, /* sub is 0: door closed, axes stand; 1: door open, axes stand; 2, 3: axes move */
    GCODE_CHECK,
    GCODE_HOME,
    GCODE_SLEEP,
    GCODE_OTHER, /* a state of a newer firmware */
};

struct gcode_report {
    enum gcode_state state;
    int sub;          /* number after the colon that follows the state; −1 if there is none */
    int n_at;         /* number of positions, above 0 */
    int n_wco;        /* number of offsets; 0 if the report has none */
    gboolean is_work; /* `at` is in work coordinates; the machine position is at + wco */
    double at[GCODE_MAX_AXES], wco[GCODE_MAX_AXES];
    char name[16];   /* name of the state, as the board writes it */
    char inputs[16]; /* letters of the inputs that are active ("X" is the limit switch of X) */
};

enum gcode_kind {
    GCODE_NONE, /* nothing that the driver uses, or noise */
    GCODE_OK,
    GCODE_ERROR,     /* error:NUMBER of GRBL */
    GCODE_ALARM_NOW, /* ALARM:NUMBER of GRBL */
    GCODE_REPORT,
    GCODE_BANNER,   /* the board has been reset */
    GCODE_SETTING,  /* $NUMBER=VALUE of GRBL */
    GCODE_VERSION,  /* text has the version of the firmware */
    GCODE_BUSY,     /* Marlin works on a long command */
    GCODE_RESEND,   /* Marlin wants line NUMBER again */
    GCODE_POSITION, /* answer of Marlin or Klipper to M114 */
    GCODE_FAILURE,  /* Marlin: "Error:TEXT"; Klipper: "!! TEXT" */
    GCODE_KILLED,   /* Marlin has stopped for good, until it is reset */
    /* Marlin's values of M92 (steps per unit), M201 or M203; NUMBER is 92, 201 or 203 */
    GCODE_SCALE,
    /* Marlin does not know the command "L" followed by NUMBER, or Klipper does not know the command
     * TEXT */
    GCODE_UNKNOWN,
    GCODE_ECHO,  /* Klipper's answer to "ECHO MESORIG=NUMBER" */
    GCODE_STATE, /* NUMBER is a state of Klipper */
    /* limit of M201 or M203 in Klipper, where NUMBER is 201 or 203; VALUE counts for all axes */
    GCODE_LIMIT,
};

enum klipper_state {
    KLIPPER_READY,
    KLIPPER_STARTING, /* connects to its controllers */
    KLIPPER_SHUTDOWN, /* has stopped all motors; only FIRMWARE_RESTART helps */
    KLIPPER_HALTED,   /* stopped by an error of the configuration or of a connection */
    KLIPPER_LEAVES,   /* ends or restarts */
};

struct gcode_answer {
    enum gcode_kind kind;
    int number;
    double value;
    struct gcode_report report;
    /* For GCODE_POSITION, `at` has the positions to which the axes were sent, and `steps` has the
     * positions of the motors. For GCODE_SCALE, `at` has the values. */
    gboolean has_at[GCODE_MAX_AXES], has_steps[GCODE_MAX_AXES];
    double at[GCODE_MAX_AXES], steps[GCODE_MAX_AXES];
    /* Printable ASCII. Set for GCODE_VERSION, GCODE_FAILURE, GCODE_KILLED and GCODE_UNKNOWN, and
     * for a GCODE_OK of Klipper that has a version. */
    char text[64];
};

/* Parse a line without its end. A line that is recognisably damaged becomes GCODE_NONE. */
void gcode_grbl_read(const char *line, struct gcode_answer *ret);
void gcode_marlin_read(const char *line, struct gcode_answer *ret);
void gcode_klipper_read(const char *line, struct gcode_answer *ret);

/* Returns whether no axis moves in the reported state. */
gboolean gcode_report_stands(const struct gcode_report *report);

/* Return what an alarm or an error of GRBL means, and after ERROR_ADVICE (base/error_details.h)
 * what to do. Return NULL if the number is not known. */
const char *gcode_alarm_text(int number);
const char *gcode_error_text(int number);
