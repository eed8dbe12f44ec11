/*
 * The rig as the web server sees it: a client of mesorigd's D-Bus interface like any other, which
 * keeps the last state for the server's requests. It never blocks: calls are answered later. One
 * thread, the one that runs the main loop.
 */
#pragma once

#include <gio/gio.h>

typedef struct WebRig WebRig;

/* address: of a daemon that listens for its user ("unix:path=…"), or NULL: the bus, "system" or
 * "session". The daemon may end and start again, and need not be there yet; at an address it is
 * looked for every 2 s, which is told on standard error. Waits for the first answer, for 5 s. */
WebRig *web_rig_new(const char *address, const char *bus, GError **error);
void web_rig_free(WebRig *rig); /* NULL is ignored */

/* Called with the name of a stream event and its data, one line of JSON: "state" at most twice a
 * second, "event" for each event of the daemon, "picture" for each new picture of a camera. */
typedef void (*WebRigNews)(const char *name, const char *json, gpointer data);
void web_rig_listen(WebRig *rig, WebRigNews func, gpointer data);

/* As JSON; g_free(). */
char *web_rig_state(
    const WebRig *rig); /* an object; "state" is "away" where no daemon answers, "reason" why */
char *web_rig_events(const WebRig *rig); /* the last WEB_RIG_EVENTS, an array */
char *
web_rig_progress(const WebRig *rig); /* what was done when: {"elapsed_s": […], "shots": […]} */

#define WEB_RIG_EVENTS 200

/* A method without arguments: "Pause", "Continue", "Abort", "SafeState", "Release". answer: what it
 * returns, a tuple, or NULL with an error, which is what the daemon says; both are owned by the
 * caller of back. back is called in any case, also by web_rig_free(). */
typedef void (*WebRigDone)(GVariant *answer, const GError *error, gpointer data);
void web_rig_call(WebRig *rig, const char *method, WebRigDone back, gpointer data);

/* The latest picture of a camera, 8 bits, sRGB. */
struct web_picture {
    GBytes *png;
    char *json; /* camera, time_s, width, height, shares of its pixels that are white and black,
                   histogram of 64 steps for each of red, green and blue */
};
/* picture: NULL with an error; owned by the rig until back returns. A picture is fetched and
 * encoded once, however many clients ask for it; the daemon is asked for cameras that it has only.
 */
typedef void (*WebRigPicture)(const struct web_picture *picture, const GError *error,
                              gpointer data);
void web_rig_picture(WebRig *rig, const char *camera, WebRigPicture back, gpointer data);
