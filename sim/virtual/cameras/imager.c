#include "imager_private.h"

#include <string.h>

static void clear_picture(struct imager_picture *picture) {
    g_free(picture->data);
    memset(picture, 0, sizeof *picture);
}

guint32 imager_reg(const struct imager *imager, guint address) {
    return imager->regs[(address - REG_BEGIN) / 4];
}

void imager_set_reg(struct imager *imager, guint address, guint32 value) {
    imager->regs[(address - REG_BEGIN) / 4] = value;
}

static void update_payload(struct imager *imager) {
    imager_set_reg(imager, REG_PAYLOAD,
                   (guint32)imager_payload(imager_reg(imager, REG_FORMAT), imager->options.cfa,
                                           (int)imager_reg(imager, REG_WIDTH),
                                           (int)imager_reg(imager, REG_HEIGHT)));
}

void imager_reset(struct imager *imager) {
    const struct virtual_camera_options *options = &imager->options;
    memset(imager->regs, 0, sizeof imager->regs);
    imager_set_reg(imager, REG_SENSOR_WIDTH, (guint32)options->width);
    imager_set_reg(imager, REG_SENSOR_HEIGHT, (guint32)options->height);
    imager_set_reg(imager, REG_WIDTH, (guint32)options->width);
    imager_set_reg(imager, REG_HEIGHT, (guint32)options->height);
    imager_set_reg(imager, REG_FORMAT, imager_first_format(options->cfa));
    imager_set_reg(imager, REG_EXPOSURE_US, 10000);
    imager_set_reg(imager, REG_BLACK, (guint32)(options->black_level * 10));
    imager_set_reg(imager, REG_AUTO_EXPOSURE, 1); /* the default of many real cameras */
    for (guint i = 0; options->processing && i < VIRTUAL_PROCESSING; i++)
        imager_set_reg(imager, REG_PROCESSING + 4 * i, options->processing->first[i]);
    update_payload(imager);
    imager->triggered = FALSE;
    g_cond_broadcast(&imager->cond);
}

static guint imager_processing(const struct imager *imager) {
    const struct virtual_processing *processing = imager->options.processing;
    guint on = 0;
    for (guint i = 0; processing && i < VIRTUAL_PROCESSING; i++)
        if (imager_reg(imager, REG_PROCESSING + 4 * i) != processing->neutral[i])
            on |= 1u << i;
    return on;
}

void imager_stop(struct imager *imager) {
    imager_set_reg(imager, REG_ACQUISITION, 0);
    imager->triggered = FALSE;
    g_cond_broadcast(&imager->cond);
}

static void trigger(struct imager *imager, guint source) {
    if (imager_reg(imager, REG_ACQUISITION) != 1 || imager_reg(imager, REG_TRIGGER_MODE) != 1 ||
        imager_reg(imager, REG_TRIGGER_FROM) != source || imager->faults.unplugged)
        return;
    imager->state.triggers++;
    if (imager->triggered || imager->exposing) {
        imager->state.missed++;
    } else if (imager->faults.blind > 0) {
        imager->faults.blind--;
    } else {
        imager->triggered = TRUE;
        imager->state.triggered_us = g_get_monotonic_time();
        g_cond_broadcast(&imager->cond);
    }
}

void imager_write(struct imager *imager, guint address, guint32 value) {
    if (address == REG_EXPOSURE_US) {
        double step = MAX(imager->faults.rounding_us, 1);
        guint32 rounded = (guint32)(step * (guint32)(value / step + 0.5));
        value = CLAMP(rounded, MIN_EXPOSURE_US, MAX_EXPOSURE_US);
    }
    if (address >= REG_PROCESSING && imager->options.processing &&
        imager->options.processing->fixed >> (address - REG_PROCESSING) / 4 & 1)
        return;
    imager_set_reg(imager, address, value);
    if (address == REG_ACQUISITION && value == 0)
        imager_stop(imager);
    else if (address == REG_TRIGGER && value == 1)
        trigger(imager, TRIGGER_SOFTWARE);
    update_payload(imager);
}

guint8 imager_xml_byte(const struct imager *imager, guint64 address) {
    guint64 at = address - GENICAM_AT;
    return at < imager->xml_size ? (guint8)imager->xml[at] : 0;
}

/* Makes picture->data from the chosen region of the sensor's picture. If options->picture is NULL,
 * the sensor's picture is a ramp. If processed is TRUE, values are squared, relative to full scale.
 * After this, shift is added: the change of BlackLevel in DN. */
static void fill(struct imager *imager, const struct virtual_exposure *exposure, int shift,
                 gboolean processed, struct imager_picture *picture) {
    const struct virtual_camera_options *options = &imager->options;
    gsize n = (gsize)picture->width * picture->height;
    guint width = (guint)options->width;
    int most = (1 << options->bits) - 1;
    g_autofree guint16 *sensor = g_new0(guint16, (gsize)options->width * (gsize)options->height);
    g_autofree guint16 *region = g_new(guint16, n);
    if (options->picture)
        options->picture(exposure, options->data, sensor);
    else
        for (guint i = 0; i < width * (guint)options->height; i++)
            sensor[i] =
                (guint16)((i % width * 3 + i / width * 7 + (guint)exposure->n * 11) & (guint)most);
    for (guint i = 0; processed && i < width * (guint)options->height; i++)
        sensor[i] = (guint16)((guint)sensor[i] * sensor[i] / (guint)most);
    gboolean whole = shift == 0 && n == (gsize)options->width * (gsize)options->height;
    for (guint i = 0; !whole && i < n; i++) {
        guint x = picture->x + i % picture->width, y = picture->y + i / picture->width;
        region[i] = (guint16)CLAMP(sensor[y * width + x] + shift, 0, most);
    }
    picture->data = g_malloc(picture->size);
    imager_pack(picture->format, options->cfa, whole ? sensor : region, n, options->bits,
                picture->data);
}

static void keep(struct imager *imager, struct imager_picture *picture) {
    gboolean old = imager->faults.old > 0 && imager->kept[0].data;
    gboolean odd = imager->faults.odd > 0;
    picture->id = ++imager->last_id;
    picture->width -= odd ? 2 : 0;
    imager->faults.odd -= odd;
    picture->cut = imager->faults.cut > 0;
    imager->faults.cut -= picture->cut;
    imager->faults.old -= old;
    if (old && imager->kept[0].size == picture->size) {
        memcpy(picture->data, imager->kept[0].data, picture->size);
        picture->stamp_us = imager->kept[0].stamp_us;
    }
    clear_picture(&imager->kept[IMAGER_N_KEPT - 1]);
    memmove(imager->kept + 1, imager->kept, (IMAGER_N_KEPT - 1) * sizeof *picture);
    imager->kept[0] = *picture;
}

/* Waits until a time of g_get_monotonic_time(). Returns FALSE if the acquisition or the imager was
 * stopped. */
static gboolean wait_until(struct imager *imager, gint64 until_us) {
    while (!imager->quit && imager_reg(imager, REG_ACQUISITION) == 1)
        if (!g_cond_wait_until(&imager->cond, &imager->mutex, until_us))
            return TRUE;
    return FALSE;
}

/* Exposes a picture, keeps it and sends it. The mutex must be locked. It is unlocked during waits
 * and while the picture is made.
 *
 * Takes no picture if the format is not possible, if the chosen region is not within the sensor, or
 * if the acquisition ends before the exposure does. The fault late_us delays the sending. If the
 * acquisition ends during this delay, the picture is not sent. */
static void take_picture(struct imager *imager) {
    struct virtual_exposure exposure = {
        .n = imager->state.pictures + 1,
        .start_us = imager->state.triggered_us + imager->faults.slow_us,
        .exposure_us = imager_reg(imager, REG_EXPOSURE_US),
        .gain_db = imager_reg(imager, REG_GAIN) / 100.0,
    };
    struct imager_picture picture = {
        .id = imager->last_id + 1,
        .format = imager_reg(imager, REG_FORMAT),
        .width = imager_reg(imager, REG_WIDTH),
        .height = imager_reg(imager, REG_HEIGHT),
        .x = imager_reg(imager, REG_OFFSET_X),
        .y = imager_reg(imager, REG_OFFSET_Y),
        .size = imager_reg(imager, REG_PAYLOAD),
    };
    int shift = (int)(imager_reg(imager, REG_BLACK) / 10.0 - imager->options.black_level);
    if (picture.size == 0 || picture.x + picture.width > (guint)imager->options.width ||
        picture.y + picture.height > (guint)imager->options.height)
        return;
    imager->exposing = TRUE;
    if (imager->faults.announces) {
        picture.stamp_us = exposure.start_us;
        imager->bus->announce(&picture, imager->data);
    }
    gboolean exposed = wait_until(imager, exposure.start_us + exposure.exposure_us);
    imager->exposing = FALSE;
    if (!exposed)
        return;
    gboolean processed = imager_processing(imager) != 0;
    g_mutex_unlock(&imager->mutex);
    fill(imager, &exposure, shift, processed, &picture);
    g_mutex_lock(&imager->mutex);
    gint64 late_us = imager->faults.late_us;
    picture.stamp_us = exposure.start_us + imager->faults.ahead_us +
                       (imager->faults.stamps_end ? exposure.exposure_us : 0);
    keep(imager, &picture);
    if (late_us > 0 && !wait_until(imager, g_get_monotonic_time() + late_us))
        return;
    imager->state.pictures++;
    imager->bus->send(imager->data);
}

static gpointer image_all(gpointer data) {
    struct imager *imager = data;
    g_mutex_lock(&imager->mutex);
    while (!imager->quit) {
        if (!imager->triggered) {
            g_cond_wait(&imager->cond, &imager->mutex);
            continue;
        }
        imager->triggered = FALSE;
        take_picture(imager);
    }
    g_mutex_unlock(&imager->mutex);
    return NULL;
}

void imager_init(struct imager *imager, const struct virtual_camera_options *options, char *xml,
                 const struct imager_bus *bus, gpointer data) {
    *imager = (struct imager){.options = *options, .bus = bus, .data = data, .xml = xml};
    imager->options.serial = g_strdup(options->serial);
    imager->xml_size = strlen(xml);
    g_mutex_init(&imager->mutex);
    g_cond_init(&imager->cond);
    imager_reset(imager);
}

void imager_start(struct imager *imager) {
    imager->thread = g_thread_new("virtual-imager", image_all, imager);
}

void imager_quit(struct imager *imager) {
    g_mutex_lock(&imager->mutex);
    imager->quit = TRUE;
    g_cond_broadcast(&imager->cond);
    g_mutex_unlock(&imager->mutex);
    g_clear_pointer(&imager->thread, g_thread_join);
}

void imager_clear(struct imager *imager) {
    for (int i = 0; i < IMAGER_N_KEPT; i++)
        clear_picture(&imager->kept[i]);
    g_mutex_clear(&imager->mutex);
    g_cond_clear(&imager->cond);
    g_free((char *)imager->options.serial);
    g_free(imager->xml);
}

void imager_fail(struct imager *imager, const struct virtual_camera_faults *faults) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&imager->mutex);
    imager->faults = *faults;
}

void imager_pulse(struct imager *imager) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&imager->mutex);
    trigger(imager, TRIGGER_LINE);
}

void imager_get_state(struct imager *imager, struct virtual_camera_state *ret) {
    *ret = imager->state;
    ret->acquiring = imager_reg(imager, REG_ACQUISITION) == 1;
    ret->automatic = imager_reg(imager, REG_AUTO_EXPOSURE) != 0;
    ret->pixel_format = (int)imager_reg(imager, REG_FORMAT);
    ret->exposure_us = imager_reg(imager, REG_EXPOSURE_US);
    ret->gain_db = imager_reg(imager, REG_GAIN) / 100.0;
    ret->black_level = imager_reg(imager, REG_BLACK) / 10.0;
    ret->processing = imager_processing(imager);
}
