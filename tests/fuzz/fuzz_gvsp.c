/* Pictures of a GigE camera. Aravis joins the packets and returns size, format, times and number.
 * These functions of Aravis are replaced here by functions that return any value. */
#include "fuzz.h"

#include "aravis/answer.h"
#include "drivers/frame.h"

#include <string.h>

#define MAX_PIXELS 4096

struct __attribute__((packed)) head {
    guint8 status, format, of_limits, width, height, limits_width, limits_height, flags;
    guint32 code;
    guint64 id, stamp_ns, system_ns;
};

struct _ArvBuffer { /* Aravis's own is opaque */
    struct head head;
    const uint8_t *data;
    size_t size;
};

static struct _ArvBuffer now;
static int n_formats;

ArvBufferStatus arv_buffer_get_status(ArvBuffer *buffer) {
    return (ArvBufferStatus)((int)now.head.status % 10 - 1);
}

guint64 arv_buffer_get_timestamp(ArvBuffer *buffer) {
    return now.head.stamp_ns;
}

guint64 arv_buffer_get_system_timestamp(ArvBuffer *buffer) {
    return now.head.system_ns;
}

guint64 arv_buffer_get_frame_id(ArvBuffer *buffer) {
    return now.head.id;
}

gint arv_buffer_get_image_width(ArvBuffer *buffer) {
    return now.head.width;
}

gint arv_buffer_get_image_height(ArvBuffer *buffer) {
    return now.head.height;
}

ArvPixelFormat arv_buffer_get_image_pixel_format(ArvBuffer *buffer) {
    return (ArvPixelFormat)(now.head.flags & 8 ? now.head.code
                                               : aravis_formats[now.head.format % n_formats].code);
}

const void *arv_buffer_get_data(ArvBuffer *buffer, size_t *ret_size) {
    *ret_size = now.size;
    return now.data;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static guint8 *copy; /* of exactly so many bytes: what is read beyond them is seen */
    if (size < sizeof now.head)
        return 0;
    for (n_formats = 0; aravis_formats[n_formats].name;)
        n_formats++;
    memcpy(&now.head, data, sizeof now.head);
    g_free(copy);
    copy = g_memdup2(data + sizeof now.head, size - sizeof now.head);
    now.data = copy;
    now.size = size - sizeof now.head;
    const struct aravis_format *format = &aravis_formats[now.head.of_limits % n_formats];
    const struct aravis_limits limits = {.width = 1 + now.head.limits_width % 64,
                                         .height = 1 + now.head.limits_height % 64,
                                         .format = format,
                                         .bits = format->bits};
    struct answer_state state = {.limits = &limits,
                                 .clock = {.valid = now.head.flags & 1, .error_us = 1000},
                                 .exposure_us = 4000,
                                 .shot = 1,
                                 .sent_us = g_get_monotonic_time(),
                                 .stamp_is_end = (now.head.flags & 2) != 0};
    state.asked_us = state.sent_us;
    if (now.head.flags & 4) /* near to now */
        now.head.stamp_ns =
            (guint64)(state.sent_us + (gint64)(now.head.stamp_ns % 20000) - 10000) * 1000;
    answer_begin(&state);
    for (int i = 0; i < 2; i++) {
        GError *error = NULL;
        gint64 before_us = 0;
        g_autoptr(Frame) frame = answer_frame(&state, (ArvBuffer *)&now, &before_us, &error);
        g_assert_true(!frame || !error);
        g_assert_true(frame || error || before_us > 0);
        if (frame) {
            g_assert_cmpint(frame->width, ==, limits.width);
            g_assert_cmpint(frame->height, ==, limits.height);
            g_assert_cmpint(frame->exposure_start_us, >=, state.sent_us);
            for (int k = 0; k < frame->width * frame->height; k++)
                g_assert_cmpint(frame->pixels[k], <, 1 << limits.bits);
        }
        g_clear_error(&error);
        now.head.id += 1;
    }
    return 0;
}
