/* The safe state as a latch: SafeState comes before calls that arrived earlier, holds until
 * Release, and is answered while devices or the main loop are busy. */
#include "bus/bus_errors.h"
#include "bus/bus_private.h"

#include <string.h>

#include "lib/bus_peer.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};

static GVariant *on(const char *name) {
    return g_variant_new("(sbd)", name, TRUE, 60.0);
}

static GVariant *off(const char *name) {
    return g_variant_new("(sbd)", name, FALSE, 0.0);
}

static gboolean no_hands(const Bus *bus) {
    return bus->hands.list->len == 0;
}

static gboolean is_dark(const Bus *bus) {
    const struct devices *devices = bus->rig.devices;
    for (int i = 0; i < devices->geometry.n_lamps; i++)
        if (lamps_light(devices->lamps[i].bank, devices->lamps[i].index) != LIGHT_OFF)
            return FALSE;
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (laser_light(devices->lasers[i]) != LIGHT_OFF)
            return FALSE;
    return TRUE;
}

static gboolean is_set(const Bus *bus) {
    return bus_latch_is_set(bus->latch);
}

/* Lets GDBus's threads pass on all that was sent, while the main loop stands still. */
static void wait_for_arrival(struct bus_peer *peer) {
    for (int i = 0; !is_set(peer->bus); i++) {
        g_assert_cmpint(i, <, 60000);
        g_usleep(1000);
    }
}

/* A call that waits for the main loop when SafeState arrives never begins. */
static void test_overtakes(gconstpointer same_client) {
    struct bus_peer *peer = bus_peer_open(real_clock);
    g_autoptr(GDBusConnection) other = bus_peer_join(peer);
    GDBusConnection *asker = same_client ? peer->client : other;
    GAsyncResult *known = NULL; /* the daemon serves the connection once it has answered */
    bus_peer_begin(asker, "Release", NULL, &known);
    g_variant_unref(bus_peer_end(asker, &known, NULL, NULL));
    for (int i = 0; i < 30; i++) {
        GAsyncResult *lights = NULL, *lit = NULL, *safe = NULL;
        bus_peer_begin(peer->client, "SetLaser", on("laser30"), &lights);
        bus_peer_begin(peer->client, "SetLamp", on("lamp30"), &lit);
        g_dbus_connection_flush_sync(peer->client, NULL, NULL);
        bus_peer_begin(asker, "SafeState", NULL, &safe);
        wait_for_arrival(peer);
        g_variant_unref(bus_peer_end(asker, &safe, NULL, NULL));
        bus_peer_fails(peer->client, &lights, "Latched", "mesorig release");
        bus_peer_fails(peer->client, &lit, "Latched", "mesorig release");
        g_assert_true(is_dark(peer->bus));
        g_assert_true(no_hands(peer->bus));
        bus_peer_tell(peer, "Release", NULL);
    }
    bus_peer_free(peer);
}

TEST(holds) {
    struct bus_peer *peer = bus_peer_open(real_clock);
    GVariant *start[2];
    for (int i = 0; i < 2; i++)
        start[i] = g_variant_new("(ssa{sv})", peer->conf, peer->session, NULL);
    bus_peer_tell(peer, "SetLamp", on("lamp30"));
    bus_peer_tell(peer, "HomeAxis", g_variant_new("(s)", "arc"));
    bus_peer_tell(peer, "SafeState", NULL);
    bus_peer_wait(peer, is_dark);
    g_assert_true(bus_rig1_get_latched(peer->bus->object));
    bus_peer_refused(peer, "SetLamp", on("lamp30"), "Latched", "release");
    bus_peer_refused(peer, "SetLaser", on("laser30"), "Latched", "release");
    bus_peer_refused(peer, "MoveAxis", g_variant_new("(sd)", "arc", 3.0), "Latched", "release");
    bus_peer_refused(peer, "HomeAxis", g_variant_new("(s)", "arc"), "Latched", "release");
    bus_peer_refused(peer, "Start", start[0], "Latched", "release");
    bus_peer_refused(peer, "Continue", NULL, "Latched", "release");
    bus_peer_refused(peer, "QueueResume", NULL, "Latched", "release");
    bus_peer_refused(peer, "Renew", g_variant_new("(d)", 1.0), "Latched", "release");
    bus_peer_tell(peer, "SetLamp", off("lamp30"));
    bus_peer_tell(peer, "SetLaser", off("laser30"));
    bus_peer_tell(peer, "Snap", g_variant_new("(sxd)", "cam30", (gint64)4000, 0.0));
    bus_peer_tell(peer, "SafeState", NULL);

    /* No path inside of the daemon passes the latch. */
    g_autoptr(GError) error = NULL;
    g_assert_false(laser_set(peer->bus->rig.devices->lasers[0], TRUE, &error));
    g_assert_error(error, BUS_ERROR, BUS_ERROR_LATCHED);
    g_clear_error(&error);
    g_assert_false(lamps_set(peer->bus->rig.devices->banks[0], 0, TRUE, &error));
    g_assert_error(error, BUS_ERROR, BUS_ERROR_LATCHED);
    g_clear_error(&error);
    g_assert_false(axis_home(peer->bus->rig.devices->arc, &error));
    g_assert_error(error, BUS_ERROR, BUS_ERROR_LATCHED);
    g_clear_error(&error);
    g_assert_false(bus_run_begin(&peer->bus->run, peer->session, FALSE, NULL, FALSE, &error));
    g_assert_error(error, BUS_ERROR, BUS_ERROR_LATCHED);

    bus_peer_tell(peer, "Release", NULL);
    g_assert_false(bus_rig1_get_latched(peer->bus->object));
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    bus_peer_tell(peer, "SetLaser", off("laser30"));
    bus_peer_tell(peer, "Release", NULL); /* of a rig that is not held */
    bus_peer_tell(peer, "Start", start[1]);
    bus_peer_free(peer);
}

/* A Release that arrived before SafeState does not undo it. */
TEST(release_is_late) {
    struct bus_peer *peer = bus_peer_open(real_clock);
    GAsyncResult *release = NULL, *safe = NULL;
    bus_peer_begin(peer->client, "Release", NULL, &release);
    bus_peer_begin(peer->client, "SafeState", NULL, &safe);
    wait_for_arrival(peer);
    g_variant_unref(bus_peer_end(peer->client, &safe, NULL, NULL));
    bus_peer_fails(peer->client, &release, "Latched", "after this Release");
    g_assert_true(is_set(peer->bus));
    g_assert_true(bus_rig1_get_latched(peer->bus->object));
    bus_peer_tell(peer, "Release", NULL);
    g_assert_false(is_set(peer->bus));
    bus_peer_free(peer);
}

TEST(without_rig) {
    struct bus_peer *peer = bus_peer_new(real_clock);
    bus_peer_refused(peer, "SafeState", NULL, "NoRig", "OpenRig");
    g_assert_false(is_set(peer->bus));
    bus_peer_tell(peer, "OpenRig", g_variant_new("(s)", peer->rig));
    bus_peer_tell(peer, "SetLamp", on("lamp30"));
    bus_peer_free(peer);
}

/* The latch outlives the rig. */
TEST(reopened) {
    struct bus_peer *peer = bus_peer_open(real_clock);
    bus_peer_tell(peer, "SafeState", NULL);
    bus_peer_tell(peer, "CloseRig", NULL);
    bus_peer_tell(peer, "OpenRig", g_variant_new("(s)", peer->rig));
    bus_peer_refused(peer, "SetLamp", on("lamp30"), "Latched", "release");
    bus_peer_free(peer);
}

/* A laser that does not answer: SafeState is answered while the laser still has time to do so. */
TEST(slow_device) {
    static const struct change changes[] = {
        {"[rig]", "clock = real"}, {"[laser laser30]", "fault_deaf = 2"}, {0}};
    struct bus_peer *peer = bus_peer_open(changes);
    GAsyncResult *result = NULL;
    gboolean safe = TRUE, told = FALSE;
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    bus_peer_begin(peer->client, "SafeState", NULL, &result);
    g_autoptr(GVariant) answer = bus_peer_end(peer->client, &result, NULL, NULL);
    g_autoptr(GVariant) devices = NULL;
    g_variant_get(answer, "(b@a(sss))", &safe, &devices);
    for (gsize i = 0; i < g_variant_n_children(devices); i++) {
        const char *class_name, *name, *state;
        g_variant_get_child(devices, i, "(&s&s&s)", &class_name, &name, &state);
        told |= strcmp(name, "laser30") == 0 && strcmp(state, "commanded only") == 0;
    }
    g_assert_false(safe);
    g_assert_true(told);
    g_assert_cmpint(laser_safety(peer->bus->rig.devices->lasers[0]), ==, DEVICE_TOLD);
    bus_peer_free(peer);
}

struct asking {
    char *address;
    GVariant *answer;
};

static gpointer ask_in_thread(gpointer data) {
    struct asking *asking = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GDBusConnection) connection = g_dbus_connection_new_for_address_sync(
        asking->address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, &error);
    g_assert_no_error(error);
    /* The main loop answers this one, so that it has the connection before it is blocked. */
    g_autoptr(GVariant) state =
        g_dbus_connection_call_sync(connection, NULL, BUS_PATH, "org.freedesktop.DBus.Properties",
                                    "Get", g_variant_new("(ss)", BUS_NAME, "State"), NULL,
                                    G_DBUS_CALL_FLAGS_NONE, 60000, NULL, &error);
    g_assert_no_error(error);
    asking->answer =
        ok(g_dbus_connection_call_sync(connection, NULL, BUS_PATH, BUS_NAME, "SafeState", NULL,
                                       NULL, G_DBUS_CALL_FLAGS_NONE, 60000, NULL, ERR));
    return NULL;
}

/* The main loop stands still until the call is answered; then the rig is made safe all the same. */
TEST(busy_loop) {
    struct bus_peer *peer = bus_peer_open(real_clock);
    struct asking asking = {peer->address, NULL};
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    GThread *thread = g_thread_new("operator", ask_in_thread, &asking);
    while (!is_set(peer->bus))
        g_main_context_iteration(NULL, FALSE);
    const gboolean blocked = !asking.answer && laser_is_on(peer->bus->rig.devices->lasers[0]);
    g_thread_join(thread);
    gboolean safe = TRUE;
    g_autoptr(GVariant) devices = NULL;
    g_variant_get(asking.answer, "(b@a(sss))", &safe, &devices);
    if (blocked) {
        g_autofree char *text = g_variant_print(devices, FALSE);
        g_assert_false(safe);
        assert_has(text, "as soon as it can");
    }
    bus_peer_wait(peer, is_dark);
    bus_peer_wait(peer, no_hands);
    g_variant_unref(asking.answer);
    bus_peer_free(peer);
}

BEFORE_TESTS {
    /* Faults of devices and the safe state are logged as warnings. */
    g_log_set_always_fatal(G_LOG_LEVEL_CRITICAL | G_LOG_FATAL_MASK);
    g_test_add_data_func("/bus-latch/overtakes/same-client", GINT_TO_POINTER(TRUE), test_overtakes);
    g_test_add_data_func("/bus-latch/overtakes/another", NULL, test_overtakes);
}
