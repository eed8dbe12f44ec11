/* Describes an event in words, for users and for programs. */
#include "hooks.h"

#include <gio/gio.h>
#include <string.h>

#include "base/json.h"

/* Beginnings of the messages about a device, as bus_safety.c writes them. */
#define UNSAFE    "THE RIG COULD NOT BE MADE SAFE"
#define CONFIRMED "confirmed "

static const struct {
    const char *what, *words;
    guint8 urgency; /* urgency of a desktop notification: 0 low, 1 normal, 2 critical */
} words_of[] = {
    {"begun", "the capture has begun", 0},
    {"done", "captured", 1},
    {"fault", "stopped by a fault", 2},
    {"aborted", "aborted", 1},
    {"hands", "somebody is needed at the rig", 2},
    {"queue-paused", "the queue is paused", 2},
    {"queue-empty", "the queue is empty", 1},
    {"unsafe", "NOT SAFE: it may shine or move", 2},
    {"confirmed", "safe again", 2},
};

const char *hooks_what_of_event(const char *level, const char *message) {
    if (strcmp(level, "error") == 0 && g_str_has_prefix(message, UNSAFE))
        return "unsafe";
    return strcmp(level, "info") == 0 && g_str_has_prefix(message, CONFIRMED) ? "confirmed" : NULL;
}

GVariant *hooks_details_of_event(const char *source, const char *message) {
    GVariantBuilder to;
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "device", g_variant_new_string(source));
    g_variant_builder_add(&to, "{sv}", "message", g_variant_new_string(message));
    return g_variant_builder_end(&to);
}

static const char *detail(GVariant *details, const char *key) {
    const char *text = "";
    g_variant_lookup(details, key, "&s", &text);
    return text;
}

char *hooks_title(const char *what, GVariant *details) {
    const char *device = detail(details, "device");
    const char *name = *device ? device : detail(details, "name");
    const char *words = what;
    for (gsize i = 0; i < G_N_ELEMENTS(words_of); i++)
        if (strcmp(words_of[i].what, what) == 0)
            words = words_of[i].words;
    return *name ? g_strdup_printf("%s: %s", name, words) : g_strdup(words);
}

char *hooks_text(const char *what, GVariant *details) {
    const char *message = detail(details, "message"), *session = detail(details, "session");
    guint32 waiting = 0;
    g_autoptr(GString) to = g_string_new(message);
    g_variant_lookup(details, "waiting", "u", &waiting);
    if (*session)
        g_string_append_printf(to, "%s%s", to->len ? "\n" : "", session);
    if (waiting)
        g_string_append_printf(to, "%s%u %s in the queue", to->len ? "\n" : "", waiting,
                               waiting == 1 ? "session waits" : "sessions wait");
    return g_strdup(to->str);
}

char *hooks_json(const char *what, GVariant *details, gint64 time_s) {
    GVariantBuilder to;
    GVariantIter iter;
    const char *key;
    GVariant *value;
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "event", g_variant_new_string(what));
    g_variant_builder_add(&to, "{sv}", "time", g_variant_new_int64(time_s));
    g_variant_iter_init(&iter, details);
    while (g_variant_iter_next(&iter, "{&sv}", &key, &value)) {
        g_variant_builder_add(&to, "{sv}", key, value);
        g_variant_unref(value);
    }
    return json_text(g_variant_builder_end(&to));
}

gboolean hooks_show(GDBusConnection *session_bus, const char *what, GVariant *details) {
    g_autofree char *title = hooks_title(what, details), *text = hooks_text(what, details);
    g_autofree char *markup = g_markup_escape_text(text, -1);
    guint8 urgency = 1;
    GVariantBuilder hints;
    for (gsize i = 0; i < G_N_ELEMENTS(words_of); i++)
        if (strcmp(words_of[i].what, what) == 0)
            urgency = words_of[i].urgency;
    g_variant_builder_init(&hints, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&hints, "{sv}", "urgency", g_variant_new_byte(urgency));
    g_variant_builder_add(&hints, "{sv}", "desktop-entry",
                          g_variant_new_string("org.mesorig.View"));
    g_dbus_connection_call(session_bus, "org.freedesktop.Notifications",
                           "/org/freedesktop/Notifications", "org.freedesktop.Notifications",
                           "Notify",
                           g_variant_new("(susssasa{sv}i)", "Mesorig", 0, "org.mesorig.View", title,
                                         markup, NULL, &hints, -1),
                           NULL, G_DBUS_CALL_FLAGS_NONE, 10000, NULL, NULL, NULL);
    return !g_dbus_connection_is_closed(session_bus);
}
