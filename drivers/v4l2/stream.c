#include "stream.h"

#include "drivers/device.h"

#include <errno.h>
#include <math.h>
#include <sys/mman.h>

/* A buffer request in the form that the node's type needs. */
struct asked {
    struct v4l2_buffer buffer;
    struct v4l2_plane plane;
};

static void fill_asked(struct asked *asked, const struct video_node *node, guint32 index) {
    *asked =
        (struct asked){.buffer = {.index = index, .type = node->type, .memory = V4L2_MEMORY_MMAP}};
    if (node->type != V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE)
        return;
    asked->buffer.m.planes = &asked->plane;
    asked->buffer.length = 1;
}

static gboolean choose_format(const struct video_node *node, const char *name,
                              const struct video_format **ret, GError **error) {
    g_autoptr(GArray) offered = video_node_formats(node);
    g_autoptr(GString) list = g_string_new(NULL);
    gboolean named = name && *name, has_wanted = FALSE;
    guint32 wanted = 0;
    *ret = NULL;
    if (named)
        video_fourcc_parse(name, &wanted);
    for (guint i = 0; i < offered->len; i++) {
        guint32 fourcc = g_array_index(offered, guint32, i);
        g_autofree char *text = video_fourcc_name(fourcc);
        g_string_append_printf(list, "%s%s", i ? ", " : "", text);
        has_wanted |= named && fourcc == wanted;
        if (!named)
            *ret = video_format_better(*ret, video_format_find(fourcc));
        else if (fourcc == wanted)
            *ret = video_format_find(fourcc);
    }
    if (!*ret && named)
        video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                     has_wanted
                         ? "offers format %s, but only Bayer, mono, YUYV and UYVY formats can "
                           "be used for measuring; it offers %s"
                         : "does not offer format %s; it offers %s, of which only Bayer, "
                           "mono, YUYV and UYVY formats can be used for measuring",
                     name, list->len ? list->str : "no format");
    else if (!*ret && offered->len == 0)
        video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                     "offers no format" ERROR_ADVICE "use another camera");
    else if (!*ret)
        video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                     "offers only %s, which cannot be used for measuring; a camera with a Bayer, "
                     "mono, YUYV or UYVY format is needed",
                     list->str);
    return *ret != NULL;
}

static gboolean stream_check_format(const struct video_node *node,
                                    const struct video_request *request,
                                    const struct video_pix *pix, const struct video_setup *setup,
                                    GError **error) {
    g_autofree char *name = video_fourcc_name(setup->format->fourcc);
    g_autofree char *sizes = video_node_sizes(node, setup->format->fourcc);
    gboolean wide = request->width > 0 && (guint32)request->width != pix->width;
    gboolean high = request->height > 0 && (guint32)request->height != pix->height;
    if (pix->width < 1 || pix->height < 1 || pix->width > 65536 || pix->height > 65536 ||
        pix->fourcc != setup->format->fourcc ||
        pix->stride < video_format_row_bytes(setup->format, (int)pix->width) ||
        pix->stride > 65536 * 16)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                            "answered with %u × %u pixels in rows of %u bytes for format %s, which "
                            "is impossible" ERROR_ADVICE "choose another format",
                            pix->width, pix->height, pix->stride, name);
    if (pix->planes != 1)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                            "spreads a frame of format %s over %u planes of memory; only formats "
                            "of one plane are supported; choose another format",
                            name, pix->planes);
    if (wide || high)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                            "does not offer %d × %d pixels in format %s; it offers %s" ERROR_ADVICE
                            "set width and height",
                            request->width, request->height, name, *sizes ? sizes : "others");
    if (pix->field != V4L2_FIELD_NONE)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                            "sends interlaced fields (field type %u), not whole frames" ERROR_ADVICE
                            "choose another format, width or height",
                            pix->field);
    return TRUE;
}

/* Sets the frame rate. *ret_us is the frame interval that the device reports or, if the device
 * does not report one, that of the requested frame rate. */
static gboolean set_rate(const struct video_node *node, double frame_rate, gint64 *ret_us,
                         GError **error) {
    struct v4l2_streamparm parm = {.type = node->type};
    struct v4l2_fract *interval = &parm.parm.capture.timeperframe;
    gboolean knows = video_ioctl(node, VIDIOC_G_PARM, &parm) == 0 &&
                     parm.parm.capture.capability & V4L2_CAP_TIMEPERFRAME;
    if (knows && frame_rate > 0) {
        *interval = (struct v4l2_fract){10000, (guint32)lrint(frame_rate * 1e4)};
        if (video_ioctl(node, VIDIOC_S_PARM, &parm) < 0)
            return video_set_error(error, node, errno, "could not be set to its frame_rate");
    }
    double seconds = frame_rate > 0 ? 1 / frame_rate : 0;
    if (knows && interval->denominator > 0)
        seconds = (double)interval->numerator / interval->denominator;
    if (seconds <= 0 || seconds > 3600)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                            "does not report its frame rate; set frame_rate");
    if (frame_rate > 0 && fabs(seconds * frame_rate - 1) > 0.05)
        return video_refuse(
            error, DEVICE_ERROR_UNSUPPORTED, node,
            "does not send %g frames per second in this format, but %.4g; correct frame_rate",
            frame_rate, 1 / seconds);
    *ret_us = MAX(llrint(seconds * 1e6), 1);
    return TRUE;
}

gboolean video_setup_apply(const struct video_node *node, const struct video_request *request,
                           struct video_setup *ret, GError **error) {
    struct video_pix pix;
    *ret = (struct video_setup){0};
    if (!choose_format(node, request->format, &ret->format, error))
        return FALSE;
    gboolean set = video_node_get_pix(node, &pix) == 0;
    if (set) {
        pix.width = request->width > 0 ? (guint32)request->width : pix.width;
        pix.height = request->height > 0 ? (guint32)request->height : pix.height;
        pix.fourcc = ret->format->fourcc;
        set = video_node_set_pix(node, &pix) == 0;
    }
    if (!set)
        return video_set_error(error, node, errno, "could not be set to its format");
    if (!stream_check_format(node, request, &pix, ret, error) ||
        !set_rate(node, request->frame_rate, &ret->interval_us, error))
        return FALSE;
    ret->width = (int)pix.width;
    ret->height = (int)pix.height;
    ret->stride = pix.stride;
    ret->bytes = video_format_bytes(ret->format, ret->width, ret->height, ret->stride);
    ret->full_range = pix.full_range;
    return TRUE;
}

double video_setup_mb_s(const struct video_setup *setup) {
    return (double)setup->stride * setup->height / (double)setup->interval_us;
}

static gboolean map_buffer(struct video_stream *stream, const struct video_node *node,
                           guint32 index, gsize bytes, GError **error) {
    struct asked asked;
    fill_asked(&asked, node, index);
    if (video_ioctl(node, VIDIOC_QUERYBUF, &asked.buffer) < 0)
        return video_set_error(error, node, errno, "did not report its buffers");
    gboolean many = node->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
    guint32 length = many ? asked.plane.length : asked.buffer.length;
    guint32 offset = many ? asked.plane.m.mem_offset : asked.buffer.m.offset;
    if (length < bytes)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                            "has buffers of %u bytes, but a frame has %" G_GSIZE_FORMAT
                            " bytes" ERROR_ADVICE "choose another format",
                            length, bytes);
    guint8 *data = mmap(NULL, length, PROT_READ | PROT_WRITE, MAP_SHARED, node->fd, offset);
    if (data == MAP_FAILED)
        return video_set_error(error, node, errno, "did not let its buffers be mapped");
    stream->buffers[index].data = data;
    stream->buffers[index].size = length;
    stream->n = (int)index + 1;
    return video_ioctl(node, VIDIOC_QBUF, &asked.buffer) == 0 ||
           video_set_error(error, node, errno, "did not take a buffer");
}

gboolean video_stream_start(struct video_stream *stream, const struct video_node *node,
                            const struct video_setup *setup, GError **error) {
    struct v4l2_requestbuffers request = {
        .count = VIDEO_BUFFERS, .type = node->type, .memory = V4L2_MEMORY_MMAP};
    int type = (int)node->type;
    *stream = (struct video_stream){0};
    if (video_ioctl(node, VIDIOC_REQBUFS, &request) < 0)
        return video_set_error(error, node, errno, "gave no buffers");
    gboolean ok = request.count >= 2 ||
                  video_refuse(error, DEVICE_ERROR_UNSUPPORTED, node,
                               "gave %u buffers, but 2 are needed to stream" ERROR_ADVICE
                               "make frames smaller, or end other programs that use cameras",
                               request.count);
    for (guint32 i = 0; ok && i < MIN(request.count, VIDEO_BUFFERS); i++)
        ok = map_buffer(stream, node, i, setup->bytes, error);
    if (ok && video_ioctl(node, VIDIOC_STREAMON, &type) < 0)
        ok = video_set_error(error, node, errno, "could not start streaming");
    if (!ok)
        video_stream_stop(stream, node);
    return ok;
}

void video_stream_stop(struct video_stream *stream, const struct video_node *node) {
    struct v4l2_requestbuffers none = {.type = node->type, .memory = V4L2_MEMORY_MMAP};
    int type = (int)node->type;
    if (node->fd >= 0)
        video_ioctl(node, VIDIOC_STREAMOFF, &type);
    for (int i = 0; i < stream->n; i++)
        munmap(stream->buffers[i].data, stream->buffers[i].size);
    stream->n = 0;
    if (node->fd >= 0)
        video_ioctl(node, VIDIOC_REQBUFS, &none);
}

int video_stream_take(const struct video_stream *stream, const struct video_node *node,
                      struct v4l2_buffer *ret) {
    struct asked asked;
    fill_asked(&asked, node, 0);
    if (video_ioctl(node, VIDIOC_DQBUF, &asked.buffer) < 0)
        return errno == EAGAIN ? 0 : -1;
    *ret = asked.buffer;
    ret->m.offset = 0;
    guint32 begins = asked.plane.data_offset; /* 0 if the node has no planes */
    if (node->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE)
        ret->bytesused = asked.plane.bytesused - MIN(asked.plane.bytesused, begins);
    if ((int)ret->index < stream->n &&
        begins + ret->bytesused <= stream->buffers[ret->index].size) {
        ret->m.offset = begins;
        return 1;
    }
    errno = EIO;
    return -1;
}

void video_stream_give_back(const struct video_node *node, const struct v4l2_buffer *buffer) {
    struct asked again;
    fill_asked(&again, node, buffer->index);
    video_ioctl(node, VIDIOC_QBUF, &again.buffer);
}
