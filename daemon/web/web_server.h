/*
 * The web server of a rig: a page, an HTTP interface and a stream of server-sent events, described
 * in docs/web.md. Everyone who reaches the port may read; requests that change something need the
 * token. Requests of other sites' pages are refused: the token is a header, which such a page
 * cannot send, the Host must be a name of this server (against DNS rebinding), and no response
 * allows other origins. One thread, the one that runs the main loop.
 */
#pragma once

#include "web_rig.h"

struct web_options {
    const char *address;      /* IP address to listen on; NULL: loopback alone */
    guint port;               /* 0: any that is free */
    const char *token;        /* NULL: nothing acts */
    const char *const *hosts; /* names under which it is reached, beside the address and localhost;
                                 NULL: none */
};

#define WEB_PORT 8470

typedef struct WebServer WebServer;

/* Borrows rig, which must outlive it. */
WebServer *web_server_new(WebRig *rig, const struct web_options *options, GError **error);
void web_server_free(WebServer *server); /* NULL is ignored */

/* "http://127.0.0.1:8470/"; g_free(). */
char *web_server_uri(const WebServer *server);
