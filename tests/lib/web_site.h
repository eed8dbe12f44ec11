/* A daemon of the small simulated rig, which has opened no rig yet, and a web server (mesorig-web)
 * of it, for tests. What goes wrong in here fails the test. */
#pragma once

#include <libsoup/soup.h>

#include "operator.h"

#define SITE_TOKEN  "an-0123456789-token"
#define SITE_WAIT_S 30

struct site {
    struct operation *run;
    GSubprocess *daemon, *server;
    char *bus, *uri;
    char *log; /* the file with what the server has told on standard error */
    guint16 port;
    SoupSession *http;
};

enum {
    SITE_SHOWS = 1,            /* it has no token */
    SITE_SAFE_NEEDS_TOKEN = 2, /* as the option says */
    SITE_RIG = 4,              /* the daemon has opened the rig */
};

/* changes: of the rig file, or NULL. */
struct site *site_new(int flags, const struct change *changes);

/* Ends both programs, which must end by themselves and with exit code 0. */
void site_free(struct site *site);

/* Starts the daemon again, whose socket must be gone. */
void site_start_daemon(struct site *site);

/* The small session, by the daemon that the server shows. */
void site_capture(struct site *site);

/* A request; header: "Name: value", or NULL. The status; ret (may be NULL): the body, g_free(). */
guint site_ask(const struct site *site, const char *method, const char *path, const char *header,
               char **ret);

/* A connection from this address (127.0.0.2, say), to which nothing has been sent. Reads and writes
 * wait for SITE_WAIT_S each. */
GSocket *site_dial(const struct site *site, const char *from);
void site_send(GSocket *socket, const char *text);

/* What arrives until the server closes, or until it contains this text (NULL: only then); g_free().
 */
char *site_receive(GSocket *socket, const char *until);

/* The three of them: a request as it goes over the line, in which each “$” is this server's name
 * and port, and its whole answer; g_free(). */
char *site_converse(const struct site *site, const char *from, const char *request);

/* The status of such an answer; 0: there is none. */
guint site_status(const char *answer);
