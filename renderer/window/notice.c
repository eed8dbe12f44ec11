#include "notice.h"

#include "session_bus.h"

#include <gio/gio.h>

#define ANSWER_MS 3000

void notice_show(const char *title, const char *sentence) {
    g_autoptr(GDBusConnection) bus =
        session_bus_is_there() ? g_bus_get_sync(G_BUS_TYPE_SESSION, NULL, NULL) : NULL;
    if (bus == NULL)
        return;
    GVariantBuilder actions, hints;
    g_variant_builder_init(&actions, G_VARIANT_TYPE_STRING_ARRAY);
    g_variant_builder_init(&hints, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&hints, "{sv}", "desktop-entry",
                          g_variant_new_string("org.mesorig.View"));
    /* Notify (name, replaces, icon, title, text, actions, hints, timeout). A timeout of −1 means
     * the timeout of the service. */
    g_autoptr(GVariant) reply = g_dbus_connection_call_sync(
        bus, "org.freedesktop.Notifications", "/org/freedesktop/Notifications",
        "org.freedesktop.Notifications", "Notify",
        g_variant_new("(susssasa{sv}i)", "Mesorig", 0, "org.mesorig.View", title, sentence,
                      &actions, &hints, -1),
        NULL, G_DBUS_CALL_FLAGS_NONE, ANSWER_MS, NULL, NULL);
}
