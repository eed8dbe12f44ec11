/*
 * A client of mesorigd's D-Bus interface, which keeps the last state of the rig for the web
 * server's requests. Only web_rig_new() waits; all other calls return immediately and are answered
 * later from the main loop. All functions belong to the main loop's thread.
 */
#pragma once

#include <gio/gio.h>
#include <gio/gunixfdlist.h>

typedef struct WebRig WebRig;

/* Connects to a daemon. address is the daemon's own socket ("unix:path=…"). If address is NULL,
 * the daemon is on the bus named by bus, "system" or "session". The daemon need not run yet, and
 * may end and start again. If no daemon answers at address, the WebRig tries again every 2 s,
 * and prints a message to standard error. The function waits up to about 15 s (bus_client.h) for
 * a daemon at address. Returns NULL with an error if the bus cannot be used. */
WebRig *web_rig_new(const char *address, const char *bus, GError **error);
void web_rig_free(WebRig *rig); /* NULL is ignored */

/* Called with the name of a server-sent event and its data, which are one line of JSON. "state"
 * comes at most twice a second, and has "places" only if they have changed since the last "state".
 * There is an "event" for each event of the daemon, and a "picture" for each new picture of a
 * camera. */
typedef void (*WebRigNews)(const char *name, const char *json, gpointer data);
void web_rig_listen(WebRig *rig, WebRigNews func, gpointer data);

/* Returns the state as a JSON object; g_free(). If no daemon answers, the member "state" is "away",
 * and the member "reason" says why. */
char *web_rig_state(const WebRig *rig);
/* Returns the directory of the session that the daemon captures or has captured last. Returns NULL
 * or "" if there is none, or if no daemon answers. Valid until control returns to the main loop. */
const char *web_rig_session(const WebRig *rig);
/* Returns the last WEB_RIG_EVENTS events as a JSON array; g_free(). */
char *web_rig_events(const WebRig *rig);
/* Returns samples of the number of shots done over time, in JSON: {"elapsed_s": […], "shots": […]}.
 * Free the text with g_free(). */
char *web_rig_progress(const WebRig *rig);

#define WEB_RIG_EVENTS 200

/* Calls a method of the daemon without arguments: "Pause", "Continue", "Finish", "Abort",
 * "SafeState" or "Release". back is always called once. If no answer has come before,
 * web_rig_free() calls it with an error. answer is the tuple that the method returns. If the call
 * failed, answer is NULL and error is set. back owns neither answer nor error. */
typedef void (*WebRigDone)(GVariant *answer, const GError *error, gpointer data);
void web_rig_call(WebRig *rig, const char *method, WebRigDone back, gpointer data);
/* The same as web_rig_call() for a method with arguments. parameters is a tuple and may be
 * floating. */
void web_rig_call_with(WebRig *rig, const char *method, GVariant *parameters, WebRigDone back,
                       gpointer data);

/* The same as web_rig_call_with() for a method that also returns files. The list `files` owns the
 * file descriptors. `files` is NULL if error is set. */
typedef void (*WebRigFiles)(GVariant *answer, GUnixFDList *files, const GError *error,
                            gpointer data);
void web_rig_call_files(WebRig *rig, const char *method, GVariant *parameters, WebRigFiles back,
                        gpointer data);

/* The latest picture of a camera, 8 bits, sRGB. */
struct web_picture {
    GBytes *png;
    /* A JSON object with camera, time_s, width, height, the shares of white and of black pixels,
     * and a histogram of 64 bins for each of red, green and blue. */
    char *json;
};
/* The WebRig owns picture, which is valid during the call. picture is NULL if error is set. */
typedef void (*WebRigPicture)(const struct web_picture *picture, const GError *error,
                              gpointer data);
/* Gets the latest picture of a camera. back is called once. It is called within this function if
 * the picture, or the error, is already known. A picture is fetched and encoded only once, even if
 * several clients request it. The daemon is asked only for cameras that the rig has. */
void web_rig_picture(WebRig *rig, const char *camera, WebRigPicture back, gpointer data);
