/* mesorig-hooks: the executables that it runs, those of the package, and notifications. None of
 * them may delay the others or a capture. */
#include "hooks/hooks.h"

#include <glib/gstdio.h>
#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bus/bus.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/wait.h"
#include "rig/devices.h"

#define HOOKS BUILD_DIR "/bin/mesorig-hooks"

struct fixture {
    char *folder, *hooks_folder, *conf, *log, *out;
};

/* What this process has logged. */
static GString *logged;

static GLogWriterOutput take_log(GLogLevelFlags level, const GLogField *fields, gsize n,
                                 gpointer data) {
    for (gsize i = 0; i < n; i++)
        if (strcmp(fields[i].key, "MESSAGE") == 0)
            g_string_append_printf(logged, "%s\n", (const char *)fields[i].value);
    return level & (G_LOG_LEVEL_WARNING | G_LOG_LEVEL_MESSAGE)
               ? G_LOG_WRITER_HANDLED
               : g_log_writer_default(level, fields, n, data);
}

static void write_file(const char *path, const char *text, int mode) {
    ok(g_file_set_contents(path, text, -1, ERR));
    g_assert_cmpint(g_chmod(path, mode), ==, 0);
}

static void write_hook(const struct fixture *fixture, const char *name, const char *script,
                       int mode) {
    g_autofree char *path = g_build_filename(fixture->hooks_folder, name, NULL);
    g_autofree char *text = g_strdup_printf("#!/bin/sh\nout=%s/out\n%s\n", fixture->folder, script);
    write_file(path, text, mode);
}

static void write_conf(const struct fixture *fixture, double time_limit_s) {
    g_autofree char *text = g_strdup_printf("[hooks]\nfolder = %s\ntime_limit_s = %g\n",
                                            fixture->hooks_folder, time_limit_s);
    write_file(fixture->conf, text, 0644);
}

static void set_up(struct fixture *fixture, gconstpointer data) {
    fixture->folder = g_dir_make_tmp("mesorig-hooks-XXXXXX", NULL);
    fixture->hooks_folder = g_build_filename(fixture->folder, "hooks.d", NULL);
    fixture->conf = g_build_filename(fixture->folder, "hooks.conf", NULL);
    fixture->log = g_build_filename(fixture->folder, "log", NULL);
    fixture->out = g_build_filename(fixture->folder, "out", NULL);
    g_assert_cmpint(g_mkdir(fixture->hooks_folder, 0755), ==, 0);
    write_conf(fixture, 3);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->hooks_folder);
    g_free(fixture->conf);
    g_free(fixture->log);
    g_free(fixture->out);
}

/* With --check: until all is done. What it has logged; g_free(). */
static char *run_check(const struct fixture *fixture) {
    return process_text(0, (const char *[]){HOOKS, "--check", "--config", fixture->conf, NULL});
}

static char *read_out(const struct fixture *fixture) {
    char *text = NULL;
    return g_file_get_contents(fixture->out, &text, NULL, NULL) ? text : g_strdup("");
}

static void test_run(struct fixture *fixture, gconstpointer data) {
    write_hook(fixture, "20-second", "echo \"second $MESORIG_EVENT\" >>$out", 0755);
    write_hook(fixture, "10-first", "echo \"first $MESORIG_NAME: $(cat)\" >>$out; echo said", 0755);
    write_hook(fixture, "30-plain", "echo plain >>$out", 0644);
    write_hook(fixture, "40-backup~", "echo backup >>$out", 0755);
    write_hook(fixture, ".hidden", "echo hidden >>$out", 0755);
    g_autofree char *log = run_check(fixture), *out = read_out(fixture);
    g_auto(GStrv) lines = g_strsplit(out, "\n", -1);
    g_assert_cmpuint(g_strv_length(lines), ==, 3);
    g_assert_true(g_str_has_prefix(lines[0], "first check: {"));
    g_assert_cmpstr(lines[1], ==, "second queue-empty");
    assert_has(log, "10-first: said");
    g_autoptr(JsonParser) parser = json_parser_new();
    g_assert_true(json_parser_load_from_data(parser, lines[0] + strlen("first check: "), -1, NULL));
    JsonObject *object = json_node_get_object(json_parser_get_root(parser));
    g_assert_cmpstr(json_object_get_string_member(object, "event"), ==, "queue-empty");
    g_assert_cmpstr(json_object_get_string_member(object, "name"), ==, "check");
    g_assert_cmpint(json_object_get_int_member(object, "time"), >, 1700000000);
}

/* One that hangs with all it has started, one that fails, one that prints a megabyte, one that
 * reads nothing, one that leaves a process behind: the last one is run all the same. */
static void test_bad(struct fixture *fixture, gconstpointer data) {
    write_hook(fixture, "1-hangs",
               "sleep 987 & echo $! >>$out.pids; trap '' TERM; sleep 987; sleep 987", 0755);
    write_hook(fixture, "2-fails", "echo why >&2; exit 7", 0755);
    write_hook(fixture, "3-prints", "head -c 1000000 /dev/zero | tr '\\0' x", 0755);
    write_hook(fixture, "4-leaves", "sleep 987 & echo $! >>$out.pids", 0755);
    write_hook(fixture, "5-dies", "kill -SEGV $$", 0755);
    write_hook(fixture, "6-last", "echo last >>$out", 0755);
    g_autofree char *nothing = g_build_filename(fixture->hooks_folder, "7-no-program", NULL);
    write_file(nothing, "#!/no/such/program\n", 0755);
    const gint64 begin = g_get_monotonic_time();
    g_autofree char *log = run_check(fixture), *out = read_out(fixture);
    g_assert_cmpint(g_get_monotonic_time() - begin, <, WAIT_S * G_USEC_PER_SEC); /* not 987 s */
    g_assert_cmpstr(out, ==, "last\n");
    assert_has(log, "1-hangs took longer than its time limit of 3 s, and was ended");
    assert_has(log, "2-fails: why");
    assert_has(log, "2-fails failed with exit code 7");
    assert_has(log, "3-prints: 983616 further bytes of its output were dropped");
    assert_has(log, "5-dies ended by signal 11");
    assert_has(log, "7-no-program");
    g_assert_cmpuint(strlen(log), <, 40000);
    g_autofree char *path = g_strconcat(fixture->out, ".pids", NULL), *pids = NULL;
    g_assert_true(g_file_get_contents(path, &pids, NULL, NULL));
    g_auto(GStrv) each = g_strsplit(g_strchomp(pids), "\n", -1);
    g_assert_cmpuint(g_strv_length(each), ==, 2);
    for (char **pid = each; *pid; pid++) {
        g_autofree char *proc = g_strdup_printf("/proc/%s/cmdline", *pid), *line = NULL;
        for (int i = 0; i < 100; i++) {
            g_clear_pointer(&line, g_free);
            if (!g_file_get_contents(proc, &line, NULL, NULL) || !*line)
                break; /* gone, or nobody's child any more */
            g_usleep(G_USEC_PER_SEC / 20);
        }
        g_assert_true(!line || !*line);
    }
}

/* A file that other users could have written is not run. */
static void test_trusted(struct fixture *fixture, gconstpointer data) {
    write_hook(fixture, "1-open", "echo open >>$out", 0777);
    write_hook(fixture, "2-own", "echo own >>$out", 0755);
    if (geteuid() == 0) {
        write_hook(fixture, "3-other", "echo other >>$out", 0755);
        g_autofree char *path = g_build_filename(fixture->hooks_folder, "3-other", NULL);
        g_assert_cmpint(chown(path, 65534, 65534), ==, 0);
    }
    g_autofree char *log = run_check(fixture), *out = read_out(fixture);
    g_assert_cmpstr(out, ==, "own\n");
    assert_has(log, "1-open is not used: it belongs to user ");
    g_assert_cmpint(g_chmod(fixture->hooks_folder, 0777), ==, 0);
    g_unlink(fixture->out);
    g_autofree char *second = run_check(fixture), *none = read_out(fixture);
    g_assert_cmpstr(none, ==, "");
    assert_has(second, "hooks.d is not used");
}

/* Installs a hook of etc/hooks with lines for those of the same variables; ends with NULL. */
static void install(const struct fixture *fixture, const char *name, const char *const *lines) {
    g_autofree char *from = g_build_filename(SOURCE_DIR "/etc/hooks", name, NULL);
    g_autofree char *to = g_build_filename(fixture->hooks_folder, name, NULL);
    g_autofree char *text = NULL;
    ok(g_file_get_contents(from, &text, NULL, ERR));
    for (; *lines; lines++) {
        g_autofree char *variable = g_strndup(*lines, strcspn(*lines, "=") + 1);
        g_autofree char *before = g_strconcat("\n", variable, NULL);
        const char *at = strstr(text, before);
        g_assert_nonnull(at);
        g_autofree char *head = g_strndup(text, (gsize)(at + 1 - text));
        char *changed = g_strconcat(head, *lines, strchr(at + 1, '\n'), NULL);
        g_free(text);
        text = changed;
    }
    write_file(to, text, 0755);
}

static void test_mail(struct fixture *fixture, gconstpointer data) {
    g_autofree char *sendmail = g_build_filename(fixture->folder, "sendmail", NULL);
    g_autofree char *script = g_strdup_printf("#!/bin/sh\n(echo \"$@\"; cat) >%s\n", fixture->out);
    g_autofree char *path = g_strconcat(fixture->folder, ":", g_getenv("PATH"), NULL);
    write_file(sendmail, script, 0755);
    write_conf(fixture, 30);
    install(fixture, "50-mail", (const char *[]){"to=anna@lab.example", NULL});
    g_autofree char *variable = g_strconcat("PATH=", path, NULL);
    const char *const check[] = {"/usr/bin/env", variable,      HOOKS, "--check",
                                 "--config",     fixture->conf, NULL};
    g_autofree char *log = process_text(0, check), *out = read_out(fixture);
    g_assert_cmpstr(log, ==, "");
    g_assert_true(g_str_has_prefix(out, "-i -- anna@lab.example\n"));
    assert_has(out, "\nTo: anna@lab.example\nSubject: check: the queue is empty\n");
    assert_has(out, "\n\ncheck: the queue is empty\n\nmesorig-hooks --check: nothing has happened");
    g_unlink(fixture->out);
    install(fixture, "50-mail", (const char *[]){"events=fault", NULL});
    g_free(process_text(0, check));
    g_assert_false(g_file_test(fixture->out, G_FILE_TEST_EXISTS));
}

/* A web server of this process. */
struct server {
    SoupServer *soup;
    guint16 port;
    int n;
    guint status;
    int refusals; /* of the first posts */
    char *body, *authorization, *type;
};

static void on_post(SoupServer *soup, SoupServerMessage *message, const char *path,
                    GHashTable *query, gpointer data) {
    struct server *server = data;
    SoupMessageBody *body = soup_server_message_get_request_body(message);
    SoupMessageHeaders *headers = soup_server_message_get_request_headers(message);
    server->n++;
    g_assert_cmpstr(soup_server_message_get_method(message), ==, "POST");
    g_free(server->body);
    server->body = g_strndup(body->data, (gsize)body->length);
    g_free(server->authorization);
    server->authorization = g_strdup(soup_message_headers_get_one(headers, "Authorization"));
    g_free(server->type);
    server->type = g_strdup(soup_message_headers_get_one(headers, "Content-Type"));
    const gboolean refused = server->n <= server->refusals;
    soup_server_message_set_status(message, refused ? 503 : server->status, NULL);
}

static void server_begin(struct server *server) {
    *server = (struct server){.soup = soup_server_new(NULL, NULL), .status = 204};
    soup_server_add_handler(server->soup, NULL, on_post, server, NULL);
    ok(soup_server_listen_local(server->soup, 0, SOUP_SERVER_LISTEN_IPV4_ONLY, ERR));
    GSList *uris = soup_server_get_uris(server->soup);
    server->port = (guint16)g_uri_get_port(uris->data);
    g_slist_free_full(uris, (GDestroyNotify)g_uri_unref);
}

static void server_end(struct server *server) {
    soup_server_disconnect(server->soup);
    g_object_unref(server->soup);
    g_free(server->body);
    g_free(server->authorization);
    g_free(server->type);
}

static GVariant *some_details(void) {
    return g_variant_new_parsed("{'name': <'weave'>, 'session': <'/s/weave.session'>}");
}

/* Hooks of this process, until they have told one event. */
static void tell_one(const struct fixture *fixture) {
    g_auto(HooksConf) conf = {0};
    ok(hooks_conf_load(&conf, fixture->conf, ERR));
    g_autoptr(Hooks) hooks = hooks_new(&conf);
    hooks_tell(hooks, "fault", some_details());
    while (!hooks_is_idle(hooks))
        g_main_context_iteration(NULL, TRUE);
}

/* A server that refuses twice still gets the event. A server that does not answer is reported. */
static void test_webhook(struct fixture *fixture, gconstpointer data) {
    struct server server;
    server_begin(&server);
    g_autofree char *header = g_build_filename(fixture->folder, "header", NULL);
    g_autofree char *url = g_strdup_printf("url=http://127.0.0.1:%u/rig", server.port);
    g_autofree char *with = g_strconcat("header_file=", header, NULL);
    write_file(header, "Authorization: Bearer secret-1\n", 0600);
    write_conf(fixture, 60);
    install(fixture, "60-webhook", (const char *[]){url, with, NULL});
    server.refusals = 2;
    tell_one(fixture);
    g_assert_cmpint(server.n, ==, 3);
    g_assert_cmpstr(server.authorization, ==, "Bearer secret-1");
    g_assert_cmpstr(server.type, ==, "application/json");
    assert_has(server.body, "\"event\": \"fault\"");
    assert_has(server.body, "\"session\": \"/s/weave.session\"");
    server.status = 404;
    tell_one(fixture);
    assert_has(logged->str, "60-webhook: curl: (22) The requested URL returned error: 404\n");
    assert_has(logged->str, "60-webhook failed with exit code 22");
    server_end(&server);
}

static void test_mistakes(struct fixture *fixture, gconstpointer data) {
    write_file(fixture->conf, "[hooks]\ntime_limit_s = 0\n[mail]\nto = anna@lab.example\n", 0644);
    g_autofree char *said =
        process_text(1, (const char *[]){HOOKS, "--check", "--config", fixture->conf, NULL});
    assert_has(said, "2 mistakes");
    assert_has(said, "[hooks] time_limit_s: 0 is out of range");
    assert_has(said, "there is no such section: [hooks] is the only section of this file");
}

static void test_shipped(struct fixture *fixture, gconstpointer data) {
    g_auto(HooksConf) conf = {0};
    ok(hooks_conf_load(&conf, SOURCE_DIR "/etc/hooks.conf", ERR));
    g_assert_cmpstr(conf.folder, ==, "/etc/mesorig/hooks.d");
}

/* The desktop's service, on a bus of its own. */
struct screen {
    GString *shown;
    guint8 urgency;
};

static void on_notify(GDBusConnection *connection, const char *sender, const char *path,
                      const char *interface, const char *method, GVariant *parameters,
                      GDBusMethodInvocation *invocation, gpointer data) {
    struct screen *screen = data;
    const char *summary, *body;
    g_autoptr(GVariant) hints = NULL;
    g_variant_get(parameters, "(&su&s&s&sas@a{sv}i)", NULL, NULL, NULL, &summary, &body, NULL,
                  &hints, NULL);
    g_variant_lookup(hints, "urgency", "y", &screen->urgency);
    g_string_append_printf(screen->shown, "%s|%s\n", summary, body);
    g_dbus_method_invocation_return_value(invocation, g_variant_new("(u)", 1));
}

static void test_desktop(struct fixture *fixture, gconstpointer data) {
    static const char xml[] =
        "<node><interface name='org.freedesktop.Notifications'><method name='Notify'>"
        "<arg type='s' direction='in'/><arg type='u' direction='in'/>"
        "<arg type='s' direction='in'/><arg type='s' direction='in'/>"
        "<arg type='s' direction='in'/><arg type='as' direction='in'/>"
        "<arg type='a{sv}' direction='in'/><arg type='i' direction='in'/>"
        "<arg type='u' direction='out'/></method></interface></node>";
    static const GDBusInterfaceVTable vtable = {.method_call = on_notify};
    struct screen screen = {g_string_new(NULL), 9};
    GTestDBus *dbus = g_test_dbus_new(G_TEST_DBUS_NONE);
    g_test_dbus_up(dbus);
    GDBusConnection *service =
        g_dbus_connection_new_for_address_sync(g_test_dbus_get_bus_address(dbus),
                                               G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT |
                                                   G_DBUS_CONNECTION_FLAGS_MESSAGE_BUS_CONNECTION,
                                               NULL, NULL, NULL);
    GDBusNodeInfo *node = g_dbus_node_info_new_for_xml(xml, NULL);
    g_assert_nonnull(service);
    g_dbus_connection_register_object(service, "/org/freedesktop/Notifications",
                                      node->interfaces[0], &vtable, &screen, NULL, NULL);
    g_bus_own_name_on_connection(service, "org.freedesktop.Notifications",
                                 G_BUS_NAME_OWNER_FLAGS_NONE, NULL, NULL, NULL, NULL);
    g_assert_true(hooks_show(service, "hands",
                             g_variant_ref_sink(g_variant_new_parsed(
                                 "{'name': <'weave'>, 'message': <'lay <b> down'>}"))));
    UNTIL (screen.shown->len)
        g_main_context_iteration(NULL, FALSE);
    g_assert_cmpstr(screen.shown->str, ==,
                    "weave: somebody is needed at the rig|lay &lt;b&gt; down\n");
    g_assert_cmpuint(screen.urgency, ==, 2);
    /* And the program, on the same bus. */
    g_string_truncate(screen.shown, 0);
    g_setenv("DBUS_SESSION_BUS_ADDRESS", g_test_dbus_get_bus_address(dbus), TRUE);
    GSubprocess *program = process_start(G_SUBPROCESS_FLAGS_NONE, NULL,
                                         (const char *[]){HOOKS, "--desktop", "--check", NULL});
    UNTIL (strchr(screen.shown->str, '\n'))
        g_main_context_iteration(NULL, FALSE);
    g_subprocess_wait(program, NULL, NULL);
    g_assert_true(g_subprocess_get_successful(program));
    g_object_unref(program);
    assert_has(screen.shown->str, "check: the queue is empty|mesorig-hooks --check: nothing");
    g_dbus_connection_close_sync(service, NULL, NULL);
    g_object_unref(service);
    g_dbus_node_info_unref(node);
    g_string_free(screen.shown, TRUE);
    g_test_dbus_stop(dbus);
    g_object_unref(dbus);
}

static void wait_for_out(const struct fixture *fixture, const char *wanted) {
    g_autofree char *out = NULL;
    UNTIL (g_strcmp0(out, wanted) == 0) {
        g_usleep(G_USEC_PER_SEC / 10);
        g_free(out);
        out = read_out(fixture);
    }
}

/* after: what must come before it, or "". */
static void wait_for_log(const struct fixture *fixture, const char *after, const char *wanted) {
    g_autofree char *log = NULL;
    const char *at = NULL;
    UNTIL (at &&strstr(at, wanted)) {
        g_usleep(G_USEC_PER_SEC / 10);
        g_clear_pointer(&log, g_free);
        at = g_file_get_contents(fixture->log, &log, NULL, NULL) ? strstr(log, after) : NULL;
    }
}

static GSubprocess *start_daemon(const struct operation *run, const char *bus) {
    return process_start_ready(
        G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
        (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen", bus, "--rig", run->rig, NULL});
}

static void end(GSubprocess *program) {
    g_subprocess_send_signal(program, SIGTERM);
    g_subprocess_wait(program, NULL, NULL);
    g_assert_true(g_subprocess_get_successful(program));
    g_object_unref(program);
}

/* The whole way: a daemon captures, a hook that hangs is run for each event, and nothing waits for
 * it. The daemon comes after the program, at the address that the environment names, goes, and
 * comes again. */
static void test_capture(struct fixture *fixture, gconstpointer data) {
    struct operation *run = operator_new(NULL);
    g_autofree char *bus = g_strdup_printf("unix:path=%s/bus", run->directory);
    write_hook(fixture, "1-note", "echo \"$MESORIG_EVENT $MESORIG_SESSION\" >>$out; sleep 987",
               0755);
    g_autofree char *variable = g_strdup_printf("MESORIG_ADDRESS=%s", bus);
    GSubprocess *hooks = process_start_ready(
        G_SUBPROCESS_FLAGS_NONE, fixture->log,
        (const char *[]){"/usr/bin/env", variable, HOOKS, "--config", fixture->conf, NULL});
    g_autofree char *none = g_strdup_printf("mesorig-hooks: no mesorigd answers at %s", bus);
    wait_for_log(fixture, "", none);
    GSubprocess *daemon = start_daemon(run, bus);
    g_autofree char *answers = g_strdup_printf("mesorig-hooks: mesorigd answers at %s\n", bus);
    wait_for_log(fixture, "", answers);
    operator_does(run, 0, "capture", "--address", bus, run->rig, run->conf, "-o", run->session,
                  NULL);
    g_autofree char *wanted = g_strdup_printf("begun %s\ndone %s\n", run->session, run->session);
    wait_for_out(fixture, wanted);
    end(daemon);
    g_autofree char *ended = g_strdup_printf("mesorig-hooks: mesorigd at %s has ended", bus);
    wait_for_log(fixture, "", ended);
    daemon = start_daemon(run, bus);
    wait_for_log(fixture, ended, answers);
    g_autofree char *second = g_strconcat(run->directory, "/second.session", NULL);
    operator_does(run, 0, "capture", "--address", bus, run->rig, run->conf, "-o", second, NULL);
    g_autofree char *more = g_strdup_printf("%sbegun %s\ndone %s\n", wanted, second, second);
    wait_for_out(fixture, more);
    end(daemon);
    end(hooks);
    operator_free(run);
}

/* A daemon of this process, which reports what it is told to. */
static gboolean on_client(GDBusServer *server, GDBusConnection *connection, gpointer data) {
    GDBusConnection **ret = data;
    *ret = g_object_ref(connection);
    return TRUE;
}

static void report(GDBusConnection *connection, const char *level, const char *message) {
    ok(g_dbus_connection_emit_signal(connection, NULL, BUS_PATH, BUS_NAME, "Event",
                                     g_variant_new("(sss)", level, "top", message), ERR));
    g_dbus_connection_flush_sync(connection, NULL, NULL);
}

/* A laser that does not confirm that it is off, and then does. */
static void test_unsafe(struct fixture *fixture, gconstpointer data) {
    g_assert_cmpstr(hooks_what_of_event("error", DEVICES_UNSAFE ": laser top: why"), ==, "unsafe");
    g_assert_cmpstr(hooks_what_of_event("info", "confirmed off again"), ==, "confirmed");
    g_assert_cmpstr(hooks_what_of_event("info", "confirmed again that it stands still"), ==,
                    "confirmed");
    g_assert_null(hooks_what_of_event("error", "cannot open"));
    g_assert_null(hooks_what_of_event("info", "all shots are taken"));
    g_autofree char *address = g_strdup_printf("unix:path=%s/bus", fixture->folder);
    g_autofree char *guid = g_dbus_generate_guid();
    g_autoptr(GError) error = NULL;
    GDBusConnection *client = NULL;
    g_autoptr(GDBusServer) server =
        g_dbus_server_new_sync(address, G_DBUS_SERVER_FLAGS_NONE, guid, NULL, NULL, &error);
    g_assert_no_error(error);
    g_signal_connect(server, "new-connection", G_CALLBACK(on_client), &client);
    g_dbus_server_start(server);
    write_hook(fixture, "1-note",
               "echo \"$MESORIG_EVENT $MESORIG_DEVICE: $MESORIG_MESSAGE\" >>$out", 0755);
    GSubprocess *hooks = process_start(
        G_SUBPROCESS_FLAGS_NONE, NULL,
        (const char *[]){HOOKS, "--address", address, "--config", fixture->conf, NULL});
    while (!client)
        g_main_context_iteration(NULL, TRUE);
    /* It is not told when the program listens. */
    g_autofree char *out = g_strdup("");
    UNTIL (*out) {
        report(client, "info", "the rig is open");
        report(client, "error", DEVICES_UNSAFE ": laser top: no answer");
        g_usleep(G_USEC_PER_SEC / 2);
        g_free(out);
        out = read_out(fixture);
    }
    g_assert_true(g_str_has_prefix(out, "unsafe top: " DEVICES_UNSAFE ": laser top: no answer\n"));
    report(client, "info", "confirmed off again");
    UNTIL (strstr(out, "confirmed")) {
        g_usleep(G_USEC_PER_SEC / 10);
        g_free(out);
        out = read_out(fixture);
    }
    g_assert_true(g_str_has_suffix(out, "\nconfirmed top: confirmed off again\n"));
    g_assert_null(strstr(out, "open"));
    end(hooks);
    g_dbus_connection_close_sync(client, NULL, NULL);
    g_object_unref(client);
    g_dbus_server_stop(server);
    g_autoptr(GVariant) details = g_variant_ref_sink(hooks_details_of_event("top", "why"));
    g_autofree char *title = hooks_title("unsafe", details);
    g_assert_cmpstr(title, ==, "top: NOT SAFE: it may shine or move");
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    logged = g_string_new(NULL);
    g_log_set_writer_func(take_log, NULL, NULL);
    g_log_set_always_fatal(G_LOG_FATAL_MASK | G_LOG_LEVEL_CRITICAL);
#define ADD(name, func) g_test_add("/hooks/" name, struct fixture, NULL, set_up, func, tear_down)
    ADD("desktop", test_desktop); /* first: it forks, and there are no threads yet */
    ADD("run", test_run);
    ADD("bad", test_bad);
    ADD("trusted", test_trusted);
    ADD("mail", test_mail);
    ADD("webhook", test_webhook);
    ADD("mistakes", test_mistakes);
    ADD("shipped", test_shipped);
    ADD("capture", test_capture);
    ADD("unsafe", test_unsafe);
    const int result = operator_tests();
    g_string_free(logged, TRUE);
    return result;
}
