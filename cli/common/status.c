#include "status.h"

#include <string.h>

gboolean status_is_capturing(BusRig1 *rig) {
    static const char *const states[] = {"homing", "running", "pausing", "paused", NULL};
    const char *state = bus_rig1_get_state(rig);
    return state && g_strv_contains(states, state);
}

void status_say_progress(Record *to, BusRig1 *rig) {
    const int shots = bus_rig1_get_shots(rig), done = bus_rig1_get_shots_done(rig);
    const guint64 end = bus_rig1_get_predicted_end(rig);
    record_say(to, "session    %s\n", bus_rig1_get_session(rig));
    record_say(to, "shots      %d of %d, %.1f{:%%}\n", done, shots, (double)done / shots);
    record_say(to, "frames     %" G_GINT64_FORMAT " in this run, %" G_GINT64_FORMAT " retakes\n",
               bus_rig1_get_frames(rig), bus_rig1_get_retakes(rig));
    record_say(to, "disk       %" G_GINT64_FORMAT "{:size} of about %" G_GINT64_FORMAT "{:size}\n",
               (gint64)bus_rig1_get_bytes_stored(rig), (gint64)bus_rig1_get_bytes_expected(rig));
    record_say(to, "time       %g{:time}, %g{:time} left%s", bus_rig1_get_elapsed(rig),
               bus_rig1_get_left(rig), bus_rig1_get_simulated(rig) ? " (simulated)" : "");
    if (end) {
        g_autoptr(GDateTime) time = g_date_time_new_from_unix_local((gint64)end);
        g_autofree char *text = time ? g_date_time_format(time, "%F %H:%M") : g_strdup("?");
        record_say(to, ", ends about %s", text);
    }
    record_say(to, "\n");
}

void status_say_sentences(Record *to, const char *key, const char *text) {
    g_autoptr(GString) lines = g_string_new(text);
    g_string_replace(lines, ". ", ".\n           ", 0);
    record_say(to, "%-10s %s\n", key, lines->str);
}

/* Returns the text of a device that is unsafe or has a fault. Returns NULL for other devices. The
 * text is printed below the table, unless the text `reason` contains it. */
static const char *text_of(const char *health) {
    if (g_str_has_prefix(health, "unsafe: "))
        return health + strlen("unsafe: ");
    return g_str_has_prefix(health, "fault: ") ? health + strlen("fault: ") : NULL;
}

void status_say_devices(Record *to, GVariant *devices, const char *reason) {
    const char *class_name, *name, *driver, *health;
    g_autoptr(GString) faults = g_string_new(NULL);
    gboolean faulty = FALSE;
    GVariantIter iter;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        faulty |= g_str_has_prefix(health, "fault: ");
    record_say(to, "\n%-10s %-16s %-16s %s\n", "CLASS", "NAME", "DRIVER", "HEALTH");
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health)) {
        const char *text = text_of(health);
        record_say(to, "%-10s %-16s %-16s %s\n", class_name, name, driver,
                   g_str_has_prefix(health, "unsafe: ") ? "UNSAFE: not confirmed off or standing"
                   : text                               ? "fault"
                   : faulty && g_strcmp0(health, "ok") == 0 ? "ok before the fault"
                                                            : health);
        if (text && !strstr(reason, text) && !strstr(faults->str, text))
            g_string_append_printf(faults, "%s: %s\n", name, text);
    }
    record_say(to, "%s%s", faults->len ? "\n" : "", faults->str);
}
