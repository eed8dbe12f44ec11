/*
 * Runs the executables of a folder at each event of a capture or of the rig, or shows events as
 * notifications on a desktop. Events are handled one after the other, and so are the executables
 * of an event. The failure of an executable is written to the log, and the next executable is run.
 * All functions belong to the main loop's thread.
 */
#pragma once

#include "hooks_conf.h"

#include <gio/gio.h>

/* Maximum number of waiting events. If there are more, the oldest one is dropped. */
#define HOOKS_MAX_WAITING 1000

typedef struct Hooks Hooks;

/* Makes hooks. conf is borrowed. */
Hooks *hooks_new(const struct hooks_conf *conf);

/* Kills the program that runs, and frees the hooks. NULL is ignored. */
void hooks_free(Hooks *hooks);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Hooks, hooks_free)

/* Handles an event. `what` and `details` are the arguments of the signal Milestone, or the results
 * of hooks_what_of_event() and hooks_details_of_event(). details is a{sv}; a floating reference is
 * taken. */
void hooks_tell(Hooks *hooks, const char *what, GVariant *details);

/* Returns whether no program runs and no event waits. */
gboolean hooks_is_idle(const Hooks *hooks);

/* Convert the daemon's signal Event. hooks_what_of_event() returns "unsafe" if a device has not
 * confirmed that it is off or stands still, "confirmed" if it has done so later, and NULL for all
 * other events. hooks_details_of_event() returns the details, floating. */
const char *hooks_what_of_event(const char *level, const char *message);
GVariant *hooks_details_of_event(const char *source, const char *message);

/* Describe an event for users. hooks_title() returns one line: "weave: captured". hooks_text()
 * returns up to three lines: the message, the session directory, and the number of waiting
 * sessions. A line that the event does not have is left out, so the text may be empty. Free the
 * results with g_free(). */
char *hooks_title(const char *what, GVariant *details);
char *hooks_text(const char *what, GVariant *details);

/* Describes an event for programs: {"event": …, "time": …, "session": …, …}. Free it with
 * g_free(). */
char *hooks_json(const char *what, GVariant *details, gint64 time_s);

/* Shows an event as a desktop notification (org.freedesktop.Notifications), through this connection
 * to the session bus. Does not wait for an answer. Returns FALSE if the connection is closed. */
gboolean hooks_show(GDBusConnection *session_bus, const char *what, GVariant *details);
