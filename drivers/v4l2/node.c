#include "node.h"

#include "drivers/device.h"
#include "drivers/recording.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define CLASS_FOLDER "/sys/class/video4linux"
#define MAX_LISTED   256 /* limit for lists of formats and sizes; vivid has 80 */

/* Records a call and the struct that the call has filled in. Leaves out the calls that are made for
 * each frame. Keeps errno. */
static void record(const struct video_node *node, unsigned long request, int why,
                   const guint8 *arg) {
    const struct recording_bus bus = {"v4l2", node->path ? node->path : "video"};
    if (request == VIDIOC_QBUF || request == VIDIOC_DQBUF)
        return;
    recording_note(bus, "ioctl V %u: %s", (guint)_IOC_NR(request), why ? g_strerror(why) : "done");
    if (!why && arg)
        recording_bytes(bus, RECORDING_RECEIVED, arg, _IOC_SIZE(request));
    errno = why;
}

int video_ioctl(const struct video_node *node, unsigned long request, void *arg) {
    int code;
    do
        code = ioctl(node->fd, request, arg);
    while (code < 0 && errno == EINTR);
    if (recording_is_on())
        record(node, request, code < 0 ? errno : 0, arg);
    return code;
}

gboolean video_set_error(GError **error, const struct video_node *node, int code,
                         const char *what) {
    static const char gone[] = "it was unplugged" ERROR_ADVICE "check its cable";
    static const char closed[] = "this user may not open it" ERROR_ADVICE
                                 "install etc/udev/60-mesorig.rules, or join group video";
    static const struct {
        int code;
        enum device_error error;
        const char *advice;
    } known[] = {
        {ENODEV, DEVICE_ERROR_DISCONNECTED, gone},
        {ENXIO, DEVICE_ERROR_DISCONNECTED, gone},
        {ENOENT, DEVICE_ERROR_DISCONNECTED,
         "there is no such device" ERROR_ADVICE "check its path and its cable"},
        {EBUSY, DEVICE_ERROR_BUSY, "another program uses it" ERROR_ADVICE "end that program"},
        {EACCES, DEVICE_ERROR_UNSUPPORTED, closed},
        {EPERM, DEVICE_ERROR_UNSUPPORTED, closed},
        {ENOSPC, DEVICE_ERROR_UNSUPPORTED,
         "the USB bus has no bandwidth left for it" ERROR_ADVICE
         "lower frame_rate, make frames smaller, or plug it into another controller"},
        {ENOTTY, DEVICE_ERROR_UNSUPPORTED, "it cannot do that" ERROR_ADVICE "use another camera"},
    };
    const char *path = node->path ? node->path : "the camera";
    for (gsize i = 0; i < G_N_ELEMENTS(known); i++)
        if (known[i].code == code)
            return device_error_set(error, known[i].error, node->who, "%s %s: %s", path, what,
                                    known[i].advice);
    return device_error_set(error, DEVICE_ERROR_PROTOCOL, node->who,
                            "%s %s: %s" ERROR_ADVICE "unplug the camera, and plug it in again",
                            path, what, g_strerror(code));
}

gboolean video_refuse(GError **error, enum device_error code, const struct video_node *node,
                      const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_autofree char *what = g_strdup_vprintf(format, args);
    va_end(args);
    return device_error_set(error, code, node->who, "%s %s", node->path, what);
}

void video_node_close(struct video_node *node) {
    if (node->fd >= 0)
        close(node->fd);
    g_free(node->path);
    g_free(node->card);
    g_free(node->driver);
    g_free(node->bus);
    *node = (struct video_node){.fd = -1};
}

static char *node_text_of(const guint8 *field, gsize size) {
    g_autofree char *text = g_strndup((const char *)field, size);
    return g_utf8_make_valid(text, -1);
}

/* Opens a node. Sets errno on failure; ENOTTY means that it is not a video capture device. */
static gboolean open_path(struct video_node *node, const char *path) {
    struct v4l2_capability capability = {0};
    *node = (struct video_node){.fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC)};
    node->path = g_strdup(path);
    if (node->fd < 0 || video_ioctl(node, VIDIOC_QUERYCAP, &capability) < 0)
        return FALSE;
    guint32 can = capability.capabilities & V4L2_CAP_DEVICE_CAPS ? capability.device_caps
                                                                 : capability.capabilities;
    node->card = node_text_of(capability.card, sizeof capability.card);
    node->driver = node_text_of(capability.driver, sizeof capability.driver);
    node->bus = node_text_of(capability.bus_info, sizeof capability.bus_info);
    node->type = can & V4L2_CAP_VIDEO_CAPTURE          ? V4L2_BUF_TYPE_VIDEO_CAPTURE
                 : can & V4L2_CAP_VIDEO_CAPTURE_MPLANE ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE
                                                       : 0;
    errno = ENOTTY;
    return node->type && can & V4L2_CAP_STREAMING;
}

static int by_number(gconstpointer a, gconstpointer b) {
    const char *one = *(char *const *)a, *two = *(char *const *)b;
    gsize n = strlen(one), m = strlen(two);
    return n != m ? (n > m) - (n < m) : strcmp(one, two);
}

static GPtrArray *list_all(void) {
    GPtrArray *paths = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GDir) dir = g_dir_open(CLASS_FOLDER, 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir)))
        if (g_str_has_prefix(name, "video"))
            g_ptr_array_add(paths, g_strconcat("/dev/", name, NULL));
    g_ptr_array_sort(paths, by_number);
    return paths;
}

GPtrArray *video_node_list(void) {
    GPtrArray *all = list_all();
    for (guint i = all->len; i-- > 0;) {
        struct video_node node;
        /* A node that may not be opened stays in the list, so that an error can name it. */
        if (!open_path(&node, all->pdata[i]) && node.fd >= 0)
            g_ptr_array_remove_index(all, i);
        video_node_close(&node);
    }
    return all;
}

/* Opens the first node that matches bus. *n is the number of matching nodes. Appends to `seen`, as
 * text, every node that could be opened. */
static void open_fitting(struct video_node *ret, const char *bus, GString *seen, int *n) {
    g_autoptr(GPtrArray) all = list_all();
    *n = 0;
    for (guint i = 0; i < all->len; i++) {
        struct video_node node;
        gboolean fits = FALSE;
        if (open_path(&node, all->pdata[i])) {
            fits = !bus || !*bus || strcmp(bus, node.bus) == 0;
            g_string_append_printf(seen, "%s%s (%s, bus %s)", seen->len ? ", " : "", node.path,
                                   node.card, node.bus);
        }
        *n += fits;
        if (fits && *n == 1)
            *ret = node;
        else
            video_node_close(&node);
    }
}

gboolean video_node_open(struct video_node *node, const char *who, const char *path,
                         const char *bus, GError **error) {
    g_autoptr(GString) seen = g_string_new(NULL);
    int n;
    *node = (struct video_node){.fd = -1};
    if (path && *path) {
        gboolean opened = open_path(node, path);
        node->who = who;
        if (opened)
            return TRUE;
        if (errno == ENOTTY)
            device_error_set(error, DEVICE_ERROR_UNSUPPORTED, who,
                             "%s is not a camera that streams video" ERROR_ADVICE
                             "“mesorig devices” lists those",
                             path);
        else
            video_set_error(error, node, errno, "could not be opened");
        video_node_close(node);
        return FALSE;
    }
    open_fitting(node, bus, seen, &n);
    node->who = who;
    if (n == 1)
        return TRUE;
    video_node_close(node);
    if (n > 1)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, who,
            "more than one camera fits: %s" ERROR_ADVICE "select one by bus or device", seen->str);
    return device_error_set(error, DEVICE_ERROR_DISCONNECTED, who,
                            "no such camera is plugged in (bus \"%s\"); found: %s" ERROR_ADVICE
                            "check its cable, and that this user may open it",
                            bus ? bus : "", seen->len ? seen->str : "none");
}

static gboolean is_full_range(guint32 quantization, guint32 colorspace) {
    return quantization == V4L2_QUANTIZATION_FULL_RANGE ||
           (quantization == V4L2_QUANTIZATION_DEFAULT && colorspace == V4L2_COLORSPACE_JPEG);
}

static void read_pix(const struct v4l2_format *format, struct video_pix *ret) {
    const struct v4l2_pix_format *pix = &format->fmt.pix;
    const struct v4l2_pix_format_mplane *many = &format->fmt.pix_mp;
    if (format->type == V4L2_BUF_TYPE_VIDEO_CAPTURE)
        *ret = (struct video_pix){pix->width,
                                  pix->height,
                                  pix->pixelformat,
                                  pix->field,
                                  pix->bytesperline,
                                  1,
                                  pix->priv == V4L2_PIX_FMT_PRIV_MAGIC &&
                                      is_full_range(pix->quantization, pix->colorspace)};
    else
        *ret = (struct video_pix){many->width,
                                  many->height,
                                  many->pixelformat,
                                  many->field,
                                  many->plane_fmt[0].bytesperline,
                                  many->num_planes,
                                  is_full_range(many->quantization, many->colorspace)};
}

int video_node_get_pix(const struct video_node *node, struct video_pix *ret) {
    struct v4l2_format format = {.type = node->type};
    if (video_ioctl(node, VIDIOC_G_FMT, &format) < 0)
        return -1;
    read_pix(&format, ret);
    return 0;
}

/* Requests only width, height and format. The device chooses the other values. */
int video_node_set_pix(const struct video_node *node, struct video_pix *pix) {
    struct v4l2_format format = {.type = node->type};
    if (video_ioctl(node, VIDIOC_G_FMT, &format) < 0)
        return -1;
    if (format.type == V4L2_BUF_TYPE_VIDEO_CAPTURE) {
        struct v4l2_pix_format *one = &format.fmt.pix;
        one->width = pix->width;
        one->height = pix->height;
        one->pixelformat = pix->fourcc;
        one->field = V4L2_FIELD_NONE;
        one->bytesperline = one->sizeimage = 0;
    } else {
        struct v4l2_pix_format_mplane *many = &format.fmt.pix_mp;
        many->width = pix->width;
        many->height = pix->height;
        many->pixelformat = pix->fourcc;
        many->field = V4L2_FIELD_NONE;
        many->num_planes = 1;
        memset(many->plane_fmt, 0, sizeof many->plane_fmt);
    }
    if (video_ioctl(node, VIDIOC_S_FMT, &format) < 0)
        return -1;
    read_pix(&format, pix);
    return 0;
}

GArray *video_node_formats(const struct video_node *node) {
    GArray *formats = g_array_new(FALSE, FALSE, sizeof(guint32));
    for (guint32 i = 0; i < MAX_LISTED; i++) {
        struct v4l2_fmtdesc desc = {.index = i, .type = node->type};
        if (video_ioctl(node, VIDIOC_ENUM_FMT, &desc) < 0)
            break;
        g_array_append_val(formats, desc.pixelformat);
    }
    return formats;
}

char *video_node_sizes(const struct video_node *node, guint32 fourcc) {
    GString *text = g_string_new(NULL);
    for (guint32 i = 0; i < MAX_LISTED; i++) {
        struct v4l2_frmsizeenum size = {.index = i, .pixel_format = fourcc};
        if (video_ioctl(node, VIDIOC_ENUM_FRAMESIZES, &size) < 0)
            break;
        if (size.type != V4L2_FRMSIZE_TYPE_DISCRETE) {
            g_string_append_printf(text, "%u × %u to %u × %u", size.stepwise.min_width,
                                   size.stepwise.min_height, size.stepwise.max_width,
                                   size.stepwise.max_height);
            break;
        }
        g_string_append_printf(text, "%s%u × %u", i ? ", " : "", size.discrete.width,
                               size.discrete.height);
    }
    return g_string_free(text, FALSE);
}

char *video_node_sysfs(const struct video_node *node) {
    char *target = realpath(node->path, NULL); /* resolves a link in /dev/v4l */
    g_autofree char *name = g_path_get_basename(target ? target : node->path);
    g_autofree char *device = g_build_filename(CLASS_FOLDER, name, "device", NULL);
    free(target);
    char *real = realpath(device, NULL);
    char *copy = g_strdup(real);
    free(real);
    return copy;
}
