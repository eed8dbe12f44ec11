/* A rig whose lamp is on a serial LED controller: the commands of an operator, and the lamp after
 * the end of the daemon while it is lit. */
#include "lib/find_guardian.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/rig_daemon.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "virtual/leds.h"

#include <signal.h>

struct bench {
    VirtualLeds *leds;
    struct rig_daemon run;
    GSubprocess *holder;
};

static void begin(struct bench *bench, const char *folder, gboolean resets_on_open) {
    const struct virtual_leds_options options = {.n = 6,
                                                 .dark_ms = 2000,
                                                 .boot_ms = resets_on_open ? 200 : 0,
                                                 .resets_on_open = resets_on_open};
    *bench = (struct bench){.leds = ok(virtual_leds_new(&options, ERR))};
    g_autofree char *text =
        g_strdup_printf("[rig]\nid = leds\nclock = real\narc_radius_mm = 500\n"
                        "[lamps bank]\ndriver = serial-lamps\nport = %s\n"
                        "[lamp lamp30]\nbank = bank\nindex = 4\ntheta_deg = 30\nphi_deg = "
                        "0\ndistance_mm = 500\n" RIG_DAEMON_CAMERA,
                        virtual_leds_port(bench->leds));
    rig_daemon_begin(&bench->run, folder, text);
}

static void end(struct bench *bench) {
    rig_daemon_end(&bench->run);
    g_clear_object(&bench->holder);
    virtual_leds_free(bench->leds);
}

static struct virtual_leds_state state_of(const struct bench *bench) {
    struct virtual_leds_state state;
    virtual_leds_state(bench->leds, &state);
    return state;
}

TEST(operator) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, TRUE);
    g_free(process_mesorig(0, "lamp --address %s lamp30 --for 0.2", bench.run.address));
    g_assert_cmpint(state_of(&bench).n_sets, >=, 2);
    g_assert_false(state_of(&bench).lit);
    g_autofree char *status = process_mesorig(0, "status --address %s", bench.run.address);
    assert_has(status, "serial-lamps");
    end(&bench);
}

/* The daemon ends while the lamp is lit. */
static void abandoned(int signal, gboolean resets_on_open) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, resets_on_open);
    bench.holder = process_start(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                                 (const char *[]){BUILD_DIR "/bin/mesorig", "lamp", "--address",
                                                  bench.run.address, "lamp30", NULL});
    UNTIL (state_of(&bench).levels[4] == 255)
        g_usleep(1000);
    const gint64 begun = g_get_monotonic_time();
    g_subprocess_send_signal(bench.run.daemon, signal);
    UNTIL (!state_of(&bench).lit)
        g_usleep(1000);
    g_test_message("the lamp is dark %.2f s after the end of the daemon, %s",
                   (double)(g_get_monotonic_time() - begun) * 1e-6,
                   state_of(&bench).n_watchdog ? "by its watchdog" : "by a command");
    if (signal == SIGSTOP) /* the guardian waits for longer */
        g_assert_cmpint(state_of(&bench).n_watchdog, ==, 1);
    UNTIL (!find_guardian(bench.run.rig))
        g_usleep(10000);
    g_assert_false(state_of(&bench).lit);
    g_autofree char *log = text_file_read(bench.run.log);
    /* What the daemon or its guardian says. */
    if (signal == SIGTERM)
        assert_has(log, "mesorigd: the rig is safe\n");
    else
        assert_has(log, "lamps bank: off, read back\n");
    end(&bench);
}

TEST(killed) {
    abandoned(SIGKILL, FALSE);
}

TEST(killed_arduino) {
    abandoned(SIGKILL, TRUE);
}

TEST(hangs) {
    abandoned(SIGSTOP, FALSE);
}

TEST(told_to_end) {
    abandoned(SIGTERM, FALSE);
}
