/* An input that forbids laser and motion while it is open: a door switch, an emergency stop. */
#pragma once

#include "device.h"

typedef struct Interlock Interlock;

typedef void (*InterlockFunc)(Interlock *interlock, gboolean closed, gpointer data);

struct interlock_driver {
    struct driver_info info;
    /* Connects and reports the first state. */
    gboolean (*open)(Interlock *interlock, GError **error);
    void (*close)(Interlock *interlock);
};

struct Interlock {
    struct device device;
    const struct interlock_driver *driver;
    struct interlock_state *state;
};

Interlock *interlock_open(const struct interlock_driver *driver,
                          const struct config_section *section, const char *const *also,
                          Clock *clock, GError **error);
void interlock_close(Interlock *interlock); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Interlock, interlock_close)

/* Adds a listener, which is called when the interlock opens or closes. There may be any number
 * of listeners. Returns an id for interlock_unlisten(). */
guint interlock_listen(Interlock *interlock, InterlockFunc func, gpointer data);
void interlock_unlisten(Interlock *interlock, guint id);

/* Returns whether the contact is closed. Returns FALSE before the driver has reported the first
 * state, and while the state cannot be read. */
gboolean interlock_is_closed(const Interlock *interlock);
/* Returns whether the state of the contact cannot be read. */
gboolean interlock_is_lost(const Interlock *interlock);

/* Returns a sentence for the operator, to be freed with g_free(). The sentence says that the
 * interlock is open, or that it cannot be read and counts as open. It also says what to do. */
char *interlock_advice(const Interlock *interlock);

/* For drivers: report the state of the contact, or that it cannot be read and therefore counts
 * as open. Both may be called from within open(). */
void interlock_report(Interlock *interlock, gboolean closed);
void interlock_report_lost(Interlock *interlock);
