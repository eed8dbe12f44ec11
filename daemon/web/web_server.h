/*
 * The web server of a rig: a page, an HTTP interface and a stream of server-sent events, described
 * in docs/operate/web.md. Everyone who reaches the port may read and make the rig safe; requests
 * that change anything else need the token. Requests of other sites' pages are refused: Host must
 * be a name of this server (against DNS rebinding), Origin the same name with scheme and port, and
 * no response allows other origins. web_door.h says what a client may take. One thread, the one
 * that runs the main loop.
 */
#pragma once

#include "web_rig.h"

struct web_options {
    const char *address; /* IP address to listen on; NULL: loopback only */
    guint port;          /* 0: any that is free */
    const char *token;   /* NULL: nobody may send commands */
    gboolean safe_needs_token;
    const char *const *hosts; /* further names under which it is reached: NAME, NAME:PORT or
                                 https://NAME; NULL: none */
};

#define WEB_PORT 8470

typedef struct WebServer WebServer;

/* Borrows rig, which must outlive it. */
WebServer *web_server_new(WebRig *rig, const struct web_options *options, GError **error);
void web_server_free(WebServer *server); /* NULL is ignored */

/* "http://127.0.0.1:8470/"; g_free(). */
char *web_server_uri(const WebServer *server);
