/*
 * Devices by hand, one at a time: pictures, lamps, lasers, axes, while nothing is captured.
 *
 * A lamp or laser is on for a lease, which the daemon measures in real time and the client can
 * renew. Everything that a client has switched on goes off, and everything that it has set moving
 * stops, when the lease is over, when the client goes, when an interlock opens, and before a
 * capture, SafeState or the end of the rig. Lasers and axes are refused while an interlock is open.
 * Main loop's thread.
 */
#pragma once

#include "bus_private.h"

/* Each carries out the method of the same name. It answers the call when the device has done what
 * was asked (for a lamp or laser: when the light is stable), or at once with an error. */
void bus_hands_snap(Bus *bus, GDBusMethodInvocation *invocation, const char *camera,
                    gint64 exposure_us, double gain_db);
void bus_hands_set_lamp(Bus *bus, GDBusMethodInvocation *invocation, const char *lamp, gboolean on,
                        double for_s);
void bus_hands_set_laser(Bus *bus, GDBusMethodInvocation *invocation, const char *laser,
                         gboolean on, double for_s);
void bus_hands_move(Bus *bus, GDBusMethodInvocation *invocation, const char *axis, double deg);
void bus_hands_home(Bus *bus, GDBusMethodInvocation *invocation, const char *axis);

/* Begins the leases of all lamps and lasers again that the caller has switched on. ret_n: their
 * number. Error BUS_ERROR_LIMIT: for_s is out of range. */
gboolean bus_hands_renew(Bus *bus, GDBusMethodInvocation *invocation, double for_s, guint *ret_n,
                         GError **error);

/* Moves an axis to park_deg, after homing it if need be; an axis without park_deg is homed only.
 * Refuses an axis that a client has in hand, and all axes while an interlock is open. done is
 * called once, with an error if the axis did not get there or if another call has ended the
 * move. */
typedef void (*BusParked)(Bus *bus, const GError *error);
gboolean bus_hands_park(Bus *bus, Axis *axis, BusParked done, GError **error);

/* Listens to the interlocks of a rig that was opened, or is to be closed. */
void bus_hands_watch(Bus *bus, gboolean watch);

/* Ends the work of all hands: answers their calls with BUS_ERROR_CANCELLED and the text why,
 * commands lights off and stops axes. */
void bus_hands_stop(Bus *bus, const char *why);

/* The same as bus_hands_stop(), but does not wait for the devices: the caller listens to them from
 * now on. */
void bus_hands_end(Bus *bus, const char *why);

/* Ends, in the same way, everything that a client has begun whose connection has closed. */
void bus_hands_end_client(Bus *bus, GDBusConnection *connection);
