#include "v4l2_private.h"

#include "virtual/testbed.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define MAX_RATE 1000.0

struct virtual_control *virtual_find_control(VirtualV4l2 *camera, guint32 id) {
    for (int i = 0; i < camera->n_controls; i++)
        if (camera->controls[i].about.id == id)
            return &camera->controls[i];
    return NULL;
}

/* The following functions each handle an ioctl. They return 0 or an errno. argument is the struct
 * of the ioctl. */

static guint32 type_of(const VirtualV4l2 *camera) {
    return camera->config.planes ? V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE : V4L2_BUF_TYPE_VIDEO_CAPTURE;
}

static int query_capability(VirtualV4l2 *camera, void *argument) {
    struct v4l2_capability *capability = argument;
    guint32 kind = camera->config.planes ? V4L2_CAP_VIDEO_CAPTURE_MPLANE : V4L2_CAP_VIDEO_CAPTURE;
    *capability =
        (struct v4l2_capability){.version = 0x060100,
                                 .capabilities = kind | V4L2_CAP_STREAMING | V4L2_CAP_DEVICE_CAPS,
                                 .device_caps = kind | V4L2_CAP_STREAMING};
    gboolean uvc = camera->config.stamp == VIRTUAL_V4L2_FIRST_DATA;
    g_strlcpy((char *)capability->driver, uvc ? "uvcvideo" : "virtual", 16);
    g_snprintf((char *)capability->card, 32, "Virtual camera %s", camera->port);
    g_snprintf((char *)capability->bus_info, 32, "usb-virtual-%s", camera->port);
    return 0;
}

static int enum_format(VirtualV4l2 *camera, void *argument) {
    struct v4l2_fmtdesc *desc = argument;
    return desc->type == type_of(camera) &&
                   virtual_pixels_offered(&camera->config, desc->index, &desc->pixelformat)
               ? 0
               : EINVAL;
}

static int enum_size(VirtualV4l2 *camera, void *argument) {
    struct v4l2_frmsizeenum *size = argument;
    if (size->index != 0)
        return EINVAL;
    size->type = V4L2_FRMSIZE_TYPE_DISCRETE;
    size->discrete.width = (guint32)camera->config.width;
    size->discrete.height = (guint32)camera->config.height;
    return 0;
}

static guint32 virtual_v4l2_size_of(const VirtualV4l2 *camera) {
    return (guint32)virtual_pixels_size(camera->fourcc, camera->config.width,
                                        camera->config.height);
}

gsize virtual_buffer_room(const VirtualV4l2 *camera) {
    gsize page = (gsize)sysconf(_SC_PAGESIZE);
    return (virtual_v4l2_size_of(camera) + page - 1) / page * page;
}

static int get_format(VirtualV4l2 *camera, void *argument) {
    struct v4l2_format *format = argument;
    const guint32 width = (guint32)camera->config.width, height = (guint32)camera->config.height;
    const guint32 stride = (guint32)virtual_pixels_stride(camera->fourcc, camera->config.width);
    if (format->type != type_of(camera))
        return EINVAL;
    if (!camera->config.planes) {
        format->fmt.pix = (struct v4l2_pix_format){.width = width,
                                                   .height = height,
                                                   .pixelformat = camera->fourcc,
                                                   .field = V4L2_FIELD_NONE,
                                                   .bytesperline = stride,
                                                   .sizeimage = virtual_v4l2_size_of(camera),
                                                   .colorspace = V4L2_COLORSPACE_SRGB,
                                                   .priv = V4L2_PIX_FMT_PRIV_MAGIC};
        return 0;
    }
    struct v4l2_pix_format_mplane *pix = &format->fmt.pix_mp;
    *pix = (struct v4l2_pix_format_mplane){.width = width,
                                           .height = height,
                                           .pixelformat = camera->fourcc,
                                           .field = V4L2_FIELD_NONE,
                                           .colorspace = V4L2_COLORSPACE_SRGB,
                                           .num_planes = (guint8)camera->config.planes};
    for (int i = 0; i < camera->config.planes; i++)
        pix->plane_fmt[i] = (struct v4l2_plane_pix_format){
            .sizeimage = virtual_v4l2_size_of(camera), .bytesperline = stride};
    return 0;
}

static int virtual_v4l2_set_format(VirtualV4l2 *camera, void *argument) {
    const struct v4l2_format *format = argument;
    guint32 fourcc, wanted = camera->config.planes ? format->fmt.pix_mp.pixelformat
                                                   : format->fmt.pix.pixelformat;
    if (camera->n_buffers)
        return EBUSY;
    for (guint32 i = 0; virtual_pixels_offered(&camera->config, i, &fourcc); i++)
        if (fourcc == wanted)
            camera->fourcc = fourcc;
    return get_format(camera, argument);
}

static int get_parm(VirtualV4l2 *camera, void *argument) {
    struct v4l2_streamparm *parm = argument;
    parm->parm.capture = (struct v4l2_captureparm){
        .capability = V4L2_CAP_TIMEPERFRAME,
        .timeperframe = {1000, (guint32)lrint(camera->frame_rate * 1000)}};
    return 0;
}

static int set_parm(VirtualV4l2 *camera, void *argument) {
    const struct v4l2_streamparm *parm = argument;
    struct v4l2_fract interval = parm->parm.capture.timeperframe;
    if (camera->streaming)
        return EBUSY;
    if (interval.numerator > 0 && interval.denominator > 0)
        camera->frame_rate = CLAMP((double)interval.denominator / interval.numerator, 1, MAX_RATE);
    return get_parm(camera, argument);
}

/* With V4L2_CTRL_FLAG_NEXT_CTRL, the program asks for the control with the next larger id. Because
 * the controls are sorted by id, this is the first one that the loop finds. */
static int query_control(VirtualV4l2 *camera, void *argument) {
    struct v4l2_queryctrl *query = argument;
    guint32 id = query->id & ~V4L2_CTRL_FLAG_NEXT_CTRL;
    for (int i = 0; i < camera->n_controls; i++) {
        const struct virtual_control *control = &camera->controls[i];
        if (query->id & V4L2_CTRL_FLAG_NEXT_CTRL ? control->about.id > id
                                                 : control->about.id == id) {
            *query = control->about;
            return 0;
        }
    }
    return EINVAL;
}

static int get_control(VirtualV4l2 *camera, void *argument) {
    struct v4l2_control *value = argument;
    const struct virtual_control *control = virtual_find_control(camera, value->id);
    if (!control)
        return EINVAL;
    value->value = control->value;
    return 0;
}

static int virtual_v4l2_set_control(VirtualV4l2 *camera, void *argument) {
    struct v4l2_control *value = argument;
    struct virtual_control *control = virtual_find_control(camera, value->id);
    if (!control)
        return EINVAL;
    if (value->value < control->about.minimum || value->value > control->about.maximum)
        return ERANGE;
    control->value = value->value;
    if (camera->fault == VIRTUAL_V4L2_DISOBEYS)
        control->value = control->about.minimum;
    camera->changed_us = g_get_monotonic_time();
    return 0;
}

static int request_buffers(VirtualV4l2 *camera, void *argument) {
    struct v4l2_requestbuffers *request = argument;
    if (request->memory != V4L2_MEMORY_MMAP || request->type != type_of(camera) ||
        camera->streaming)
        return camera->streaming ? EBUSY : EINVAL;
    request->count = MIN(request->count, MAX_BUFFERS);
    memset(camera->buffers, 0, sizeof camera->buffers);
    camera->n_buffers = (int)request->count;
    off_t size = (off_t)(virtual_buffer_room(camera) * request->count);
    return camera->n_buffers == 0 || ftruncate(camera->fd, MAX(size, 1)) == 0 ? 0 : ENOMEM;
}

static int query_buffer(VirtualV4l2 *camera, void *argument) {
    struct v4l2_buffer *buffer = argument;
    if ((int)buffer->index >= camera->n_buffers)
        return EINVAL;
    guint32 offset = (guint32)(virtual_buffer_room(camera) * buffer->index);
    if (camera->config.planes) {
        buffer->m.planes->length = virtual_v4l2_size_of(camera);
        buffer->m.planes->m.mem_offset = offset;
    } else {
        buffer->length = virtual_v4l2_size_of(camera);
        buffer->m.offset = offset;
    }
    return 0;
}

static int queue_buffer(VirtualV4l2 *camera, void *argument) {
    const struct v4l2_buffer *buffer = argument;
    if ((int)buffer->index >= camera->n_buffers ||
        camera->buffers[buffer->index].state != BUFFER_IDLE)
        return EINVAL;
    camera->buffers[buffer->index].state = BUFFER_QUEUED;
    camera->buffers[buffer->index].order = ++camera->n_ordered;
    return 0;
}

static int dequeue_buffer(VirtualV4l2 *camera, void *argument) {
    struct v4l2_buffer *buffer = argument;
    struct virtual_buffer *done = virtual_oldest_buffer(camera, BUFFER_DONE);
    if (camera->fault == VIRTUAL_V4L2_STREAM_BREAKS) {
        camera->fault = VIRTUAL_V4L2_WELL;
        return EIO;
    }
    if (!camera->streaming || !done)
        return camera->streaming ? EAGAIN : EINVAL;
    buffer->index = (guint32)(done - camera->buffers);
    buffer->flags = done->flags;
    buffer->sequence = done->sequence;
    if (camera->config.planes)
        buffer->m.planes->bytesused = done->bytes;
    else
        buffer->bytesused = done->bytes;
    buffer->timestamp.tv_sec = done->stamp_us / G_USEC_PER_SEC;
    buffer->timestamp.tv_usec = done->stamp_us % G_USEC_PER_SEC;
    buffer->field = V4L2_FIELD_NONE;
    done->state = BUFFER_IDLE;
    return 0;
}

static int stream_on(VirtualV4l2 *camera, void *argument) {
    if (camera->fault == VIRTUAL_V4L2_NO_BANDWIDTH)
        return ENOSPC;
    if (camera->n_buffers == 0 || virtual_pixels_stride(camera->fourcc, 1) == 0)
        return EINVAL;
    if (!camera->streaming)
        virtual_stream_start(camera);
    return 0;
}

static int stream_off(VirtualV4l2 *camera, void *argument) {
    virtual_stream_stop(camera);
    for (int i = 0; i < camera->n_buffers; i++)
        camera->buffers[i].state = BUFFER_IDLE;
    return 0;
}

static const struct {
    unsigned long request;
    gsize size;
    int (*answer)(VirtualV4l2 *camera, void *argument);
} answers[] = {
    {VIDIOC_QUERYCAP, sizeof(struct v4l2_capability), query_capability},
    {VIDIOC_ENUM_FMT, sizeof(struct v4l2_fmtdesc), enum_format},
    {VIDIOC_ENUM_FRAMESIZES, sizeof(struct v4l2_frmsizeenum), enum_size},
    {VIDIOC_G_FMT, sizeof(struct v4l2_format), get_format},
    {VIDIOC_S_FMT, sizeof(struct v4l2_format), virtual_v4l2_set_format},
    {VIDIOC_G_PARM, sizeof(struct v4l2_streamparm), get_parm},
    {VIDIOC_S_PARM, sizeof(struct v4l2_streamparm), set_parm},
    {VIDIOC_QUERYCTRL, sizeof(struct v4l2_queryctrl), query_control},
    {VIDIOC_G_CTRL, sizeof(struct v4l2_control), get_control},
    {VIDIOC_S_CTRL, sizeof(struct v4l2_control), virtual_v4l2_set_control},
    {VIDIOC_REQBUFS, sizeof(struct v4l2_requestbuffers), request_buffers},
    {VIDIOC_QUERYBUF, sizeof(struct v4l2_buffer), query_buffer},
    {VIDIOC_QBUF, sizeof(struct v4l2_buffer), queue_buffer},
    {VIDIOC_DQBUF, sizeof(struct v4l2_buffer), dequeue_buffer},
    {VIDIOC_STREAMON, sizeof(int), stream_on},
    {VIDIOC_STREAMOFF, sizeof(int), stream_off},
};

static int virtual_v4l2_answer(VirtualV4l2 *camera, unsigned long request, UMockdevIoctlData *arg) {
    for (gsize i = 0; i < G_N_ELEMENTS(answers); i++) {
        if (answers[i].request != request)
            continue;
        UMockdevIoctlData *data = umockdev_ioctl_data_resolve(arg, 0, answers[i].size, NULL);
        if (!data)
            return EFAULT;
        /* A buffer of the multi-planar interface points to its planes. Only the first plane is
         * read. */
        const struct v4l2_buffer *buffer = (const struct v4l2_buffer *)data->data;
        gboolean there = answers[i].size != sizeof *buffer || !camera->config.planes;
        if (!there && buffer->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE && buffer->length > 0) {
            UMockdevIoctlData *planes = umockdev_ioctl_data_resolve(
                data, G_STRUCT_OFFSET(struct v4l2_buffer, m), sizeof(struct v4l2_plane), NULL);
            there = planes != NULL;
            g_clear_pointer(&planes, umockdev_ioctl_data_unref);
        }
        int code = there ? answers[i].answer(camera, data->data) : EINVAL;
        umockdev_ioctl_data_unref(data);
        return code;
    }
    return ENOTTY;
}

/* Checks whether the program that owns the buffers has closed the node or has ended. If so, ends
 * the stream and frees the buffers. umockdev 0.17 does not emit client-vanished, so this is done
 * before each ioctl. */
static void free_buffers_of_vanished(VirtualV4l2 *camera) {
    if (!camera->owner || umockdev_ioctl_client_get_connected(camera->owner))
        return;
    stream_off(camera, NULL);
    camera->n_buffers = 0;
    g_clear_object(&camera->owner);
}

static gboolean virtual_v4l2_on_ioctl(UMockdevIoctlBase *handler, UMockdevIoctlClient *client,
                                      gpointer user) {
    VirtualV4l2 *camera = user;
    UMockdevIoctlData *arg = umockdev_ioctl_client_get_arg(client);
    const unsigned long request = umockdev_ioctl_client_get_request(client) & 0xffffffffu;
    g_mutex_lock(&camera->mutex);
    free_buffers_of_vanished(camera);
    int code = camera->sysfs ? virtual_v4l2_answer(camera, request, arg) : ENODEV;
    if (code == 0 && request == VIDIOC_REQBUFS) {
        g_clear_object(&camera->owner);
        camera->owner = camera->n_buffers > 0 ? g_object_ref(client) : NULL;
    }
    g_mutex_unlock(&camera->mutex);
    umockdev_ioctl_client_complete(client, code ? -1 : 0, code);
    return TRUE;
}

/* Adds a USB device to the testbed if it does not exist yet: the root hub, a hub, or the camera. */
static void add_usb(VirtualV4l2 *camera, const char *path, gboolean is_hub) {
    static int last_address;
    g_autofree char *root = umockdev_testbed_get_root_dir(camera->testbed);
    g_autofree char *real = g_strconcat(root, "/sys", path, NULL);
    if (g_file_test(real, G_FILE_TEST_EXISTS))
        return;
    int bus = atoi(camera->port), address = ++last_address;
    double speed = camera->config.speed_mbit_s;
    GError *error = NULL;
    g_autofree char *text = g_strdup_printf(
        "P: %s\nN: bus/usb/%03d/%03d\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: BUSNUM=%03d\n"
        "E: DEVNUM=%03d\nE: DEVNAME=/dev/bus/usb/%03d/%03d\nE: DEVTYPE=usb_device\n"
        "A: bConfigurationValue=1\\n\nA: busnum=%d\\n\nA: devnum=%d\\n\nA: speed=%.0f\\n\n"
        "H: descriptors=120100%02X%s40%s0001000000010902120001010080320904000000%s\n",
        path, bus, address, bus, address, bus, address, bus, address, speed, speed >= 5000 ? 3 : 2,
        is_hub ? "090001" : "EF0201", is_hub ? "6B1D0200" : "FECA0100",
        is_hub ? "09000000" : "0E010000");
    umockdev_testbed_add_from_string(camera->testbed, text, &error);
    g_assert_no_error(error);
}

/* Adds the chain of devices for the camera's port. For "2-1.3", these are /devices/usb2, its hub
 * 2-1, and the camera 2-1.3. Returns the path of the camera. Free it with g_free(). */
static char *add_usb_chain(VirtualV4l2 *camera) {
    GString *path = g_string_new(NULL);
    g_string_printf(path, "/devices/usb%d", atoi(camera->port));
    add_usb(camera, path->str, TRUE);
    for (const char *end = strchr(camera->port, '.');; end = strchr(end + 1, '.')) {
        int n = end ? (int)(end - camera->port) : (int)strlen(camera->port);
        g_string_append_printf(path, "/%.*s", n, camera->port);
        add_usb(camera, path->str, end != NULL);
        if (!end)
            return g_string_free(path, FALSE);
    }
}

void virtual_v4l2_plug(VirtualV4l2 *camera, int number) {
    GError *error = NULL;
    g_return_if_fail(!camera->sysfs);
    g_free(camera->node);
    camera->node = g_strdup_printf("/dev/video%d", number);
    g_autofree char *usb = add_usb_chain(camera);
    g_autofree char *sysfs = g_strdup_printf("%s/video4linux/video%d", usb, number);
    /* A node that is added with content is a regular file, so programs can map it into memory. */
    g_autofree char *text =
        g_strdup_printf("P: %s\nN: video%d=00\nE: SUBSYSTEM=video4linux\nE: DEVNAME=/dev/video%d\n"
                        "A: name=Virtual camera\\n\nL: device=../../../%s\n",
                        sysfs, number, number, strrchr(usb, '/') + 1);
    umockdev_testbed_attach_ioctl(camera->testbed, camera->node, camera->handler, &error);
    g_assert_no_error(error);
    umockdev_testbed_add_from_string(camera->testbed, text, &error);
    g_assert_no_error(error);
    g_autofree char *root = umockdev_testbed_get_root_dir(camera->testbed);
    g_autofree char *file = g_strconcat(root, camera->node, NULL);
    g_mutex_lock(&camera->mutex);
    camera->fd = open(file, O_RDWR | O_CLOEXEC);
    camera->sysfs = g_strdup_printf("/sys%s", sysfs);
    g_mutex_unlock(&camera->mutex);
    g_assert_cmpint(camera->fd, >=, 0);
}

void virtual_v4l2_unplug(VirtualV4l2 *camera) {
    g_mutex_lock(&camera->mutex);
    g_autofree char *sysfs = g_steal_pointer(&camera->sysfs);
    virtual_stream_stop(camera);
    camera->n_buffers = 0;
    g_clear_object(&camera->owner);
    int fd = camera->fd;
    camera->fd = -1;
    g_mutex_unlock(&camera->mutex);
    if (!sysfs)
        return;
    close(fd);
    umockdev_testbed_uevent(camera->testbed, sysfs, "remove");
    umockdev_testbed_remove_device(camera->testbed, sysfs);
    umockdev_testbed_detach_ioctl(camera->testbed, camera->node, NULL);
}

#define CONTROL(id, type, name, min, max, value)                                                   \
    {                                                                                              \
        V4L2_CID_##id, V4L2_CTRL_TYPE_##type, name, min, max, 1, value, 0, {                       \
            0                                                                                      \
        }                                                                                          \
    }
static const struct {
    /* A camera does not have the control if config.lacks has one of these bits. 0: every camera has
     * it. */
    guint lacks;
    struct v4l2_queryctrl about;
} v4l2_controls[] = {
    {0, CONTROL(BRIGHTNESS, INTEGER, "Brightness", -64, 64, 0)},
    {0, CONTROL(CONTRAST, INTEGER, "Contrast", 0, 95, 32)},
    {VIRTUAL_V4L2_NO_WHITE_BALANCE,
     CONTROL(AUTO_WHITE_BALANCE, BOOLEAN, "White Balance, Automatic", 0, 1, 1)},
    {0, CONTROL(GAMMA, INTEGER, "Gamma", 100, 500, 300)},
    {VIRTUAL_V4L2_NO_GAIN, CONTROL(GAIN, INTEGER, "Gain", 0, 240, 32)},
    {VIRTUAL_V4L2_NO_WHITE_BALANCE,
     CONTROL(WHITE_BALANCE_TEMPERATURE, INTEGER, "White Balance Temperature", 2800, 6500, 4600)},
    {0, CONTROL(SHARPNESS, INTEGER, "Sharpness", 0, 7, 3)},
    {VIRTUAL_V4L2_NO_EXPOSURE, CONTROL(EXPOSURE_AUTO, MENU, "Auto Exposure", 0, 3, 3)},
    {VIRTUAL_V4L2_NO_EXPOSURE,
     CONTROL(EXPOSURE_ABSOLUTE, INTEGER, "Exposure Time, Absolute", 1, 5000, 157)},
    {VIRTUAL_V4L2_NO_EXPOSURE,
     CONTROL(EXPOSURE_AUTO_PRIORITY, BOOLEAN, "Exposure, Dynamic Framerate", 0, 1, 1)},
    {0, CONTROL(FOCUS_AUTO, BOOLEAN, "Focus, Automatic Continuous", 0, 1, 1)},
    {0, CONTROL(WIDE_DYNAMIC_RANGE, BOOLEAN, "Wide Dynamic Range", 0, 1, 1)},
};
#undef CONTROL
G_STATIC_ASSERT(G_N_ELEMENTS(v4l2_controls) <= MAX_CONTROLS);

VirtualV4l2 *virtual_v4l2_new(const struct virtual_v4l2_config *config) {
    VirtualV4l2 *camera = g_new0(VirtualV4l2, 1);
    camera->config = *config;
    camera->config.width = config->width ? config->width : 64;
    camera->config.height = config->height ? config->height : 48;
    camera->config.bits = config->bits ? config->bits : 12;
    if (config->speed_mbit_s == 0)
        camera->config.speed_mbit_s = 480;
    camera->port = g_strdup(config->port ? config->port : "2-1");
    camera->frame_rate = config->frame_rate > 0 ? config->frame_rate : 100;
    camera->fourcc = V4L2_PIX_FMT_MJPEG;
    camera->pixels = g_new0(guint16, (gsize)camera->config.width * (gsize)camera->config.height);
    camera->fd = -1;
    g_mutex_init(&camera->mutex);
    g_cond_init(&camera->woken);
    for (gsize i = 0; i < G_N_ELEMENTS(v4l2_controls); i++)
        if (!(config->lacks & v4l2_controls[i].lacks)) {
            camera->controls[camera->n_controls++] = (struct virtual_control){
                v4l2_controls[i].about, v4l2_controls[i].about.default_value};
        }
    for (int i = 0; config->odd_gamma && i < camera->n_controls; i++)
        if (camera->controls[i].about.id == V4L2_CID_GAMMA)
            camera->controls[i] = (struct virtual_control){
                {V4L2_CID_GAMMA, V4L2_CTRL_TYPE_INTEGER, "Gamma", 0, 31, 1, 16, 0, {0}}, 16};
    camera->testbed = testbed_ref();
    camera->handler = umockdev_ioctl_base_new();
    testbed_connect(camera->handler, "handle-ioctl", G_CALLBACK(virtual_v4l2_on_ioctl), camera);
    virtual_v4l2_plug(camera, config->number);
    return camera;
}

VirtualV4l2 *virtual_v4l2_new_world(const struct virtual_v4l2_config *config, World *world,
                                    const char *name, GError **error) {
    struct virtual_v4l2_config seen = *config;
    struct world_sensor sensor;
    int index = world_find_camera(world, name);
    if (index < 0) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "the world has no camera \"%s\"; give the name of a camera in the world file",
                    name);
        return NULL;
    }
    world_sensor(world, index, &sensor);
    seen.width = sensor.width;
    seen.height = sensor.height;
    seen.bits = sensor.bits;
    seen.cfa = sensor.cfa;
    VirtualV4l2 *camera = virtual_v4l2_new(&seen);
    camera->world_index = index;
    camera->world = world_ref(world);
    return camera;
}

void virtual_v4l2_free(VirtualV4l2 *camera) {
    if (!camera)
        return;
    virtual_v4l2_unplug(camera);
    testbed_disconnect(camera->handler, camera);
    g_mutex_lock(&camera->mutex);
    virtual_stream_wait(camera);
    g_mutex_unlock(&camera->mutex);
    g_clear_object(&camera->owner);
    g_clear_object(&camera->handler);
    testbed_unref();
    world_unref(camera->world);
    g_cond_clear(&camera->woken);
    g_mutex_clear(&camera->mutex);
    g_free(camera->pixels);
    g_free(camera->port);
    g_free(camera->node);
    g_free(camera);
}

void virtual_v4l2_set_fault(VirtualV4l2 *camera, enum virtual_v4l2_fault fault) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    camera->fault = fault;
}

gint64 virtual_v4l2_control(VirtualV4l2 *camera, guint32 id) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    const struct virtual_control *control = virtual_find_control(camera, id);
    return control ? control->value : -1;
}

int virtual_v4l2_n_exposed(VirtualV4l2 *camera) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->mutex);
    return camera->n_exposed;
}
