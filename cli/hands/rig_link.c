#include "rig_link.h"

#include "bus/bus_client.h"
#include "rig/devices.h"

Link *rig_link_find(const char *rig, gboolean *ret_simulated, GError **error) {
    GError *why = NULL;
    gboolean simulated = TRUE;
    struct rig geometry;
    gsize n = 0;
    g_autoptr(Config) config =
        devices_read_geometry(rig, &geometry, error) ? config_load(rig, error) : NULL;
    if (!config)
        return NULL;
    const struct config_section *sections = config_sections(config, &n);
    for (gsize i = 0; i < n; i++) {
        const char *driver = config_value(&sections[i], "driver", NULL);
        simulated &= !driver || g_str_has_prefix(driver, "sim-");
    }
    *ret_simulated = simulated;
    Link *link = link_find_rig(rig, &why);
    if (why)
        g_propagate_error(error, why);
    else if (!link)
        link = simulated ? link_start(error) : link_find_free(rig, error);
    return link;
}

gboolean rig_link_open(Link *link, const char *rig, GError **error) {
    const char *open = bus_rig1_get_rig_path(link_rig(link));
    if (g_strcmp0(open, rig) == 0)
        return TRUE;
    if (!open || !*open)
        return bus_rig1_call_open_rig_sync(link_rig(link), rig, NULL, error);
    g_set_error(
        error, G_IO_ERROR, G_IO_ERROR_BUSY,
        "the daemon of %s is not for the rig %s: it has %s open. Name the daemon of your rig by "
        "--address or %s, or start one: mesorigd --listen unix:path=/tmp/NAME --rig %s; or let the "
        "first daemon close its rig with “mesorig close %s”, and repeat this command",
        link_option(link), rig, open, BUS_CLIENT_VARIABLE, rig, link_option(link));
    return FALSE;
}
