/* Answers to calls that are not passed on to the D-Bus skeleton. */
#pragma once

#include <gio/gio.h>

/* Replies to a call with error or, if error is NULL, with body. body is floating, owned by the
 * caller, or NULL. Takes ownership of the error. Sends nothing if the caller of the method expects
 * no reply. Any thread may call this function. */
void bus_reply(GDBusConnection *connection, GDBusMessage *message, GVariant *body, GError *error);
