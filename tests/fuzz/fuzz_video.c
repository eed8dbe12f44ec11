/* The controls, formats and sizes that a V4L2 device reports, and a picture of the reported size.
 * This file replaces ioctl() while a device is read. */
#include "fuzz.h"

#include "v4l2/controls.h"
#include "v4l2/stream.h"

#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#define MAX_BYTES (1 << 20) /* larger pictures are not unpacked: they would be slow */

static gboolean video_asked;
static const uint8_t *said;
static size_t said_left;

/* The device keeps what is set, but for what it says itself. */
int ioctl(int fd, unsigned long request, ...) {
    va_list args;
    va_start(args, request);
    void *arg = va_arg(args, void *);
    va_end(args);
    if (!video_asked)
        return (int)syscall(SYS_ioctl, fd, request, arg);
    if (said_left == 0) {
        errno = ENODEV;
        return -1;
    }
    static const int refusals[] = {EINVAL, ENOTTY, EBUSY, EIO, ENODEV, EACCES, ENOSPC, ERANGE};
    const uint8_t how = *said++;
    said_left--;
    if (how >= 248) {
        errno = refusals[how - 248];
        return -1;
    }
    /* So many bytes of the answer, from the place in it that the next byte says, in fours. */
    const size_t size = _IOC_SIZE(request);
    if (how == 0 || said_left == 0)
        return 0;
    const size_t at = 4u * (*said++ % (size / 4));
    said_left--;
    const size_t n = MIN(MIN((size_t)how, size - at), said_left);
    memcpy((guint8 *)arg + at, said, n);
    said += n;
    said_left -= n;
    return 0;
}

static void check_text(const GError *error) {
    g_assert_true(!error || g_utf8_validate(error->message, -1, NULL));
}

static void ask(const struct video_node *node) {
    static const char *const settings[] = {"brightness=10", "gain=-1", "white_balance = 5", "x",
                                           NULL};
    GError *error = NULL;
    struct video_controls controls;
    video_controls_read(node, &controls);
    g_free(video_controls_lacking(&controls));
    const struct video_range *ranges[] = {&controls.exposure, &controls.gain,
                                          &controls.white_balance};
    for (gsize k = 0; k < G_N_ELEMENTS(ranges); k++)
        for (int i = 0; ranges[k]->id && i < 3; i++) {
            const gint64 value = video_range_nearest(ranges[k], (i - 1) * 1e9);
            g_assert_cmpint(value, >=, ranges[k]->min);
            g_assert_cmpint(value, <=, ranges[k]->max);
        }
    gboolean ok = video_controls_by_hand(node, &error);
    check_text(error);
    fuzz_check(ok, &error);
    for (int i = 0; settings[i]; i++) {
        ok = video_control_set_named(node, settings[i], &error);
        check_text(error);
        fuzz_check(ok, &error);
    }
    g_auto(GStrv) left = video_controls_left(node, (char **)settings);
    for (char **text = left; *text; text++)
        g_assert_true(g_utf8_validate(*text, -1, NULL));
    g_autoptr(GArray) formats = video_node_formats(node);
    g_free(video_node_sizes(node, formats->len ? g_array_index(formats, guint32, 0) : 0));
}

static void take(const struct video_node *node, int width, int height) {
    const struct video_request request = {
        .format = width % 2 ? "" : "GREY", .width = width, .height = height};
    GError *error = NULL;
    struct video_setup setup;
    const gboolean ok = video_setup_apply(node, &request, &setup, &error);
    check_text(error);
    fuzz_check(ok, &error);
    if (!ok)
        return;
    g_assert_cmpint(setup.width, >, 0);
    g_assert_cmpint(setup.height, >, 0);
    g_assert_cmpint(setup.interval_us, >=, 0);
    if (setup.bytes > MAX_BYTES || (gint64)setup.width * setup.height > MAX_BYTES)
        return;
    g_autofree guint8 *picture = g_malloc(setup.bytes);
    g_autofree guint16 *pixels = g_new(guint16, (gsize)setup.width * (gsize)setup.height);
    memset(picture, 0xa5, setup.bytes);
    video_format_unpack(setup.format, picture, setup.stride, setup.width, setup.height, pixels);
    for (gsize i = 0; i < (gsize)setup.width * (gsize)setup.height; i++)
        g_assert_cmpint(pixels[i], <, 1 << setup.format->bits);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 3)
        return 0;
    const struct video_node node = {.fd = -1,
                                    .who = "camera top",
                                    .path = (char[]){"/dev/video9"},
                                    .type = data[0] % 2 ? V4L2_BUF_TYPE_VIDEO_CAPTURE
                                                        : V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE};
    said = data + 3;
    said_left = size - 3;
    video_asked = TRUE;
    if (data[0] & 2)
        ask(&node);
    else
        take(&node, data[1] % 64, data[2] % 64);
    video_asked = FALSE;
    return 0;
}
