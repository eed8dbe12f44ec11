/*
 * A controller for several axes that speaks G-code on a serial port: GRBL 1.1, FluidNC, grblHAL,
 * Marlin or Klipper. All sections that name the port share the board and its connection.
 *
 * A board carries out one motion after another. The requests of its axes therefore take turns. An
 * axis whose request waits is told so. The board knows only the motion under way, so a program that
 * dies leaves at most one motion behind.
 *
 * A stop brakes the motion of its axis. It also ends a homing under way, whichever axis has
 * requested it. It does not end a move of another axis: the stop is then confirmed by the positions
 * that the board reports.
 *
 * Opening the port resets most boards. The board counts as connected when it has answered. boot_ms
 * is the time that the board may take to answer after its port was opened or after a reset. A board
 * that was lost is searched for again by the next request to home or to stop.
 *
 * All functions belong to the main loop's thread. Callbacks come from the main loop, never from
 * within a function of this header. Errors are DEVICE_ERROR and name the port, not the axis.
 */
#pragma once

#include "answer.h"

#include "drivers/device.h"

enum gcode_dialect { GCODE_GRBL, GCODE_MARLIN, GCODE_KLIPPER };

/* The options of a board in the section of an axis; the first member of the driver's struct. */
struct gcode_link {
    char *port;
    int baud, dialect;
    double answer_ms, boot_ms;
};

extern const char *const gcode_dialects[];

#define GCODE_LINK(name) G_STRUCT_OFFSET(struct gcode_link, name)
/* clang-format off */
#define GCODE_LINK_OPTIONS                                                                         \
    {"port", OPTION_STRING, .offset = GCODE_LINK(port),                                            \
     .help = "Serial port of the board, such as a link in /dev/serial/by-id"},                     \
    {"baud", OPTION_INT, NULL, 300, 4000000, "115200", NULL, GCODE_LINK(baud),                     \
     "Speed of the port"},                                                                         \
    {"dialect", OPTION_CHOICE, NULL, 0, 0, "grbl", gcode_dialects, GCODE_LINK(dialect),            \
     "Language of the board; grbl also stands for FluidNC and grblHAL"},                           \
    {"answer_ms", OPTION_DOUBLE, "ms", 50, 2000, "1000", NULL, GCODE_LINK(answer_ms),              \
     "How long an answer may take"},                                                               \
    {"boot_ms", OPTION_DOUBLE, "ms", 100, 60000, "5000", NULL, GCODE_LINK(boot_ms),                \
     "How long the board may take to answer after its port was opened"}
/* clang-format on */

/* For a driver's check(): adds a mistake if a section further up in the file names the same port
 * with other settings. */
void gcode_link_check(const struct gcode_link *link, const struct config_section *section,
                      Mistakes *mistakes);

/* An axis on a board. */
typedef struct GcodeClient GcodeClient;

struct gcode_listener {
    /* The board has reported the position of the axis, in units of the board. The board read it at
     * a moment between the times asked_us and answered_us. */
    void (*at)(gpointer data, double units, gint64 asked_us, gint64 answered_us);
    /* A request has ended. error is NULL if it succeeded. The client may leave the board. */
    void (*ended)(gpointer data, const GError *error);
    /* A request has not begun yet, because another axis of the board moves. */
    void (*waits)(gpointer data);
    /* The position of a watched axis without a request has become unknown. The client may leave the
     * board. */
    void (*lost)(gpointer data, const GError *error);
};

/* Settings of an axis that the board has reported. Each is 0 if it is not known. */
struct gcode_limits {
    double steps;    /* motor steps in a unit */
    double units_s;  /* top speed */
    double units_s2; /* acceleration */
    int homing;      /* 1: homing is switched on in the board, −1: it is off */
    int inches;      /* 1: the board reports inches, −1: it reports millimetres */
};

/* For a device's open(): connects to the board, or joins the board if another axis has opened it.
 * `letter` is an index into GCODE_LETTERS. poll_ms is the time between two reports while an axis
 * moves.
 *
 * Waits until the board has answered, at most 2 boot_ms + 8 answer_ms + 4 s. Stops a motion that
 * another program has left behind. Returns NULL with an error on failure. */
GcodeClient *gcode_client_new(const struct gcode_link *link, int letter, double poll_ms,
                              const struct device *device, const struct gcode_listener *listener,
                              gpointer data, GError **error);
void gcode_client_free(GcodeClient *client); /* NULL is ignored */

void gcode_client_limits(const GcodeClient *client, struct gcode_limits *ret);
/* Returns whether the board lacks the axis of the client. */
gboolean gcode_client_is_missing(const GcodeClient *client);
/* Returns whether the request of another axis homes all axes of the board now. */
gboolean gcode_client_is_dragged(const GcodeClient *client);
const char *gcode_client_firmware(const GcodeClient *client);

/* Starts a motion to a position. The request ends when the board has reported that the axis stands.
 * The caller then compares the last position that at() was given with the target. */
gboolean gcode_client_move(GcodeClient *client, double units, double units_s, GError **error);

enum gcode_homing {
    GCODE_HOME_ALL,  /* all axes of the board together */
    GCODE_HOME_AXIS, /* this axis */
    GCODE_HOME_HERE, /* nothing moves; the board is only prepared for motions */
};

/* Starts homing. GCODE_HOME_ALL also moves watched axes that have not requested it. These axes are
 * moved back before the request ends. */
gboolean gcode_client_home(GcodeClient *client, enum gcode_homing homing, GError **error);

/* Stops the axis and forgets its request. brake_s is the longest time that the axis takes to brake.
 * The stop ends with an error if the axis is watched and its position is lost. */
gboolean gcode_client_stop(GcodeClient *client, double brake_s, GError **error);

/* Stops the axis and waits until it stands, at most 4 answer_ms + boot_ms + 1.5 brake_s. Only for
 * close() of a device. */
void gcode_client_stop_now(GcodeClient *client, double brake_s);

/* Sets whether the axis is watched. The position of a watched axis is known, and lost() is called
 * if it becomes unknown. */
void gcode_client_watch(GcodeClient *client, gboolean watched);

/* Calls lost() soon, if the axis is watched. Takes ownership of error. */
void gcode_client_report_lost(GcodeClient *client, GError *error);
