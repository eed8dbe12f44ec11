#include "bus_reply.h"

#include "bus_errors.h"

void bus_reply(GDBusConnection *connection, GDBusMessage *message, GVariant *body, GError *error) {
    g_autoptr(GDBusMessage) answer = NULL;
    if (error) {
        error = bus_errors_wrap(error);
        g_autofree char *name = g_dbus_error_encode_gerror(error);
        answer = g_dbus_message_new_method_error_literal(message, name, error->message);
        g_error_free(error);
    } else {
        answer = g_dbus_message_new_method_reply(message);
        if (body)
            g_dbus_message_set_body(answer, body);
    }
    if (!(g_dbus_message_get_flags(message) & G_DBUS_MESSAGE_FLAGS_NO_REPLY_EXPECTED))
        g_dbus_connection_send_message(connection, answer, G_DBUS_SEND_MESSAGE_FLAGS_NONE, NULL,
                                       NULL);
}
