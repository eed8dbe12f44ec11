#include "devices_gige.h"
#include "bench.h"

#include "lib/gige_rig.h"

#include <arpa/inet.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define SHOTS       300
#define EXPOSURE_US 10
#define PACKET      8192
#define LIMIT_MS    2000

/* Registers of GigE Vision, and of the virtual camera's own (its GenICam file names them). */
#define CONTROL       0x0a00
#define STREAM_PORT   0x0d00
#define PACKET_SIZE   0x0d04
#define STREAM_IP     0x0d18
#define FORMAT        0x1110
#define ACQUISITION   0x1114
#define EXPOSURE      0x1118
#define TRIGGER_MODE  0x1124
#define TRIGGER_FROM  0x1128
#define TRIGGER       0x112c
#define FORMAT_MONO_8 0x01080001

struct bare { /* a client that knows nothing but the protocol */
    int control, stream;
    guint16 id;
};

static void put32(guint8 *to, guint32 value) {
    value = htonl(value);
    memcpy(to, &value, 4);
}

static void wait_readable(int fd) {
    struct pollfd pollfd = {fd, POLLIN, 0};
    if (poll(&pollfd, 1, LIMIT_MS) <= 0)
        g_error("bench: the virtual camera does not answer");
}

/* command 0x80: read, 0x82: write. */
static void ask(struct bare *bare, guint8 command, guint32 address, guint32 value) {
    guint8 request[16] = {0x42, 1, 0, command, 0, command == 0x80 ? 4 : 8}, reply[64];
    request[6] = (guint8)(++bare->id >> 8);
    request[7] = (guint8)bare->id;
    put32(request + 8, address);
    put32(request + 12, value);
    if (send(bare->control, request, command == 0x80 ? 12 : 16, 0) < 0)
        g_error("bench: %s", g_strerror(errno));
    wait_readable(bare->control);
    if (recv(bare->control, reply, sizeof reply, 0) < 8 || reply[0] != 0)
        g_error("bench: the virtual camera refuses 0x%x at 0x%x", command, address);
}

static void connect_bare(struct bare *bare, const char *address) {
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons(3956)};
    struct sockaddr_in here = {.sin_family = AF_INET};
    socklen_t size = sizeof here;
    int buffer = 4 << 20;
    inet_pton(AF_INET, address, &to.sin_addr);
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    *bare = (struct bare){socket(AF_INET, SOCK_DGRAM, 0), socket(AF_INET, SOCK_DGRAM, 0), 0};
    setsockopt(bare->stream, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
    if (connect(bare->control, (struct sockaddr *)&to, sizeof to) != 0 ||
        bind(bare->stream, (struct sockaddr *)&here, sizeof here) != 0 ||
        getsockname(bare->stream, (struct sockaddr *)&here, &size) != 0)
        g_error("bench: %s", g_strerror(errno));
    const guint32 settings[][2] = {{CONTROL, 2},
                                   {STREAM_PORT, ntohs(here.sin_port)},
                                   {STREAM_IP, INADDR_LOOPBACK},
                                   {PACKET_SIZE, PACKET},
                                   {FORMAT, FORMAT_MONO_8},
                                   {EXPOSURE, EXPOSURE_US},
                                   {TRIGGER_FROM, 1},
                                   {TRIGGER_MODE, 1},
                                   {ACQUISITION, 1}};
    for (gsize i = 0; i < G_N_ELEMENTS(settings); i++)
        ask(bare, 0x82, settings[i][0], settings[i][1]);
}

/* As quick as can be: making pictures is not what is measured. */
static void paint(const struct virtual_exposure *exposure, gpointer data, guint16 *pixels) {
    pixels[0] = (guint16)exposure->n;
}

static VirtualGige *make_device(const char *serial, int width, int height) {
    struct virtual_camera_options options = {
        .serial = serial, .width = width, .height = height, .bits = 8, .picture = paint};
    GError *error = NULL;
    VirtualGige *device = virtual_gige_new(&options, NULL, &error);
    if (!device)
        g_error("bench: %s", error->message);
    return device;
}

static double time_driver(struct eye *eye, guint64 shot) {
    int n = eye->n_ended;
    gint64 start = g_get_monotonic_time();
    eye_trigger(eye, shot);
    while (eye->n_ended == n)
        g_main_context_iteration(NULL, TRUE);
    if (eye->last != CAMERA_FRAME)
        g_error("bench: %s", eye->error->message);
    return (double)(g_get_monotonic_time() - start);
}

void gige_latency(int width, int height, struct gige_latency *ret) {
    static double registers[SHOTS], bare_us[SHOTS], driver_us[SHOTS];
    g_autoptr(VirtualGige) other = make_device("BARE", width, height);
    struct eye eye = {.device = make_device("DRIVER", width, height)};
    struct bare bare;
    GError *error = NULL;
    g_autofree char *keys = g_strdup_printf("pixel_format = Mono8\npacket_size = %d", PACKET);
    connect_bare(&bare, virtual_gige_address(other));
    if (!eye_open(&eye, keys, &error) || !eye_ready(&eye, EXPOSURE_US, &error))
        g_error("bench: %s", error->message);
    time_driver(&eye, SHOTS); /* the first is slower */
    for (int i = 0; i < SHOTS; i++) {
        gint64 start = g_get_monotonic_time();
        ask(&bare, 0x80, CONTROL, 0);
        registers[i] = (double)(g_get_monotonic_time() - start);
        /* Until the trailer is here, which comes last. */
        guint8 packet[PACKET];
        gint64 begun = g_get_monotonic_time();
        ask(&bare, 0x82, TRIGGER, 1);
        do {
            wait_readable(bare.stream);
            if (recv(bare.stream, packet, sizeof packet, 0) < 8)
                g_error("bench: %s", g_strerror(errno));
        } while (packet[4] != 2);
        bare_us[i] = (double)(g_get_monotonic_time() - begun);
        driver_us[i] = time_driver(&eye, (guint64)i);
    }
    ret->register_us = bench_time_quantile(registers, SHOTS, 0.5);
    ret->protocol = bench_times(bare_us, SHOTS);
    ret->driver = bench_times(driver_us, SHOTS);
    close(bare.control);
    close(bare.stream);
    eye_end(&eye, NULL);
}
