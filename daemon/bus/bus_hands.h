/*
 * Devices that clients use by hand while nothing is captured: cameras, lamps, lasers and axes. A
 * device is used by one call at a time.
 *
 * A client switches a lamp or laser on for a limited time, its lease. The daemon measures the lease
 * in real time, and the client can renew it. The light goes off when its lease is over.
 *
 * In these cases, every light that a client has switched on goes off, and every axis that a client
 * has set in motion stops:
 * - the client disconnects (only its own devices),
 * - an interlock opens,
 * - a capture is about to begin,
 * - SafeState is called,
 * - the rig is about to be closed.
 *
 * While an interlock is open, no laser is switched on and no axis is moved. The struct is owned by
 * the Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_jobs.h"

struct bus_hands {
    struct bus_rig *rig;         /* borrowed; this module sets rig->n_hands */
    const struct bus_jobs *jobs; /* borrowed */
    GPtrArray *list;             /* devices that clients use by hand, as struct hand */
    /* For each interlock: the number that interlock_listen() has returned. */
    guint interlocks[DEVICES_MAX_INTERLOCKS];
};

void bus_hands_init(struct bus_hands *hands, struct bus_rig *rig, const struct bus_jobs *jobs);
void bus_hands_clear(struct bus_hands *hands);

/* Each function carries out the method of the same name. The call is answered when the device has
 * done what was requested. A lamp or laser has done so when its light is stable, or when it has
 * confirmed that it is off. If the request is refused, or if the device fails later, the answer is
 * an error. */
void bus_hands_snap(struct bus_hands *hands, GDBusMethodInvocation *invocation, const char *camera,
                    gint64 exposure_us, double gain_db);
void bus_hands_set_lamp(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                        const char *lamp, gboolean on, double for_s);
void bus_hands_set_laser(struct bus_hands *hands, GDBusMethodInvocation *invocation,
                         const char *laser, gboolean on, double for_s);
void bus_hands_move(struct bus_hands *hands, GDBusMethodInvocation *invocation, const char *axis,
                    double deg);
void bus_hands_home(struct bus_hands *hands, GDBusMethodInvocation *invocation, const char *axis);

/* Renews the leases of all lamps and lasers that the caller has switched on: each ends for_s
 * seconds from now. *ret_n is the number of these lights. The error is BUS_ERROR_NO_RIG if no rig
 * is open, BUS_ERROR_BUSY if the rig is being closed, and BUS_ERROR_LIMIT if for_s is out of
 * range. */
gboolean bus_hands_renew(struct bus_hands *hands, GDBusMethodInvocation *invocation, double for_s,
                         guint *ret_n, GError **error);

/* Moves an axis to park_deg, after homing it if necessary. An axis without park_deg is only homed.
 * Returns FALSE with an error if the axis is in use by hand, an interlock is open, or the axis
 * refuses the command. After TRUE, `done` is called once. It gets an error if the axis did not
 * arrive, or if another call has ended the move. */
typedef void (*BusParked)(gpointer data, const GError *error);
gboolean bus_hands_park(struct bus_hands *hands, Axis *axis, BusParked done, gpointer data,
                        GError **error);

/* If watch is TRUE, starts listening to the interlocks of the rig. If watch is FALSE, stops
 * listening. Call it with TRUE after the rig was opened, and with FALSE before the rig is
 * closed. */
void bus_hands_watch(struct bus_hands *hands, gboolean watch);

/* Ends all use of devices by hand. Waiting calls are answered with BUS_ERROR_CANCELLED and the text
 * `why`, lights are commanded off, and axes are stopped. A light remains in use until it has
 * confirmed that it is off, and an axis until it stands still. The use of a camera, and of a device
 * that refuses the command, ends at once. */
void bus_hands_stop(struct bus_hands *hands, const char *why);

/* Does the same as bus_hands_stop(), but no device remains in use, even if it has not obeyed yet.
 * From now on the caller may listen to the devices. */
void bus_hands_end(struct bus_hands *hands, const char *why);

/* Ends the use of all devices by one client, as bus_hands_stop() does for all clients. Call it when
 * the connection of the client has closed. */
void bus_hands_end_client(struct bus_hands *hands, GDBusConnection *connection);
