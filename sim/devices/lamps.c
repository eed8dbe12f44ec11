#include "devices.h"
#include "part.h"
#include "unheard.h"
#include "world/world_private.h"

struct sim_lamps {
    char *world_path;
    char **names, **fault_dead;
    double latency_ms;
    int fault_dead_after;
    struct sim_unheard unheard;

    World *world;
    int *lamps;         /* index in the world of each lamp of the bank */
    int *switches;      /* number of times that each lamp was switched on */
    GQueue pending;     /* of struct pending, in order */
    gint64 answered_us; /* time of the latest answer; answers come in the order of the commands */
};

struct pending {
    LampBank *bank;
    int index;
    gboolean on;
    gboolean reached; /* the device has received the command, and will answer */
    gboolean answers;
    guint timer;
};

#define FIELD(name) G_STRUCT_OFFSET(struct sim_lamps, name)

static const struct option options[] = {
    {"world", OPTION_PATH, NULL, 0, 0, NULL, NULL, FIELD(world_path),
     "World file whose lamps these are"},
    {"lamps", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(names),
     "The world's lamps in the order of the bank; default: all, in the order of the world file"},
    {"latency_ms", OPTION_DOUBLE, "ms", 0, 60000, "5", NULL, FIELD(latency_ms),
     "Time that a relay takes to switch and to answer"},
    {"fault_dead", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(fault_dead),
     "Fault: these lamps give no light, although their switches answer"},
    {"fault_dead_after", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL, FIELD(fault_dead_after),
     "Fault: number of times that a lamp of fault_dead still lights before it dies; 0: it is dead "
     "from the start"},
    SIM_UNHEARD_OPTIONS(FIELD(unheard)),
    {NULL},
};

static void switch_lamps(LampBank *bank, int index, gboolean on) {
    struct sim_lamps *sim = bank->device.priv;
    gint64 now = clock_now_us(bank->device.clock);
    for (int i = 0; i < bank->n; i++) {
        int lamp = sim->lamps[i];
        if (index >= 0 && index != i)
            continue;
        if (on &&
            g_strv_contains((const char *const *)sim->fault_dead, sim->world->lamp_names[lamp]) &&
            sim->switches[i]++ >= sim->fault_dead_after)
            world_set_lamp_dead(sim->world, lamp, TRUE);
        world_set_lamp(sim->world, lamp, on, now);
    }
}

static void sim_lamps_on_timer(gpointer data) {
    struct pending *pending = data, done = *pending;
    struct device *device = &done.bank->device;
    struct sim_lamps *sim = device->priv;
    gint64 now = clock_now_us(device->clock);
    if (!done.reached) {
        if (sim_unheard_obeys(&sim->unheard, device->clock, &done.answers))
            switch_lamps(done.bank, done.index, done.on);
        sim->answered_us = MAX(sim->answered_us, now + (done.answers ? 0 : SIM_UNHEARD_US));
    }
    if (!done.reached && sim->answered_us > now) {
        pending->reached = TRUE;
        pending->answers = done.answers;
        pending->timer =
            clock_call_at(device->clock, sim->answered_us, sim_lamps_on_timer, pending);
        return;
    }
    g_queue_remove(&sim->pending, pending);
    g_free(pending);
    lamps_report(done.bank, done.index, done.on, done.answers ? NULL : sim_unheard_error(device));
}

static gboolean sim_lamps_set(LampBank *bank, int index, gboolean on, GError **error) {
    struct sim_lamps *sim = bank->device.priv;
    struct pending *pending = g_new0(struct pending, 1);
    pending->bank = bank;
    pending->index = index;
    pending->on = on;
    pending->timer = clock_call_in(bank->device.clock, (gint64)(sim->latency_ms * 1000),
                                   sim_lamps_on_timer, pending);
    g_queue_push_tail(&sim->pending, pending);
    return TRUE;
}

static gboolean find_lamps(LampBank *bank, GError **error) {
    struct sim_lamps *sim = bank->device.priv;
    gboolean all = !*sim->names;
    bank->n = all ? sim->world->n_lamps : (int)g_strv_length(sim->names);
    sim->lamps = g_new0(int, MAX(bank->n, 1));
    sim->switches = g_new0(int, MAX(bank->n, 1));
    for (int i = 0; i < bank->n; i++) {
        sim->lamps[i] = all ? i : world_find_lamp(sim->world, sim->names[i]);
        if (sim->lamps[i] < 0) {
            g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN,
                        "lamps %s: lamps: the world file %s has no lamp \"%s\": give the names of "
                        "lamps in it",
                        bank->device.name, sim->world_path, sim->names[i]);
            return FALSE;
        }
    }
    for (char **name = sim->fault_dead; *name; name++) {
        if (world_find_lamp(sim->world, *name) < 0) {
            g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN,
                        "lamps %s: fault_dead: the world file %s has no lamp \"%s\": give the "
                        "names of lamps in it",
                        bank->device.name, sim->world_path, *name);
            return FALSE;
        }
    }
    return TRUE;
}

static void sim_lamps_clear(struct sim_lamps *sim) {
    g_clear_pointer(&sim->lamps, g_free);
    g_clear_pointer(&sim->switches, g_free);
    g_clear_pointer(&sim->world, world_unref);
}

static void sim_lamps_check(gconstpointer given, const struct config_section *section,
                            Mistakes *mistakes) {
    const struct sim_lamps *sim = given;
    for (char **name = sim->names; *name; name++)
        sim_part_check(section, sim->world_path, "lamps", *name, "lamp", NULL, mistakes);
    for (char **name = sim->fault_dead; *name; name++)
        sim_part_check(section, sim->world_path, "fault_dead", *name, "lamp", NULL, mistakes);
}

static gboolean sim_lamps_open_lamps(LampBank *bank, GError **error) {
    struct sim_lamps *sim = bank->device.priv;
    sim->world = world_get(sim->world_path, error);
    if (!sim->world)
        return FALSE;
    if (!find_lamps(bank, error)) {
        sim_lamps_clear(sim);
        return FALSE;
    }
    bank->warm_up_s = world_lamp_warm_up_s(sim->world);
    /* The world remembers when each lamp was last on. If the world has existed longer than this
     * device, this time may belong to another clock. The lamps are therefore switched on and off
     * once. */
    gint64 now = clock_now_us(bank->device.clock);
    for (int i = 0; i < bank->n; i++) {
        world_set_lamp_dead(sim->world, sim->lamps[i], FALSE);
        world_set_lamp(sim->world, sim->lamps[i], FALSE, now);
        world_set_lamp(sim->world, sim->lamps[i], TRUE, now);
        world_set_lamp(sim->world, sim->lamps[i], FALSE, now);
    }
    return TRUE;
}

static void sim_lamps_close_lamps(LampBank *bank) {
    struct sim_lamps *sim = bank->device.priv;
    struct pending *pending;
    while ((pending = g_queue_pop_head(&sim->pending))) {
        clock_cancel(bank->device.clock, &pending->timer);
        g_free(pending);
    }
    switch_lamps(bank, -1, FALSE);
    sim_lamps_clear(sim);
}

gint64 sim_lamps_dead_until_us(const LampBank *bank) {
    return ((const struct sim_lamps *)bank->device.priv)->unheard.dead_until_us;
}

const struct lamps_driver sim_lamps_driver = {
    .info = {"lamps", "sim-lamps", "Lamps of the simulated world", options,
             sizeof(struct sim_lamps), sim_lamps_check},
    .open = sim_lamps_open_lamps,
    .close = sim_lamps_close_lamps,
    .set = sim_lamps_set,
};
