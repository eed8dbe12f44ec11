#include "v4l2_private.h"

#include <errno.h>
#include <string.h>
#include <unistd.h>

#define FUTURE_US 100000

/* Returns the value of a control, or the argument `otherwise` if the camera lacks the control. */
static gint32 setting(VirtualV4l2 *camera, guint32 id, gint32 otherwise) {
    const struct virtual_control *control = virtual_find_control(camera, id);
    return control ? control->value : otherwise;
}

/* Delays from the end of an exposure to its first and to its last data, in frame intervals. */
#define FIRST_DATA_PART 0.1
#define LAST_DATA_PART  0.4

/* A frame that is being transferred. */
struct shot {
    guint stream;
    guint64 number;
    gint64 start_us, exposure_us, first_data_us, end_us;
    double gain_db;
    enum virtual_v4l2_fault fault;
    guint32 fourcc;
};

/* Waits until time_us or the end of the stream. The mutex must be locked. It is unlocked during the
 * wait. Returns FALSE when the stream has ended. */
static gboolean sleep_until(VirtualV4l2 *camera, guint stream, gint64 time_us) {
    while (camera->stream == stream && g_get_monotonic_time() < time_us)
        g_cond_wait_until(&camera->woken, &camera->mutex, time_us);
    return camera->stream == stream;
}

struct virtual_buffer *virtual_oldest_buffer(VirtualV4l2 *camera, enum buffer_state state) {
    struct virtual_buffer *found = NULL;
    for (int i = 0; i < camera->n_buffers; i++)
        if (camera->buffers[i].state == state &&
            (!found || camera->buffers[i].order < found->order))
            found = &camera->buffers[i];
    return found;
}

/* Delivers a frame in a buffer. The mutex must be locked. */
static void deliver(VirtualV4l2 *camera, const struct shot *shot, struct virtual_buffer *buffer,
                    const guint8 *data) {
    gsize bytes = virtual_pixels_size(shot->fourcc, camera->config.width, camera->config.height);
    gsize index = (gsize)(buffer - camera->buffers);
    gboolean half = shot->fault == VIRTUAL_V4L2_ERROR_FLAG || shot->fault == VIRTUAL_V4L2_SHORT;
    gsize sent = half ? bytes / 2 : bytes;
    off_t at = (off_t)(index * virtual_buffer_room(camera));
    if (pwrite(camera->fd, data, sent, at) != (gssize)sent)
        g_error("%s: a frame of the virtual camera cannot be written (%s)", camera->node,
                g_strerror(errno));
    buffer->bytes = (guint32)sent;
    buffer->flags = camera->config.stamp == VIRTUAL_V4L2_END ? V4L2_BUF_FLAG_TSTAMP_SRC_EOF
                                                             : V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
    if (shot->fault != VIRTUAL_V4L2_OTHER_CLOCK)
        buffer->flags |= V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    if (shot->fault == VIRTUAL_V4L2_ERROR_FLAG)
        buffer->flags |= V4L2_BUF_FLAG_ERROR;
    buffer->sequence = (guint32)shot->number;
    buffer->stamp_us = camera->config.stamp == VIRTUAL_V4L2_START        ? shot->start_us
                       : camera->config.stamp == VIRTUAL_V4L2_FIRST_DATA ? shot->first_data_us
                                                                         : shot->end_us;
    if (shot->fault == VIRTUAL_V4L2_FUTURE)
        buffer->stamp_us += FUTURE_US;
    buffer->order = ++camera->n_ordered;
    buffer->state = BUFFER_DONE;
}

/* Makes the picture of a frame and waits for the end of its data. Delivers the picture if a buffer
 * is queued. Returns FALSE when the stream has ended. The mutex must be locked. It is unlocked
 * while the picture is made and while the function waits. */
static gboolean make_picture(VirtualV4l2 *camera, const struct shot *shot) {
    gsize n = (gsize)camera->config.width * (gsize)camera->config.height;
    g_autofree guint16 *pixels = g_new0(guint16, n);
    g_autofree guint8 *data =
        g_malloc(virtual_pixels_size(shot->fourcc, camera->config.width, camera->config.height));
    g_mutex_unlock(&camera->mutex);
    if (shot->fault == VIRTUAL_V4L2_FROZEN) {
        memcpy(pixels, camera->pixels, n * sizeof *pixels);
    } else if (camera->world) {
        struct world_state state;
        world_snapshot(camera->world, shot->start_us, shot->exposure_us, &state);
        /* The noise depends on the time of the frame. Numbers of frames would repeat, because every
         * stream begins to count from the same number. */
        world_expose(camera->world, camera->world_index, &state, shot->exposure_us, shot->gain_db,
                     (guint64)shot->start_us, pixels);
    } else if (camera->config.expose) {
        camera->config.expose(camera->config.user, shot->start_us, shot->exposure_us, shot->gain_db,
                              shot->number, pixels);
    } else { /* a ramp with noise */
        GRand *rand = g_rand_new_with_seed((guint32)shot->start_us);
        for (gsize i = 0; i < n; i++) {
            gint64 column = (gint64)(i % (gsize)camera->config.width);
            gint64 value = shot->exposure_us / 16 + column + g_rand_int_range(rand, 0, 8);
            pixels[i] = (guint16)MIN(value, (1 << camera->config.bits) - 1);
        }
        g_rand_free(rand);
    }
    virtual_pixels_pack(&camera->config, shot->fourcc, pixels, data);
    g_mutex_lock(&camera->mutex);
    camera->n_exposed++;
    if (!sleep_until(camera, shot->stream, shot->end_us))
        return FALSE;
    memcpy(camera->pixels, pixels, n * sizeof *pixels);
    struct virtual_buffer *buffer = virtual_oldest_buffer(camera, BUFFER_QUEUED);
    if (buffer)
        deliver(camera, shot, buffer, data);
    return TRUE;
}

/* Waits until the next frame has been exposed, and delivers it. Nothing is delivered if no buffer
 * is queued, or if the fault SILENT is set. Returns FALSE when the stream has ended. The mutex must
 * be locked. It is unlocked while the function waits and while the picture is made. */
static gboolean take_one(VirtualV4l2 *camera, guint stream) {
    gint64 interval = (gint64)(1e6 / camera->frame_rate), now = g_get_monotonic_time();
    struct shot shot = {.stream = stream,
                        .number = (guint64)((now - camera->first_us) / interval) + 1};
    shot.start_us = camera->first_us + (gint64)shot.number * interval;
    if (!sleep_until(camera, stream, shot.start_us))
        return FALSE;
    /* As with many sensors, a new setting affects the frame after the next. In automatic mode, the
     * camera chooses exposure and gain itself. */
    if (camera->exposure_us == 0 || camera->changed_us + interval <= shot.start_us) {
        gboolean by_hand = setting(camera, V4L2_CID_EXPOSURE_AUTO, 1) == 1;
        gint64 set_us = 100 * setting(camera, V4L2_CID_EXPOSURE_ABSOLUTE, 40);
        camera->exposure_us = MIN(by_hand ? set_us : interval * 2 / 3, interval);
        camera->gain_db = setting(camera, V4L2_CID_GAIN, 0) / 10.0 + (by_hand ? 0 : 6);
    }
    shot.exposure_us = camera->exposure_us;
    shot.gain_db = camera->gain_db;
    shot.fault = camera->fault;
    shot.fourcc = camera->fourcc;
    gint64 exposed_us = shot.start_us + shot.exposure_us;
    shot.first_data_us = exposed_us + (gint64)(FIRST_DATA_PART * (double)interval);
    shot.end_us = exposed_us + (gint64)(LAST_DATA_PART * (double)interval);
    if (!sleep_until(camera, stream, exposed_us))
        return FALSE;
    if (!virtual_oldest_buffer(camera, BUFFER_QUEUED) || shot.fault == VIRTUAL_V4L2_SILENT)
        return TRUE;
    return make_picture(camera, &shot);
}

struct run {
    VirtualV4l2 *camera;
    guint stream;
};

static gpointer v4l2_stream_run(gpointer data) {
    g_autofree struct run *run = data;
    VirtualV4l2 *camera = run->camera;
    g_mutex_lock(&camera->mutex);
    while (camera->stream == run->stream && take_one(camera, run->stream))
        ;
    camera->n_threads--;
    g_cond_broadcast(&camera->woken);
    g_mutex_unlock(&camera->mutex);
    return NULL;
}

void virtual_stream_start(VirtualV4l2 *camera) {
    struct run *new = g_new(struct run, 1);
    *new = (struct run){camera, ++camera->stream};
    camera->streaming = TRUE;
    camera->first_us = g_get_monotonic_time();
    camera->exposure_us = 0;
    camera->n_threads++;
    g_thread_unref(g_thread_new("virtual camera", v4l2_stream_run, new));
}

void virtual_stream_stop(VirtualV4l2 *camera) {
    camera->streaming = FALSE;
    camera->stream++;
    g_cond_broadcast(&camera->woken);
}

void virtual_stream_wait(VirtualV4l2 *camera) {
    while (camera->n_threads > 0)
        g_cond_wait(&camera->woken, &camera->mutex);
}
