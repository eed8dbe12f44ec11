/*
 * Triggers eight GigE Vision cameras of 1024 × 768 pixels on loopback together, at a given rate for
 * a given time. Counts the packets that are lost or sent again and the pictures that are refused,
 * and measures the time of a picture.
 *
 *     bench_gige [--seconds 60] [--rate 30] [--packet-socket] [--json]
 *
 * Frames of 8 bits, so that eight cameras at 30 Hz are 189 MB/s, more than one line of 1 Gbit/s.
 */
#include "bench.h"
#include "lib/gige_rig.h"

#include <stdlib.h>
#include <string.h>

#define N_CAMERAS 8
#define WIDTH     1024
#define HEIGHT    768

static int rate = 30, seconds = 60;
static gboolean packet_socket;

static const GOptionEntry entries[] = {
    {"seconds", 0, 0, G_OPTION_ARG_INT, &seconds, "How long", "N"},
    {"rate", 0, 0, G_OPTION_ARG_INT, &rate, "Pictures a second and camera", "HZ"},
    {"packet-socket", 0, 0, G_OPTION_ARG_NONE, &packet_socket,
     "Read packets by AF_PACKET (needs CAP_NET_RAW)", NULL},
    {NULL},
};

static guint16 *painted; /* the same for all: making pictures is not what is measured */

static void paint(const struct virtual_exposure *exposure, gpointer data, guint16 *pixels) {
    memcpy(pixels, painted, WIDTH * HEIGHT * sizeof *pixels);
    pixels[0] = (guint16)(exposure->n & 0xfff);
    pixels[1] = (guint16)(exposure->n >> 12 & 0xfff);
}

static VirtualGige *make_device(int i) {
    g_autofree char *serial = g_strdup_printf("BENCH%d", i);
    struct virtual_camera_options options = {.serial = serial,
                                             .width = WIDTH,
                                             .height = HEIGHT,
                                             .bits = 8,
                                             .cfa = CFA_RGGB,
                                             .picture = paint};
    GError *error = NULL;
    VirtualGige *device = virtual_gige_new(&options, NULL, &error);
    if (!device)
        g_error("bench_gige: %s", error->message);
    return device;
}

struct tally {
    int triggered, late, frames, refused, faults;
    double slowest_ms, sum_ms;
    gint64 sent_us[N_CAMERAS];
};

struct seat {
    struct eye eye;
    struct tally *tally;
    int index;
};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct seat *seat = data;
    struct tally *tally = seat->tally;
    double ms = (double)(g_get_monotonic_time() - tally->sent_us[seat->index]) / 1e3;
    if (event == CAMERA_EXPOSED)
        return;
    tally->frames += event == CAMERA_FRAME;
    tally->refused += event == CAMERA_REFUSED;
    tally->faults += event == CAMERA_FAULT;
    if (event != CAMERA_FRAME) {
        g_printerr("bench_gige: %s\n", error->message);
        camera_arm(camera, NULL);
        return;
    }
    tally->sum_ms += ms;
    tally->slowest_ms = MAX(tally->slowest_ms, ms);
}

static void open_seats(struct seat *seats, struct tally *tally) {
    GError *error = NULL;
    g_autofree char *keys = g_strdup_printf("pixel_format = BayerRG8\npacket_socket = %s",
                                            packet_socket ? "yes" : "no");
    for (int i = 0; i < N_CAMERAS; i++) {
        seats[i] = (struct seat){.tally = tally, .index = i};
        seats[i].eye.device = make_device(i);
        if (!eye_open(&seats[i].eye, keys, &error))
            g_error("bench_gige: %s", error->message);
        camera_listen(seats[i].eye.camera, on_event, &seats[i]);
    }
    for (int i = 0; i < N_CAMERAS; i++)
        if (!eye_ready(&seats[i].eye, 1000, &error))
            g_error("bench_gige: %s", error->message);
}

static gboolean anybody_waits(const struct seat *seats) {
    for (int i = 0; i < N_CAMERAS; i++)
        if (camera_is_waiting(seats[i].eye.camera))
            return TRUE;
    return FALSE;
}

static void print(struct seat *seats, const struct tally *tally) {
    guint64 resent = 0, packets = 0;
    for (int i = 0; i < N_CAMERAS; i++) {
        struct virtual_camera_state state;
        virtual_gige_state(seats[i].eye.device, &state);
        resent += state.resent;
        packets += state.packets;
    }
    bench_begin(NULL);
    bench_put("%s{socket} %d{rate_hz} %d{seconds} %d{triggered} %d{frames} %d{late} %d{refused} "
              "%d{faults} %" G_GUINT64_FORMAT "{packets} %" G_GUINT64_FORMAT
              "{resent} %.2f{mean_ms} %.1f{slowest_ms}",
              packet_socket ? "packet" : "plain", rate, seconds, tally->triggered, tally->frames,
              tally->late, tally->refused, tally->faults, packets, resent,
              tally->sum_ms / MAX(tally->frames, 1), tally->slowest_ms);
    bench_end();
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct seat seats[N_CAMERAS];
    struct tally tally = {0};
    bench_parse(&argc, &argv, entries, NULL);
    if (rate < 1 || seconds < 1)
        bench_fail(2, "rate and seconds are at least 1");
    painted = g_new(guint16, WIDTH * HEIGHT);
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        painted[i] = (guint16)(i * 31 % 251);
    open_seats(seats, &tally);
    gint64 begun = g_get_monotonic_time();
    for (int n = 0; n < rate * seconds; n++) {
        gint64 due = begun + (gint64)n * G_USEC_PER_SEC / rate;
        double left_s = (double)(due - g_get_monotonic_time()) / 1e6;
        conformance_pass(seats[0].eye.clock, MAX(left_s, 0));
        /* A tick that finds a camera still at work is late: the rate is not kept. */
        for (int i = 0; i < N_CAMERAS; i++) {
            Camera *camera = seats[i].eye.camera;
            if (camera_is_waiting(camera)) {
                tally.late++;
                continue;
            }
            tally.sent_us[i] = g_get_monotonic_time();
            tally.triggered += camera_trigger(camera, ((guint64)n), NULL);
        }
    }
    while (anybody_waits(seats))
        g_main_context_iteration(NULL, TRUE);
    print(seats, &tally);
    for (int i = 0; i < N_CAMERAS; i++)
        eye_end(&seats[i].eye, NULL);
    g_free(painted);
    return tally.frames == tally.triggered ? 0 : 1;
}
