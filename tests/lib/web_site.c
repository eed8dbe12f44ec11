#include "web_site.h"
#include "lib/ok.h"
#include "lib/wait.h"

#include <string.h>

static void start_daemon(struct site *site, int flags) {
    g_autofree char *queue = g_build_filename(site->run->directory, "queue", NULL);
    const char *argv[8] = {BUILD_DIR "/bin/mesorigd", "--listen", site->bus};
    int n = 3;
    if (flags & SITE_RIG) {
        argv[n++] = "--rig";
        argv[n++] = site->run->rig;
    }
    if (flags & SITE_QUEUE) {
        argv[n++] = "--queue";
        argv[n++] = queue;
    }
    site->daemon = process_start_ready(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL, argv);
}

void site_start_daemon(struct site *site) {
    start_daemon(site, 0);
}

static struct site *start(int flags, const struct change *changes,
                          void (*write)(const char *folder)) {
    struct site *site = g_new0(struct site, 1);
    g_autoptr(GError) error = NULL;
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    site->run = operator_new(changes);
    site->bus = g_strdup_printf("unix:path=%s/bus", site->run->directory);
    site->log = g_build_filename(site->run->directory, "web.log", NULL);
    g_autofree char *token = g_build_filename(site->run->directory, "token", NULL);
    g_assert_true(g_file_set_contents(token, SITE_TOKEN "\n", -1, NULL));
    if (write)
        write(site->run->directory);
    start_daemon(site, flags);
    /* If libsoup is told to continue a message that has already ended, this is an error of the
     * server. */
    const char *const common[] = {"/usr/bin/env",
                                  "G_DEBUG=fatal-criticals",
                                  BUILD_DIR "/bin/mesorig-web",
                                  "--address",
                                  site->bus,
                                  "--port",
                                  "0"};
    for (gsize i = 0; i < G_N_ELEMENTS(common); i++)
        g_ptr_array_add(argv, (gpointer)common[i]);
    if (!(flags & SITE_SHOWS)) {
        g_ptr_array_add(argv, "--token-file");
        g_ptr_array_add(argv, token);
    }
    if (flags & SITE_SAFE_NEEDS_TOKEN)
        g_ptr_array_add(argv, "--safe-needs-token");
    if (flags & SITE_SESSIONS) {
        g_ptr_array_add(argv, "--sessions");
        g_ptr_array_add(argv, site->run->directory);
    }
    g_ptr_array_add(argv, NULL);
    site->server =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_PIPE, site->log, (const char *const *)argv->pdata);
    g_autoptr(GDataInputStream) out =
        g_data_input_stream_new(g_subprocess_get_stdout_pipe(site->server));
    site->uri = ok(g_data_input_stream_read_line(out, NULL, NULL, ERR));
    g_assert_nonnull(site->uri);
    site->uri[strcspn(site->uri, " ")] = '\0';
    g_autoptr(GUri) uri = g_uri_parse(site->uri, G_URI_FLAGS_NONE, &error);
    g_assert_no_error(error);
    site->port = (guint16)g_uri_get_port(uri);
    site->http = soup_session_new_with_options("timeout", SITE_WAIT_S, NULL);
    return site;
}

struct site *site_new(int flags, const struct change *changes) {
    return start(flags, changes, NULL);
}

struct site *site_new_of(int flags, void (*write)(const char *folder)) {
    return start(flags, NULL, write);
}

static void call_daemon(const struct site *site, const char *method, GVariant *arguments) {
    g_autoptr(GDBusConnection) bus = ok(g_dbus_connection_new_for_address_sync(
        site->bus, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, ERR));
    g_variant_unref(ok(g_dbus_connection_call_sync(
        bus, NULL, "/org/mesorig/Rig1", "org.mesorig.Rig1", method, arguments, NULL,
        G_DBUS_CALL_FLAGS_NONE, SITE_WAIT_S * 1000, NULL, ERR)));
}

void site_open(const struct site *site) {
    call_daemon(site, "OpenRig", g_variant_new("(s)", site->run->rig));
}

void site_reopen(const struct site *site) {
    call_daemon(site, "CloseRig", NULL);
    site_open(site);
}

void site_free(struct site *site) {
    GSubprocess *const processes[] = {site->server, site->daemon};
    g_autofree char *log = NULL;
    for (gsize i = 0; i < G_N_ELEMENTS(processes); i++) {
        g_subprocess_send_signal(processes[i], SIGTERM);
        g_subprocess_wait(processes[i], NULL, NULL);
        if (!g_subprocess_get_successful(processes[i]) &&
            g_file_get_contents(site->log, &log, NULL, NULL))
            g_error("%s has not ended well; mesorig-web said: %s",
                    i == 0 ? "mesorig-web" : "mesorigd", log);
        g_object_unref(processes[i]);
    }
    g_object_unref(site->http);
    operator_free(site->run);
    g_free(site->bus);
    g_free(site->uri);
    g_free(site->log);
    g_free(site);
}

void site_capture(struct site *site) {
    operator_does(site->run, 0, "capture", "--address", site->bus, site->run->rig, site->run->conf,
                  "-o", site->run->session, NULL);
}

guint site_ask(const struct site *site, const char *method, const char *path, const char *header,
               char **ret) {
    g_autofree char *uri = g_strconcat(site->uri, path, NULL);
    g_autoptr(SoupMessage) message = soup_message_new(method, uri);
    g_autoptr(GError) error = NULL;
    if (header) {
        g_auto(GStrv) parts = g_strsplit(header, ": ", 2);
        soup_message_headers_replace(soup_message_get_request_headers(message), parts[0], parts[1]);
    }
    g_autoptr(GBytes) answer = soup_session_send_and_read(site->http, message, NULL, &error);
    g_assert_no_error(error);
    /* Pages of other sites must not be allowed to read any answer. */
    g_assert_null(soup_message_headers_get_one(soup_message_get_response_headers(message),
                                               "Access-Control-Allow-Origin"));
    gsize length;
    const char *text = g_bytes_get_data(answer, &length);
    if (ret)
        *ret = g_strndup(text, length);
    return soup_message_get_status(message);
}

GSocket *site_dial(const struct site *site, const char *from) {
    g_autoptr(GSocketAddress) own = g_inet_socket_address_new_from_string(from, 0);
    g_autoptr(GSocketAddress) server =
        g_inet_socket_address_new_from_string("127.0.0.1", site->port);
    GSocket *socket =
        ok(g_socket_new(G_SOCKET_FAMILY_IPV4, G_SOCKET_TYPE_STREAM, G_SOCKET_PROTOCOL_TCP, ERR));
    g_socket_set_timeout(socket, SITE_WAIT_S);
    ok(g_socket_bind(socket, own, FALSE, ERR));
    ok(g_socket_connect(socket, server, NULL, ERR));
    return socket;
}

void site_send(GSocket *socket, const char *text) {
    const gsize n = strlen(text);
    for (gsize at = 0; at < n;) {
        const gssize sent = ok(g_socket_send(socket, text + at, n - at, NULL, ERR));
        at += (gsize)sent;
    }
}

char *site_receive(GSocket *socket, const char *until) {
    g_autoptr(GString) text = g_string_new(NULL);
    g_autoptr(GError) error = NULL;
    char bytes[4096];
    gssize n;
    while (!(until && strstr(text->str, until)) &&
           (n = g_socket_receive(socket, bytes, sizeof bytes, NULL, &error)) > 0)
        g_string_append_len(text, bytes, n);
    if (error && !g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CONNECTION_CLOSED))
        g_assert_no_error(error);
    return g_strdup(text->str);
}

char *site_converse(const struct site *site, const char *from, const char *request) {
    g_autoptr(GSocket) socket = site_dial(site, from);
    g_autofree char *name = g_strdup_printf("127.0.0.1:%u", site->port);
    g_autoptr(GString) text = g_string_new(request);
    g_string_replace(text, "$", name, 0);
    site_send(socket, text->str);
    return site_receive(socket, NULL);
}

guint site_status(const char *answer) {
    return g_str_has_prefix(answer, "HTTP/1.") && strlen(answer) > 12 ? (guint)atoi(answer + 9) : 0;
}

char *site_does(const struct site *site, guint status, const char *path) {
    char *said = NULL;
    const guint is = site_ask(site, "POST", path, "Authorization: Bearer " SITE_TOKEN, &said);
    if (is != status)
        g_error("POST %s: %u, not %u: %s", path, is, status, said);
    return said;
}

char *site_look(const struct site *site, const char *path) {
    char *text = NULL;
    g_assert_cmpuint(site_ask(site, "GET", path, NULL, &text), ==, 200);
    return text;
}

void site_wait(const struct site *site, const char *path, const char *words, gboolean has) {
    g_autofree char *text = NULL;
    for (int i = 0; i < 10 * SITE_WAIT_S; i++) {
        g_free(text);
        text = site_look(site, path);
        if ((strstr(text, words) != NULL) == has)
            return;
        g_usleep(G_USEC_PER_SEC / 10);
    }
    g_error("within %d s %s %s %s: %s", SITE_WAIT_S, path, has ? "did not have" : "had", words,
            text);
}

Browser *site_browse(const struct site *site, int width, int height) {
    Browser *browser = browser_new(width, height);
    browser_open(browser, site->uri);
    return browser;
}

void site_unlock(Browser *browser) {
    browser_press(browser, "unlock");
    browser_set(browser, "token", SITE_TOKEN);
    g_free(browser_value(browser, "document.getElementById('token-form').requestSubmit()"));
    browser_wait(browser, "document.getElementById('unlock').hidden");
}
