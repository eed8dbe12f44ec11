/*
 * Devices by hand, one at a time: pictures, lamps, lasers, axes, while nothing is captured.
 *
 * What a client has switched on goes off, and what it has set moving stops, when the client goes,
 * when an interlock opens, and before a capture, SafeState or the end of the rig. Lasers and axes
 * are refused while an interlock is open. Main loop's thread.
 */
#pragma once

#include "bus_private.h"

/* As the methods of these names: answered when the device has done it (a lamp or laser when its
 * light is stable), or at once with an error. */
void bus_hands_snap(Bus *bus, GDBusMethodInvocation *invocation, const char *camera,
                    gint64 exposure_us, double gain_db);
void bus_hands_set_lamp(Bus *bus, GDBusMethodInvocation *invocation, const char *lamp, gboolean on);
void bus_hands_set_laser(Bus *bus, GDBusMethodInvocation *invocation, const char *laser,
                         gboolean on);
void bus_hands_move(Bus *bus, GDBusMethodInvocation *invocation, const char *axis, double deg);
void bus_hands_home(Bus *bus, GDBusMethodInvocation *invocation, const char *axis);

/* Moves an axis to where it rests (park_deg), after homing it if need be, or homes it, unless
 * somebody has it in hand or an interlock is open. done: once, with an error if it does not stand
 * there, also if another call ends it. */
typedef void (*BusParked)(Bus *bus, const GError *error);
gboolean bus_hands_park(Bus *bus, Axis *axis, BusParked done, GError **error);

/* Listens to the interlocks of a rig that was opened, or is to be closed. */
void bus_hands_watch(Bus *bus, gboolean watch);

/* Ends all: calls are answered with BUS_ERROR_CANCELLED and why, lights are commanded off, axes are
 * stopped. A light that does not confirm it is reported. */
void bus_hands_stop(Bus *bus, const char *why);

/* The same at once, for whoever listens to the devices from now on. */
void bus_hands_end(Bus *bus, const char *why);

/* The same for everything that this client has begun: its connection has closed. */
void bus_hands_end_client(Bus *bus, GDBusConnection *connection);
