#include "devices.h"
#include "part.h"
#include "unheard.h"
#include "world/world.h"

struct sim_laser {
    char *world_path, *part_name;
    double warm_up_ms, latency_ms;
    gboolean fault_stays_on;
    int fault_deaf;
    struct sim_unheard unheard;

    World *world;
    int laser;
    gboolean on;
    int n_deaf;
    GQueue pending;     /* of struct pending, in order */
    gint64 answered_us; /* time of the latest answer; answers come in the order of the commands */
};

struct pending {
    Laser *laser;
    gboolean on;
    gboolean reached; /* the device has received the command, and will answer */
    gboolean answers;
    guint timer;
};

#define FIELD(name) G_STRUCT_OFFSET(struct sim_laser, name)

static const struct option options[] = {
    {"world", OPTION_PATH, NULL, 0, 0, "", NULL, FIELD(world_path),
     "World file whose laser this is; default: it lights nothing"},
    {"part", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(part_name),
     "The laser's name in the world file; default: the section's own name"},
    {"warm_up_ms", OPTION_DOUBLE, "ms", 0, 600000, "0", NULL, FIELD(warm_up_ms),
     "Time from switching on until the laser's power is stable"},
    {"latency_ms", OPTION_DOUBLE, "ms", 0, 60000, "5", NULL, FIELD(latency_ms),
     "Time that the laser takes to switch and to answer"},
    {"fault_stays_on", OPTION_BOOL, NULL, 0, 0, "no", NULL, FIELD(fault_stays_on),
     "Fault: after it was switched on, the laser stays on, although it answers that it is off"},
    {"fault_deaf", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL, FIELD(fault_deaf),
     "Fault: number of commands to switch off that the laser neither obeys nor answers"},
    SIM_UNHEARD_OPTIONS(FIELD(unheard)),
    {NULL},
};

static void sim_laser_shine(struct sim_laser *sim, gboolean on) {
    if (sim->world)
        world_set_laser(sim->world, sim->laser, on);
}

static void sim_laser_switch(struct sim_laser *sim, gboolean on) {
    sim->on = on;
    if (on || !sim->fault_stays_on)
        sim_laser_shine(sim, on);
}

static void sim_laser_on_timer(gpointer data) {
    struct pending *pending = data, done = *pending;
    struct device *device = &done.laser->device;
    struct sim_laser *sim = device->priv;
    gint64 now = clock_now_us(device->clock);
    if (!done.reached) {
        if (sim_unheard_obeys(&sim->unheard, device->clock, &done.answers))
            sim_laser_switch(sim, done.on);
        sim->answered_us = MAX(sim->answered_us, now + (done.answers ? 0 : SIM_UNHEARD_US));
    }
    if (!done.reached && sim->answered_us > now) {
        pending->reached = TRUE;
        pending->answers = done.answers;
        pending->timer =
            clock_call_at(device->clock, sim->answered_us, sim_laser_on_timer, pending);
        return;
    }
    g_queue_remove(&sim->pending, pending);
    g_free(pending);
    laser_report(done.laser, done.on, done.answers ? NULL : sim_unheard_error(device));
}

static gboolean sim_laser_set(Laser *laser, gboolean on, GError **error) {
    struct sim_laser *sim = laser->device.priv;
    if (sim->on && !on && sim->n_deaf < sim->fault_deaf) {
        sim->n_deaf++;
        return TRUE;
    }
    struct pending *pending = g_new0(struct pending, 1);
    pending->laser = laser;
    pending->on = on;
    pending->timer = clock_call_in(laser->device.clock, (gint64)(sim->latency_ms * 1000),
                                   sim_laser_on_timer, pending);
    g_queue_push_tail(&sim->pending, pending);
    return TRUE;
}

static int sim_laser_find_place(const Laser *laser, const char *name, GError **error) {
    const struct sim_laser *sim = laser->device.priv;
    int found = world_find_laser(sim->world, name);
    if (found < 0)
        g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN,
                    "laser %s: part: the world file %s has no laser \"%s\": give the name of one "
                    "of its lasers",
                    laser->device.name, sim->world_path, name);
    return found;
}

/* Moves the laser to the place of another laser in the world file, which has the name `place`. If
 * `place` is the name of this device, the laser returns to its own place. Returns FALSE with an
 * error if there is no such laser. Does nothing if the world is not open. */
static gboolean mount(Laser *laser, const char *place, GError **error) {
    struct sim_laser *sim = laser->device.priv;
    if (!sim->world)
        return TRUE;
    int found = g_str_equal(place, laser->device.name) ? sim->laser
                                                       : sim_laser_find_place(laser, place, error);
    if (found >= 0)
        world_mount_laser(sim->world, sim->laser, found);
    return found >= 0;
}

static void sim_laser_check(gconstpointer given, const struct config_section *section,
                            Mistakes *mistakes) {
    const struct sim_laser *sim = given;
    sim_part_check(section, sim->world_path, "part", sim->part_name, "laser", NULL, mistakes);
}

static gboolean sim_laser_open_laser(Laser *laser, GError **error) {
    struct sim_laser *sim = laser->device.priv;
    const char *name = *sim->part_name ? sim->part_name : laser->device.name;
    laser->warm_up_s = sim->warm_up_ms / 1000;
    if (!*sim->world_path)
        return TRUE;
    sim->world = world_get(sim->world_path, error);
    if (!sim->world)
        return FALSE;
    sim->laser = sim_laser_find_place(laser, name, error);
    if (sim->laser < 0) {
        g_clear_pointer(&sim->world, world_unref);
        return FALSE;
    }
    sim_laser_shine(sim, FALSE);
    world_mount_laser(sim->world, sim->laser, sim->laser);
    return TRUE;
}

static void sim_laser_close_laser(Laser *laser) {
    struct sim_laser *sim = laser->device.priv;
    struct pending *pending;
    while ((pending = g_queue_pop_head(&sim->pending))) {
        clock_cancel(laser->device.clock, &pending->timer);
        g_free(pending);
    }
    sim_laser_shine(sim, FALSE);
    g_clear_pointer(&sim->world, world_unref);
}

gint64 sim_laser_dead_until_us(const Laser *laser) {
    return ((const struct sim_laser *)laser->device.priv)->unheard.dead_until_us;
}

const struct laser_driver sim_laser_driver = {
    .info = {"laser", "sim-laser", "A line laser of the simulated world", options,
             sizeof(struct sim_laser), sim_laser_check},
    .simulated = TRUE,
    .open = sim_laser_open_laser,
    .close = sim_laser_close_laser,
    .set = sim_laser_set,
    .mount = mount,
};
