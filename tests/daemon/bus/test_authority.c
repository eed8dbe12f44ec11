/* Who may call what: the table against interface and policy, polkit's answers, rights of folders.
 */
#include "bus/bus.h"
#include "bus/bus_authority.h"
#include "bus/bus_caller.h"
#include "bus/bus_errors.h"
#include "lib/text_file.h"

#include <glib/gstdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#define INTERFACE SOURCE_DIR "/etc/org.mesorig.Rig1.xml"
#define POLICY    SOURCE_DIR "/etc/polkit/org.mesorig.Rig1.policy"

TEST(table) {
    static const char *const free[] = {"SafeState", "Renew", NULL};
    g_autofree char *xml = text_file_read(INTERFACE), *policy = text_file_read(POLICY);
    g_autoptr(GError) error = NULL;
    GDBusNodeInfo *node = g_dbus_node_info_new_for_xml(xml, &error);
    gboolean known = TRUE;
    g_assert_no_error(error);
    g_assert_cmpint(g_strv_length((char **)node->interfaces), ==, 1);
    for (GDBusMethodInfo **method = node->interfaces[0]->methods; *method; method++) {
        const char *action = bus_authority_action((*method)->name, &known);
        g_autofree char *element = g_strdup_printf("<action id=\"%s\">", action);
        if (!known)
            g_error("%s has no row in daemon/bus/bus_authority.c", (*method)->name);
        g_assert_cmpint(!action, ==, g_strv_contains(free, (*method)->name));
        if (action && !strstr(policy, element))
            g_error("the action %s of %s is not in " POLICY, action, (*method)->name);
    }
    g_dbus_node_info_unref(node);
    g_assert_null(bus_authority_action("OpenSesame", &known));
    g_assert_false(known);
    g_assert_nonnull(strstr(policy, "<action id=\"org.mesorig.rig.calibrate\">"));
}

TEST(rights) {
    static const struct {
        guint mode;
        gboolean owner, member, stranger;
    } cases[] = {
        {0700, TRUE, FALSE, FALSE},  {0770, TRUE, TRUE, FALSE},   {0755, TRUE, FALSE, FALSE},
        {0777, TRUE, TRUE, TRUE},    {0070, FALSE, TRUE, FALSE},  {0707, TRUE, FALSE, TRUE},
        {0500, FALSE, FALSE, FALSE}, {0200, FALSE, FALSE, FALSE},
    };
    g_autofree char *folder = g_dir_make_tmp("mesorig-rights-XXXXXX", NULL);
    g_autofree char *inner = g_build_filename(folder, "inner", NULL);
    g_autofree char *new = g_build_filename(inner, "no", "such.session", NULL);
    g_autofree char *link = g_build_filename(folder, "link", NULL);
    struct stat info;
    g_assert_cmpint(g_mkdir(inner, 0700), ==, 0);
    g_assert_cmpint(symlink(inner, link), ==, 0);
    g_assert_cmpint(stat(inner, &info), ==, 0);
    const struct bus_caller owner = {info.st_uid, {0}, 0};
    const struct bus_caller member = {info.st_uid + 1, {info.st_gid + 1, info.st_gid}, 2};
    const struct bus_caller stranger = {info.st_uid + 1, {info.st_gid + 1}, 1};
    const char *const paths[] = {inner, new, link};
    g_assert_cmpint(g_chmod(folder, 0755), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_assert_cmpint(g_chmod(inner, (int)cases[i].mode), ==, 0);
        for (gsize k = 0; k < (geteuid() == 0 ? G_N_ELEMENTS(paths) : 1); k++) {
            g_assert_cmpint(bus_caller_may_write(&owner, paths[k], NULL), ==, cases[i].owner);
            g_assert_cmpint(bus_caller_may_write(&member, paths[k], NULL), ==, cases[i].member);
            g_assert_cmpint(bus_caller_may_write(&stranger, paths[k], NULL), ==, cases[i].stranger);
        }
    }
    /* What is above counts as well. */
    g_autoptr(GError) error = NULL;
    g_chmod(inner, 0777);
    g_chmod(folder, 0700);
    g_assert_false(bus_caller_may_write(&stranger, inner, &error));
    g_assert_error(error, BUS_ERROR, BUS_ERROR_DENIED);
    g_assert_nonnull(strstr(error->message, folder));
    g_assert_true(bus_caller_may_write(&owner, inner, NULL));
    g_assert_false(bus_caller_may_write(&owner, "/proc/self/status", NULL));
    remove_tree(folder);
}

/* A bus of its own, on which this process is everybody: mesorigd, polkit and a client. */
struct fixture {
    GTestDBus *dbus;
    GDBusConnection *daemon, *client, *polkit;
    Bus *bus;
    guint name;
    gboolean allows;
    gboolean hangs;
    GString *asked;
    GDBusMethodInvocation *waiting;
};

static void on_check(GDBusConnection *connection, const char *sender, const char *path,
                     const char *interface, const char *method, GVariant *parameters,
                     GDBusMethodInvocation *invocation, gpointer data) {
    struct fixture *fixture = data;
    const char *kind, *action, *name = NULL;
    g_autoptr(GVariant) subject = NULL;
    if (strcmp(method, "CheckAuthorization") != 0) {
        g_dbus_method_invocation_return_value(invocation, NULL);
        return;
    }
    g_variant_get(parameters, "((&s@a{sv})&sa{ss}u&s)", &kind, &subject, &action, NULL, NULL, NULL);
    g_assert_cmpstr(kind, ==, "system-bus-name");
    g_assert_true(g_variant_lookup(subject, "name", "&s", &name));
    g_assert_cmpstr(name, ==, g_dbus_connection_get_unique_name(fixture->client));
    g_string_append_printf(fixture->asked, "%s ", action);
    if (fixture->hangs)
        fixture->waiting = invocation;
    else
        g_dbus_method_invocation_return_value(
            invocation, g_variant_new("((bba{ss}))", fixture->allows, FALSE, NULL));
}

static GDBusConnection *connect_to(struct fixture *fixture) {
    GDBusConnection *connection = ok(
        g_dbus_connection_new_for_address_sync(g_test_dbus_get_bus_address(fixture->dbus),
                                               G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT |
                                                   G_DBUS_CONNECTION_FLAGS_MESSAGE_BUS_CONNECTION,
                                               NULL, NULL, ERR));
    return connection;
}

static void own(GDBusConnection *connection, const char *name) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) owned = g_dbus_connection_call_sync(
        connection, "org.freedesktop.DBus", "/org/freedesktop/DBus", "org.freedesktop.DBus",
        "RequestName", g_variant_new("(su)", name, 4), NULL, G_DBUS_CALL_FLAGS_NONE, -1, NULL,
        &error);
    g_assert_no_error(error);
}

static void add_polkit(struct fixture *fixture) {
    static const char xml[] =
        "<node><interface name='org.freedesktop.PolicyKit1.Authority'>"
        "<method name='CheckAuthorization'><arg type='(sa{sv})' direction='in'/>"
        "<arg type='s' direction='in'/><arg type='a{ss}' direction='in'/>"
        "<arg type='u' direction='in'/><arg type='s' direction='in'/>"
        "<arg type='(bba{ss})' direction='out'/></method>"
        "<method name='CancelCheckAuthorization'><arg type='s' direction='in'/></method>"
        "</interface></node>";
    static const GDBusInterfaceVTable vtable = {.method_call = on_check};
    GDBusNodeInfo *node = g_dbus_node_info_new_for_xml(xml, NULL);
    fixture->polkit = connect_to(fixture);
    g_assert_cmpuint(
        g_dbus_connection_register_object(fixture->polkit, "/org/freedesktop/PolicyKit1/Authority",
                                          node->interfaces[0], &vtable, fixture, NULL, NULL),
        >, 0);
    own(fixture->polkit, "org.freedesktop.PolicyKit1");
    g_dbus_node_info_unref(node);
}

static void set_up(struct fixture *fixture, gconstpointer data) {
    fixture->dbus = g_test_dbus_new(G_TEST_DBUS_NONE);
    g_test_dbus_up(fixture->dbus);
    g_setenv("DBUS_SYSTEM_BUS_ADDRESS", g_test_dbus_get_bus_address(fixture->dbus), TRUE);
    fixture->asked = g_string_new(NULL);
    fixture->daemon = connect_to(fixture);
    fixture->client = connect_to(fixture);
    if (data)
        add_polkit(fixture);
    fixture->bus = bus_new("system");
    ok(bus_export(fixture->bus, fixture->daemon, ERR));
    own(fixture->daemon, BUS_NAME);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    bus_free(fixture->bus);
    while (g_main_context_iteration(NULL, FALSE))
        ;
    GDBusConnection **const all[] = {&fixture->client, &fixture->daemon, &fixture->polkit};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        if (*all[i])
            g_dbus_connection_close_sync(*all[i], NULL, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        g_clear_object(all[i]);
    g_test_dbus_stop(fixture->dbus);
    g_object_unref(fixture->dbus);
    g_string_free(fixture->asked, TRUE);
}

static void take_result(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

static void begin(struct fixture *fixture, const char *method, GVariant *parameters,
                  GAsyncResult **ret_result) {
    *ret_result = NULL;
    g_dbus_connection_call(fixture->client, BUS_NAME, BUS_PATH, BUS_NAME, method, parameters, NULL,
                           G_DBUS_CALL_FLAGS_NONE, 60000, NULL, take_result, ret_result);
}

/* Which error it ends with. Without a rig and a session every call ends with one. */
static void finish(struct fixture *fixture, GAsyncResult **result, enum bus_error code) {
    g_autoptr(GError) error = NULL;
    while (!*result)
        g_main_context_iteration(NULL, TRUE);
    g_assert_null(g_dbus_connection_call_finish(fixture->client, *result, &error));
    g_assert_error(error, BUS_ERROR, (int)code);
    g_clear_object(result);
}

static void call(struct fixture *fixture, const char *method, GVariant *parameters,
                 enum bus_error code) {
    GAsyncResult *result;
    begin(fixture, method, parameters, &result);
    finish(fixture, &result, code);
}

static GVariant *start_with(const char *options) {
    return g_variant_new("(ss@a{sv})", "/x", "/y", g_variant_new_parsed(options));
}

static void test_asked(struct fixture *fixture, gconstpointer data) {
    call(fixture, "Pause", NULL, BUS_ERROR_DENIED);
    call(fixture, "CloseRig", NULL, BUS_ERROR_DENIED);
    call(fixture, "SetLaser", g_variant_new("(sbd)", "top", TRUE, 1.0), BUS_ERROR_DENIED);
    call(fixture, "Start", start_with("@a{sv} {}"), BUS_ERROR_DENIED);
    call(fixture, "Start", start_with("{'calibration': <'/z'>}"), BUS_ERROR_DENIED);
    call(fixture, "QueueAdd", start_with("@a{sv} {}"), BUS_ERROR_DENIED);
    call(fixture, "QueueAdd", start_with("{'calibration': <'/z'>}"), BUS_ERROR_DENIED);
    call(fixture, "QueueRemove", g_variant_new("(u)", 1), BUS_ERROR_DENIED);
    call(fixture, "QueueResume", NULL, BUS_ERROR_DENIED);
    call(fixture, "SafeState", NULL, BUS_ERROR_NO_RIG);
    call(fixture, "SetLaser", g_variant_new("(sbd)", "top", FALSE, 0.0), BUS_ERROR_NO_RIG);
    g_assert_cmpstr(fixture->asked->str, ==,
                    "org.mesorig.rig.capture org.mesorig.rig.administer org.mesorig.rig.laser "
                    "org.mesorig.rig.capture org.mesorig.rig.calibrate "
                    "org.mesorig.rig.capture org.mesorig.rig.calibrate "
                    "org.mesorig.rig.capture org.mesorig.rig.capture ");
    fixture->allows = TRUE;
    call(fixture, "Pause", NULL, BUS_ERROR_NO_SESSION);
    call(fixture, "CloseRig", NULL, BUS_ERROR_NO_RIG);
    call(fixture, "SetLaser", g_variant_new("(sbd)", "top", TRUE, 1.0), BUS_ERROR_NO_RIG);
    call(fixture, "QueueResume", NULL, BUS_ERROR_FAILED); /* this daemon keeps no queue */
}

/* A polkit that does not answer delays nobody else, and SafeState ends what it was asked about. */
static void test_hangs(struct fixture *fixture, gconstpointer data) {
    GAsyncResult *pause, *more[70];
    fixture->hangs = TRUE;
    begin(fixture, "Pause", NULL, &pause);
    while (!fixture->waiting)
        g_main_context_iteration(NULL, TRUE);
    g_assert_null(pause);
    call(fixture, "SetLaser", g_variant_new("(sbd)", "top", FALSE, 0.0), BUS_ERROR_NO_RIG);
    g_assert_null(pause);
    call(fixture, "SafeState", NULL, BUS_ERROR_NO_RIG);
    finish(fixture, &pause, BUS_ERROR_CANCELLED);
    /* polkit answers in the end. Otherwise this call and the 64 calls below with their
     * cancellations would be more than the 128 pending replies that the test's bus allows. */
    g_dbus_method_invocation_return_dbus_error(g_steal_pointer(&fixture->waiting),
                                               "org.freedesktop.PolicyKit1.Error.Cancelled",
                                               "cancelled");
    /* So many may wait. The client's own limit of calls counts those before. */
    for (int i = 0; i < 70; i++) {
        begin(fixture, "Pause", NULL, &more[i]);
        while (i < 64 && !fixture->waiting)
            g_main_context_iteration(NULL, TRUE);
        g_clear_object(&fixture->waiting);
        if (i >= 64)
            finish(fixture, &more[i], BUS_ERROR_LIMIT);
    }
    call(fixture, "SafeState", NULL, BUS_ERROR_NO_RIG);
    for (int i = 0; i < 64; i++)
        finish(fixture, &more[i], BUS_ERROR_CANCELLED);
}

static void test_absent(struct fixture *fixture, gconstpointer data) {
    call(fixture, "Pause", NULL, BUS_ERROR_NO_SESSION);
    call(fixture, "CloseRig", NULL, BUS_ERROR_NO_RIG);
}

/* polkit's library keeps its first connection: one bus a process. */
static void test_alone(gconstpointer path) {
    g_test_trap_subprocess(path, 60 * G_USEC_PER_SEC, 0);
    g_test_trap_assert_passed();
}

BEFORE_TESTS {
    bus_errors_register();
#define ADD(name, func, polkit)                                                                    \
    g_test_add_data_func("/authority/" name, "/authority/" name "/subprocess", test_alone);        \
    g_test_add("/authority/" name "/subprocess", struct fixture, polkit, set_up, func, tear_down)
    ADD("asked", test_asked, "");
    ADD("hangs", test_hangs, "");
    ADD("absent", test_absent, NULL);
}
