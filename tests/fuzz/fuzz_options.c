/* The options of calls on the bus: as a message on the wire, which GDBus takes apart first, and as
 * a value of the right type. */
#include "fuzz.h"

#include "bus/bus_options.h"

#include <gio/gio.h>

static void read_options(GVariant *options) {
    struct bus_options ret = {0};
    GError *error = NULL;
    fuzz_check(bus_options_read(options, &ret, &error), &error);
    bus_options_clear(&ret);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autoptr(GError) error = NULL;
    g_autofree guchar *blob = g_memdup2(data, size);
    g_autoptr(GDBusMessage) message =
        size > 0 ? g_dbus_message_new_from_blob(blob, size, G_DBUS_CAPABILITY_FLAGS_NONE, &error)
                 : NULL;
    GVariant *body = message ? g_dbus_message_get_body(message) : NULL;
    for (gsize i = 0; body && i < g_variant_n_children(body); i++) {
        g_autoptr(GVariant) child = g_variant_get_child_value(body, i);
        if (g_variant_is_of_type(child, G_VARIANT_TYPE_VARDICT))
            read_options(child);
    }
    g_autoptr(GBytes) bytes = g_bytes_new(data, size);
    g_autoptr(GVariant) raw =
        g_variant_ref_sink(g_variant_new_from_bytes(G_VARIANT_TYPE_VARDICT, bytes, FALSE));
    g_autoptr(GVariant) normal = g_variant_get_normal_form(raw);
    read_options(normal);
    return 0;
}
