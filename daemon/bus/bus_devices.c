#include "bus_devices.h"

struct listing {
    GVariantBuilder builder;
    GHashTable *faults;
};

static void bus_devices_add(struct listing *list, const struct device *device, const char *health) {
    const char *fault = g_hash_table_lookup(list->faults, device->name);
    g_autofree char *health_text = fault ? g_strconcat("fault: ", fault, NULL) : g_strdup(health);
    g_variant_builder_add(&list->builder, "(ssss)", device->info->class_name, device->name,
                          device->info->name, health_text);
}

static void bus_devices_add_axis(struct listing *list, const Axis *axis) {
    if (axis)
        bus_devices_add(list, &axis->device,
                        !axis_is_homed(axis)   ? "not homed"
                        : axis_is_moving(axis) ? "moving"
                                               : "ok");
}

GVariant *bus_devices(struct devices *devices, GHashTable *faults) {
    struct listing list = {.faults = faults};
    g_variant_builder_init(&list.builder, G_VARIANT_TYPE("a(ssss)"));
    if (!devices)
        return g_variant_builder_end(&list.builder);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        bus_devices_add_axis(&list, devices_positioner(devices, i));
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            bus_devices_add_axis(&list, devices->sweeps[i]);
    for (int i = 0; i < devices->n_banks; i++) {
        int on = 0;
        for (int k = 0; k < devices->banks[i]->n; k++)
            on += lamps_is_on(devices->banks[i], k);
        g_autofree char *health = on ? g_strdup_printf("%d on", on) : g_strdup("off");
        bus_devices_add(&list, &devices->banks[i]->device, health);
    }
    for (int i = 0; i < devices->geometry.n_cameras; i++)
        if (devices_is_unit(&devices->geometry, i))
            bus_devices_add(&list, &devices->cameras[i]->device, "ok");
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            bus_devices_add(&list, &devices->lasers[i]->device,
                            laser_is_on(devices->lasers[i]) ? "on" : "off");
    for (int i = 0; i < devices->n_interlocks; i++)
        bus_devices_add(&list, &devices->interlocks[i]->device,
                        interlock_is_closed(devices->interlocks[i]) ? "closed" : "open");
    return g_variant_builder_end(&list.builder);
}
