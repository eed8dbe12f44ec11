#include "web_snaps.h"

#include "base/json.h"
#include "base/png_bytes.h"
#include "base/srgb.h"
#include "capture/picture_values.h"
#include "capture/thumbnail.h"
#include "drivers/frame.h"

#include <libsoup/soup.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define MAX_SIDE     65536 /* maximum width and height that the daemon may claim */
#define MAX_PIXELS   (100 << 20)
#define MAX_EXPOSURE 6e8 /* µs; the daemon knows the limits of each camera */

struct WebSnaps {
    gboolean busy; /* a picture is being taken */
    char *camera;  /* of the last picture; NULL if there is none */
    Frame *frame;
    double high_dn; /* 99th percentile of the frame */
    GBytes *png;
};

/* A picture that is being taken. */
struct shot {
    struct web_task task; /* without the strings */
    WebSnaps *snaps;      /* reference */
    char *camera;
    int file; /* with the pixels; −1 if it was closed */
    Frame *frame;
    struct picture_values values;
    GBytes *png;
};

static void clear(gpointer data) {
    WebSnaps *snaps = data;
    g_free(snaps->camera);
    frame_unref(snaps->frame);
    g_clear_pointer(&snaps->png, g_bytes_unref);
    *snaps = (struct WebSnaps){.busy = snaps->busy};
}

WebSnaps *web_snaps_new(void) {
    return g_rc_box_new0(WebSnaps);
}

void web_snaps_unref(WebSnaps *snaps) {
    g_rc_box_release_full(snaps, clear);
}

static void shot_free(struct shot *shot) {
    if (shot->file >= 0)
        close(shot->file);
    frame_unref(shot->frame);
    g_clear_pointer(&shot->png, g_bytes_unref);
    web_snaps_unref(shot->snaps);
    g_free(shot->camera);
    g_free(shot);
}

/* Reads the pixels, and measures and encodes the picture. Runs in a thread. */
static void develop(GTask *work, gpointer source, gpointer data, GCancellable *cancellable) {
    struct shot *shot = data;
    Frame *frame = shot->frame;
    const gsize size = (gsize)frame->width * (gsize)frame->height * sizeof(guint16);
    gsize done = 0;
    gssize n;
    while (done < size &&
           (n = pread(shot->file, (guint8 *)frame->pixels + done, size - done, (off_t)done)) > 0)
        done += (gsize)n;
    if (done < size) {
        g_task_return_new_error(
            work, G_IO_ERROR, G_IO_ERROR_PARTIAL_INPUT,
            "mesorigd sent only %zu of the picture's %zu bytes: take the picture again", done,
            size);
        return;
    }
    int width, height;
    g_autofree guint8 *rgb = NULL;
    GError *error = NULL;
    shot->values = picture_values(frame);
    thumbnail_make_sized(frame, WEB_SNAPS_SIDE, &width, &height, &rgb);
    shot->png = png_bytes(rgb, width, height, &error);
    if (error)
        g_task_return_error(work, error);
    else
        g_task_return_boolean(work, TRUE);
}

static char *shot_json(const struct shot *shot) {
    const Frame *frame = shot->frame;
    const struct picture_values *values = &shot->values;
    const struct {
        const char *key;
        double value;
    } numbers[] = {{"black_dn", frame->black_level}, {"mean_dn", values->mean_dn},
                   {"max_dn", values->max_dn},       {"high_dn", values->high_dn},
                   {"saturated", values->saturated}, {"dark", values->dark},
                   {"focus", values->focus}};
    GVariantBuilder to, histogram;
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "camera", g_variant_new_string(shot->camera));
    g_variant_builder_add(&to, "{sv}", "width", g_variant_new_int32(frame->width));
    g_variant_builder_add(&to, "{sv}", "height", g_variant_new_int32(frame->height));
    g_variant_builder_add(&to, "{sv}", "bits", g_variant_new_int32(frame->bits));
    g_variant_builder_add(&to, "{sv}", "cfa", g_variant_new_string(cfa_name(frame->cfa)));
    g_variant_builder_add(&to, "{sv}", "exposure_us", g_variant_new_int64(frame->exposure_us));
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_variant_builder_add(&to, "{sv}", numbers[i].key, g_variant_new_double(numbers[i].value));
    g_variant_builder_init(&histogram, G_VARIANT_TYPE("au"));
    for (int i = 0; i < PICTURE_BINS; i++)
        g_variant_builder_add(&histogram, "u", values->bins[i]);
    g_variant_builder_add(&to, "{sv}", "histogram", g_variant_builder_end(&histogram));
    return json_text(g_variant_builder_end(&to));
}

/* Keeps the picture, and answers the task. */
static void on_developed(GObject *source, GAsyncResult *result, gpointer data) {
    struct shot *shot = data;
    WebSnaps *snaps = shot->snaps;
    g_autoptr(GError) error = NULL;
    snaps->busy = FALSE;
    if (g_task_propagate_boolean(G_TASK(result), &error)) {
        g_autofree char *json = shot_json(shot);
        snaps->camera = g_strdup(shot->camera);
        snaps->frame = frame_ref(shot->frame);
        snaps->high_dn = shot->values.high_dn;
        snaps->png = g_bytes_ref(shot->png);
        web_task_answer(&shot->task, SOUP_STATUS_OK, json);
    } else {
        web_task_refuse(&shot->task, SOUP_STATUS_CONFLICT, error->message);
    }
    shot_free(shot);
}

/* Reads the answer of Snap, without the pixels. */
static gboolean read_answer(GVariant *answer, GUnixFDList *files, struct shot *shot,
                            GError **error) {
    guint width, height, bits;
    double black_dn;
    const char *filter;
    gint64 exposed_us;
    gint32 handle;
    enum cfa cfa;
    g_variant_get(answer, "(uuud&sxh)", &width, &height, &bits, &black_dn, &filter, &exposed_us,
                  &handle);
    shot->file = files ? g_unix_fd_list_get(files, handle, error) : -1;
    if (shot->file < 0)
        return FALSE;
    if (width < 1 || height < 1 || width > MAX_SIDE || height > MAX_SIDE ||
        (guint64)width * height > MAX_PIXELS || bits < 1 || bits > 16 || !cfa_parse(filter, &cfa)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "mesorigd sent a picture of an unknown form (%u × %u pixels of %u bits, colour "
                    "filter %s): run mesorigd and mesorig-web of the same version",
                    width, height, bits, filter);
        return FALSE;
    }
    shot->frame = frame_new((int)width, (int)height);
    shot->frame->bits = (int)bits;
    shot->frame->black_level = black_dn;
    shot->frame->cfa = cfa;
    shot->frame->exposure_us = exposed_us;
    return TRUE;
}

static void on_snap(GVariant *answer, GUnixFDList *files, const GError *error, gpointer data) {
    struct shot *shot = data;
    g_autoptr(GError) unfit = NULL;
    clear(shot->snaps); /* only one picture is in memory at a time */
    if (!error && read_answer(answer, files, shot, &unfit)) {
        g_autoptr(GTask) work = g_task_new(NULL, NULL, on_developed, shot);
        g_task_set_task_data(work, shot, NULL); /* on_developed() frees it, in the main thread */
        g_task_run_in_thread(work, develop);
        return;
    }
    shot->snaps->busy = FALSE;
    web_task_refuse(&shot->task, SOUP_STATUS_CONFLICT,
                    error   ? error->message
                    : unfit ? unfit->message
                            : "mesorigd sent no picture: take the picture again");
    shot_free(shot);
}

void web_snaps_take(const struct web_task *task) {
    double exposure_us;
    if (!g_utf8_validate(task->name, -1, NULL)) {
        web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                        "the name of this camera is not UTF-8: /api/v1/state lists the cameras");
        return;
    }
    if (!web_task_number(task, "exposure_us", 1, MAX_EXPOSURE, &exposure_us))
        return;
    if (task->snaps->busy) {
        web_task_refuse(task, SOUP_STATUS_CONFLICT,
                        "another picture is being taken: try again when it is done");
        return;
    }
    struct shot *shot = g_new0(struct shot, 1);
    shot->task = (struct web_task){.back = task->back, .data = task->data};
    shot->snaps = g_rc_box_acquire(task->snaps);
    shot->camera = g_strdup(task->name);
    shot->file = -1;
    shot->snaps->busy = TRUE;
    web_rig_call_files(task->rig, "Snap",
                       g_variant_new("(sxd)", task->name, (gint64)exposure_us, 0.0), on_snap, shot);
}

/* Returns whether the last picture is of the camera of the task. If it is not, answers the task. */
static gboolean has_picture(const struct web_task *task) {
    if (task->snaps->camera && strcmp(task->snaps->camera, task->name) == 0)
        return TRUE;
    web_task_refuse(task, SOUP_STATUS_NOT_FOUND,
                    "the last picture on request is of another camera, or there is none: POST "
                    "cameras/NAME/snap takes one");
    return FALSE;
}

void web_snaps_png(const struct web_task *task) {
    if (has_picture(task))
        web_task_bytes(task, "image/png", task->snaps->png);
}

void web_snaps_pixels(const struct web_task *task) {
    double x, y;
    g_autoptr(GError) error = NULL;
    if (!web_task_number(task, "x", 0, MAX_SIDE, &x) ||
        !web_task_number(task, "y", 0, MAX_SIDE, &y) || !has_picture(task))
        return;
    const Frame *frame = task->snaps->frame;
    const int width = MIN(WEB_SNAPS_PIXELS, frame->width);
    const int height = MIN(WEB_SNAPS_PIXELS, frame->height);
    const int left = MIN((int)x, frame->width - width), top = MIN((int)y, frame->height - height);
    const int full = (1 << frame->bits) - 1;
    const double white = MAX(task->snaps->high_dn - frame->black_level, 1);
    g_autofree guint8 *rgb = g_malloc((gsize)3 * (gsize)width * (gsize)height);
    for (int i = 0; i < width * height; i++) {
        const int row = top + i / width, column = left + i % width;
        const guint16 dn = frame->pixels[(gsize)row * (gsize)frame->width + (gsize)column];
        guint8 *to = rgb + 3 * (gsize)i;
        const double linear = CLAMP((dn - frame->black_level) / white, 0, 1);
        memset(to, (int)lround(255 * srgb_encode(linear)), 3);
        if (dn >= full) {
            to[0] = 255;
            to[1] = to[2] = 0;
        }
    }
    g_autoptr(GBytes) png = png_bytes(rgb, width, height, &error);
    if (png)
        web_task_bytes(task, "image/png", png);
    else
        web_task_refuse(task, SOUP_STATUS_INTERNAL_SERVER_ERROR, error->message);
}
