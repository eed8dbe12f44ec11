/*
 * Scripted clients of the daemon's bus, in its own process: each is one end of a pair of sockets,
 * and speaks D-Bus with GLib's messages and no thread. The daemon's end is given to its bus as the
 * daemon's server (bus_serve()) gives it a connection that has authenticated itself.
 */
#pragma once

#include <glib.h>

#include "bus/bus.h"
#include "bus_schedule.h"
#include "scene.h"

/* A call, and what became of it. */
struct bus_call {
    int client; /* its number; fresh connections count on */
    guint32 serial;
    enum bus_method method;
    int device;
    gboolean on;
    double for_s;
    gint64 sent_us, answered_us; /* −1: it was not answered */
    gboolean deaf;               /* its client did not read for some of the time in between */
    gboolean ok;
    char error[64]; /* "Busy"; empty: none */
    gboolean safe;  /* what SafeState answered */
};

struct bus_clients;

struct bus_clients *bus_clients_new(struct scene *scene, Bus *bus);

/* Of struct bus_call, in the order in which they were sent. */
const GArray *bus_clients_calls(const struct bus_clients *clients);
/* Of guint, numbers of these calls, in the order in which they were answered. */
const GArray *bus_clients_answered(const struct bus_clients *clients);
/* When the client of that call went; −1: it is there. */
gint64 bus_clients_gone_us(const struct bus_clients *clients, const struct bus_call *call);

/* Does what a step says, and waits until GDBus's thread has handled it. The main loop is not run,
 * other than for fresh connections. */
void bus_clients_step(struct bus_clients *clients, const struct bus_step *step);

/* Reads what the daemon has sent to clients that read. */
void bus_clients_read(struct bus_clients *clients);

void bus_clients_close_all(struct bus_clients *clients);
