/* A rig whose lamp is on a node in the network: the lamp after the end of the daemon while it is
 * lit. */
#include "lib/find_guardian.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/rig_daemon.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "virtual/dmx_node.h"
#include "virtual/wled.h"

#include <signal.h>

struct bench {
    VirtualDmx *node;
    VirtualWled *wled; /* instead of the node */
    struct rig_daemon run;
    GSubprocess *holder;
};

static void begin(struct bench *bench, const char *folder, const char *driver,
                  const struct virtual_dmx_options *given) {
    struct virtual_dmx_options options = given ? *given : (struct virtual_dmx_options){0};
    options.address = virtual_dmx_address(1);
    *bench = (struct bench){};
    if (given)
        bench->node = ok(virtual_dmx_new(&options, ERR));
    else
        bench->wled = ok(virtual_wled_new(options.address, 6, ERR));
    g_autofree char *key =
        given ? g_strdup("universe = 1")
              : g_strdup_printf("http_port = %d", virtual_wled_http_port(bench->wled));
    g_autofree char *text =
        g_strdup_printf("[rig]\nid = leds\nclock = real\narc_radius_mm = 500\n"
                        "[lamps bank]\ndriver = %s\naddress = %s\nlocal_address = %s\n%s\nn = 6\n"
                        "[lamp lamp30]\nbank = bank\nindex = 4\ntheta_deg = 30\nphi_deg = "
                        "0\ndistance_mm = 500\n" RIG_DAEMON_CAMERA,
                        driver, virtual_dmx_address(1), virtual_dmx_address(0), key);
    rig_daemon_begin(&bench->run, folder, text);
}

static void end(struct bench *bench) {
    rig_daemon_end(&bench->run);
    g_clear_object(&bench->holder);
    virtual_dmx_free(bench->node);
    virtual_wled_free(bench->wled);
}

/* What a lamp shows, and whether it went off by itself. */
struct seen {
    gboolean lit;
    int level, n_lost;
};

static struct seen see(const struct bench *bench) {
    struct virtual_dmx_state dmx;
    struct virtual_wled_state wled;
    if (bench->node) {
        virtual_dmx_state(bench->node, &dmx);
        return (struct seen){dmx.lit, dmx.levels[0][4], dmx.n_lost};
    }
    virtual_wled_state(bench->wled, &wled);
    return (struct seen){wled.lit, wled.leds[4][1], wled.n_returns};
}

static void light(struct bench *bench) {
    bench->holder = process_start(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                                  (const char *[]){BUILD_DIR "/bin/mesorig", "lamp", "--address",
                                                   bench->run.address, "lamp30", NULL});
    UNTIL (see(bench).level == 255)
        g_usleep(1000);
}

static double wait_dark(struct bench *bench, gint64 begun) {
    UNTIL (!see(bench).lit)
        g_usleep(1000);
    return (double)(g_get_monotonic_time() - begun) * 1e-6;
}

/* The daemon ends while the lamp is lit. words is what the daemon or its guardian says. */
static void abandoned(int signal, const char *driver, const struct virtual_dmx_options *options,
                      const char *words) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, driver, options);
    light(&bench);
    const gint64 begun = g_get_monotonic_time();
    g_subprocess_send_signal(bench.run.daemon, signal);
    const double dark_s = wait_dark(&bench, begun);
    g_test_message("the lamp is dark %.2f s after the end of the daemon, %s", dark_s,
                   see(&bench).n_lost ? "by loss of data" : "by a command");
    UNTIL (!find_guardian(bench.run.rig))
        g_usleep(10000);
    g_assert_false(see(&bench).lit);
    g_autofree char *log = text_file_read(bench.run.log);
    assert_has(log, words);
    end(&bench);
}

/* Daemon and guardian are killed at the same time. */
static void alone(const char *driver, const struct virtual_dmx_options *options, gboolean dark) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, driver, options);
    light(&bench);
    g_subprocess_send_signal(bench.run.daemon, SIGSTOP);
    end_guardian(bench.run.rig);
    g_subprocess_send_signal(bench.run.daemon, SIGKILL);
    g_subprocess_wait(bench.run.daemon, NULL, NULL);
    if (dark)
        wait_dark(&bench, g_get_monotonic_time());
    else
        g_usleep(4 * G_USEC_PER_SEC);
    g_assert_cmpint(see(&bench).lit, ==, !dark);
    g_assert_cmpint(see(&bench).n_lost, ==, !options || options->sacn);
    end(&bench);
}

static const struct virtual_dmx_options artnet = {.universe = 1, .n = 1};

TEST(artnet_operator) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, "artnet-lamps", &artnet);
    g_free(process_mesorig(0, "lamp --address %s lamp30 --for 0.2", bench.run.address));
    g_assert_false(see(&bench).lit);
    g_autofree char *status = process_mesorig(0, "status --address %s", bench.run.address);
    assert_has(status, "artnet-lamps");
    g_autofree char *safe = process_mesorig(0, "safe --address %s", bench.run.address);
    assert_has(safe, "sent, and the node answers");
    assert_has(safe, "lamps and lasers are off");
    end(&bench);
}

TEST(artnet_killed) {
    abandoned(SIGKILL, "artnet-lamps", &artnet, "lamps bank: off, sent, and the node answers\n");
}

TEST(artnet_hangs) {
    abandoned(SIGSTOP, "artnet-lamps", &artnet, "lamps bank: off, sent, and the node answers\n");
}

TEST(artnet_told_to_end) {
    abandoned(SIGTERM, "artnet-lamps", &artnet, "mesorigd: the rig is safe\n");
}

/* A node holds the last levels for ever. */
TEST(artnet_alone) {
    alone("artnet-lamps", &artnet, FALSE);
}

static const struct virtual_dmx_options sacn = {.sacn = TRUE, .universe = 1, .n = 1};

TEST(sacn_killed) {
    abandoned(SIGKILL, "sacn-lamps", &sacn, "lamps bank: off, sent, but nothing answers\n");
}

/* The stream ends with the daemon, so the receiver goes dark before the guardian acts. */
TEST(sacn_hangs) {
    abandoned(SIGSTOP, "sacn-lamps", &sacn, "lamps bank: off, sent, but nothing answers\n");
}

TEST(sacn_told_to_end) {
    abandoned(SIGTERM, "sacn-lamps", &sacn, "mesorigd: the rig is safe\n");
}

TEST(sacn_alone) {
    alone("sacn-lamps", &sacn, TRUE);
}

/* A receiver that is set to hold its last levels. */
TEST(sacn_alone_holds) {
    static const struct virtual_dmx_options holds = {
        .sacn = TRUE, .universe = 1, .n = 1, .holds_last = TRUE};
    alone("sacn-lamps", &holds, FALSE);
}

TEST(wled_killed) {
    abandoned(SIGKILL, "wled-lamps", NULL, "lamps bank: off, read back\n");
}

/* The time without levels is over before the guardian acts. */
TEST(wled_hangs) {
    abandoned(SIGSTOP, "wled-lamps", NULL, "lamps bank: off, read back\n");
}

TEST(wled_told_to_end) {
    abandoned(SIGTERM, "wled-lamps", NULL, "mesorigd: the rig is safe\n");
}

TEST(wled_alone) {
    alone("wled-lamps", NULL, TRUE);
}
