/* Answers to calls that did not reach the skeleton. */
#pragma once

#include <gio/gio.h>

/* Replies to a call. body is floating, owned by the caller, or NULL. Takes ownership of the error.
 * Any thread may call it. */
void bus_reply(GDBusConnection *connection, GDBusMessage *message, GVariant *body, GError *error);
