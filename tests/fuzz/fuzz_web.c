/* Requests to the web server, as bytes on a connection. The rig behind it is replaced here: it
 * answers immediately, or in the next round of the main loop. */
#include "fuzz.h"

#include "web/web_server.h"

#include <gio/gio.h>
#include <string.h>
#include <sys/socket.h>

#define TOKEN  "0123456789abcdef"
#define ROUNDS 200

struct WebRig {
    int n_calls;
};

struct question {
    WebRigPicture picture;
    WebRigDone done;
    gpointer data;
    gboolean refused;
};

static struct WebRig rig;

WebRig *web_rig_new(const char *address, const char *bus, GError **error) {
    return &rig;
}

void web_rig_free(WebRig *given) {
}

void web_rig_listen(WebRig *given, WebRigNews func, gpointer data) {
}

const char *web_rig_session(const WebRig *given) {
    return NULL;
}

char *web_rig_state(const WebRig *given) {
    return g_strdup("{}");
}

char *web_rig_events(const WebRig *given) {
    return g_strdup("[]");
}

char *web_rig_progress(const WebRig *given) {
    return g_strdup("{}");
}

static gboolean answer(gpointer data) {
    struct question *question = data;
    g_autoptr(GError) error = g_error_new_literal(G_IO_ERROR, G_IO_ERROR_FAILED, "no");
    struct web_picture picture = {g_bytes_new_static("png", 3), (char[]){"{}"}};
    const GError *why = question->refused ? error : NULL;
    if (question->picture)
        question->picture(why ? NULL : &picture, why, question->data);
    else
        question->done(NULL, why, question->data);
    g_bytes_unref(picture.png);
    g_free(question);
    return G_SOURCE_REMOVE;
}

static void ask(WebRigPicture picture, WebRigDone done, gpointer data, gboolean refused) {
    struct question *question = g_new0(struct question, 1);
    *question = (struct question){picture, done, data, refused};
    if (rig.n_calls++ % 2)
        g_idle_add(answer, question);
    else
        answer(question);
}

void web_rig_call(WebRig *given, const char *method, WebRigDone back, gpointer data) {
    ask(NULL, back, data, g_str_equal(method, "Abort"));
}

/* Methods with arguments are refused, because each of them would need an answer of its own type. */
void web_rig_call_with(WebRig *given, const char *method, GVariant *parameters, WebRigDone back,
                       gpointer data) {
    g_variant_unref(g_variant_ref_sink(parameters));
    ask(NULL, back, data, TRUE);
}

void web_rig_call_files(WebRig *given, const char *method, GVariant *parameters, WebRigFiles back,
                        gpointer data) {
    g_autoptr(GError) error = g_error_new_literal(G_IO_ERROR, G_IO_ERROR_FAILED, "no");
    g_variant_unref(g_variant_ref_sink(parameters));
    back(NULL, NULL, error, data);
}

void web_rig_picture(WebRig *given, const char *camera, WebRigPicture back, gpointer data) {
    g_assert_true(g_utf8_validate(camera, -1, NULL));
    ask(back, NULL, data, strlen(camera) % 2);
}

static guint16 port_of(const WebServer *server) {
    g_autofree char *text = web_server_uri(server);
    g_autoptr(GUri) uri = g_uri_parse(text, G_URI_FLAGS_NONE, NULL);
    return (guint16)g_uri_get_port(uri);
}

/* Until the server has nothing more to do, or for so many rounds. */
static void serve(GSocket *socket) {
    char bytes[4096];
    int idle = 0;
    for (int i = 0; i < ROUNDS && idle < 4; i++) {
        g_autoptr(GError) error = NULL;
        idle = g_main_context_iteration(NULL, FALSE) ? 0 : idle + 1;
        const gssize n =
            g_socket_receive_with_blocking(socket, bytes, sizeof bytes, FALSE, NULL, &error);
        if (n > 0)
            idle = 0;
        else if (n == 0 || !g_error_matches(error, G_IO_ERROR, G_IO_ERROR_WOULD_BLOCK))
            return;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static WebServer *server;
    static GSocketAddress *address;
    g_autoptr(GError) error = NULL;
    if (!server) {
        /* The corpus names no port, which is 80. */
        static const char *const hosts[] = {"localhost:80", "127.0.0.1:80", "[::1]:80", NULL};
        const struct web_options options = {.token = TOKEN, .hosts = hosts};
        server = web_server_new(&rig, &options, &error);
        g_assert_no_error(error);
        address = g_inet_socket_address_new_from_string("127.0.0.1", port_of(server));
    }
    rig.n_calls = 0;
    g_autoptr(GSocket) socket =
        g_socket_new(G_SOCKET_FAMILY_IPV4, G_SOCKET_TYPE_STREAM, G_SOCKET_PROTOCOL_TCP, &error);
    g_assert_no_error(error);
    g_socket_connect(socket, address, NULL, &error);
    g_assert_no_error(error);
    g_socket_send_with_blocking(socket, (const char *)data, size, FALSE, NULL, NULL);
    g_socket_shutdown(socket, FALSE, TRUE, NULL);
    serve(socket);
    /* Reset, so that no port of this side stays taken. */
    const struct linger at_once = {1, 0};
    setsockopt(g_socket_get_fd(socket), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
    g_socket_close(socket, NULL);
    for (int i = 0; i < 20 && g_main_context_iteration(NULL, FALSE); i++)
        ;
    return 0;
}
