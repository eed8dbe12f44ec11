/*
 * The web server of a rig: a page, an HTTP interface and a stream of server-sent events, described
 * in docs/operate/web.md. Everyone who reaches the port may read. If safe_needs_token is not set,
 * everyone may also make the rig safe. All other requests need the token.
 *
 * Requests from pages of other sites are refused:
 * - The header Host must be a name of this server, against DNS rebinding.
 * - If there is a header Origin, it must be the same name with scheme and port.
 * - No response allows other origins.
 *
 * The limits of connections and times are in web_door.h. All functions belong to the main loop's
 * thread.
 */
#pragma once

#include "web_rig.h"

struct web_options {
    const char *address; /* IP address to listen on; NULL for the loopback addresses */
    guint port;          /* 0 for any free port */
    const char *token;   /* token for commands; NULL if no client may send commands */
    gboolean safe_needs_token;
    /* Further names of the server: NAME, NAME:PORT or https://NAME. NULL means none. */
    const char *const *hosts;
    /* Absolute path of the folder of session files and session directories; NULL if there is none
     */
    const char *sessions;
};

#define WEB_PORT 8470

typedef struct WebServer WebServer;

/* Starts the server. rig is not owned and must live longer than the server. Returns NULL with an
 * error if the port cannot be opened or a name in hosts is not valid. */
WebServer *web_server_new(WebRig *rig, const struct web_options *options, GError **error);
void web_server_free(WebServer *server); /* NULL is ignored */

/* Returns the address of the page, such as "http://127.0.0.1:8470/". Free it with g_free(). */
char *web_server_uri(const WebServer *server);
