#include "browser.h"

#include "base/json.h"
#include "lib/ok.h"
#include "lib/wait.h"
#include "process.h"

#include <gio/gio.h>
#include <json-glib/json-glib.h>
#include <libsoup/soup.h>
#include <string.h>

#define NARROWEST 500 /* px */

struct Browser {
    GSubprocess *driver;
    SoupSession *http;
    int port;
    char *session, *profile;
};

/* Returns the member "value" of the answer; json_node_unref(). body is JSON, or NULL for a request
 * without a body. */
static JsonNode *call(Browser *browser, const char *method, const char *path, const char *body) {
    g_autofree char *uri = g_strdup_printf("http://127.0.0.1:%d%s", browser->port, path);
    g_autoptr(SoupMessage) message = soup_message_new(method, uri);
    g_autoptr(GError) error = NULL;
    g_autoptr(JsonParser) parser = json_parser_new();
    if (body) {
        g_autoptr(GBytes) bytes = g_bytes_new(body, strlen(body));
        soup_message_set_request_body_from_bytes(message, "application/json", bytes);
    }
    g_autoptr(GBytes) answer = soup_session_send_and_read(browser->http, message, NULL, &error);
    g_assert_no_error(error);
    gsize length;
    const char *text = g_bytes_get_data(answer, &length);
    if (soup_message_get_status(message) != SOUP_STATUS_OK)
        g_error("%s %s: %.*s", method, path, (int)length, text);
    ok(json_parser_load_from_data(parser, text, (gssize)length, ERR));
    JsonObject *object = json_node_get_object(json_parser_get_root(parser));
    return json_node_copy(json_object_get_member(object, "value"));
}

static gboolean answers(int port) {
    g_autoptr(GSocketClient) client = g_socket_client_new();
    g_autoptr(GSocketConnection) connection =
        g_socket_client_connect_to_host(client, "127.0.0.1", (guint16)port, NULL, NULL);
    return connection != NULL;
}

static int free_port(void) {
    g_autoptr(GSocketListener) listener = g_socket_listener_new();
    const guint16 port = ok(g_socket_listener_add_any_inet_port(listener, NULL, ERR));
    g_socket_listener_close(listener);
    return port;
}

Browser *browser_new(int width, int height) {
    Browser *browser = g_new0(Browser, 1);
    browser->port = free_port();
    browser->http = soup_session_new_with_options("timeout", 3 * WAIT_S, NULL);
    browser->profile = g_dir_make_tmp("mesorig-browser-XXXXXX", NULL);
    g_autofree char *port = g_strdup_printf("--port=%d", browser->port);
    const char *const argv[] = {"chromedriver", port, NULL};
    browser->driver = process_start(
        G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL, argv);
    UNTIL (answers(browser->port))
        g_usleep(G_USEC_PER_SEC / 10);
    /* Chromium makes no window narrower than 500 pixels, but shows pages as if it were. */
    g_autofree char *phone =
        width < NARROWEST ? g_strdup_printf("\"mobileEmulation\": {\"deviceMetrics\": {\"width\": "
                                            "%d, \"height\": %d, \"pixelRatio\": 1, \"mobile\": "
                                            "false, \"touch\": false}}, ",
                                            width, height)
                          : g_strdup("");
    g_autofree char *wish = g_strdup_printf(
        "{\"capabilities\": {\"alwaysMatch\": {\"timeouts\": {\"script\": 240000}, "
        "\"goog:chromeOptions\": {%s\"args\": "
        "[\"--headless=new\","
        " \"--no-sandbox\", \"--disable-gpu\", \"--use-angle=swiftshader\", "
        "\"--enable-unsafe-swiftshader\", \"--disable-quic\", \"--no-first-run\", "
        "\"--disable-background-networking\", \"--disable-component-update\", \"--disable-sync\", "
        "\"--disable-dev-shm-usage\", \"--window-size=%d,%d\", \"--user-data-dir=%s\"]}}}}",
        phone, width, height, browser->profile);
    g_autoptr(JsonNode) value = call(browser, "POST", "/session", wish);
    browser->session =
        g_strdup(json_object_get_string_member(json_node_get_object(value), "sessionId"));
    return browser;
}

void browser_free(Browser *browser) {
    if (!browser)
        return;
    g_autofree char *path = g_strdup_printf("/session/%s", browser->session);
    const char *const remove[] = {"rm", "-rf", browser->profile, NULL};
    json_node_unref(call(browser, "DELETE", path, NULL));
    g_subprocess_force_exit(browser->driver);
    g_subprocess_wait(browser->driver, NULL, NULL);
    process_run(remove, NULL, NULL);
    g_object_unref(browser->driver);
    g_object_unref(browser->http);
    g_free(browser->session);
    g_free(browser->profile);
    g_free(browser);
}

void browser_open(Browser *browser, const char *uri) {
    g_autofree char *path = g_strdup_printf("/session/%s/url", browser->session);
    g_autofree char *body = g_strdup_printf("{\"url\": \"%s\"}", uri);
    json_node_unref(call(browser, "POST", path, body));
}

char *browser_value(Browser *browser, const char *expression) {
    g_autofree char *path = g_strdup_printf("/session/%s/execute/sync", browser->session);
    g_autofree char *script = g_strdup_printf("return String(%s);", expression);
    g_autoptr(GString) body = g_string_new("{\"args\": [], \"script\": ");
    json_append_string(body, script);
    g_string_append_c(body, '}');
    g_autoptr(JsonNode) value = call(browser, "POST", path, body->str);
    return g_strdup(json_node_get_string(value));
}

void browser_wait(Browser *browser, const char *expression) {
    for (int i = 0; i < 10 * WAIT_S; i++) {
        g_autofree char *value = browser_value(browser, expression);
        if (strcmp(value, "true") == 0)
            return;
        g_usleep(G_USEC_PER_SEC / 10);
    }
    g_autofree char *shown = browser_value(browser, "document.body.innerText");
    g_error("%s did not become true within %d s; the page shows:\n%s", expression, WAIT_S, shown);
}

void browser_press(Browser *browser, const char *id) {
    g_autofree char *ready = g_strdup_printf("!document.getElementById('%s').disabled && "
                                             "document.getElementById('%s').offsetParent !== null",
                                             id, id);
    g_autofree char *click = g_strdup_printf("document.getElementById('%s').click()", id);
    browser_wait(browser, ready);
    g_free(browser_value(browser, click));
}

void browser_set(Browser *browser, const char *id, const char *value) {
    g_autoptr(GString) text = g_string_new(NULL);
    json_append_string(text, value);
    g_autofree char *script = g_strdup_printf(
        "(e => { e.value = %s; e.dispatchEvent(new Event('input', {bubbles: true})); "
        "e.dispatchEvent(new Event('change', {bubbles: true})); })(document.getElementById('%s'))",
        text->str, id);
    g_free(browser_value(browser, script));
}

void browser_picture(Browser *browser, const char *id, const char *path) {
    g_autofree char *shown =
        g_strdup_printf("document.getElementById('%s').offsetParent !== null", id);
    g_autofree char *scroll = g_strdup_printf("document.getElementById('%s').scrollIntoView()", id);
    g_autofree char *place = g_strdup_printf("/session/%s/goog/cdp/execute", browser->session);
    browser_wait(browser, shown);
    g_free(browser_value(browser, scroll));
    g_usleep(G_USEC_PER_SEC / 2); /* frames and pictures are drawn later */
    g_autoptr(JsonNode) value =
        call(browser, "POST", place,
             "{\"cmd\": \"Page.captureScreenshot\", \"params\": {\"format\": \"jpeg\", "
             "\"quality\": 75}}");
    gsize n;
    const char *data = json_object_get_string_member(json_node_get_object(value), "data");
    g_autofree guchar *jpeg = g_base64_decode(data, &n);
    ok(g_file_set_contents(path, (const char *)jpeg, (gssize)n, ERR));
}
