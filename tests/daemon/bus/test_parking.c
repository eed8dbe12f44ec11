/* The state of the rig after the last session of the queue, read from its devices. */
#include "bus/bus.h"
#include "bus/bus_private.h"
#include "bus/queue.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <string.h>

#include "lib/remove_tree.h"
#include "lib/small_rig.h"

#define WAIT_US (120 * G_USEC_PER_SEC)

static void set_text(char **field, const char *text) {
    g_free(*field);
    *field = g_strdup(text);
}

static void add_session(Bus *bus, const char *folder) {
    g_autofree char *path = g_build_filename(folder, "session.conf", NULL);
    g_autofree char *directory = g_build_filename(folder, "small.session", NULL), *text = NULL;
    struct queue_item *item = queue_item_new();
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    set_text(&item->name, "small");
    set_text(&item->session_path, path);
    set_text(&item->session_text, text);
    set_text(&item->directory, directory);
    set_text(&item->rig, bus->rig.path);
    ok(bus_unattended_add(bus->unattended, item, ERR));
}

/* Runs one session in a rig with these changes, and fills where the axes stand. */
static void run_one(const struct change *changes, double *ret_turntable_deg, double *ret_arc_deg) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *rig = g_build_filename(folder, "rig.conf", NULL);
    g_autofree char *queue = g_build_filename(folder, "queue", NULL);
    g_autofree char *address = g_strdup_printf("unix:path=%s/bus", folder);
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    enum device_safety safety;
    small_rig_write(folder, "rig.conf", changes);
    small_rig_write(folder, "world.conf", NULL);
    small_rig_write(folder, "session.conf", NULL);
    Bus *bus = bus_new(address);
    BusServer *server = ok(bus_serve(bus, address, ERR));
    bus_keep_queue(bus, queue);
    ok(bus_open_rig(bus, rig, ERR));
    add_session(bus, folder);
    while (!strstr(bus_rig1_get_queue_reason(bus->object), "parked")) {
        g_assert_cmpint(g_get_monotonic_time(), <, until);
        g_main_context_iteration(NULL, TRUE);
    }
    g_assert_cmpstr(bus_rig1_get_queue_state(bus->object), ==, "empty");
    g_assert_cmpstr(bus_rig1_get_state(bus->object), ==, "done");
    *ret_turntable_deg = axis_position_deg(bus->rig.devices->turntable);
    *ret_arc_deg = axis_position_deg(bus->rig.devices->arc);
    g_variant_unref(g_variant_ref_sink(devices_safety(bus->rig.devices, &safety)));
    g_assert_cmpint(safety, ==, DEVICE_SAFE);
    for (int i = 0; i < bus->rig.devices->geometry.n_lasers; i++)
        g_assert_false(laser_is_on(bus->rig.devices->lasers[i]));
    for (int i = 0; i < bus->rig.devices->banks[0]->n; i++)
        g_assert_false(lamps_is_on(bus->rig.devices->banks[0], i));
    bus_unserve(bus, server);
    bus_free(bus);
    while (g_main_context_iteration(NULL, FALSE))
        ;
}

TEST(park) {
    static const struct change changes[] = {
        {"[axis arc]", "park_deg = 123"}, {"[axis turntable]", "park_deg = -30"}, {NULL, NULL}};
    double turntable_deg, arc_deg;
    run_one(changes, &turntable_deg, &arc_deg);
    g_assert_cmpfloat_with_epsilon(remainder(arc_deg - 123, 360), 0, 0.01);
    g_assert_cmpfloat_with_epsilon(remainder(turntable_deg + 30, 360), 0, 0.01);
}

TEST(home) {
    double turntable_deg, arc_deg;
    run_one(NULL, &turntable_deg, &arc_deg);
    g_assert_cmpfloat_with_epsilon(remainder(arc_deg, 360), 0, 0.01);
    g_assert_cmpfloat_with_epsilon(remainder(turntable_deg, 360), 0, 0.01);
}

BEFORE_TESTS {
    g_log_set_always_fatal(G_LOG_FATAL_MASK | G_LOG_LEVEL_CRITICAL);
}
