/*
 * Devices that clients use by hand while nothing is captured, each by one call at a time: cameras,
 * lamps, lasers and axes.
 *
 * A client switches a lamp or laser on for a limited time, its lease. The daemon measures the lease
 * in real time, and the client can renew it. A light that a client has switched on goes off when
 * its lease is over. Every light of a client goes off, and every axis that the client has set in
 * motion stops, when the client disconnects, when an interlock opens, before a capture begins, at
 * SafeState, and before the rig is closed. While an interlock is open, no laser is switched on and
 * no axis is moved. Owned by the Bus. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_jobs.h"

struct bus_hands {
    struct bus_rig *rig;         /* borrowed; this module sets rig->n_hands */
    const struct bus_jobs *jobs; /* borrowed */
    GPtrArray *list;             /* of struct hand: devices that clients use by hand */
    /* for each interlock: number of the listener (interlock_listen()) */
    guint interlocks[DEVICES_MAX_INTERLOCKS];
};

void bus_hands_init(struct bus_hands *hands, struct bus_rig *rig, const struct bus_jobs *jobs);
void bus_hands_clear(struct bus_hands *hands);

/* Each function carries out the method of the same name. It answers the call when the device has
 * done what was requested. For a lamp or laser this is when the light is stable, or when it has
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

/* Restarts the leases of all lamps and lasers that the caller has switched on, for for_s seconds.
 * *ret_n is the number of these lights. The error is BUS_ERROR_NO_RIG if no rig is open,
 * BUS_ERROR_BUSY if the rig is being closed, and BUS_ERROR_LIMIT if for_s is out of range. */
gboolean bus_hands_renew(struct bus_hands *hands, GDBusMethodInvocation *invocation, double for_s,
                         guint *ret_n, GError **error);

/* Moves an axis to park_deg, after homing it if necessary. An axis without park_deg is only
 * homed. Returns FALSE with an error if the axis is in use by hand, an interlock is open, or the
 * axis refuses the command. Otherwise done is called once, with an error if the axis did not
 * arrive or if another call has ended the move. */
typedef void (*BusParked)(gpointer data, const GError *error);
gboolean bus_hands_park(struct bus_hands *hands, Axis *axis, BusParked done, gpointer data,
                        GError **error);

/* If watch is TRUE, starts listening to the interlocks of the rig, otherwise stops. Call it with
 * TRUE after the rig was opened, and with FALSE before the rig is closed. */
void bus_hands_watch(struct bus_hands *hands, gboolean watch);

/* Ends all use of devices by hand: answers the calls with BUS_ERROR_CANCELLED and the text `why`,
 * commands lights off and stops axes. A light remains in use until it has confirmed that it is off,
 * and an axis until it stands still. The use ends at once for a camera, and for a device that
 * refuses the command. */
void bus_hands_stop(struct bus_hands *hands, const char *why);

/* Does the same as bus_hands_stop(), but no device remains in use. From now on the caller may
 * listen to the devices. */
void bus_hands_end(struct bus_hands *hands, const char *why);

/* Ends, as bus_hands_stop() does, the use of all devices by one client. Call it when the connection
 * of the client has closed. */
void bus_hands_end_client(struct bus_hands *hands, GDBusConnection *connection);
