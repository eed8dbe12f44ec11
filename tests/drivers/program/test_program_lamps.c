/* Lamps of a program: what every driver must do, what the device of the program did, and faults of
 * the program. model.py is the program, and its file hardware.json is the device. */
#include "conformance/conformance.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/program_model.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "program/devices.h"

#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

struct bench {
    const char *folder;
    Clock *clock;
    LampBank *bank;
    int n, index;
    gboolean on;
    GError *error;
};

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    struct bench *bench = data;
    bench->n++;
    bench->index = index;
    bench->on = on;
    g_clear_error(&bench->error);
    bench->error = error ? g_error_copy(error) : NULL;
}

static void assert_hardware(const char *folder, const char *on) {
    g_autofree char *is = program_model_read(folder, "hardware.json");
    g_autofree char *expected = g_strdup_printf("{\"on\": [%s]}", on);
    g_assert_cmpstr(is, ==, expected);
}

#define DARK "false, false, false, false"

static gboolean open_bank(struct bench *bench, const char *more, GError **error) {
    g_autofree char *section = program_model_section("lamps", bench->folder, 20, "");
    const struct conformance with = {.section = section};
    const struct config_section *read;
    g_autoptr(Config) config = conformance_config(&with, more, &read);
    bench->bank = lamps_open(&program_lamps_driver, read, NULL, bench->clock, error);
    if (!bench->bank)
        return FALSE;
    lamps_listen(bench->bank, on_lamp, bench);
    return TRUE;
}

static void begin(struct bench *bench, const char *folder) {
    *bench = (struct bench){.folder = folder, .clock = clock_new_real()};
    ok(open_bank(bench, "", ERR));
}

/* No program of a test is left when its device was closed. */
static void assert_ended(const char *folder) {
    UNTIL (program_model_processes(folder) == 0)
        g_usleep(10000);
}

static void end(struct bench *bench) {
    g_clear_pointer(&bench->bank, lamps_close);
    g_clear_pointer(&bench->clock, clock_unref);
    g_clear_error(&bench->error);
    assert_ended(bench->folder);
}

static void set(struct bench *bench, int index, gboolean on) {
    bench->n = 0;
    ok(lamps_set(bench->bank, index, on, ERR));
}

static void set_and_wait(struct bench *bench, int index, gboolean on) {
    set(bench, index, on);
    conformance_wait(bench->clock, &bench->n, 1, 10);
    g_assert_cmpint(bench->index, ==, index);
    g_assert_cmpint(bench->on, ==, on);
}

static void wait_safe(struct bench *bench) {
    UNTIL (!device_is_unsafe(&bench->bank->device) && lamps_safety(bench->bank) == DEVICE_SAFE)
        conformance_pass(bench->clock, 0.01);
}

TEST(truth) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    g_assert_cmpint(bench.bank->n, ==, 4);
    g_assert_cmpfloat(bench.bank->watchdog_s, ==, 10);
    g_assert_cmpstr(bench.bank->device.identity, ==, "model of a device, serial number 7");
    set_and_wait(&bench, 2, TRUE);
    assert_hardware(folder, "false, false, true, false");
    set_and_wait(&bench, 0, TRUE);
    assert_hardware(folder, "true, false, true, false");
    set_and_wait(&bench, 2, FALSE);
    g_assert_no_error(bench.error);
    assert_hardware(folder, "true, false, false, false");
    end(&bench);
    assert_hardware(folder, DARK);
}

/* Lamps that something else has left on are off when the device was opened. */
TEST(left_on) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    text_file_write(folder, "hardware.json", "{\"on\": [true, true, true, true]}");
    begin(&bench, folder);
    assert_hardware(folder, DARK);
    end(&bench);
}

/* Each fault comes while lamp 1 is on. The message says what happened. Afterwards every lamp is
 * off, although the program could not switch it off when it failed, and the lamps work again. */
static const struct fault {
    const char *name;
    enum device_error code;
    const char *says;
} faults[] = {
    {"unanswered", DEVICE_ERROR_TIMEOUT, "did not answer “set” within 1500 ms; it was ended"},
    {"cut", DEVICE_ERROR_TIMEOUT, "did not answer “set” within 1500 ms; it was ended"},
    {"sleeps", DEVICE_ERROR_TIMEOUT, "did not answer “set” within 1500 ms; it was ended"},
    {"dies", DEVICE_ERROR_DISCONNECTED,
     "has ended with exit code 3; see what it has printed in the log of mesorigd"},
    {"crashes", DEVICE_ERROR_DISCONNECTED, "was ended by signal 6"},
    {"garbage", DEVICE_ERROR_PROTOCOL, "sent a line that is not a JSON object: “{"},
    {"cannot-read", DEVICE_ERROR_PROTOCOL, "could not read a request: this is not JSON"},
    {"deep", DEVICE_ERROR_PROTOCOL, "sent a line of more than 64 arrays and objects"},
    {"huge", DEVICE_ERROR_PROTOCOL, "sent a line of more than 65536 bytes"},
    {"closes-output", DEVICE_ERROR_DISCONNECTED, "was ended by signal 9"},
    {"refuses", DEVICE_ERROR_PROTOCOL, "refused “set”: the fuse has?blown"},
    {"lies", DEVICE_ERROR_PROTOCOL, "lamp 0 was switched on, but"},
    {"short", DEVICE_ERROR_PROTOCOL, "sent an answer in which “on” is not an array of 4 values"},
};

static void run_fault(gconstpointer data) {
    const struct fault *fault = data;
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    set_and_wait(&bench, 1, TRUE);
    program_model_fail(folder, fault->name);
    set(&bench, 0, TRUE);
    conformance_wait(bench.clock, &bench.n, 1, 10);
    g_assert_error(bench.error, DEVICE_ERROR, (int)fault->code);
    g_assert_true(g_str_has_prefix(bench.error->message, "lamps test: "));
    assert_has(bench.error->message, fault->says);
    g_assert_true(lamps_is_on(bench.bank, 0));
    program_model_fail(folder, "");
    ok(lamps_all_off(bench.bank, ERR));
    wait_safe(&bench);
    assert_hardware(folder, DARK);
    set_and_wait(&bench, 3, TRUE);
    g_assert_no_error(bench.error);
    assert_hardware(folder, "false, false, false, true");
    end(&bench);
}

/* A lamp that was on while the program failed for another reason is not left on. */
static void other_lamp(const char *fault) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    set_and_wait(&bench, 1, TRUE);
    program_model_fail(folder, fault);
    set(&bench, 0, TRUE);
    conformance_wait(bench.clock, &bench.n, 2, 10);
    g_assert_cmpint(lamps_light(bench.bank, 1), ==, LIGHT_UNSAFE);
    program_model_fail(folder, "");
    wait_safe(&bench);
    assert_hardware(folder, DARK);
    end(&bench);
}

TEST(other_lamp__dies) {
    other_lamp("dies");
}

TEST(other_lamp__unanswered) {
    other_lamp("unanswered");
}

/* Answers to nothing, unknown events and slow answers are no faults. */
static void no_fault(const char *name) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    program_model_fail(folder, name);
    set_and_wait(&bench, 1, TRUE);
    g_assert_no_error(bench.error);
    assert_hardware(folder, "false, true, false, false");
    set_and_wait(&bench, 1, FALSE);
    g_assert_no_error(bench.error);
    g_assert_false(device_is_unsafe(&bench.bank->device));
    program_model_fail(folder, "");
    end(&bench);
}

TEST(no_fault__chatters) {
    no_fault("chatters");
}

TEST(no_fault__slow) {
    no_fault("slow");
}

/* The program ends while nothing is asked of it. Its lamps count as lit until they were read back,
 * and they are off then. */
TEST(dies_idle) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    set_and_wait(&bench, 1, TRUE);
    bench.n = 0;
    program_model_kill(folder);
    conformance_wait(bench.clock, &bench.n, 1, 10);
    g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    assert_has(bench.error->message, "was ended by signal 9");
    g_assert_cmpint(bench.index, ==, -1);
    g_assert_true(device_is_unsafe(&bench.bank->device));
    wait_safe(&bench);
    assert_hardware(folder, DARK);
    end(&bench);
}

/* A program that hangs while nothing is asked of it is missed by its "ping". */
TEST(hangs_idle) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    set_and_wait(&bench, 1, TRUE);
    bench.n = 0;
    program_model_fail(folder, "sleeps");
    conformance_wait(bench.clock, &bench.n, 1, 10);
    assert_has(bench.error->message, "did not answer “ping” within 1500 ms; it was ended");
    program_model_fail(folder, "");
    wait_safe(&bench);
    assert_hardware(folder, DARK);
    end(&bench);
}

/* The program reports that its device has lost its state. */
TEST(lost) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    set_and_wait(&bench, 1, TRUE);
    program_model_fail(folder, "loses");
    bench.n = 0;
    conformance_wait(bench.clock, &bench.n, 1, 10);
    assert_has(bench.error->message, "lamps test: its program reports: a fuse has blown");
    wait_safe(&bench);
    assert_hardware(folder, DARK);
    end(&bench);
}

/* "Stop" is sent while another request waits for its answer. */
TEST(stop_at_once) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    program_model_fail(folder, "waits-for-stop");
    set(&bench, 0, TRUE);
    UNTIL (program_model_asked(folder, "set") == 1)
        conformance_pass(bench.clock, 0.01);
    ok(lamps_all_off(bench.bank, ERR));
    conformance_wait(bench.clock, &bench.n, 2, 10);
    g_assert_cmpint(bench.index, ==, -1);
    g_assert_no_error(bench.error);
    g_assert_cmpint(lamps_safety(bench.bank), ==, DEVICE_SAFE);
    program_model_fail(folder, "");
    end(&bench);
}

/* An "on" that waits for its turn is never sent after an "off" of the same lamp. */
TEST(overtaken) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    program_model_fail(folder, "slow");
    set(&bench, 0, TRUE);
    ok(lamps_set(bench.bank, 1, TRUE, ERR));
    ok(lamps_set(bench.bank, 1, FALSE, ERR));
    conformance_wait(bench.clock, &bench.n, 3, 10);
    g_assert_cmpint(program_model_asked(folder, "set"), ==, 2); /* lamp 0 on, lamp 1 off */
    assert_hardware(folder, "true, false, false, false");
    program_model_fail(folder, "");
    end(&bench);
}

static void close_at_failure(LampBank *bank, int index, gboolean on, gint64 at_us,
                             const GError *error, gpointer data) {
    struct bench *bench = data;
    g_assert_nonnull(error);
    bench->n++;
    lamps_close(g_steal_pointer(&bench->bank));
}

/* A listener may close the lamps, also while other requests wait. */
static void closed_at(const char *fault) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    lamps_listen(bench.bank, close_at_failure, &bench);
    program_model_fail(folder, fault);
    for (int i = 0; i < 4; i++)
        ok(lamps_set(bench.bank, i, TRUE, ERR));
    conformance_wait(bench.clock, &bench.n, 1, 10);
    conformance_pass(bench.clock, 0.3);
    g_assert_cmpint(bench.n, ==, 1);
    program_model_fail(folder, "");
    end(&bench);
}

TEST(closed_at__dies) {
    closed_at("dies");
}

TEST(closed_at__refuses) {
    closed_at("refuses");
}

TEST(closed_at__unanswered) {
    closed_at("unanswered");
}

TEST(pings) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    UNTIL (program_model_asked(folder, "ping") > 2) /* one of them while it was opened */
        conformance_pass(bench.clock, 0.05);
    end(&bench);
}

/* What the program of a device may do, and what it finds. */
TEST(rights) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    g_setenv("NOTIFY_SOCKET", "/run/systemd/notify", TRUE);
    g_assert_cmpint(dup(0), >, 2); /* stays open in this process only */
    begin(&bench, folder);
    g_unsetenv("NOTIFY_SOCKET");
    g_autofree char *process = program_model_read(folder, "process");
    assert_has(process, "\"files\": [0, 1, 2]");
    assert_has(process, "\"folder\": \"/\"");
    assert_has(process, "\"leads\": true");
    assert_has(process, geteuid() == 0 ? "\"rights\": [\"1\", 0, 0]" : "\"rights\": [\"1\", 0, ");
    g_assert_null(strstr(process, "NOTIFY_SOCKET"));
    end(&bench);
}

/* Opening fails, says why, and leaves no process behind. */
static const struct fault open_faults[] = {
    {"dies-at-start", DEVICE_ERROR_DISCONNECTED, "has ended with exit code 1"},
    {"crashes", DEVICE_ERROR_DISCONNECTED, "was ended by signal 6"},
    {"garbage", DEVICE_ERROR_PROTOCOL, "not a JSON object"},
    {"cut", DEVICE_ERROR_TIMEOUT, "has not started within 1 s; it was ended"},
    {"mute", DEVICE_ERROR_TIMEOUT, "has not started within 1 s; it was ended"},
    {"newer", DEVICE_ERROR_PROTOCOL, "answered version = 2, which is out of range: 1 to 1"},
    {"other-class", DEVICE_ERROR_PROTOCOL, "is of the class “axes”, not “lamps”"},
    {"lies", DEVICE_ERROR_PROTOCOL, "lamp 0 was switched off, but"},
};

static void run_open_fault(gconstpointer data) {
    const struct fault *fault = data;
    TEMPORARY_FOLDER(folder);
    struct bench bench = {.folder = folder, .clock = clock_new_real()};
    g_autoptr(GError) error = NULL;
    const gboolean late = fault->code == DEVICE_ERROR_TIMEOUT;
    program_model_fail(folder, fault->name);
    g_autofree char *section = program_model_section("lamps", folder, late ? 1 : 20, "");
    const struct conformance with = {.section = section};
    const struct config_section *read;
    g_autoptr(Config) config = conformance_config(&with, "", &read);
    g_assert_null(lamps_open(&program_lamps_driver, read, NULL, bench.clock, &error));
    g_assert_error(error, DEVICE_ERROR, (int)fault->code);
    g_assert_true(g_str_has_prefix(error->message, "lamps test: "));
    assert_has(error->message, fault->says);
    end(&bench);
}

TEST(no_program) {
    static const struct conformance with = {
        .section = "[lamps test]\ndriver = program-lamps\nprogram = /etc/passwd\n"};
    const struct config_section *read;
    g_autoptr(Config) config = conformance_config(&with, "", &read);
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(GError) error = NULL;
    g_assert_null(lamps_open(&program_lamps_driver, read, NULL, clock, &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE);
    assert_has(error->message, "test.conf:3: [lamps test] program: /etc/passwd is not a program");
}

/* Every key of a preset is one of its driver. */
TEST(presets) {
    static const struct {
        const char *name;
        const struct driver_info *info;
    } presets[] = {{"program-axis.conf", &program_axis_driver.info},
                   {"program-camera.conf", &program_camera_driver.info},
                   {"program-lamps.conf", &program_lamps_driver.info}};
    static const char *const also[] = {"driver", NULL};
    for (gsize i = 0; i < G_N_ELEMENTS(presets); i++) {
        const struct driver_info *info = presets[i].info;
        g_autofree char *path = g_build_filename(SOURCE_DIR "/etc/devices", presets[i].name, NULL);
        g_autoptr(Config) config = ok(config_load(path, ERR));
        const struct config_section *section = config_find(config, info->class_name, NULL);
        g_autofree gpointer priv = g_malloc0(info->priv_size);
        g_assert_cmpstr(config_value(section, "driver", NULL), ==, info->name);
        ok(options_parse(info->options, section, also, priv, ERR));
        options_clear(info->options, priv);
    }
}

/* Two sections, or two daemons, do not run the same program. */
TEST(used_twice) {
    TEMPORARY_FOLDER(folder);
    struct bench bench, second = {.folder = folder};
    g_autoptr(GError) error = NULL;
    begin(&bench, folder);
    second.clock = bench.clock;
    g_assert_false(open_bank(&second, "", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    end(&bench);
}

/* Another process switches a lamp on and is killed. */
static pid_t light_up(const char *folder, const char *fault) {
    int ends[2];
    char byte;
    g_assert_cmpint(pipe(ends), ==, 0);
    const pid_t pid = fork();
    g_assert_cmpint(pid, >=, 0);
    if (pid == 0) {
        struct bench bench;
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        begin(&bench, folder);
        set_and_wait(&bench, 1, TRUE);
        program_model_fail(folder, fault);
        if (*fault)
            set(&bench, 2, TRUE);
        conformance_pass(bench.clock, 0.1);
        if (write(ends[1], "+", 1) == 1)
            pause();
        _exit(1);
    }
    close(ends[1]);
    g_assert_cmpint(read(ends[0], &byte, 1), ==, 1);
    close(ends[0]);
    g_assert_cmpint(kill(pid, SIGKILL), ==, 0);
    g_assert_cmpint(waitpid(pid, NULL, 0), ==, pid);
    return pid;
}

/* When this program is killed, the program of the device switches its lamps off and ends. */
TEST(parent_killed) {
    TEMPORARY_FOLDER(folder);
    light_up(folder, "");
    UNTIL (({
        g_autofree char *is = program_model_read(folder, "hardware.json");
        strcmp(is, "{\"on\": [" DARK "]}") == 0;
    }))
        wait_ms(10);
    UNTIL (program_model_processes(folder) == 0)
        wait_ms(10);
}

/* The same with a program that hangs: it is killed, and whoever opens the device next switches the
 * lamps off. */
TEST(parent_killed__sleeps) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    light_up(folder, "sleeps");
    UNTIL (program_model_processes(folder) == 0)
        wait_ms(10);
    assert_hardware(folder, "false, true, false, false");
    program_model_fail(folder, "");
    begin(&bench, folder);
    assert_hardware(folder, DARK);
    end(&bench);
}

static char *model_folder;

/* The examples of contrib/ must do what every driver must do. */
static struct conformance examples[] = {
    {.name = "gpio-lamp.py", .real_clock = TRUE},
    {.name = "gpio-lamp.sh", .real_clock = TRUE},
};

static void add_example(struct conformance *example) {
    g_autofree char *pin = g_build_filename(model_folder, example->name, NULL);
    text_file_write(model_folder, example->name, "0");
    example->section = g_strdup_printf(
        "[lamps test]\ndriver = program-lamps\nprogram = %s\n"
        "arguments = " SOURCE_DIR "/contrib/programs/%s;%s\n",
        g_str_has_suffix(example->name, "py") ? PROGRAM_PYTHON : "/bin/bash", example->name, pin);
    conformance_lamps(&program_lamps_driver, example);
}

/* The pin is the truth. */
static void run_example(gconstpointer data) {
    const struct conformance *example = data;
    const struct config_section *section;
    struct bench bench = {.clock = clock_new_real()};
    g_autoptr(Config) config = conformance_config(example, "", &section);
    bench.bank = ok(lamps_open(&program_lamps_driver, section, NULL, bench.clock, ERR));
    lamps_listen(bench.bank, on_lamp, &bench);
    for (int on = 1; on >= 0; on--) {
        set_and_wait(&bench, 0, on);
        g_autofree char *pin = program_model_read(model_folder, example->name);
        g_assert_cmpstr(g_strstrip(pin), ==, on ? "1" : "0");
    }
    lamps_close(bench.bank);
    clock_unref(bench.clock);
}

static struct conformance model = {
    .name = "program-lamps", .real_clock = TRUE, .fail = program_model_conformance_fail};

BEFORE_TESTS {
    model_folder = remove_tree_begin();
    model.section = program_model_section("lamps", model_folder, 3, "");
    model.fail_data = model_folder;
    conformance_lamps(&program_lamps_driver, &model);
    for (gsize i = 0; i < G_N_ELEMENTS(examples); i++) {
        add_example(&examples[i]);
        g_autofree char *path = g_strdup_printf("/program-lamps/example/%s", examples[i].name);
        g_test_add_data_func(path, &examples[i], run_example);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        g_autofree char *path = g_strdup_printf("/program-lamps/fault/%s", faults[i].name);
        g_test_add_data_func(path, &faults[i], run_fault);
    }
    for (gsize i = 0; i < G_N_ELEMENTS(open_faults); i++) {
        g_autofree char *path = g_strdup_printf("/program-lamps/open/%s", open_faults[i].name);
        g_test_add_data_func(path, &open_faults[i], run_open_fault);
    }
}

AFTER_TESTS {
    g_autofree char *used = program_model_read(model_folder, "hardware.json");
    if (*used) /* not with -p */
        assert_hardware(model_folder, DARK);
    remove_tree_end(&model_folder);
    g_free((gpointer)model.section);
    for (gsize i = 0; i < G_N_ELEMENTS(examples); i++)
        g_free((gpointer)examples[i].section);
}
