/* The rig on D-Bus, as a client of the same process sees it over a peer connection. */
#include "bus/bus.h"
#include "bus/bus_errors.h"
#include "bus/bus_private.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include "lib/long_session.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"

#define RIG     SOURCE_DIR "/tests/small/rig.conf"
#define SESSION SOURCE_DIR "/tests/small/session.conf"
#define WAIT_US (120 * G_USEC_PER_SEC)

struct fixture {
    char *folder, *socket, *address, *directory, *session;
    Bus *bus;
    BusServer *server;
    GDBusConnection *client;
    int closed, changes, events, thumbnails;
    int shots_done;
    char *state;
};

static void on_closed(Bus *bus, gpointer data) {
    ((struct fixture *)data)->closed++;
}

static void on_signal(GDBusConnection *connection, const char *sender, const char *path,
                      const char *interface, const char *signal, GVariant *parameters,
                      gpointer data) {
    struct fixture *fixture = data;
    if (strcmp(signal, "Event") == 0) {
        fixture->events++;
    } else if (strcmp(signal, "ThumbnailChanged") == 0) {
        fixture->thumbnails++;
    } else if (strcmp(signal, "PropertiesChanged") == 0) {
        g_autoptr(GVariant) properties = g_variant_get_child_value(parameters, 1);
        const char *state;
        fixture->changes++;
        g_variant_lookup(properties, "ShotsDone", "i", &fixture->shots_done);
        if (g_variant_lookup(properties, "State", "&s", &state)) {
            g_free(fixture->state);
            fixture->state = g_strdup(state);
        }
    }
}

static void take_result(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

static GAsyncResult *wait_for(GAsyncResult **result) {
    while (!*result)
        g_main_context_iteration(NULL, TRUE);
    return *result;
}

static GDBusConnection *join(struct fixture *fixture) {
    GAsyncResult *result = NULL;
    g_autoptr(GError) error = NULL;
    g_dbus_connection_new_for_address(fixture->address,
                                      G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL,
                                      take_result, &result);
    GDBusConnection *client = g_dbus_connection_new_for_address_finish(wait_for(&result), &error);
    g_object_unref(result);
    g_assert_no_error(error);
    return client;
}

static void set_up(struct fixture *fixture, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    fixture->folder = ok(g_dir_make_tmp("mesorig-bus-XXXXXX", ERR));
    fixture->socket = g_build_filename(fixture->folder, "bus", NULL);
    fixture->address = g_strconcat("unix:path=", fixture->socket, NULL);
    fixture->directory = g_build_filename(fixture->folder, "small.session", NULL);
    fixture->session = long_session_write(fixture->folder, LONG_RINGS);
    fixture->bus = bus_new(fixture->address);
    fixture->server = bus_serve(fixture->bus, fixture->address, &error);
    bus_listen_client(fixture->bus, on_closed, fixture);
    g_assert_no_error(error);
    fixture->client = join(fixture);
    g_dbus_connection_signal_subscribe(fixture->client, NULL, NULL, NULL, NULL, NULL,
                                       G_DBUS_SIGNAL_FLAGS_NONE, on_signal, fixture, NULL);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    g_clear_object(&fixture->client);
    bus_unserve(fixture->bus, fixture->server);
    bus_free(fixture->bus);
    while (g_main_context_iteration(NULL, FALSE))
        ;
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->socket);
    g_free(fixture->address);
    g_free(fixture->directory);
    g_free(fixture->session);
    g_free(fixture->state);
}

/* What a call answers, or NULL; then error is set. Parameters are consumed. */
static GVariant *call_on(struct fixture *fixture, const char *interface, const char *method,
                         GVariant *parameters, GError **error) {
    GAsyncResult *result = NULL;
    g_dbus_connection_call(fixture->client, NULL, BUS_PATH, interface, method, parameters, NULL,
                           G_DBUS_CALL_FLAGS_NONE, 60000, NULL, take_result, &result);
    GVariant *answer = g_dbus_connection_call_finish(fixture->client, wait_for(&result), error);
    g_object_unref(result);
    return answer;
}

static GVariant *ask(struct fixture *fixture, const char *method, GVariant *parameters) {
    GVariant *answer = ok(call_on(fixture, BUS_NAME, method, parameters, ERR));
    return answer;
}

static void tell(struct fixture *fixture, const char *method, GVariant *parameters) {
    g_variant_unref(ask(fixture, method, parameters));
}

/* The call fails with a name, and says something with these words. */
static void refused(struct fixture *fixture, const char *method, GVariant *parameters,
                    const char *name, const char *words) {
    g_autoptr(GError) error = NULL;
    g_autofree char *full = g_strconcat("org.mesorig.Error.", name, NULL);
    g_assert_null(call_on(fixture, BUS_NAME, method, parameters, &error));
    g_autofree char *found = g_dbus_error_get_remote_error(error);
    g_assert_cmpstr(found, ==, full);
    if (words && !strstr(error->message, words))
        g_error("%s does not say “%s”: %s", method, words, error->message);
}

static GVariant *get(struct fixture *fixture, const char *property) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) answer = call_on(fixture, "org.freedesktop.DBus.Properties", "Get",
                                         g_variant_new("(ss)", BUS_NAME, property), &error);
    g_assert_no_error(error);
    GVariant *value = NULL;
    g_variant_get(answer, "(v)", &value);
    return value;
}

static void assert_state(struct fixture *fixture, const char *expected) {
    g_autoptr(GVariant) state = get(fixture, "State");
    g_assert_cmpstr(g_variant_get_string(state, NULL), ==, expected);
}

static void wait_for_state(struct fixture *fixture, const char *expected) {
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    while (g_strcmp0(fixture->state, expected) != 0) {
        g_assert_cmpint(g_get_monotonic_time(), <, until);
        g_main_context_iteration(NULL, TRUE);
    }
}

static GVariant *start_parameters(const char *session, const char *directory) {
    return g_variant_new("(ssa{sv})", session, directory, NULL);
}

static GVariant *resume_parameters(const char *directory) {
    return g_variant_new("(sa{sv})", directory, NULL);
}

static void test_closed(struct fixture *fixture, gconstpointer data) {
    assert_state(fixture, "closed");
    refused(fixture, "CloseRig", NULL, "NoRig", "OpenRig");
    refused(fixture, "SafeState", NULL, "NoRig", NULL);
    refused(fixture, "Pause", NULL, "NoSession", NULL);
    refused(fixture, "Continue", NULL, "NoSession", NULL);
    refused(fixture, "Abort", NULL, "NoSession", NULL);
    refused(fixture, "GetThumbnail", g_variant_new("(s)", "cam30"), "NoRig", NULL);
    refused(fixture, "Start", start_parameters(SESSION, fixture->directory), "NoRig", NULL);
    refused(fixture, "Resume", resume_parameters(fixture->directory), "NoRig", NULL);
    refused(fixture, "Validate", g_variant_new("(ssa{sv})", SESSION, fixture->directory, NULL),
            "NoRig", NULL);
}

static void test_open(struct fixture *fixture, gconstpointer data) {
    g_autofree char *bad = g_build_filename(fixture->folder, "bad.conf", NULL);
    g_file_set_contents(bad, "[rig]\nid = bad\n\n[axis turntable]\ndriver = steam\n", -1, NULL);
    g_autoptr(GError) error = NULL;
    refused(fixture, "OpenRig", g_variant_new("(s)", "rig.conf"), "BadPath", "absolute");
    refused(fixture, "OpenRig", g_variant_new("(s)", ""), "BadPath", NULL);
    g_assert_null(call_on(fixture, BUS_NAME, "OpenRig", g_variant_new("(s)", "/no/such"), &error));
    g_assert_nonnull(strstr(error->message, "/no/such"));
    refused(fixture, "OpenRig", g_variant_new("(s)", bad), "ConfigUnknown", "bad.conf:5");
    assert_state(fixture, "closed");

    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    assert_state(fixture, "idle");
    refused(fixture, "OpenRig", g_variant_new("(s)", RIG), "Busy", "CloseRig");
    g_autoptr(GVariant) simulated = get(fixture, "Simulated");
    g_assert_true(g_variant_get_boolean(simulated));

    /* Turntable, arc, two sweeps, a bank, two cameras, two lasers, a door. */
    g_autoptr(GVariant) devices = get(fixture, "Devices");
    g_assert_cmpuint(g_variant_n_children(devices), ==, 10);
    const char *class_name, *name, *driver, *health;
    g_variant_get_child(devices, 0, "(&s&s&s&s)", &class_name, &name, &driver, &health);
    g_assert_cmpstr(class_name, ==, "axis");
    g_assert_cmpstr(name, ==, "turntable");
    g_assert_cmpstr(driver, ==, "sim-axis");
    g_assert_cmpstr(health, ==, "not homed");

    /* Two lasers, a bank, two sweeps, arc and turntable: each has answered. */
    g_autoptr(GVariant) answer = ask(fixture, "SafeState", NULL);
    g_autoptr(GVariant) states = NULL;
    gboolean safe = FALSE;
    g_variant_get(answer, "(b@a(sss))", &safe, &states);
    g_assert_true(safe);
    g_assert_cmpuint(g_variant_n_children(states), ==, 7);
    for (gsize i = 0; i < 7; i++) {
        const char *state;
        g_variant_get_child(states, i, "(&s&s&s)", &class_name, &name, &state);
        g_assert_cmpstr(state, ==, "read back");
    }
    tell(fixture, "CloseRig", NULL);
    assert_state(fixture, "closed");
}

/* A rig file that was changed while it is open is not used until it is opened again. */
static void test_changed_rig(struct fixture *fixture, gconstpointer data) {
    g_autofree char *rig = g_build_filename(fixture->folder, "rig.conf", NULL);
    g_autofree char *world = g_build_filename(fixture->folder, "world.conf", NULL);
    g_autofree char *text = NULL, *of_world = NULL;
    ok(g_file_get_contents(RIG, &text, NULL, ERR));
    ok(g_file_get_contents(SOURCE_DIR "/tests/small/world.conf", &of_world, NULL, ERR));
    ok(g_file_set_contents(rig, text, -1, ERR));
    ok(g_file_set_contents(world, of_world, -1, ERR));
    tell(fixture, "OpenRig", g_variant_new("(s)", rig));
    tell(fixture, "Validate", start_parameters(fixture->session, ""));
    g_autoptr(GString) changed = g_string_new(text);
    g_assert_cmpuint(g_string_replace(changed, "arc_width_mm = 30", "arc_width_mm = 31", 1), ==, 1);
    ok(g_file_set_contents(rig, changed->str, -1, ERR));
    refused(fixture, "Validate", start_parameters(fixture->session, ""), "Failed",
            "has changed since mesorigd opened it");
    refused(fixture, "Start", start_parameters(fixture->session, fixture->directory), "Failed",
            "mesorig close");
    g_assert_false(g_file_test(fixture->directory, G_FILE_TEST_EXISTS));
    g_unlink(rig); /* a file that is gone has no other values */
    tell(fixture, "Validate", start_parameters(fixture->session, ""));
    ok(g_file_set_contents(rig, changed->str, -1, ERR));
    tell(fixture, "CloseRig", NULL);
    tell(fixture, "OpenRig", g_variant_new("(s)", rig));
    tell(fixture, "Validate", start_parameters(fixture->session, ""));
}

static void test_validate(struct fixture *fixture, gconstpointer data) {
    g_autofree char *bad = g_build_filename(fixture->folder, "bad.conf", NULL);
    g_file_set_contents(bad, "[session]\nname = x\ncolour = blue\n[sample]\nwidth_mm = x\n", -1,
                        NULL);
    gboolean ok = FALSE;
    const char *text;
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    g_autoptr(GVariant) good =
        ask(fixture, "Validate", g_variant_new("(ssa{sv})", SESSION, fixture->directory, NULL));
    g_autoptr(GVariant) plan = NULL;
    g_variant_get(good, "(b&s@a{sv})", &ok, &text, &plan);
    g_assert_true(ok);
    g_assert_nonnull(strstr(text, "4 views, 4 lights, 2 laser positions"));
    gint32 views = 0;
    double predicted_s = 0, bound_s = 0;
    g_variant_lookup(plan, "views", "i", &views);
    g_variant_lookup(plan, "predicted_s", "d", &predicted_s);
    g_variant_lookup(plan, "lower_bound_s", "d", &bound_s);
    g_assert_cmpint(views, ==, 4);
    g_assert_cmpfloat(predicted_s, >=, bound_s);
    g_assert_cmpfloat(bound_s, >, 0);
    g_assert_false(g_file_test(fixture->directory, G_FILE_TEST_EXISTS));

    g_autoptr(GVariant) wrong =
        ask(fixture, "Validate", g_variant_new("(ssa{sv})", bad, fixture->directory, NULL));
    g_variant_get(wrong, "(b&s@a{sv})", &ok, &text, NULL);
    g_assert_false(ok);
    g_auto(GStrv) told = g_strsplit(text, "\n", -1);
    g_assert_cmpuint(g_strv_length(told), >, 3);
    g_assert_nonnull(strstr(told[0], "bad.conf: "));
    g_assert_true(g_str_has_suffix(told[0], " mistakes:"));
    g_assert_nonnull(strstr(told[1], "bad.conf:3: [session] colour: there is no such key"));
    g_assert_nonnull(strstr(text, "bad.conf:5: [sample] width_mm: \"x\" is not a number"));
    refused(fixture, "Validate", g_variant_new("(ssa{sv})", "session.conf", "", NULL), "BadPath",
            NULL);
    refused(fixture, "Start", start_parameters(bad, fixture->directory), "ConfigUnknown", NULL);
    refused(fixture, "Start", start_parameters(SESSION, "here"), "BadPath", NULL);
}

/* A session too large is refused immediately, and by file and line; one that is planned for long is
 * given up when a limit is met, and the answer says which. */
static void test_limits(struct fixture *fixture, gconstpointer data) {
    g_autofree char *endless = long_session_write(fixture->folder, "30:510; 60:510");
    gboolean ok = TRUE;
    const char *text;
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    g_autoptr(GVariant) wrong =
        ask(fixture, "Validate", g_variant_new("(ssa{sv})", endless, "", NULL));
    g_variant_get(wrong, "(b&s@a{sv})", &ok, &text, NULL);
    g_assert_false(ok);
    g_assert_nonnull(strstr(text, "long.conf:"));
    g_assert_nonnull(strstr(text, "at most 40000"));
    refused(fixture, "Start", start_parameters(endless, fixture->directory), "PlanSize", "poses");

    g_autofree char *large = long_session_write(fixture->folder, "30:140; 60:140");
    struct preparer_limits *limits = &fixture->bus->jobs.limits[PREPARER_CHECK];
    limits->wall_s = 1;
    refused(fixture, "Validate", g_variant_new("(ssa{sv})", large, "", NULL), "Limit",
            "longer than the limit of 1 s");
    limits->wall_s = 300;
    limits->cpu_s = 1;
    refused(fixture, "Validate", g_variant_new("(ssa{sv})", large, "", NULL), "Limit",
            "computing time");
#ifndef __SANITIZE_ADDRESS__
    limits->cpu_s = 120;
    limits->memory_bytes = 1 << 20;
    refused(fixture, "Validate", g_variant_new("(ssa{sv})", large, "", NULL), "Limit",
            "MiB of memory");
#endif
    fixture->bus->jobs.limits[PREPARER_BEGIN].cpu_s = 1;
    refused(fixture, "Start", start_parameters(large, fixture->directory), "Limit",
            "computing time");
    g_assert_false(g_file_test(fixture->directory, G_FILE_TEST_EXISTS));
}

static GAsyncResult *pending;

static void begin_call(struct fixture *fixture, const char *method, GVariant *parameters) {
    g_dbus_connection_call(fixture->client, NULL, BUS_PATH, BUS_NAME, method, parameters, NULL,
                           G_DBUS_CALL_FLAGS_NONE, 60000, NULL, take_result, &pending);
    assert_state(fixture, "idle"); /* it comes in before */
}

static void assert_cancelled(struct fixture *fixture, const char *words) {
    g_autoptr(GError) error = NULL;
    g_assert_null(g_dbus_connection_call_finish(fixture->client, wait_for(&pending), &error));
    g_autofree char *name = g_dbus_error_get_remote_error(error);
    g_assert_cmpstr(name, ==, "org.mesorig.Error.Cancelled");
    g_assert_nonnull(strstr(error->message, words));
    g_clear_object(&pending);
}

/* While a session is being planned, its client waits and other calls are answered. After a call
 * that stops the rig, the session does not begin. */
static void test_cancel(struct fixture *fixture, gconstpointer data) {
    static const char *const methods[] = {"SafeState", "Abort", "CloseRig"};
    static const char *const words[] = {"SafeState ended", "Abort ended", "closed meanwhile"};
    g_autofree char *large = long_session_write(fixture->folder, "30:140; 60:140");
    for (gsize i = 0; i < G_N_ELEMENTS(methods); i++) {
        if (i == 0)
            tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
        begin_call(fixture, "Start", start_parameters(large, fixture->directory));
        refused(fixture, "Start", start_parameters(SESSION, fixture->directory), "Busy",
                "mesorig abort");
        tell(fixture, methods[i], NULL);
        assert_cancelled(fixture, words[i]);
        g_assert_false(g_file_test(fixture->directory, G_FILE_TEST_EXISTS));
        assert_state(fixture, i < 2 ? "idle" : "closed");
        if (i == 0)
            tell(fixture, "Release", NULL);
    }
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    begin_call(fixture, "Validate", g_variant_new("(ssa{sv})", large, "", NULL));
    refused(fixture, "Validate", g_variant_new("(ssa{sv})", SESSION, "", NULL), "Busy",
            "an earlier call of yours");
    tell(fixture, "SafeState", NULL);
    g_assert_null(pending); /* a check moves nothing and goes on */
    tell(fixture, "CloseRig", NULL);
    assert_cancelled(fixture, "closed");
}

static void assert_control(struct fixture *fixture, gboolean there) {
    g_autofree char *path = g_build_filename(fixture->directory, BUS_CONTROL, NULL);
    g_autofree char *text = NULL;
    g_assert_cmpint(g_file_get_contents(path, &text, NULL, NULL), ==, there);
    if (there) {
        g_assert_true(g_str_has_prefix(text, fixture->address));
        g_assert_cmpuint(strlen(text), ==, strlen(fixture->address) + 1);
    }
}

static void assert_thumbnail(struct fixture *fixture) {
    guint32 width, height;
    double time_s;
    g_autoptr(GVariant) rgb = NULL;
    g_autoptr(GVariant) answer = ask(fixture, "GetThumbnail", g_variant_new("(s)", "cam30"));
    g_variant_get(answer, "(uu@ayd)", &width, &height, &rgb, &time_s);
    g_assert_cmpuint(width, >, 0);
    g_assert_cmpuint(height, >, 0);
    g_assert_cmpuint(g_variant_get_size(rgb), ==, (gsize)width * height * 3);
}

/* A slow computer may pause a new session before its first picture. The session is then continued
 * until there is a picture. */
static void pause_with_picture(struct fixture *fixture) {
    for (int i = 0; i < 200; i++) {
        g_autoptr(GError) error = NULL;
        tell(fixture, "Pause", NULL);
        wait_for_state(fixture, "paused");
        g_autoptr(GVariant) answer =
            call_on(fixture, BUS_NAME, "GetThumbnail", g_variant_new("(s)", "cam30"), &error);
        if (answer)
            return;
        g_autofree char *name = g_dbus_error_get_remote_error(error);
        g_assert_true(g_str_has_suffix(name, ".NoPicture"));
        tell(fixture, "Continue", NULL);
        wait_for_state(fixture, "running");
        for (int k = 0; k < 20; k++)
            g_main_context_iteration(NULL, FALSE);
    }
    g_error("there is no picture after 200 pauses");
}

static void test_capture(struct fixture *fixture, gconstpointer data) {
    GVariantBuilder options;
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    refused(fixture, "GetThumbnail", g_variant_new("(s)", "cam31"), "Unknown", "cam30, cam60");
    refused(fixture, "GetThumbnail", g_variant_new("(s)", "cam30"), "NoSession", NULL);
    refused(fixture, "Resume", resume_parameters(fixture->directory), "SessionFormat", NULL);
    g_variant_builder_init(&options, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&options, "{sv}", "hurry", g_variant_new_boolean(TRUE));
    refused(fixture, "Start",
            g_variant_new("(ssa{sv})", fixture->session, fixture->directory, &options), "Unknown",
            "hurry");

    tell(fixture, "Start", start_parameters(fixture->session, fixture->directory));
    assert_control(fixture, TRUE);
    refused(fixture, "Start", start_parameters(fixture->session, fixture->directory), "Busy",
            "mesorig abort");
    refused(fixture, "OpenRig", g_variant_new("(s)", RIG), "Busy", NULL);
    wait_for_state(fixture, "running");
    pause_with_picture(fixture);
    const int done = fixture->shots_done;
    assert_thumbnail(fixture);
    tell(fixture, "Continue", NULL);
    wait_for_state(fixture, "running");
    tell(fixture, "Abort", NULL);
    wait_for_state(fixture, "aborted");
    g_autoptr(GVariant) end = get(fixture, "PredictedEnd");
    g_assert_cmpuint(g_variant_get_uint64(end), ==, 0);

    while (g_main_context_iteration(NULL, FALSE))
        ;
    assert_control(fixture, FALSE);
    assert_thumbnail(fixture);
    refused(fixture, "Continue", NULL, "NoSession", NULL);
    refused(fixture, "Start", start_parameters(fixture->session, fixture->directory),
            "SessionExists", NULL);
    tell(fixture, "Resume", resume_parameters(fixture->directory));
    wait_for_state(fixture, "done");
    g_autoptr(GVariant) shots = get(fixture, "Shots");
    g_assert_cmpint(g_variant_get_int32(shots), >, done);
    g_assert_cmpint(fixture->shots_done, ==, g_variant_get_int32(shots));
    g_assert_cmpint(fixture->changes, >, 3);
    g_assert_cmpint(fixture->events, >, 0);
    g_assert_cmpint(fixture->thumbnails, >, 0);
    while (g_main_context_iteration(NULL, FALSE))
        ;
    assert_thumbnail(fixture);
    tell(fixture, "CloseRig", NULL);
    assert_control(fixture, FALSE);
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    refused(fixture, "GetThumbnail", g_variant_new("(s)", "cam30"), "NoSession", NULL);
}

/* Freed in the middle of everything: safe, no leak, and the session can be gone on with. */
static void test_end_while_running(struct fixture *fixture, gconstpointer data) {
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    tell(fixture, "Start", start_parameters(fixture->session, fixture->directory));
    wait_for_state(fixture, "running");
    tell(fixture, "CloseRig", NULL);
    assert_state(fixture, "closed");
    assert_control(fixture, FALSE);
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    tell(fixture, "Resume", resume_parameters(fixture->directory));
}

/* Who came first, or after, and only looks does not matter. */
static void test_client_gone(struct fixture *fixture, gconstpointer data) {
    g_autoptr(GDBusConnection) early = fixture->client;
    fixture->client = join(fixture);
    tell(fixture, "OpenRig", g_variant_new("(s)", RIG));
    g_dbus_connection_close_sync(early, NULL, NULL);
    g_autoptr(GDBusConnection) other = join(fixture);
    ok(g_dbus_connection_close_sync(other, NULL, ERR));
    assert_state(fixture, "idle");
    g_assert_cmpint(fixture->closed, ==, 0);
    ok(g_dbus_connection_close_sync(fixture->client, NULL, ERR));
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    while (fixture->closed == 0 && g_get_monotonic_time() < until)
        g_main_context_iteration(NULL, TRUE);
    g_assert_cmpint(fixture->closed, ==, 1);
}

static int raw_socket(const char *path) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    g_strlcpy(to.sun_path, path, sizeof(to.sun_path));
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    return connect(fd, (struct sockaddr *)&to, sizeof(to)) == 0 ? fd : -1;
}

static void test_garbage(struct fixture *fixture, gconstpointer data) {
    static const char *const hostile[] = {"", "\r\n\r\n", "GET / HTTP/1.1\r\n\r\n",
                                          "AUTH ANONYMOUS\r\nBEGIN\r\n",
                                          "AUTH DBUS_COOKIE_SHA1 00\r\n"};
    for (gsize i = 0; i < G_N_ELEMENTS(hostile); i++) {
        const int fd = raw_socket(fixture->socket);
        g_assert_cmpint(fd, >=, 0);
        g_assert_cmpint(write(fd, "\0", 1), ==, 1);
        g_assert_cmpint(write(fd, hostile[i], strlen(hostile[i])), >=, 0);
        close(fd);
    }
    assert_state(fixture, "closed");
}

/* Whether one is let in who says to be a user, as D-Bus writes that in hexadecimal. */
static gboolean is_let_in(const char *path, const char *user) {
    char words[64], answer[2];
    const int fd = raw_socket(path);
    const int n = g_snprintf(words, sizeof(words), "%cAUTH EXTERNAL %s\r\n", 0, user);
    if (fd < 0 || write(fd, words, (gsize)n) != n)
        return FALSE;
    const gboolean ok = read(fd, answer, 2) == 2 && memcmp(answer, "OK", 2) == 0;
    close(fd);
    return ok;
}

/* The same from a child that is somebody else. */
static gboolean child_is_let_in(struct fixture *fixture, uid_t uid, const char *user) {
    int status = -1;
    const pid_t child = fork();
    if (child == 0) {
        signal(SIGPIPE, SIG_IGN);
        _exit(setuid(uid) != 0 ? 2 : is_let_in(fixture->socket, user));
    }
    while (waitpid(child, &status, WNOHANG) == 0)
        g_main_context_iteration(NULL, FALSE);
    g_assert_true(WIFEXITED(status) && WEXITSTATUS(status) < 2);
    return WEXITSTATUS(status);
}

/* Not even one whom the file's mode lets in. */
static void test_other_user(struct fixture *fixture, gconstpointer data) {
    if (geteuid() != 0) {
        test_skip_or_fail("needs root, to be somebody else");
        return;
    }
    g_chmod(fixture->folder, 0755);
    g_chmod(fixture->socket, 0777);
    g_assert_true(child_is_let_in(fixture, 0, "30"));
    g_assert_false(child_is_let_in(fixture, 65534, "3635353334"));
    g_assert_false(child_is_let_in(fixture, 65534, "30"));
}

/* A thread of the server's lets clients in and then tells the main loop, which may end in between:
 * the fixture's end finds them still to be told. */
static void test_late_client(struct fixture *fixture, gconstpointer data) {
    for (int i = 0; i < 5; i++)
        g_dbus_connection_new_for_address(fixture->address,
                                          G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL,
                                          NULL, NULL);
    g_usleep(50000); /* they connect */
    for (int i = 0; i < 10; i++)
        g_main_context_iteration(NULL, FALSE); /* accepts one */
    g_usleep(50000);                           /* they are let in */
}

TEST(addresses) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *file = g_build_filename(folder, "file", NULL);
    g_autofree char *to_file = g_strconcat("unix:path=", file, NULL);
    const char *const bad[] = {"", "tcp:host=localhost", "unix:abstract=x", "unix:path=relative",
                               to_file};
    g_autoptr(Bus) bus = bus_new("unix:path=/x");
    g_file_set_contents(file, "precious", -1, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(bus_serve(bus, bad[i], &error));
        g_assert_nonnull(error);
    }
    g_assert_true(g_file_test(file, G_FILE_TEST_IS_REGULAR));
    g_unlink(file);

    /* A socket on which no process listens is replaced. A socket on which a process listens is not.
     */
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    g_strlcpy(to.sun_path, file, sizeof(to.sun_path));
    const int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    g_assert_cmpint(bind(fd, (struct sockaddr *)&to, sizeof(to)), ==, 0);
    close(fd);
    g_autoptr(GError) error = NULL;
    BusServer *server = ok(bus_serve(bus, to_file, ERR));
    g_assert_null(bus_serve(bus, to_file, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_ADDRESS_IN_USE);
    bus_unserve(bus, server);
}

BEFORE_TESTS {
    /* Faults of devices are logged as warnings. */
    g_log_set_always_fatal(G_LOG_LEVEL_CRITICAL | G_LOG_FATAL_MASK);
#define ADD(path, func) g_test_add(path, struct fixture, NULL, set_up, func, tear_down)
    ADD("/bus/closed", test_closed);
    ADD("/bus/open", test_open);
    ADD("/bus/changed-rig", test_changed_rig);
    ADD("/bus/validate", test_validate);
    ADD("/bus/limits", test_limits);
    ADD("/bus/cancel", test_cancel);
    ADD("/bus/capture", test_capture);
    ADD("/bus/end-while-running", test_end_while_running);
    ADD("/bus/client-gone", test_client_gone);
    ADD("/bus/garbage", test_garbage);
    ADD("/bus/other-user", test_other_user);
    ADD("/bus/late-client", test_late_client);
}
