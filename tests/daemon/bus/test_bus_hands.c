/* Devices that are operated by hand via the bus: wrong names, calls that arrive at the same time,
 * clients that disconnect, a door that opens, and devices that fail. In each case a light that was
 * switched on goes off, or the operator is told that it may be on. */
#include "bus/bus_private.h"

#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "lib/bus_peer.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

/* Where calls are to meet, the clock is real: a virtual one may jump to the end of what the first
 * call has begun before the second comes in. */

static gboolean no_hands(const Bus *bus) {
    return bus->hands.list->len == 0;
}

static gboolean some_hands(const Bus *bus) {
    return bus->hands.list->len > 0;
}

static gboolean two_hands(const Bus *bus) {
    return bus->hands.list->len == 2;
}

static gboolean is_dark(const struct devices *devices) {
    for (int i = 0; i < devices->geometry.n_lamps; i++)
        if (lamps_is_on(devices->lamps[i].bank, devices->lamps[i].index))
            return FALSE;
    for (int i = 0; i < devices->geometry.n_lasers; i++)
        if (laser_is_on(devices->lasers[i]))
            return FALSE;
    return TRUE;
}

static GVariant *on(const char *name) {
    return g_variant_new("(sbd)", name, TRUE, 60.0);
}

static GVariant *off(const char *name) {
    return g_variant_new("(sbd)", name, FALSE, 0.0);
}

static GVariant *picture(const char *camera, gint64 exposure_us) {
    return g_variant_new("(sxd)", camera, exposure_us, 0.0);
}

static GVariant *to(const char *axis, double deg) {
    return g_variant_new("(sd)", axis, deg);
}

static GVariant *name_of(const char *axis) {
    return g_variant_new("(s)", axis);
}

TEST(names) {
    static const struct change bare[] = {{"[camera cam60]", NULL},  {"[laser laser30]", NULL},
                                         {"[laser laser60]", NULL}, {"[axis sweep30]", NULL},
                                         {"[axis sweep60]", NULL},  {0}};
    struct bus_peer *peer = bus_peer_new(NULL);
    bus_peer_refused(peer, "Snap", picture("cam30", 4000), "NoRig", "OpenRig");
    bus_peer_refused(peer, "SetLamp", on("lamp30"), "NoRig", "OpenRig");
    bus_peer_refused(peer, "SetLaser", on("laser30"), "NoRig", "OpenRig");
    bus_peer_refused(peer, "MoveAxis", to("arc", 3), "NoRig", "OpenRig");
    bus_peer_refused(peer, "HomeAxis", name_of("arc"), "NoRig", "OpenRig");
    bus_peer_tell(peer, "OpenRig", g_variant_new("(s)", peer->rig));
    bus_peer_refused(peer, "Snap", picture("cam31", 4000), "Unknown",
                     "no camera “cam31”; choose from: cam30, cam60");
    bus_peer_refused(peer, "SetLamp", on("lamp31"), "Unknown", "choose from: lamp30, lamp60");
    bus_peer_refused(peer, "SetLaser", on("laser31"), "Unknown", "choose from: laser30, laser60");
    bus_peer_refused(peer, "MoveAxis", to("swing", 3), "Unknown",
                     "choose from: turntable, arc, sweep30, sweep60");
    bus_peer_refused(peer, "HomeAxis", name_of("swing"), "Unknown", "no axis “swing”");
    bus_peer_free(peer);

    peer = bus_peer_open(bare);
    bus_peer_refused(peer, "Snap", picture("cam31", 4000), "Unknown", "choose from: cam30");
    bus_peer_refused(peer, "SetLaser", on("laser30"), "Unknown", "the rig has none");
    bus_peer_free(peer);
}

/* Two lamps of a bank, a laser: what one call does leaves the others as they are. */
TEST(lights) {
    static const struct change slow[] = {
        {"[rig]", "clock = real"}, {"[laser laser30]", "warm_up_ms = 500"}, {0}};
    struct bus_peer *peer = bus_peer_open(slow);
    GAsyncResult *first = NULL;
    bus_peer_tell(peer, "SetLamp", off("lamp30")); /* that is off */
    bus_peer_tell(peer, "SetLaser", off("laser60"));
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 0);
    bus_peer_tell(peer, "SetLamp", on("lamp30"));
    bus_peer_tell(peer, "SetLamp", on("lamp60"));
    bus_peer_tell(peer, "SetLamp", on("lamp60")); /* again */
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 2);
    bus_peer_tell(peer, "SetLamp", off("lamp60"));
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 1);
    g_assert_true(lamps_is_on(peer->bus->rig.devices->banks[0], 0));
    g_assert_false(lamps_is_on(peer->bus->rig.devices->banks[0], 1));
    bus_peer_begin(peer->client, "SetLaser", on("laser30"), &first);
    bus_peer_refused(peer, "SetLaser", on("laser30"), "Busy", "laser30 is busy with another call");
    g_variant_unref(bus_peer_end(peer->client, &first, NULL, NULL));
    g_assert_true(laser_is_on(peer->bus->rig.devices->lasers[0]));
    bus_peer_tell(peer, "SafeState", NULL);
    bus_peer_wait(peer, no_hands);
    g_assert_true(is_dark(peer->bus->rig.devices));
    bus_peer_free(peer);
}

/* When a client disconnects, its own operations end, and those of other clients do not. */
TEST(gone) {
    static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};
    struct bus_peer *peer = bus_peer_open(real_clock);
    g_autoptr(GDBusConnection) other = bus_peer_join(peer);
    GAsyncResult *lamp = NULL, *laser = NULL, *moves = NULL, *snaps = NULL;
    bus_peer_tell(peer, "SetLamp", on("lamp30"));
    bus_peer_tell(peer, "HomeAxis", name_of("arc"));
    bus_peer_begin(other, "SetLamp", on("lamp60"), &lamp);
    g_variant_unref(bus_peer_end(other, &lamp, NULL, NULL));
    bus_peer_begin(other, "SetLaser", on("laser30"), &laser);
    g_variant_unref(bus_peer_end(other, &laser, NULL, NULL));
    bus_peer_begin(other, "MoveAxis", to("arc", 170), &moves);
    bus_peer_begin(other, "Snap", picture("cam30", 3000000), &snaps);
    while (peer->bus->hands.list->len < 5)
        g_main_context_iteration(NULL, TRUE);
    g_assert_true(axis_is_moving(peer->bus->rig.devices->arc));
    g_dbus_connection_close_sync(other, NULL, NULL);
    while (peer->bus->hands.list->len > 1)
        g_main_context_iteration(NULL, TRUE);
    g_assert_false(axis_is_moving(peer->bus->rig.devices->arc));
    g_assert_false(laser_is_on(peer->bus->rig.devices->lasers[0]));
    g_assert_true(lamps_is_on(peer->bus->rig.devices->banks[0], 0));
    g_assert_false(lamps_is_on(peer->bus->rig.devices->banks[0], 1));
    g_autoptr(GError) error = NULL;
    g_assert_null(bus_peer_end(other, &moves, NULL, &error));
    g_clear_error(&error);
    g_assert_null(bus_peer_end(other, &snaps, NULL, &error));
    bus_peer_tell(peer, "CloseRig", NULL);
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 0);
    bus_peer_free(peer);
}

/* What is on goes off; no laser shines and no axis moves behind an open door, lamps do. */
TEST(door) {
    static const struct change changes[] = {{"[rig]", "clock = real"}, {0}};
    struct bus_peer *peer = bus_peer_open(changes);
    GAsyncResult *snaps = NULL;
    g_autoptr(GError) error = NULL;
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    bus_peer_begin(peer->client, "Snap", picture("cam30", 20000000), &snaps);
    bus_peer_wait(peer, two_hands);
    interlock_report(peer->bus->rig.devices->interlocks[0], FALSE);
    bus_peer_fails(peer->client, &snaps, "Cancelled", "door");
    bus_peer_wait(peer, no_hands);
    g_assert_true(is_dark(peer->bus->rig.devices));
    bus_peer_refused(peer, "SetLaser", on("laser30"), "DeviceInterlock", "door");
    bus_peer_refused(peer, "MoveAxis", to("arc", 3), "DeviceInterlock", "door");
    bus_peer_refused(peer, "HomeAxis", name_of("turntable"), "DeviceInterlock", "door");
    g_assert_false(
        bus_hands_park(&peer->bus->hands, peer->bus->rig.devices->arc, NULL, NULL, &error));
    assert_has(error->message, "door");
    bus_peer_tell(peer, "SetLamp", on("lamp30"));
    bus_peer_tell(peer, "SetLamp", off("lamp30"));
    bus_peer_free(peer);
}

TEST(axes) {
    static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};
    static const struct change stalls[] = {{"[axis arc]", "fault_stall_at = 1"}, {0}};
    static const struct change silent[] = {
        {"[axis arc]", "fault_stall_at = 1"}, {"[axis arc]", "fault_stall_kind = silent"}, {0}};
    struct bus_peer *peer = bus_peer_open(real_clock);
    GAsyncResult *moves = NULL;
    bus_peer_refused(peer, "MoveAxis", to("sweep30", 99), "DeviceRange", "sweep30");
    bus_peer_tell(peer, "HomeAxis", name_of("arc"));
    bus_peer_begin(peer->client, "MoveAxis", to("arc", 170), &moves);
    bus_peer_wait(peer, some_hands);
    bus_peer_refused(peer, "HomeAxis", name_of("arc"), "Busy", "arc is busy");
    bus_peer_tell(peer, "SafeState", NULL);
    bus_peer_fails(peer->client, &moves, "Cancelled", "SafeState");
    bus_peer_wait(peer, no_hands);
    g_assert_false(axis_is_moving(peer->bus->rig.devices->arc));
    bus_peer_tell(peer, "Release", NULL);
    bus_peer_tell(peer, "MoveAxis", to("arc", 10));
    /* Stopped by somebody else than its client. */
    bus_peer_begin(peer->client, "MoveAxis", to("arc", 170), &moves);
    bus_peer_wait(peer, some_hands);
    axis_stop(peer->bus->rig.devices->arc, NULL);
    bus_peer_fails(peer->client, &moves, "DeviceStalled", "the axis was stopped at");
    bus_peer_free(peer);

    peer = bus_peer_open(stalls);
    bus_peer_tell(peer, "HomeAxis", name_of("arc"));
    bus_peer_refused(peer, "MoveAxis", to("arc", 170), "DeviceStalled", "arc");
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 0);
    bus_peer_free(peer);

    peer = bus_peer_open(silent);
    bus_peer_tell(peer, "HomeAxis", name_of("arc"));
    bus_peer_refused(peer, "MoveAxis", to("arc", 170), "DeviceTimeout", "arc");
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 0);
    bus_peer_free(peer);
}

static struct parked {
    int n;
    char *error;
} parked;

static void on_park(gpointer data, const GError *error) {
    g_free(parked.error);
    parked = (struct parked){parked.n + 1, error ? g_strdup(error->message) : NULL};
}

static gboolean has_parked(const Bus *bus) {
    return parked.n > 0;
}

static void park_arc(struct bus_peer *peer) {
    parked.n = 0;
    g_assert_true(
        ok(bus_hands_park(&peer->bus->hands, peer->bus->rig.devices->arc, on_park, NULL, ERR)));
}

TEST(park) {
    static const struct change changes[] = {{"[rig]", "clock = real"},
                                            {"[axis arc]", "park_deg = 40"},
                                            {"[axis arc]", "speed_deg_s = 300"},
                                            {"[axis arc]", "accel_deg_s2 = 1000"},
                                            {0}};
    static const struct change stalls[] = {
        {"[axis arc]", "park_deg = 40"}, {"[axis arc]", "fault_stall_at = 1"}, {0}};
    struct bus_peer *peer = bus_peer_open(changes);
    GAsyncResult *moves = NULL;
    g_autoptr(GError) error = NULL;
    park_arc(peer); /* homes, then moves */
    bus_peer_refused(peer, "MoveAxis", to("arc", 3), "Busy", "arc is busy");
    g_assert_false(
        bus_hands_park(&peer->bus->hands, peer->bus->rig.devices->arc, on_park, NULL, &error));
    assert_has(error->message, "somebody is moving the axis arc");
    bus_peer_wait(peer, has_parked);
    g_assert_null(parked.error);
    g_assert_cmpfloat_with_epsilon(axis_position_deg(peer->bus->rig.devices->arc), 40, 0.01);
    bus_peer_tell(peer, "MoveAxis", to("arc", 100));
    park_arc(peer); /* moves */
    bus_peer_wait(peer, has_parked);
    g_assert_cmpfloat_with_epsilon(axis_position_deg(peer->bus->rig.devices->arc), 40, 0.01);
    bus_peer_tell(peer, "HomeAxis", name_of("turntable"));
    bus_peer_tell(peer, "MoveAxis", to("arc", 100));
    bus_peer_begin(peer->client, "MoveAxis", to("turntable", 170), &moves);
    bus_peer_wait(peer, some_hands);
    park_arc(peer); /* next to another axis */
    bus_peer_tell(peer, "SafeState", NULL);
    bus_peer_wait(peer, has_parked);
    assert_has(parked.error, "SafeState");
    g_clear_error(&error);
    g_assert_null(bus_peer_end(peer->client, &moves, NULL, &error));
    bus_peer_wait(peer, no_hands);
    bus_peer_free(peer);

    peer = bus_peer_open(stalls);
    park_arc(peer);
    bus_peer_wait(peer, has_parked);
    assert_has(parked.error, "arc");
    bus_peer_wait(peer, no_hands);
    bus_peer_free(peer);
}

TEST(pictures) {
    static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};
    static const struct change lost[] = {{"[camera cam30]", "fault_lost = 1"}, {0}};
    static const struct change stale[] = {{"[camera cam30]", "fault_stale = 1"}, {0}};
    struct bus_peer *peer = bus_peer_open(real_clock);
    GAsyncResult *first = NULL;
    bus_peer_refused(peer, "Snap", picture("cam30", 1), "DeviceRange", "cam30");
    bus_peer_begin(peer->client, "Snap", picture("cam30", 500000), &first);
    bus_peer_refused(peer, "Snap", picture("cam30", 4000), "Busy", "cam30 is busy");
    g_variant_unref(bus_peer_end(peer->client, &first, NULL, NULL));
    bus_peer_begin(peer->client, "Snap", picture("cam30", 500000), &first);
    bus_peer_wait(peer, some_hands);
    bus_peer_tell(peer, "SafeState", NULL);
    bus_peer_fails(peer->client, &first, "Cancelled", "SafeState");
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 0);
    bus_peer_free(peer);

    peer = bus_peer_open(lost);
    bus_peer_refused(peer, "Snap", picture("cam30", 4000), "DeviceTimeout", "cam30");
    bus_peer_free(peer);

    /* The first picture has none before it; the next is refused until the camera gives up. */
    peer = bus_peer_open(stale);
    bus_peer_tell(peer, "Snap", picture("cam30", 4000));
    bus_peer_refused(peer, "Snap", picture("cam30", 4000), "DeviceStale", "cam30");
    g_assert_cmpuint(peer->bus->hands.list->len, ==, 0);
    bus_peer_free(peer);
}

static gboolean is_all_off(const Bus *bus) {
    return bus->hands.list->len == 0 && is_dark(bus->rig.devices);
}

/* The daemon measures how long a light is on. */
TEST(lease) {
    static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};
    struct bus_peer *peer = bus_peer_open(real_clock);
    g_autoptr(GDBusConnection) other = bus_peer_join(peer);
    GAsyncResult *result = NULL;
    g_autoptr(GVariant) renewed = NULL;
    guint n = 0;
    bus_peer_refused(peer, "SetLamp", g_variant_new("(sbd)", "lamp30", TRUE, 0.0), "Limit", "60 s");
    bus_peer_refused(peer, "SetLaser", g_variant_new("(sbd)", "laser30", TRUE, 60.1), "Limit",
                     "60.1 s");
    bus_peer_refused(peer, "Renew", g_variant_new("(d)", -1.0), "Limit", "-1 s");
    g_assert_true(is_all_off(peer->bus));

    bus_peer_tell(peer, "SetLaser", g_variant_new("(sbd)", "laser30", TRUE, 0.2));
    bus_peer_tell(peer, "SetLamp", g_variant_new("(sbd)", "lamp30", TRUE, 1.5));
    bus_peer_wait(peer, is_all_off);
    assert_has(peer->told->str, "info laser30: the lease of this light has ended");

    /* Renewed by the same call and by Renew; another client can do neither. */
    bus_peer_tell(peer, "SetLaser", g_variant_new("(sbd)", "laser30", TRUE, 1.0));
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    bus_peer_begin(other, "Renew", g_variant_new("(d)", 0.1), &result);
    renewed = bus_peer_end(other, &result, NULL, NULL);
    g_variant_get(renewed, "(u)", &n);
    g_assert_cmpuint(n, ==, 0);
    bus_peer_begin(other, "SetLaser", on("laser30"), &result);
    bus_peer_fails(other, &result, "Busy", "another client has switched laser30 on");
    g_usleep(1100 * 1000); /* the first lease is over now */
    while (g_main_context_iteration(NULL, FALSE))
        ;
    g_assert_true(laser_is_on(peer->bus->rig.devices->lasers[0]));
    g_clear_pointer(&renewed, g_variant_unref);
    bus_peer_begin(peer->client, "Renew", g_variant_new("(d)", 0.1), &result);
    renewed = bus_peer_end(peer->client, &result, NULL, NULL);
    g_variant_get(renewed, "(u)", &n);
    g_assert_cmpuint(n, ==, 1);
    bus_peer_wait(peer, is_all_off);

    /* Any client may switch a light off, also one that is warming up. */
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    bus_peer_begin(other, "SetLaser", off("laser30"), &result);
    g_variant_unref(bus_peer_end(other, &result, NULL, NULL));
    g_assert_true(is_all_off(peer->bus));
    bus_peer_free(peer);
}

TEST(warming) {
    static const struct change slow[] = {
        {"[rig]", "clock = real"}, {"[laser laser30]", "warm_up_ms = 600000"}, {0}};
    struct bus_peer *peer = bus_peer_open(slow);
    g_autoptr(GDBusConnection) other = bus_peer_join(peer);
    GAsyncResult *lights = NULL, *darkens = NULL;
    bus_peer_begin(peer->client, "SetLaser", on("laser30"), &lights);
    bus_peer_wait(peer, some_hands);
    bus_peer_begin(other, "SetLaser", off("laser30"), &darkens);
    g_variant_unref(bus_peer_end(other, &darkens, NULL, NULL));
    bus_peer_fails(peer->client, &lights, "Cancelled", "a later call has switched the light off");
    g_assert_true(is_all_off(peer->bus));
    /* The lease runs while the light warms up. */
    bus_peer_begin(peer->client, "SetLaser", g_variant_new("(sbd)", "laser30", TRUE, 0.2), &lights);
    bus_peer_fails(peer->client, &lights, "Cancelled", "call Renew");
    bus_peer_tell(peer, "SetLaser", off("laser30")); /* which may be under way already */
    bus_peer_wait(peer, is_all_off);
    bus_peer_free(peer);
}

/* A client that sends a call and closes its connection at the same time leaves nothing on. */
TEST(gone_at_once) {
    static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};
    struct bus_peer *peer = bus_peer_open(real_clock);
    for (int i = 0; i < 40; i++) {
        g_autoptr(GDBusConnection) client = bus_peer_join(peer);
        GAsyncResult *laser = NULL, *lamp = NULL;
        bus_peer_begin(client, "SetLaser", on("laser30"), &laser);
        bus_peer_begin(client, "SetLamp", on("lamp30"), &lamp);
        g_dbus_connection_flush_sync(client, NULL, NULL);
        if (i % 2) /* the daemon sees the end before the calls */
            g_dbus_connection_close_sync(client, NULL, NULL);
        else
            g_dbus_connection_close(client, NULL, NULL, NULL);
        g_usleep((gulong)(i % 4) * 5000);
        while (!laser || !lamp)
            g_main_context_iteration(NULL, TRUE);
        g_clear_object(&laser);
        g_clear_object(&lamp);
        bus_peer_tell(peer, "Snap", picture("cam30", 4000)); /* all before it has been handled */
        bus_peer_wait(peer, is_all_off);
    }
    bus_peer_free(peer);
}

static void append_call(GString *to, guint32 serial, const char *method, GVariant *parameters) {
    gsize size;
    g_autoptr(GDBusMessage) message =
        g_dbus_message_new_method_call(NULL, BUS_PATH, BUS_NAME, method);
    g_dbus_message_set_body(message, parameters);
    g_dbus_message_set_serial(message, serial);
    g_autofree guchar *blob =
        ok(g_dbus_message_to_blob(message, &size, G_DBUS_CAPABILITY_FLAGS_NONE, ERR));
    g_string_append_len(to, (const char *)blob, (gssize)size);
}

/* Sends its name and its calls without waiting for an answer, and closes its side. */
static int call_and_go(const char *address) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    g_autofree char *uid = g_strdup_printf("%u", (guint)getuid());
    g_autoptr(GString) text = g_string_new_len("", 1);
    g_string_append(text, "AUTH EXTERNAL ");
    for (const char *c = uid; *c; c++)
        g_string_append_printf(text, "%02x", (guint)*c);
    g_string_append(text, "\r\nBEGIN\r\n");
    append_call(text, 1, "SetLaser", on("laser30"));
    append_call(text, 2, "SetLamp", on("lamp30"));
    g_strlcpy(to.sun_path, address + strlen("unix:path="), sizeof to.sun_path);
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    g_assert_cmpint(connect(fd, (struct sockaddr *)&to, sizeof to), ==, 0);
    g_assert_cmpint(write(fd, text->str, text->len), ==, (gssize)text->len);
    shutdown(fd, SHUT_WR);
    return fd;
}

/* A client connects, calls and closes while the main loop is busy. GDBus then reports the end of
 * the connection before it passes the calls on. */
TEST(gone_before_the_call) {
    static const struct change real_clock[] = {{"[rig]", "clock = real"}, {0}};
    struct bus_peer *peer = bus_peer_open(real_clock);
    for (int i = 0; i < 10; i++) {
        const int fd = call_and_go(peer->address);
        for (int k = 0; k < 6; k++) { /* a busy loop, in which GDBus's threads come first */
            g_usleep(20 * 1000);
            while (g_main_context_iteration(NULL, FALSE))
                ;
        }
        bus_peer_tell(peer, "Snap", picture("cam30", 4000));
        bus_peer_wait(peer, is_all_off);
        close(fd);
    }
    bus_peer_free(peer);
}

/* A laser that does not obey: the client that asked gets an error, and all clients get an event. */
TEST(deaf) {
    static const struct change deaf[] = {{"[laser laser30]", "fault_deaf = 99"}, {0}};
    struct bus_peer *peer = bus_peer_open(deaf);
    bus_peer_tell(peer, "SetLaser", on("laser30"));
    bus_peer_refused(peer, "SetLaser", off("laser30"), "DeviceTimeout", "laser30");
    bus_peer_wait(peer, no_hands);
    while (!strstr(peer->told->str, DEVICES_UNSAFE))
        g_main_context_iteration(NULL, TRUE);
    g_test_message("%s", peer->told->str);
    bus_peer_free(peer);
}

static gboolean has_unsafe(const Bus *bus) {
    return *bus_rig1_get_unsafe(bus->object) != NULL;
}

static gboolean has_none_unsafe(const Bus *bus) {
    return !has_unsafe(bus);
}

static void assert_health(const struct bus_peer *peer, const char *device, const char *begins) {
    GVariant *devices = bus_rig1_get_devices(peer->bus->object);
    for (gsize i = 0; i < g_variant_n_children(devices); i++) {
        const char *class_name, *name, *driver, *health;
        g_variant_get_child(devices, i, "(&s&s&s&s)", &class_name, &name, &driver, &health);
        if (strcmp(name, device) == 0 && !g_str_has_prefix(health, begins))
            g_error("%s: “%s” and not “%s”", name, health, begins);
    }
}

/* The device carries "on" out, its answer is lost, and then the line is dead for a while. */
static void check_unheard(const char *section, const char *method, const char *device) {
    const struct change changes[] = {{"[rig]", "clock = real"},
                                     {section, "fault_unheard = 1"},
                                     {section, "fault_dead_s = 4"},
                                     {0}};
    struct bus_peer *peer = bus_peer_open(changes);
    const gboolean laser = strcmp(method, "SetLaser") == 0;
    g_autofree char *shown =
        g_strconcat(laser ? "laser " : "lamps ", laser ? device : "bank", NULL);
    bus_peer_refused(peer, method, on(device), "DeviceTimeout", "no answer within");
    g_assert_true(no_hands(peer->bus));
    bus_peer_wait(peer, has_unsafe);
    g_assert_cmpstr(bus_rig1_get_unsafe(peer->bus->object)[0], ==, shown);
    assert_health(peer, laser ? device : "bank", "unsafe: ");
    bus_peer_refused(peer, "CloseRig", NULL, "Busy", "has not confirmed that it is off");
    assert_has(peer->told->str, DEVICES_UNSAFE);
    bus_peer_refused(peer, "Start", g_variant_new("(ssa{sv})", peer->conf, peer->session, NULL),
                     "Busy", "has not confirmed that it is off");
    g_assert_true(has_unsafe(peer->bus)); /* it was so until here */
    bus_peer_wait(peer, has_none_unsafe);
    g_assert_true(is_dark(peer->bus->rig.devices));
    assert_health(peer, laser ? device : "bank", "off");
    bus_peer_tell(peer, method, on(device));
    bus_peer_tell(peer, method, off(device));
    assert_has(peer->told->str, "confirmed off again");
    bus_peer_free(peer);
}

TEST(unheard) {
    check_unheard("[laser laser30]", "SetLaser", "laser30");
    check_unheard("[lamps bank]", "SetLamp", "lamp30");
}

BEFORE_TESTS {
    /* Faults of devices are logged as warnings. */
    g_log_set_always_fatal(G_LOG_LEVEL_CRITICAL | G_LOG_FATAL_MASK);
}
