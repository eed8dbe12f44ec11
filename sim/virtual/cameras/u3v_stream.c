#include "u3v_private.h"

#include <errno.h>
#include <string.h>

#define LEADER_PREFIX  0x4c563355 /* "U3VL" */
#define TRAILER_PREFIX 0x54563355 /* "U3VT" */
#define IMAGE          1

static gboolean count_down(int *n) {
    gboolean is = *n > 0;
    *n -= is;
    return is;
}

void u3v_drop(VirtualU3v *camera) {
    g_free(camera->out.data);
    memset(&camera->out, 0, sizeof camera->out);
    camera->phase = U3V_IDLE;
}

/* Makes the latest picture available for reading, if the stream is on. If the previous picture has
 * not been read completely, the rest of it is lost. */
static void send_picture(gpointer data) {
    VirtualU3v *camera = data;
    struct virtual_camera_faults *faults = &camera->imager.faults;
    const struct imager_picture *picture = &camera->imager.kept[0];
    gboolean led = camera->out.id == picture->id && camera->phase == U3V_IDLE;
    u3v_drop(camera);
    if (!(u3v_reg(camera, SIRM_CONTROL) & 1))
        return;
    camera->out = *picture;
    camera->out.data = g_memdup2(picture->data, picture->size);
    camera->sent = 0;
    camera->tailless = count_down(&faults->tailless);
    camera->stunted = count_down(&faults->stunted);
    camera->hollow = count_down(&faults->hollow);
    camera->phase = count_down(&faults->headless) || led ? U3V_PAYLOAD : U3V_LEADER;
}

/* Makes the leader of a picture available before the picture exists. send_picture() adds the data
 * later. */
static void announce(const struct imager_picture *picture, gpointer data) {
    VirtualU3v *camera = data;
    u3v_drop(camera);
    camera->out = *picture;
    camera->phase = U3V_LEADER;
}

const struct imager_bus u3v_bus = {announce, send_picture};

static void put_head(guint8 *to, guint32 prefix, int size, guint64 id) {
    memset(to, 0, (gsize)size);
    u3v_put(to, prefix, 4);
    u3v_put(to + 6, (guint64)size, 2);
    u3v_put(to + 8, id - 1, 8); /* block ids of USB3 Vision begin at 0 */
}

/* Returns the size of the next transfer of the payload. The first SIRM_PAYLOAD_COUNT transfers have
 * equal sizes. Then comes the remainder. Returns 0 at the end of the payload. */
static gsize payload_size(const VirtualU3v *camera) {
    gsize size = u3v_reg(camera, SIRM_PAYLOAD), count = u3v_reg(camera, SIRM_PAYLOAD_COUNT);
    gsize last = u3v_reg(camera, SIRM_TRANSFER1);
    gsize end = camera->out.cut ? camera->out.size / 2 : camera->out.size;
    if (camera->hollow || camera->sent >= end)
        return 0;
    return MIN(camera->sent < size * count ? size : last, end - camera->sent);
}

int u3v_stream(VirtualU3v *camera, guint8 *data, int size) {
    if (camera->phase == U3V_PAYLOAD && payload_size(camera) == 0) {
        camera->phase = U3V_TRAILER;
        if (camera->tailless)
            u3v_drop(camera);
    }
    if (camera->phase == U3V_IDLE)
        return -EAGAIN;
    const struct imager_picture *out = &camera->out;
    int n = camera->phase == U3V_LEADER    ? LEADER_SIZE
            : camera->phase == U3V_PAYLOAD ? (int)payload_size(camera)
                                           : TRAILER_SIZE;
    if (n > size)
        return -EOVERFLOW;
    if (camera->phase == U3V_PAYLOAD) {
        memcpy(data, out->data + camera->sent, (gsize)n);
        camera->sent += (gsize)n;
    } else if (camera->phase == U3V_TRAILER) {
        put_head(data, TRAILER_PREFIX, TRAILER_SIZE, out->id);
        u3v_put(data + 20, camera->sent, 8);
        u3v_put(data + 28, out->height, 4);
        n = camera->stunted ? 3 : n; /* a stunted trailer is shorter than its prefix */
        u3v_drop(camera);
    } else {
        put_head(data, LEADER_PREFIX, LEADER_SIZE, out->id);
        u3v_put(data + 18, IMAGE, 2);
        u3v_put(data + 20, (guint64)out->stamp_us * 1000, 8);
        u3v_put(data + 28, out->format, 4);
        u3v_put(data + 32, out->width, 4);
        u3v_put(data + 36, out->height, 4);
        u3v_put(data + 40, out->x, 4);
        u3v_put(data + 44, out->y, 4);
        camera->phase = out->data ? U3V_PAYLOAD : U3V_IDLE;
    }
    return n;
}
