/* The driver serial-lamps on the firmware of contrib/led-controller, which tests/led_controller/run
 * builds and runs:
 *
 *     led_controller_conformance RUNNER FIRMWARE.elf FOLDER
 *
 * The conformance suite of lamps, then what switches the lamps off. The pins of the board are the
 * truth, and times are those of the board. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/wait.h"
#include "serial/devices.h"

#include <gio/gio.h>
#include <stdio.h>
#include <string.h>

#define N_LAMPS 6
#define DARK_MS 2000
#define LATE_MS 50 /* the driver may send lines this long before the runner is asked */

static const int levels[N_LAMPS] = {255, 1, 20, 255, 128, 254};

static GSubprocess *runner;
static char *section;

struct board {
    int pins[N_LAMPS];
    gboolean lit;
    double now_ms, dark_ms; /* dark_ms: when the last lamp went off */
};

/* Sends a command to the runner, and reads the state of the board. */
static struct board tell(const char *command) {
    static GDataInputStream *answers;
    GOutputStream *to = g_subprocess_get_stdin_pipe(runner);
    g_autofree char *line = g_strconcat(command, "\n", NULL);
    struct board board = {0};
    int *pins = board.pins;
    if (!answers)
        answers = g_data_input_stream_new(g_subprocess_get_stdout_pipe(runner));
    if (*command)
        ok(g_output_stream_write_all(to, line, strlen(line), NULL, NULL, ERR));
    g_autofree char *answer = ok(g_data_input_stream_read_line(answers, NULL, NULL, ERR));
    g_assert_nonnull(answer);
    if (!*command) {
        g_assert_cmpstr(answer, ==, "ready");
        return board;
    }
    g_assert_cmpint(sscanf(answer, "%d %d %d %d %d %d %lf %lf", &pins[0], &pins[1], &pins[2],
                           &pins[3], &pins[4], &pins[5], &board.now_ms, &board.dark_ms),
                    ==, N_LAMPS + 2);
    for (int i = 0; i < N_LAMPS; i++)
        board.lit |= pins[i] > 0;
    return board;
}

static void fail(gpointer unused, enum conformance_fault fault) {
    tell(fault == CONFORMANCE_UNANSWERED ? "wire 1"
         : fault == CONFORMANCE_CUT      ? "wire 2"
                                         : "wire 0");
}

struct bench {
    Clock *clock;
    LampBank *bank;
    int n_events, n_lost;
    GError *error; /* of the lamps that were lost */
};

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    bench->n_events++;
    if (index >= 0 || !on)
        return;
    bench->n_lost++;
    g_clear_error(&bench->error);
    bench->error = g_error_copy(error);
}

static void begin(struct bench *bench) {
    const struct config_section *opened;
    const struct conformance with = {.section = section};
    *bench = (struct bench){.clock = clock_new_real()};
    g_autoptr(Config) config = conformance_config(&with, "", &opened);
    bench->bank = ok(lamps_open(&serial_lamps_driver, opened, NULL, bench->clock, ERR));
    g_assert_cmpint(bench->bank->n, ==, N_LAMPS);
    lamps_listen(bench->bank, on_lamp, bench);
}

static void end(struct bench *bench) {
    lamps_close(bench->bank);
    clock_unref(bench->clock);
    g_clear_error(&bench->error);
    g_assert_false(tell("state").lit);
}

static void set_lamp(struct bench *bench, int index, gboolean on) {
    bench->n_events = 0;
    ok(lamps_set(bench->bank, index, on, ERR));
    conformance_wait(bench->clock, &bench->n_events, 1, 10);
    g_assert_cmpint(bench->n_lost, ==, 0);
}

/* Each lamp is on its pin, with its level. */
static void pins(void) {
    struct bench bench;
    begin(&bench);
    for (int i = 0; i < N_LAMPS; i++) {
        set_lamp(&bench, i, TRUE);
        const struct board board = tell("state");
        for (int k = 0; k < N_LAMPS; k++)
            g_assert_cmpint(board.pins[k], ==, k == i ? levels[i] : 0);
        set_lamp(&bench, i, FALSE);
    }
    end(&bench);
}

static void stays_lit(void) {
    struct bench bench;
    begin(&bench);
    set_lamp(&bench, 4, TRUE);
    const double begun_ms = tell("state").now_ms;
    UNTIL (tell("state").now_ms > begun_ms + 3 * DARK_MS) {
        conformance_pass(bench.clock, 0.05);
        g_assert_cmpint(tell("state").pins[4], ==, levels[4]);
    }
    g_assert_cmpint(bench.n_lost, ==, 0);
    end(&bench);
}

/* The lamps are lost with these words, and can be used again. */
static void expect_lost(struct bench *bench, const char *words) {
    conformance_wait(bench->clock, &bench->n_lost, 1, 10);
    if (!strstr(bench->error->message, words))
        g_error("\"%s\" does not say \"%s\"", bench->error->message, words);
    UNTIL (lamps_safety(bench->bank) == DEVICE_SAFE)
        conformance_pass(bench->clock, 0.01);
    g_assert_false(tell("state").lit);
    bench->n_lost = 0;
    set_lamp(bench, 1, TRUE);
    g_assert_cmpint(tell("state").pins[1], ==, levels[1]);
    end(bench);
}

/* Waits until all lamps are dark, without the main loop. Returns how long that took. */
static double time_to_dark(double from_ms) {
    UNTIL (!tell("state").lit)
        g_usleep(1000);
    const double ms = tell("state").dark_ms - from_ms;
    g_test_message("dark after %.0f ms", ms);
    return ms;
}

static void program_hangs(void) {
    struct bench bench;
    begin(&bench);
    set_lamp(&bench, 3, TRUE);
    const double ms = time_to_dark(tell("state").now_ms);
    g_assert_cmpfloat(ms, >, DARK_MS - LATE_MS);
    g_assert_cmpfloat(ms, <, DARK_MS + LATE_MS);
    expect_lost(&bench, "lamp 3 was at 255");
}

/* The hardware watchdog resets the board within a second or so; its oscillator is not exact. */
static void firmware_hangs(void) {
    struct bench bench;
    begin(&bench);
    set_lamp(&bench, 3, TRUE);
    g_assert_cmpfloat(time_to_dark(tell("hang").now_ms), <, 1200);
    expect_lost(&bench, "was reset");
}

static void reset(void) {
    struct bench bench;
    begin(&bench);
    set_lamp(&bench, 3, TRUE);
    g_assert_false(tell("reset").lit);
    expect_lost(&bench, "was reset");
}

int main(int argc, char **argv) {
    static struct conformance board = {.name = "led-controller", .real_clock = TRUE, .fail = fail};
    g_test_init(&argc, &argv, NULL);
    if (argc != 4) {
        g_printerr("usage: %s RUNNER FIRMWARE.elf FOLDER\n", argv[0]);
        return 2;
    }
    g_autofree char *port = g_build_filename(argv[3], "port", NULL);
    runner = ok(g_subprocess_new(G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDOUT_PIPE,
                                 ERR, argv[1], argv[2], port, NULL));
    section = g_strdup_printf("[lamps test]\ndriver = serial-lamps\nport = %s\n"
                              "levels = 255;1;20;255;128;254\n",
                              port);
    board.section = section;
    tell("");
    conformance_lamps(&serial_lamps_driver, &board);
    g_test_add_func("/led-controller/pins", pins);
    g_test_add_func("/led-controller/stays-lit", stays_lit);
    g_test_add_func("/led-controller/program-hangs", program_hangs);
    g_test_add_func("/led-controller/firmware-hangs", firmware_hangs);
    g_test_add_func("/led-controller/reset", reset);
    const int result = g_test_run();
    g_subprocess_force_exit(runner);
    ok(g_subprocess_wait(runner, NULL, ERR));
    return result;
}
