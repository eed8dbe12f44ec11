#include "gige_private.h"

#include <arpa/inet.h>
#include <errno.h>
#include <glib-unix.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define PORT     3956
#define N_PLACES 256
#define TICK_MS  50

static void clear_kept(struct gige_kept *kept) {
    g_free(kept->data);
    memset(kept, 0, sizeof *kept);
}

static int open_socket(const char *address, int port, gboolean share) {
    struct sockaddr_in at = {.sin_family = AF_INET, .sin_port = htons((guint16)port)};
    int one = 1, fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    inet_pton(AF_INET, address, &at.sin_addr);
    if (fd >= 0 && share)
        setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
    if (fd < 0 || bind(fd, (struct sockaddr *)&at, sizeof at) == 0)
        return fd;
    int saved = errno;
    close(fd);
    errno = saved;
    return -1;
}

static void close_sockets(VirtualGige *camera) {
    int *fds[] = {&camera->control, &camera->discovery, &camera->stream};
    for (gsize i = 0; i < G_N_ELEMENTS(fds); i++) {
        if (*fds[i] >= 0)
            close(*fds[i]);
        *fds[i] = -1;
    }
}

static gboolean open_sockets(VirtualGige *camera) {
    struct sockaddr_in source = {0};
    socklen_t size = sizeof source;
    camera->control = open_socket(camera->address, PORT, FALSE);
    if (camera->control < 0)
        return FALSE;
    camera->discovery = open_socket("255.255.255.255", PORT, TRUE);
    camera->stream = open_socket(camera->address, 0, FALSE);
    if (camera->discovery < 0 || camera->stream < 0)
        return FALSE;
    getsockname(camera->stream, (struct sockaddr *)&source, &size);
    gige_set_reg(camera, GVBS_STREAM_SOURCE, ntohs(source.sin_port));
    return TRUE;
}

/* Off, and on again: a power cut. Called with the mutex locked. */
static void lose_power(VirtualGige *camera) {
    gint64 until = g_get_monotonic_time() + (gint64)camera->down_ms * 1000;
    camera->down_ms = 0;
    close_sockets(camera);
    gige_reset(camera);
    g_cond_broadcast(&camera->cond);
    while (!camera->quit && g_cond_wait_until(&camera->cond, &camera->mutex, until))
        ;
    if (!camera->quit && !open_sockets(camera))
        g_warning("virtual camera %s: %s", camera->address, g_strerror(errno));
}

static gpointer answer_all(gpointer data) {
    VirtualGige *camera = data;
    char byte;
    g_mutex_lock(&camera->mutex);
    while (!camera->quit) {
        struct pollfd fds[] = {{camera->wake[0], POLLIN, 0},
                               {camera->control, POLLIN, 0},
                               {camera->discovery, POLLIN, 0}};
        g_mutex_unlock(&camera->mutex);
        poll(fds, G_N_ELEMENTS(fds), TICK_MS);
        g_mutex_lock(&camera->mutex);
        if (fds[0].revents && read(camera->wake[0], &byte, 1) < 0)
            break;
        for (int i = 1; i < 3; i++)
            if (fds[i].revents && fds[i].fd >= 0)
                gige_serve(camera, fds[i].fd);
        gige_check_heartbeat(camera);
        if (camera->down_ms > 0)
            lose_power(camera);
    }
    g_mutex_unlock(&camera->mutex);
    return NULL;
}

static void make_ramp(const VirtualGige *camera, guint64 n, guint16 *pixels) {
    guint mask = (1u << camera->options.bits) - 1;
    for (int y = 0; y < camera->options.height; y++)
        for (int x = 0; x < camera->options.width; x++)
            *pixels++ = (guint16)(((guint)x * 3 + (guint)y * 7 + (guint)n * 11) & mask);
}

/* The region, with what BlackLevel was changed by. */
static void cut_region(const VirtualGige *camera, const guint16 *pixels,
                       const struct gige_kept *kept, int shift, guint16 *to) {
    const struct virtual_gige_options *options = &camera->options;
    int most = (1 << options->bits) - 1;
    for (guint y = 0; y < kept->height; y++)
        for (guint x = 0; x < kept->width; x++) {
            int value = pixels[(y + kept->y) * (guint)options->width + x + kept->x] + shift;
            *to++ = (guint16)CLAMP(value, 0, most);
        }
}

static void fill(VirtualGige *camera, const struct virtual_gige_exposure *exposure, int shift,
                 struct gige_kept *kept) {
    const struct virtual_gige_options *options = &camera->options;
    gsize n = (gsize)kept->width * kept->height;
    g_autofree guint16 *sensor = g_new0(guint16, (gsize)options->width * (gsize)options->height);
    g_autofree guint16 *region = g_new(guint16, n);
    if (options->picture)
        options->picture(exposure, options->data, sensor);
    else
        make_ramp(camera, exposure->n, sensor);
    gboolean whole = shift == 0 && n == (gsize)options->width * (gsize)options->height;
    if (!whole)
        cut_region(camera, sensor, kept, shift, region);
    kept->data = g_malloc(kept->size);
    virtual_gige_pack(kept->format, options->cfa, whole ? sensor : region, n, options->bits,
                      kept->data);
}

static gboolean describe(VirtualGige *camera, struct gige_kept *ret) {
    *ret = (struct gige_kept){
        .format = gige_reg(camera, REG_FORMAT),
        .width = gige_reg(camera, REG_WIDTH),
        .height = gige_reg(camera, REG_HEIGHT),
        .x = gige_reg(camera, REG_OFFSET_X),
        .y = gige_reg(camera, REG_OFFSET_Y),
        .packet = gige_reg(camera, GVBS_PACKET_SIZE) & 0xffff,
        .size = gige_reg(camera, REG_PAYLOAD),
    };
    return ret->size > 0 && ret->packet > GIGE_OVERHEAD && ret->packet <= MAX_PACKET &&
           ret->x + ret->width <= (guint)camera->options.width &&
           ret->y + ret->height <= (guint)camera->options.height;
}

static guint16 next_id(const VirtualGige *camera) {
    return (guint16)(camera->last_id == 65535 ? 1 : camera->last_id + 1);
}

static void announce(VirtualGige *camera, struct gige_kept kept) {
    kept.id = next_id(camera);
    kept.ticks = gige_ticks(camera->state.triggered_us + camera->faults.slow_us);
    gige_send_leader(camera, &kept);
}

static void keep(VirtualGige *camera, struct gige_kept *kept) {
    gboolean old = camera->faults.old > 0 && camera->kept[0].data;
    gboolean odd = camera->faults.odd > 0;
    camera->last_id = next_id(camera);
    kept->id = camera->last_id;
    kept->width -= odd ? 2 : 0;
    camera->faults.odd -= odd;
    kept->cut = camera->faults.cut > 0;
    camera->faults.cut -= kept->cut;
    camera->faults.old -= old;
    if (old && camera->kept[0].size == kept->size) {
        memcpy(kept->data, camera->kept[0].data, kept->size);
        kept->ticks = camera->kept[0].ticks;
    }
    clear_kept(&camera->kept[GIGE_N_KEPT - 1]);
    memmove(camera->kept + 1, camera->kept, (GIGE_N_KEPT - 1) * sizeof *kept);
    camera->kept[0] = *kept;
}

static gboolean wait_until(VirtualGige *camera, gint64 until_us) {
    while (!camera->quit && gige_reg(camera, REG_ACQUISITION) == 1)
        if (!g_cond_wait_until(&camera->cond, &camera->mutex, until_us))
            return TRUE;
    return FALSE;
}

/* Called with the mutex locked. */
static void take_picture(VirtualGige *camera) {
    struct virtual_gige_exposure exposure = {
        .n = camera->state.pictures + 1,
        .start_us = camera->state.triggered_us + camera->faults.slow_us,
        .exposure_us = gige_reg(camera, REG_EXPOSURE_US),
        .gain_db = gige_reg(camera, REG_GAIN) / 100.0,
    };
    struct gige_kept kept;
    int shift = (int)(gige_reg(camera, REG_BLACK) / 10.0 - camera->options.black_level);
    camera->exposing = TRUE;
    gboolean exposed = describe(camera, &kept);
    if (exposed && camera->faults.announces)
        announce(camera, kept);
    exposed = exposed && wait_until(camera, exposure.start_us + exposure.exposure_us);
    camera->exposing = FALSE;
    if (!exposed)
        return;
    g_mutex_unlock(&camera->mutex);
    fill(camera, &exposure, shift, &kept);
    g_mutex_lock(&camera->mutex);
    gint64 late_us = camera->faults.late_us;
    kept.ticks = gige_ticks(exposure.start_us + camera->faults.ahead_us +
                            (camera->faults.stamps_end ? exposure.exposure_us : 0));
    keep(camera, &kept);
    if (late_us == 0 || wait_until(camera, g_get_monotonic_time() + late_us))
        gige_send_picture(camera);
}

static gpointer image_all(gpointer data) {
    VirtualGige *camera = data;
    g_mutex_lock(&camera->mutex);
    while (!camera->quit) {
        if (!camera->triggered) {
            g_cond_wait(&camera->cond, &camera->mutex);
            continue;
        }
        camera->triggered = FALSE;
        take_picture(camera);
    }
    g_mutex_unlock(&camera->mutex);
    return NULL;
}

static gboolean find_place(VirtualGige *camera, const char *address) {
    if (address) {
        camera->address = g_strdup(address);
        return open_sockets(camera);
    }
    for (int i = 0; i < N_PLACES; i++) {
        close_sockets(camera);
        g_free(camera->address);
        camera->address = g_strdup_printf("127.%d.%d.%d", g_random_int_range(64, 192),
                                          g_random_int_range(0, 256), g_random_int_range(2, 255));
        if (open_sockets(camera))
            return TRUE;
    }
    return FALSE;
}

VirtualGige *virtual_gige_new(const struct virtual_gige_options *options, GError **error) {
    VirtualGige *camera = g_new0(VirtualGige, 1);
    camera->options = *options;
    camera->options.serial = g_strdup(options->serial);
    camera->control = camera->discovery = camera->stream = -1;
    camera->last_id = 65530; /* soon around */
    camera->rand = g_rand_new_with_seed(1);
    camera->xml = virtual_gige_genicam(options->cfa);
    camera->xml_size = strlen(camera->xml);
    camera->wake[0] = camera->wake[1] = -1;
    g_mutex_init(&camera->mutex);
    g_cond_init(&camera->cond);
    if (!find_place(camera, options->address) ||
        !g_unix_open_pipe(camera->wake, FD_CLOEXEC, NULL)) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno), "virtual camera %s: %s: %s",
                    options->serial, camera->address, g_strerror(errno));
        virtual_gige_free(camera);
        return NULL;
    }
    guint32 source = gige_reg(camera, GVBS_STREAM_SOURCE);
    gige_reset(camera);
    gige_set_reg(camera, GVBS_STREAM_SOURCE, source);
    camera->answerer = g_thread_new("virtual-gige", answer_all, camera);
    camera->imager = g_thread_new("virtual-gige-i", image_all, camera);
    return camera;
}

static void wake(VirtualGige *camera) {
    if (write(camera->wake[1], "", 1) < 0)
        g_warning("virtual camera: %s", g_strerror(errno));
}

static void join(VirtualGige *camera) {
    g_mutex_lock(&camera->mutex);
    camera->quit = TRUE;
    g_cond_broadcast(&camera->cond);
    g_mutex_unlock(&camera->mutex);
    wake(camera);
    g_thread_join(camera->answerer);
    g_thread_join(camera->imager);
}

void virtual_gige_free(VirtualGige *camera) {
    if (!camera)
        return;
    if (camera->answerer)
        join(camera);
    close_sockets(camera);
    for (int i = 0; i < 2; i++)
        if (camera->wake[i] >= 0)
            close(camera->wake[i]);
    for (int i = 0; i < GIGE_N_KEPT; i++)
        clear_kept(&camera->kept[i]);
    g_rand_free(camera->rand);
    g_mutex_clear(&camera->mutex);
    g_cond_clear(&camera->cond);
    g_free((char *)camera->options.serial);
    g_free(camera->address);
    g_free(camera->xml);
    g_free(camera);
}

const char *virtual_gige_address(const VirtualGige *camera) {
    return camera->address;
}

void virtual_gige_fail(VirtualGige *camera, const struct virtual_gige_faults *faults) {
    g_mutex_lock(&camera->mutex);
    camera->faults = *faults;
    g_mutex_unlock(&camera->mutex);
}

void virtual_gige_steal(VirtualGige *camera, gboolean steal) {
    g_mutex_lock(&camera->mutex);
    camera->stolen = camera->has_controller = steal;
    gige_set_reg(camera, GVBS_CONTROL, steal ? 2 : 0);
    gige_stop(camera);
    g_mutex_unlock(&camera->mutex);
}

void virtual_gige_restart(VirtualGige *camera, int down_ms) {
    g_mutex_lock(&camera->mutex);
    camera->down_ms = MAX(down_ms, 1);
    g_mutex_unlock(&camera->mutex);
    wake(camera);
}

void virtual_gige_pulse(VirtualGige *camera) {
    g_mutex_lock(&camera->mutex);
    gige_trigger(camera, 0);
    g_mutex_unlock(&camera->mutex);
}

void virtual_gige_state(VirtualGige *camera, struct virtual_gige_state *ret) {
    g_mutex_lock(&camera->mutex);
    camera->state.controlled = camera->has_controller;
    camera->state.acquiring = gige_reg(camera, REG_ACQUISITION) == 1;
    camera->state.automatic = gige_reg(camera, REG_AUTO_EXPOSURE) != 0;
    camera->state.packet_size = (int)(gige_reg(camera, GVBS_PACKET_SIZE) & 0xffff);
    camera->state.pixel_format = (int)gige_reg(camera, REG_FORMAT);
    camera->state.exposure_us = gige_reg(camera, REG_EXPOSURE_US);
    camera->state.gain_db = gige_reg(camera, REG_GAIN) / 100.0;
    camera->state.black_level = gige_reg(camera, REG_BLACK) / 10.0;
    *ret = camera->state;
    g_mutex_unlock(&camera->mutex);
}
