/* mesorig-web: shows a rig in the browser. It is a separate process, and needs no rights except to
 * call the daemon. */
#include "base/program.h"
#include "bus/bus_client.h"
#include "web_server.h"

#include <errno.h>
#include <glib-unix.h>
#include <stdlib.h>
#include <string.h>
#include <systemd/sd-daemon.h>

#define MIN_TOKEN 16   /* minimum length of the token in characters */
#define MAX_TOKEN 4096 /* maximum size of the token's file in bytes */

static char *address, *bus, *listen_address, *token_path, *sessions;
static char **hosts;
static int port = WEB_PORT;
static gboolean safe_needs_token;

static const GOptionEntry entries[] = {
    {"port", 0, 0, G_OPTION_ARG_INT, &port, "Listen on this port; 0: any free port (8470)", "N"},
    {"listen", 0, 0, G_OPTION_ARG_STRING, &listen_address,
     "Listen on this IP address, so that other machines can connect (only this machine can)", "IP"},
    {"host", 0, 0, G_OPTION_ARG_STRING_ARRAY, &hosts,
     "Accept requests for this name of the server: NAME, NAME:PORT, or https://NAME behind a "
     "proxy "
     "with TLS; may be repeated",
     "NAME"},
    {"token-file", 0, 0, G_OPTION_ARG_FILENAME, &token_path,
     "Let clients that send the first line of this file capture, pause, continue, finish, abort "
     "and release the rig (no client may)",
     "FILE"},
    {"safe-needs-token", 0, 0, G_OPTION_ARG_NONE, &safe_needs_token,
     "Do not let clients without the token make the rig safe (all clients may)", NULL},
    {"sessions", 0, 0, G_OPTION_ARG_FILENAME, &sessions,
     "Show the session files and session directories in this folder, and let clients with the "
     "token "
     "capture them there (none)",
     "DIR"},
    {"bus", 0, 0, G_OPTION_ARG_STRING, &bus, "The daemon's bus: system or session (system)", "BUS"},
    {"address", 0, 0, G_OPTION_ARG_STRING, &address,
     "Connect to the daemon's own socket, not to a bus (MESORIG_ADDRESS in the environment)",
     "unix:path=…"},
    {NULL},
};

static gboolean on_signal(gpointer data) {
    g_main_loop_quit(data);
    return G_SOURCE_CONTINUE;
}

/* Returns the first line of the token file; g_free(). Returns NULL with an error if the file cannot
 * be read or the line is not a token. */
static char *read_token(GError **error) {
    g_autofree char *text = NULL;
    gsize length;
    if (!g_file_get_contents(token_path, &text, &length, error))
        return NULL;
    text[strcspn(text, "\r\n")] = '\0';
    if (length > MAX_TOKEN) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "%s has %zu bytes, and the file of a token has at most %d; make a token with: "
                    "openssl rand -hex 24",
                    token_path, length, MAX_TOKEN);
        return NULL;
    }
    if (strlen(text) < MIN_TOKEN ||
        strspn(text, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~+/=") !=
            strlen(text)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "the first line of %s is not a token of at least %d letters, digits and "
                    "characters of -._~+/=; make a token with: openssl rand -hex 24",
                    token_path, MIN_TOKEN);
        return NULL;
    }
    return g_steal_pointer(&text);
}

/* Returns the absolute path of the folder of --sessions, without links; free(). */
static char *find_folder(GError **error) {
    char *path = realpath(sessions, NULL);
    if (path && g_file_test(path, G_FILE_TEST_IS_DIR))
        return path;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                "--sessions %s: %s; give a folder with session files, to which mesorig-web has "
                "access",
                sessions, path ? "this is no folder" : g_strerror(errno));
    free(path);
    return NULL;
}

static int serve(GError **error) {
    g_autofree char *token = NULL;
    if (token_path && !(token = read_token(error)))
        return 1;
    g_autofree char *folder = NULL;
    if (sessions && !(folder = find_folder(error)))
        return 1;
    WebRig *rig = web_rig_new(address ? address : bus ? NULL : bus_client_address(), bus, error);
    const struct web_options options = {.address = listen_address,
                                        .port = (guint)port,
                                        .token = token,
                                        .safe_needs_token = safe_needs_token,
                                        .hosts = (const char *const *)hosts,
                                        .sessions = folder};
    WebServer *server = rig ? web_server_new(rig, &options, error) : NULL;
    if (server) {
        g_autoptr(GMainLoop) loop = g_main_loop_new(NULL, FALSE);
        g_autofree char *uri = web_server_uri(server);
        g_unix_signal_add(SIGINT, on_signal, loop);
        g_unix_signal_add(SIGTERM, on_signal, loop);
        g_print("%s%s\n", uri,
                token ? ""
                      : " (clients may only read and make the rig safe; --token-file allows other "
                        "commands)");
        sd_notify(0, "READY=1");
        g_main_loop_run(loop);
    }
    const int code = server ? 0 : 1;
    web_server_free(server);
    web_rig_free(rig);
    return code;
}

static const struct command_line command_line = {
    .name = "mesorig-web",
    .summary = "Shows a rig in the browser.",
    .options = entries,
};

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    program_parse(&command_line, &argc, &argv);
    if (port < 0 || port > 65535)
        return program_usage(&command_line, "--port=%d is out of range: 0 to 65535", port);
    if (safe_needs_token && !token_path)
        return program_usage(&command_line, "--safe-needs-token needs --token-file");
    if (bus && !bus_client_is_bus(bus))
        return program_usage(&command_line, BUS_CLIENT_NO_BUS, bus);
    const int code = serve(&error);
    if (error)
        g_printerr("mesorig-web: %s\n", error->message);
    return code;
}
