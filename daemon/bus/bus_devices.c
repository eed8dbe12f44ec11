#include "bus_devices.h"

struct listing {
    GVariantBuilder builder;
    GHashTable *faults, *unsafe;
};

static void add(struct listing *list, const struct device *device, const char *health) {
    const char *unsafe = g_hash_table_lookup(list->unsafe, device->who);
    const char *fault = g_hash_table_lookup(list->faults, device->name);
    g_autofree char *health_text = unsafe  ? g_strconcat("unsafe: ", unsafe, NULL)
                                   : fault ? g_strconcat("fault: ", fault, NULL)
                                           : g_strdup(health);
    g_variant_builder_add(&list->builder, "(ssss)", device->info->class_name, device->name,
                          device->info->name, health_text);
}

static void add_axis(struct listing *list, const Axis *axis) {
    if (axis)
        add(list, &axis->device,
            !axis_is_homed(axis)   ? "not homed"
            : axis_is_moving(axis) ? "moving"
                                   : "ok");
}

GVariant *bus_devices(struct devices *devices, GHashTable *faults, GHashTable *unsafe) {
    struct listing list = {.faults = faults, .unsafe = unsafe};
    g_variant_builder_init(&list.builder, G_VARIANT_TYPE("a(ssss)"));
    if (!devices)
        return g_variant_builder_end(&list.builder);
    for (int i = 0; i < DEVICES_POSITIONERS; i++)
        add_axis(&list, devices_positioner(devices, i));
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            add_axis(&list, devices->sweeps[i]);
    for (int i = 0; i < devices->n_banks; i++) {
        int on = 0;
        for (int k = 0; k < devices->banks[i]->n; k++)
            on += lamps_is_on(devices->banks[i], k);
        g_autofree char *health = on ? g_strdup_printf("%d on", on) : g_strdup("off");
        add(&list, &devices->banks[i]->device, health);
    }
    for (int i = 0; i < devices->geometry.n_cameras; i++)
        if (devices_is_unit(&devices->geometry, i))
            add(&list, &devices->cameras[i]->device, "ok");
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (rig_laser_unit(&devices->timing, i) == i)
            add(&list, &devices->lasers[i]->device, laser_is_on(devices->lasers[i]) ? "on" : "off");
    for (int i = 0; i < devices->n_interlocks; i++)
        add(&list, &devices->interlocks[i]->device,
            interlock_is_closed(devices->interlocks[i]) ? "closed" : "open");
    return g_variant_builder_end(&list.builder);
}

GVariant *bus_pose(const struct devices *devices, const struct session_shot *shot) {
    const char *kind = "", *name = "";
    if (shot && shot->kind == SHOT_LAMP) {
        kind = "lamp";
        name = devices->geometry.lamps[shot->device].name;
    } else if (shot && shot->kind == SHOT_SWEEP) {
        kind = "laser";
        name = devices->geometry.lasers[shot->device].name;
    } else if (shot) {
        kind = "dark";
    }
    return g_variant_new("(ddss)", shot ? shot->turntable_deg : 0.0, shot ? shot->arc_deg : 0.0,
                         kind, name);
}

static void add_place(GVariantBuilder *to, const char *class_name, const char *name,
                      struct vec3 position_mm, gboolean carried) {
    double theta_rad, phi_rad;
    rig_angles(position_mm, &theta_rad, &phi_rad);
    g_variant_builder_add(to, "(ssddb)", class_name, name, theta_rad * 180 / G_PI,
                          phi_rad * 180 / G_PI, carried);
}

GVariant *bus_places(const struct devices *devices) {
    GVariantBuilder to;
    g_variant_builder_init(&to, G_VARIANT_TYPE("a(ssddb)"));
    if (!devices)
        return g_variant_builder_end(&to);
    const struct rig *rig = &devices->geometry;
    for (int i = 0; i < rig->n_cameras; i++)
        add_place(&to, "camera", rig->cameras[i].name, rig_camera_centre_mm(&rig->cameras[i]),
                  FALSE);
    for (int i = 0; i < rig->n_lamps; i++)
        add_place(&to, "lamp", rig->lamps[i].name,
                  rig_lamp_position_mm(&rig->arc, &rig->lamps[i], 0), !rig->lamps[i].fixed);
    for (int i = 0; i < rig->n_lasers; i++)
        add_place(&to, "laser", rig->lasers[i].name,
                  rig_laser_position_mm(&rig->arc, &rig->lasers[i], 0), !rig->lasers[i].fixed);
    return g_variant_builder_end(&to);
}
