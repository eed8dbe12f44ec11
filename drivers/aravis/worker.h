/*
 * The thread of a camera. Aravis's calls block, for seconds if a cable is unplugged. The thread
 * makes these calls, in the order of the requests. Results are reported from the main loop. All
 * functions here belong to the main loop's thread.
 *
 * If the camera is lost, the thread looks for it once a second. When it is found, the thread sets
 * it up as before, and the camera may be armed again.
 */
#pragma once

#include "device.h"

typedef struct AravisWorker AravisWorker;

struct aravis_hooks {
    /* The camera has begun to send the frame of a trigger sent at sent_us. */
    void (*sending)(gint64 sent_us, gpointer data);
    void (*frame)(Frame *frame, gpointer data); /* the hook takes ownership of the reference */
    /* A frame is too old: its exposure, or with a camera without a clock its arrival, began
     * before_us before its trigger. The frame is not used. The right frame may follow. */
    void (*stale)(gint64 before_us, gpointer data);
    /* A request has failed, the frame of a trigger has failed, or the camera was lost. A trigger
     * that waited for its frame has ended. The hook takes ownership of the error. */
    void (*failed)(GError *error, gpointer data);
    /* The camera cannot be used because of the error. If error is NULL, it can be used again. */
    void (*lost)(const GError *error, gpointer data);
};

/* Starts to open the camera. Copies the options. */
AravisWorker *aravis_worker_new(const char *name, const struct aravis_options *options,
                                const struct aravis_hooks *hooks, gpointer data);

/* Waits until the camera is open, and fills *ret. Fails if the camera cannot be opened or does
 * not open in time. Call it before all other functions except aravis_worker_free(). */
gboolean aravis_worker_await(AravisWorker *worker, struct aravis_limits *ret, GError **error);

/* Returns the result of aravis_device_warnings() when the camera was opened. The worker owns it. */
const char *const *aravis_worker_warnings(const AravisWorker *worker);

/* Frees the worker. No hook is called afterwards. Waits until the camera is released, but no longer
 * than a second, because a camera that does not answer is released later. NULL is ignored. */
void aravis_worker_free(AravisWorker *worker);

/* These functions send a request to the thread and do not wait. aravis_worker_configure() may be
 * called before the camera is armed. If the camera refuses the exposure or the gain, each trigger
 * after that fails. */
void aravis_worker_configure(AravisWorker *worker, gint64 exposure_us, double gain_db);
void aravis_worker_arm(AravisWorker *worker);
void aravis_worker_disarm(AravisWorker *worker); /* a waiting trigger ends without an event */
void aravis_worker_trigger(AravisWorker *worker, guint64 shot);
