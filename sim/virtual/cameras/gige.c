#include "gige_private.h"

#include <arpa/inet.h>
#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define PORT        3956
#define N_ADDRESSES 256 /* largest number of random addresses that are tried */
#define TICK_MS     50

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

static gpointer answer_all(gpointer data) {
    VirtualGige *camera = data;
    char byte;
    g_mutex_lock(&camera->imager.mutex);
    while (!camera->imager.quit) {
        struct pollfd fds[] = {{camera->wake[0], POLLIN, 0},
                               {camera->control, POLLIN, 0},
                               {camera->discovery, POLLIN, 0}};
        g_mutex_unlock(&camera->imager.mutex);
        poll(fds, G_N_ELEMENTS(fds), TICK_MS);
        g_mutex_lock(&camera->imager.mutex);
        if (fds[0].revents && read(camera->wake[0], &byte, 1) < 0)
            break;
        for (int i = 1; i < 3; i++)
            if (fds[i].revents && fds[i].fd >= 0)
                gige_serve(camera, fds[i].fd);
        gige_check_heartbeat(camera);
        if (camera->down_ms == 0)
            continue;
        /* Simulate a power cut: switch the power off, and on again. */
        gint64 until = g_get_monotonic_time() + (gint64)camera->down_ms * 1000;
        camera->down_ms = 0;
        close_sockets(camera);
        gige_reset(camera);
        while (!camera->imager.quit &&
               g_cond_wait_until(&camera->imager.cond, &camera->imager.mutex, until))
            ;
        if (!camera->imager.quit && !open_sockets(camera))
            g_warning("virtual camera %s: the sockets cannot be opened again: %s", camera->address,
                      g_strerror(errno));
    }
    g_mutex_unlock(&camera->imager.mutex);
    return NULL;
}

VirtualGige *virtual_gige_new(const struct virtual_camera_options *options, const char *address,
                              GError **error) {
    VirtualGige *camera = g_new0(VirtualGige, 1);
    imager_init(&camera->imager, options,
                imager_genicam(options->cfa, &gige_transport, options->processing), &gige_bus,
                camera);
    camera->control = camera->discovery = camera->stream = -1;
    camera->rand = g_rand_new_with_seed(1);
    camera->wake[0] = camera->wake[1] = -1;
    gboolean open = FALSE;
    for (int i = 0; !open && i < (address ? 1 : N_ADDRESSES); i++) {
        close_sockets(camera);
        g_free(camera->address);
        camera->address =
            address ? g_strdup(address)
                    : g_strdup_printf("127.%d.%d.%d", g_random_int_range(64, 192),
                                      g_random_int_range(0, 256), g_random_int_range(2, 255));
        open = open_sockets(camera);
    }
    if (!open || !g_unix_open_pipe(camera->wake, FD_CLOEXEC, NULL)) {
        g_set_error(error, G_IO_ERROR, g_io_error_from_errno(errno),
                    "virtual camera %s: no %s can be opened at %s: %s; close other programs",
                    options->serial, open ? "pipe" : "sockets", camera->address, g_strerror(errno));
        virtual_gige_free(camera);
        return NULL;
    }
    guint32 source = gige_reg(camera, GVBS_STREAM_SOURCE);
    gige_reset(camera);
    gige_set_reg(camera, GVBS_STREAM_SOURCE, source);
    camera->answerer = g_thread_new("virtual-gige", answer_all, camera);
    imager_start(&camera->imager);
    return camera;
}

static void virtual_gige_wake(VirtualGige *camera) {
    if (write(camera->wake[1], "", 1) < 0)
        g_warning("virtual camera %s: the camera's thread cannot be woken: %s", camera->address,
                  g_strerror(errno));
}

void virtual_gige_free(VirtualGige *camera) {
    if (!camera)
        return;
    imager_quit(&camera->imager);
    if (camera->answerer) {
        virtual_gige_wake(camera);
        g_thread_join(camera->answerer);
    }
    close_sockets(camera);
    for (int i = 0; i < 2; i++)
        if (camera->wake[i] >= 0)
            close(camera->wake[i]);
    g_rand_free(camera->rand);
    imager_clear(&camera->imager);
    g_free(camera->address);
    g_free(camera);
}

const char *virtual_gige_address(const VirtualGige *camera) {
    return camera->address;
}

void virtual_gige_fail(VirtualGige *camera, const struct virtual_camera_faults *faults) {
    imager_fail(&camera->imager, faults);
}

void virtual_gige_steal(VirtualGige *camera, gboolean steal) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->imager.mutex);
    camera->stolen = camera->has_controller = steal;
    gige_set_reg(camera, GVBS_CONTROL, steal ? 2 : 0);
    imager_stop(&camera->imager);
}

void virtual_gige_restart(VirtualGige *camera, int down_ms) {
    g_mutex_lock(&camera->imager.mutex);
    camera->down_ms = MAX(down_ms, 1);
    g_mutex_unlock(&camera->imager.mutex);
    virtual_gige_wake(camera);
}

void virtual_gige_pulse(VirtualGige *camera) {
    imager_pulse(&camera->imager);
}

void virtual_gige_state(VirtualGige *camera, struct virtual_camera_state *ret) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&camera->imager.mutex);
    imager_get_state(&camera->imager, ret);
    ret->controlled = camera->has_controller;
    ret->packet_size = (int)(gige_reg(camera, GVBS_PACKET_SIZE) & 0xffff);
}
