#include "worker.h"

#include "answer.h"
#include "errors.h"

#include <string.h>

/* Time to wait for control of the camera. It exceeds the 3 s after which a camera releases the
 * control of a killed program. */
#define OPEN_CONTROL_S 4.5
/* limit for the opening of all cameras together: half the watchdog time of the service */
#define OPEN_LIMIT_S   15
#define CLOSE_LIMIT_S  1
#define LOOK_EVERY_US  G_USEC_PER_SEC
#define CHECK_EVERY_US (G_USEC_PER_SEC / 2)
#define CLOCK_AGE_US   (5 * G_USEC_PER_SEC)

enum job_kind { CONFIGURE, ARM, DISARM, TRIGGER, BUFFER, QUIT };

struct job {
    enum job_kind kind;
    guint generation; /* number of the arming to which the job belongs */
    gint64 exposure_us;
    double gain_db;
    guint64 shot;
};

enum event_kind { SENDING, FRAME, STALE, FAILED, LOST, FOUND };

struct event {
    AravisWorker *worker;
    enum event_kind kind;
    guint generation;
    /* With SENDING, the time of the trigger. With STALE, the time from the start of the exposure to
     * the trigger. */
    gint64 us;
    Frame *frame;
    GError *error;
};

struct AravisWorker {
    gint ref_count; /* references of the main loop, the thread and each event */
    struct aravis_options options;
    GAsyncQueue *jobs;

    /* Used only by the main loop. */
    struct aravis_hooks hooks;
    gpointer data;
    gboolean closed;
    guint generation;
    gint64 begun_us;

    GMutex mutex; /* guards the fields down to sent_us */
    GCond cond;
    gboolean opened, ended;
    GError *open_error;
    char **warnings;  /* warnings from when the camera was first opened */
    gboolean pending; /* a trigger was sent and not answered */
    guint armed;      /* the generation that is armed */
    gint64 sent_us;

    /* Used only by the thread. */
    AravisDevice *device; /* NULL if the camera is lost */
    struct aravis_limits limits;
    struct answer_state answer;
    struct job settings; /* the last CONFIGURE */
    gboolean exposure_set, gain_set;
    gboolean halted; /* the camera's stream may be halted, because a frame did not come */
    GError *settings_error;
    GError *lost_error;
};

static void unref(AravisWorker *worker) {
    if (!g_atomic_int_dec_and_test(&worker->ref_count))
        return;
    g_free(worker->options.device);
    g_free(worker->options.pixel_format);
    g_free(worker->options.trigger);
    g_free(worker->options.pulse_path);
    g_strfreev(worker->options.features);
    g_strfreev(worker->warnings);
    g_async_queue_unref(worker->jobs);
    g_mutex_clear(&worker->mutex);
    g_cond_clear(&worker->cond);
    g_clear_error(&worker->open_error);
    g_clear_error(&worker->settings_error);
    g_clear_error(&worker->lost_error);
    g_free(worker);
}

/* The next functions carry events from any thread to the main loop. */

static gboolean worker_on_event(gpointer data) {
    const struct event *event = data;
    const AravisWorker *worker = event->worker;
    gboolean lost = event->kind == LOST || event->kind == FOUND;
    if (worker->closed || (!lost && event->generation != worker->generation))
        return G_SOURCE_REMOVE;
    if (lost)
        worker->hooks.lost(event->error, worker->data);
    else if (event->kind == SENDING)
        worker->hooks.sending(event->us, worker->data);
    else if (event->kind == FRAME)
        worker->hooks.frame(frame_ref(event->frame), worker->data);
    else if (event->kind == STALE)
        worker->hooks.stale(event->us, worker->data);
    else
        worker->hooks.failed(g_error_copy(event->error), worker->data);
    return G_SOURCE_REMOVE;
}

static void worker_event_free(gpointer data) {
    struct event *event = data;
    frame_unref(event->frame);
    g_clear_error(&event->error);
    unref(event->worker);
    g_free(event);
}

/* Sends an event to the main loop; takes ownership of frame and error. */
static void post(AravisWorker *worker, enum event_kind kind, guint generation, gint64 us,
                 Frame *frame, GError *error) {
    struct event *event = g_new(struct event, 1);
    *event = (struct event){worker, kind, generation, us, frame, error};
    g_atomic_int_inc(&worker->ref_count);
    g_idle_add_full(G_PRIORITY_DEFAULT, worker_on_event, event, worker_event_free);
}

static void push(AravisWorker *worker, struct job job) {
    g_async_queue_push(worker->jobs, g_memdup2(&job, sizeof job));
}

/* The following functions run in the threads of Aravis. */

static void on_stream(void *data, ArvStreamCallbackType type, ArvBuffer *buffer) {
    AravisWorker *worker = data;
    if (type == ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE)
        push(worker, (struct job){.kind = BUFFER});
    if (type != ARV_STREAM_CALLBACK_TYPE_START_BUFFER)
        return;
    g_mutex_lock(&worker->mutex);
    if (worker->pending)
        post(worker, SENDING, worker->armed, worker->sent_us, NULL, NULL);
    g_mutex_unlock(&worker->mutex);
}

/* The following functions run in the worker's thread. */

static void set_pending(AravisWorker *worker, gboolean pending, guint generation) {
    g_mutex_lock(&worker->mutex);
    worker->pending = pending;
    worker->armed = generation;
    worker->sent_us = g_get_monotonic_time();
    worker->answer.sent_us = worker->sent_us;
    g_mutex_unlock(&worker->mutex);
}

static void close_device(AravisWorker *worker) {
    g_clear_pointer(&worker->device, aravis_device_close);
}

/* Reports that the camera is lost, and closes it. Takes ownership of the error. The report comes
 * first, because closing may take seconds if the camera does not answer. */
static void worker_lose(AravisWorker *worker, GError *error) {
    g_clear_error(&worker->lost_error);
    worker->lost_error = error;
    post(worker, LOST, 0, 0, NULL, g_error_copy(error));
    close_device(worker);
}

/* Stops waiting for a frame and reports an error. Takes ownership of the error. If the error says
 * that the camera is lost, also reports the loss and closes the camera. */
static void worker_fail(AravisWorker *worker, guint generation, GError *error) {
    set_pending(worker, FALSE, generation);
    post(worker, FAILED, generation, 0, NULL, g_error_copy(error));
    if (worker->device && aravis_error_is_lost(error))
        worker_lose(worker, error);
    else
        g_error_free(error);
}

static gboolean worker_open_device(AravisWorker *worker, double control_s, GError **error) {
    worker->device = aravis_device_open(&worker->options, control_s, on_stream, worker, error);
    if (!worker->device)
        return FALSE;
    worker->limits = *aravis_device_limits(worker->device);
    worker->answer.limits = &worker->limits;
    worker->answer.stamp_is_end = worker->options.stamp == ARAVIS_STAMP_END;
    worker->exposure_set = worker->gain_set = worker->halted = FALSE;
    return TRUE;
}

static void worker_apply_settings(AravisWorker *worker) {
    const struct job *settings = &worker->settings;
    g_clear_error(&worker->settings_error);
    if (settings->exposure_us <= 0 || !worker->device)
        return;
    if (!worker->exposure_set)
        worker->exposure_set = aravis_device_set_exposure(worker->device, settings->exposure_us,
                                                          &worker->settings_error);
    if (!worker->gain_set && !worker->settings_error)
        worker->gain_set =
            aravis_device_set_gain(worker->device, settings->gain_db, &worker->settings_error);
    worker->answer.exposure_us = settings->exposure_us;
}

static void look_for_it(AravisWorker *worker) {
    g_autoptr(GError) error = NULL;
    if (worker_open_device(worker, 0, &error)) {
        g_clear_error(&worker->lost_error);
        worker_apply_settings(worker);
        post(worker, FOUND, 0, 0, NULL, NULL);
        return;
    }
    if (g_strcmp0(error->message, worker->lost_error->message) != 0)
        worker_lose(worker, g_steal_pointer(&error));
}

static void worker_do_configure(AravisWorker *worker, const struct job *job) {
    worker->exposure_set &= job->exposure_us == worker->settings.exposure_us;
    worker->gain_set &= job->gain_db == worker->settings.gain_db;
    worker->settings = *job;
    worker_apply_settings(worker);
}

static void ask_clock(AravisWorker *worker) {
    aravis_device_ask_clock(worker->device, &worker->answer.clock);
    worker->answer.asked_us = g_get_monotonic_time();
}

static void worker_do_arm(AravisWorker *worker, const struct job *job) {
    GError *error = NULL;
    answer_begin(&worker->answer);
    if (worker->device && worker->halted) {
        close_device(worker);
        if (worker_open_device(worker, 0, &error))
            worker_apply_settings(worker);
        else
            worker_lose(worker, g_steal_pointer(&error));
    }
    if (!worker->device)
        worker_fail(worker, job->generation, g_error_copy(worker->lost_error));
    else if (aravis_device_start(worker->device, &error))
        ask_clock(worker);
    else
        worker_fail(worker, job->generation, error);
}

static void worker_do_disarm(AravisWorker *worker, const struct job *job) {
    g_autoptr(GError) error = NULL;
    gboolean unanswered = worker->pending; /* only this thread sets pending */
    set_pending(worker, FALSE, job->generation);
    worker->halted |= unanswered && worker->device && aravis_device_may_halt(worker->device);
    if (worker->device && !aravis_device_stop(worker->device, &error) &&
        aravis_error_is_lost(error))
        worker_lose(worker, g_steal_pointer(&error));
}

static void worker_do_trigger(AravisWorker *worker, const struct job *job) {
    GError *error = NULL;
    const GError *why = worker->device ? worker->settings_error : worker->lost_error;
    if (why) {
        worker_fail(worker, job->generation, g_error_copy(why));
        return;
    }
    ArvBuffer *old;
    while ((old = aravis_device_pop(worker->device)))
        aravis_device_push(worker->device, old);
    worker->answer.shot = job->shot;
    set_pending(worker, TRUE, job->generation);
    if (!aravis_device_trigger(worker->device, &error))
        worker_fail(worker, job->generation, error);
}

static void take_buffer(AravisWorker *worker, const struct job *unused) {
    ArvBuffer *buffer = worker->device ? aravis_device_pop(worker->device) : NULL;
    if (!buffer)
        return;
    g_mutex_lock(&worker->mutex);
    gboolean pending = worker->pending;
    guint generation = worker->armed;
    g_mutex_unlock(&worker->mutex);
    if (pending) {
        GError *error = NULL;
        gint64 before_us = 0;
        Frame *frame = answer_frame(&worker->answer, buffer, &before_us, &error);
        if (frame)
            post(worker, FRAME, generation, 0, frame, NULL);
        else if (error)
            post(worker, FAILED, generation, 0, NULL, error);
        else
            post(worker, STALE, generation, before_us, NULL, NULL);
        pending = !frame && !error; /* after an old frame the trigger still waits */
        g_mutex_lock(&worker->mutex);
        worker->pending = pending;
        g_mutex_unlock(&worker->mutex);
    }
    aravis_device_push(worker->device, buffer);
    if (!pending && g_get_monotonic_time() - worker->answer.asked_us > CLOCK_AGE_US)
        ask_clock(worker);
}

static void worker_announce(AravisWorker *worker, gboolean *what) {
    g_mutex_lock(&worker->mutex);
    *what = TRUE;
    g_cond_broadcast(&worker->cond);
    g_mutex_unlock(&worker->mutex);
}

static gpointer worker_work(gpointer data) {
    static void (*const work[])(AravisWorker * worker, const struct job *job) = {
        [CONFIGURE] = worker_do_configure, [ARM] = worker_do_arm,  [DISARM] = worker_do_disarm,
        [TRIGGER] = worker_do_trigger,     [BUFFER] = take_buffer,
    };
    AravisWorker *worker = data;
    if (worker_open_device(worker, OPEN_CONTROL_S, &worker->open_error))
        worker->warnings = g_strdupv((char **)aravis_device_warnings(worker->device));
    worker_announce(worker, &worker->opened);
    for (gboolean go_on = worker->device != NULL; go_on;) {
        g_autofree struct job *job = g_async_queue_timeout_pop(
            worker->jobs, worker->device ? CHECK_EVERY_US : LOOK_EVERY_US);
        if (job && job->kind == QUIT)
            go_on = FALSE;
        else if (job)
            work[job->kind](worker, job);
        else if (!worker->device)
            look_for_it(worker);
        /* Polls for the loss of control. The device must not be freed during Aravis's signal
         * "control-lost", because Aravis's heartbeat thread would then wait for itself. */
        else if (!aravis_device_has_control(worker->device))
            worker_fail(worker, worker->armed,
                        device_error_new(DEVICE_ERROR_DISCONNECTED, NULL,
                                         "control of the camera was lost" ERROR_ADVICE
                                         "check the camera's power and cable, and that no other "
                                         "program uses the camera"));
    }
    close_device(worker);
    worker_announce(worker, &worker->ended);
    unref(worker);
    return NULL;
}

/* The following functions run in the main loop. */

static gboolean wait_for(AravisWorker *worker, const gboolean *what, double seconds) {
    gint64 until = g_get_monotonic_time() + (gint64)(seconds * 1e6);
    g_mutex_lock(&worker->mutex);
    while (!*what && g_cond_wait_until(&worker->cond, &worker->mutex, until))
        ;
    gboolean done = *what;
    g_mutex_unlock(&worker->mutex);
    return done;
}

AravisWorker *aravis_worker_new(const char *name, const struct aravis_options *options,
                                const struct aravis_hooks *hooks, gpointer data) {
    AravisWorker *worker = g_new0(AravisWorker, 1);
    worker->ref_count = 2;
    worker->hooks = *hooks;
    worker->data = data;
    worker->begun_us = g_get_monotonic_time();
    worker->jobs = g_async_queue_new_full(g_free);
    g_mutex_init(&worker->mutex);
    g_cond_init(&worker->cond);
    worker->options = *options;
    worker->options.device = g_strdup(options->device);
    worker->options.pixel_format = g_strdup(options->pixel_format);
    worker->options.trigger = g_strdup(options->trigger);
    worker->options.pulse_path = g_strdup(options->pulse_path);
    worker->options.features = g_strdupv(options->features);
    g_thread_unref(g_thread_new(name, worker_work, worker));
    return worker;
}

gboolean aravis_worker_await(AravisWorker *worker, struct aravis_limits *ret, GError **error) {
    double since_s = (double)(g_get_monotonic_time() - worker->begun_us) * 1e-6;
    if (!wait_for(worker, &worker->opened, OPEN_LIMIT_S - since_s))
        return device_error_set(error, DEVICE_ERROR_TIMEOUT, NULL,
                                "it could not be opened in %d s" ERROR_ADVICE
                                "check its power and cable",
                                OPEN_LIMIT_S);
    if (worker->open_error) {
        g_propagate_error(error, g_error_copy(worker->open_error));
        return FALSE;
    }
    *ret = worker->limits;
    return TRUE;
}

const char *const *aravis_worker_warnings(const AravisWorker *worker) {
    return (const char *const *)worker->warnings;
}

void aravis_worker_free(AravisWorker *worker) {
    if (!worker)
        return;
    worker->closed = TRUE;
    push(worker, (struct job){.kind = QUIT});
    wait_for(worker, &worker->ended, CLOSE_LIMIT_S);
    unref(worker);
}

void aravis_worker_configure(AravisWorker *worker, gint64 exposure_us, double gain_db) {
    push(worker, (struct job){.kind = CONFIGURE, .exposure_us = exposure_us, .gain_db = gain_db});
}

void aravis_worker_arm(AravisWorker *worker) {
    push(worker, (struct job){.kind = ARM, .generation = ++worker->generation});
}

void aravis_worker_disarm(AravisWorker *worker) {
    push(worker, (struct job){.kind = DISARM, .generation = ++worker->generation});
}

void aravis_worker_trigger(AravisWorker *worker, guint64 shot) {
    push(worker, (struct job){.kind = TRIGGER, .generation = worker->generation, .shot = shot});
}
