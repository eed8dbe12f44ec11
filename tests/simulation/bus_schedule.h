/*
 * The events in one life of the daemon on the bus, which depend only on the seed: lines to devices
 * that lose answers and do not work for a time, and the messages of clients with their times.
 */
#pragma once

#include <glib.h>

#include "schedule.h"

#define BUS_MAX_LINES 8
#define BUS_MAX_STEPS 48
#define BUS_CLIENTS   4

enum bus_method {
    BUS_SET_LASER,
    BUS_SET_LAMP,
    BUS_MOVE_AXIS,
    BUS_HOME_AXIS,
    BUS_SNAP,
    BUS_SAFE_STATE,
    BUS_RELEASE,
    BUS_START,
    BUS_RESUME,
    BUS_PAUSE,
    BUS_CONTINUE,
    BUS_ABORT,
    BUS_CLOSE_RIG,
    BUS_OPEN_RIG,
    BUS_GET_ALL, /* of org.freedesktop.DBus.Properties */
    BUS_METHODS,
};

enum bus_action {
    STEP_CALL,  /* by a client, which connects first if need be */
    STEP_CLOSE, /* the client's connection */
    STEP_DEAF,  /* the client stops reading */
    STEP_HEARS, /* and reads again */
    STEP_FLOOD, /* n of that call */
    STEP_FLASH, /* a fresh connection, the call, and the end of the connection */
    STEP_ACTIONS,
};

/* How a fresh connection ends: before the daemon has shown the rig on it, before the call is
 * handled, or later. */
enum bus_flash { FLASH_CLOSED_FIRST, FLASH_CLOSED, FLASH_SHOWN, FLASH_LOOPS, FLASHES };

struct bus_step {
    gint64 after_us; /* since the step before; 0: nothing is handled in between */
    int turns;       /* of the main loop after it, if the next one follows at the same time */
    enum bus_action action;
    enum bus_flash flash;
    int client, n;
    enum bus_method method;
    int device; /* which of the lasers, lamps, axes or cameras */
    gboolean on;
    double for_s, deg;
    gint64 exposure_us;
};

struct bus_schedule {
    guint32 seed;
    struct device_fault lines[BUS_MAX_LINES]; /* of the rig file */
    int n_lines, n_steps;
    struct bus_step steps[BUS_MAX_STEPS];
    gint64 check_us;  /* how long a session is checked before it begins */
    double latency_s; /* the longest of a device */
    double dead_s;    /* the longest that a line is dead */
};

void bus_schedule_make(struct bus_schedule *schedule, guint32 seed);

/* A line for each of it; g_free(). */
char *bus_schedule_describe(const struct bus_schedule *schedule);

const char *bus_schedule_method(enum bus_method method);             /* "SetLaser" */
const char *bus_schedule_device(enum bus_method method, int device); /* "laser30" */
