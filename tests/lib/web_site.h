/* A daemon of the small simulated rig and a web server (mesorig-web) that is connected to it, for
 * tests. The daemon opens the rig only with SITE_RIG. Errors in these functions fail the test. */
#pragma once

#include <libsoup/soup.h>

#include "browser.h"
#include "operator.h"

#define SITE_TOKEN  "an-0123456789-token"
#define SITE_WAIT_S 30

struct site {
    struct operation *run;
    GSubprocess *daemon, *server;
    char *bus, *uri;
    char *log; /* file with the server's standard error */
    guint16 port;
    SoupSession *http;
};

enum {
    SITE_SHOWS = 1,            /* the server has no token */
    SITE_SAFE_NEEDS_TOKEN = 2, /* the server has the option --safe-needs-token */
    SITE_RIG = 4,              /* the daemon has opened the rig */
    SITE_SESSIONS = 8,         /* the server has --sessions with the folder of the operation */
    SITE_QUEUE = 16,           /* the daemon keeps a queue */
};

/* Starts the daemon and the server. changes are changes of the rig file, or NULL. */
struct site *site_new(int flags, const struct change *changes);

/* The same for another rig: write() replaces the files of the folder before the daemon starts. */
struct site *site_new_of(int flags, void (*write)(const char *folder));

/* Closes the rig and opens it again, so that the daemon reads the changed files of the world. */
void site_reopen(const struct site *site);
void site_open(const struct site *site); /* opens the rig in a daemon without a rig */

/* Ends the server and the daemon with SIGTERM. Both must then exit with code 0. */
void site_free(struct site *site);

/* Starts the daemon again. The socket of the previous daemon must be gone. */
void site_start_daemon(struct site *site);

/* Captures the small session with the daemon that the server shows. */
void site_capture(struct site *site);

/* Sends a request. header is "Name: value", or NULL. Returns the status. ret receives the body
 * (g_free()) and may be NULL. */
guint site_ask(const struct site *site, const char *method, const char *path, const char *header,
               char **ret);

/* Sends a command with the token, which must be answered with this status. Returns the answer;
 * g_free(). */
char *site_does(const struct site *site, guint status, const char *path);

/* Returns the answer to a GET request, which must succeed; g_free(). */
char *site_look(const struct site *site, const char *path);

/* Waits until the answer to a GET request has these words or, if has is FALSE, does not have them.
 */
void site_wait(const struct site *site, const char *path, const char *words, gboolean has);

/* Opens the page in a browser whose window has this size; browser_free(). */
Browser *site_browse(const struct site *site, int width, int height);

/* Types the token into the page. */
void site_unlock(Browser *browser);

/* Opens a connection from this address, for example 127.0.0.2, without sending anything. Reads and
 * writes wait at most SITE_WAIT_S each. */
GSocket *site_dial(const struct site *site, const char *from);
void site_send(GSocket *socket, const char *text);

/* Receives until the server closes the connection, or until the text contains until. If until is
 * NULL, only the first condition counts; g_free(). */
char *site_receive(GSocket *socket, const char *until);

/* Connects, sends the request unchanged except that each “$” becomes this server's name and port,
 * and returns the whole answer; g_free(). */
char *site_converse(const struct site *site, const char *from, const char *request);

/* Returns the status of an answer that site_receive() or site_converse() returned, or 0 if it has
 * none. */
guint site_status(const char *answer);
