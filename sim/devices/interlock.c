#include "devices.h"

struct sim_interlock {
    double open_after_s, open_for_s;
    guint timer;
};

#define FIELD(name) G_STRUCT_OFFSET(struct sim_interlock, name)

static const struct option options[] = {
    {"open_after_s", OPTION_DOUBLE, "s", 0, 1e9, "0", NULL, FIELD(open_after_s),
     "Fault: time from opening the device until the door opens; 0: never"},
    {"open_for_s", OPTION_DOUBLE, "s", 0, 1e9, "0", NULL, FIELD(open_for_s),
     "Fault: time for which the door stays open; 0: it is not closed again"},
    {NULL},
};

static void on_shut(gpointer data) {
    Interlock *interlock = data;
    struct sim_interlock *sim = interlock->device.priv;
    sim->timer = 0;
    interlock_report(interlock, TRUE);
}

static void on_opened(gpointer data) {
    Interlock *interlock = data;
    struct sim_interlock *sim = interlock->device.priv;
    sim->timer = 0;
    if (sim->open_for_s > 0)
        sim->timer = clock_call_in(interlock->device.clock, (gint64)(sim->open_for_s * 1e6),
                                   on_shut, interlock);
    interlock_report(interlock, FALSE);
}

static gboolean open_interlock(Interlock *interlock, GError **error) {
    struct sim_interlock *sim = interlock->device.priv;
    if (sim->open_after_s > 0)
        sim->timer = clock_call_in(interlock->device.clock, (gint64)(sim->open_after_s * 1e6),
                                   on_opened, interlock);
    interlock_report(interlock, TRUE);
    return TRUE;
}

static void close_interlock(Interlock *interlock) {
    struct sim_interlock *sim = interlock->device.priv;
    clock_cancel(interlock->device.clock, &sim->timer);
}

const struct interlock_driver sim_interlock_driver = {
    .info = {"interlock", "sim-interlock",
             "A door switch that is closed, unless open_after_s opens it", options,
             sizeof(struct sim_interlock)},
    .open = open_interlock,
    .close = close_interlock,
};
