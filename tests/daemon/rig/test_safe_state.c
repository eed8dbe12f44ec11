/* Whether the rest of a rig becomes safe when something else has failed: `mesorigd --safe-state`
 * with each device missing, with a wrong section or with its line in use, and the guardian after
 * any end of the daemon. Each device, the laser included, is a virtual one on its own line, and the
 * test reads its true state. */
#include "bus/bus.h"
#include "lib/find_guardian.h"
#include "lib/lines.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/wait.h"

#include <fcntl.h>
#include <gio/gio.h>
#include <glib/gstdio.h>
#include <modbus/modbus.h>
#include <signal.h>
#include <string.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define MESORIGD  BUILD_DIR "/bin/mesorigd"
#define WORLD     SOURCE_DIR "/tests/small/world.conf"
#define FEW_CELLS 29 /* the short form of the matrix takes each 29th cell */
#define STALLS    3
#define STALL_US  (G_USEC_PER_SEC * 46 / 10) /* a little more than a hang takes */
#define ALONE_US  (G_USEC_PER_SEC / 2)       /* the guardian goes on earlier than the daemon */
#define SLACK_US  (G_USEC_PER_SEC * 3 / 2)   /* a machine with more to do than this */

struct fixture {
    char *folder, *rig, *socket;
    struct lines lines;
    GSubprocess *daemon;
    GSubprocess *safe_state; /* between begin_safe_state() and end_safe_state() */
    GPid holder;             /* between hold() and the end of a test_held() */
    GDBusConnection *client;
    char *said;
};

static void set_up(struct fixture *fixture, gconstpointer data) {
    fixture->folder = g_dir_make_tmp("mesorig-safe-XXXXXX", NULL);
    fixture->rig = g_build_filename(fixture->folder, "rig.conf", NULL);
    fixture->socket = g_build_filename(fixture->folder, "bus", NULL);
    lines_open(&fixture->lines, WORLD);
}

static void set_up_serial_laser(struct fixture *fixture, gconstpointer data) {
    set_up(fixture, data);
    virtual_modbus_free(fixture->lines.devices[LASER]);
    fixture->lines.devices[LASER] = lines_new_device(TRUE);
    lines_write(&fixture->lines);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    g_clear_object(&fixture->client);
    if (fixture->daemon) {
        g_subprocess_force_exit(fixture->daemon);
        g_subprocess_wait(fixture->daemon, NULL, NULL);
        g_object_unref(fixture->daemon);
    }
    end_guardian(fixture->rig);
    lines_close(&fixture->lines);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->rig);
    g_free(fixture->socket);
    g_free(fixture->said);
}

static void replace(struct fixture *fixture, const char *what, const char *with) {
    g_assert_cmpuint(g_string_replace(fixture->lines.text, what, with, 0), ==, 1);
}

static void write_rig(struct fixture *fixture) {
    g_assert_true(g_file_set_contents(fixture->rig, fixture->lines.text->str, -1, NULL));
}

static void light_up(struct fixture *fixture) {
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    for (int i = 0; i < LINES_LAMPS; i++)
        virtual_modbus_set_coil(fixture->lines.devices[BANK], i, TRUE);
}

static void write_lit_rig(struct fixture *fixture) {
    write_rig(fixture);
    light_up(fixture);
}

static gboolean is_dark(struct fixture *fixture) {
    return !lines_has_light(fixture->lines.devices[LASER]) &&
           !lines_has_light(fixture->lines.devices[BANK]);
}

static void begin_safe_state(struct fixture *fixture) {
    fixture->safe_state =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_MERGE, NULL,
                      (const char *[]){MESORIGD, "--safe-state", fixture->rig, NULL});
}

/* Its exit code; what it prints is kept. */
static int end_safe_state(struct fixture *fixture) {
    g_autoptr(GSubprocess) process = g_steal_pointer(&fixture->safe_state);
    g_clear_pointer(&fixture->said, g_free);
    ok(g_subprocess_communicate_utf8(process, NULL, NULL, &fixture->said, NULL, ERR));
    g_test_message("%s", fixture->said);
    return g_subprocess_get_if_exited(process) ? g_subprocess_get_exit_status(process) : -1;
}

static int safe_state(struct fixture *fixture) {
    begin_safe_state(fixture);
    return end_safe_state(fixture);
}

static void assert_says_not(struct fixture *fixture, const char *words) {
    if (strstr(fixture->said, words))
        g_error("“%s” is said: %s", words, fixture->said);
}

static void test_well(struct fixture *fixture, gconstpointer data) {
    write_lit_rig(fixture);
    g_assert_cmpint(safe_state(fixture), ==, 0);
    g_assert_true(is_dark(fixture));
    assert_has(fixture->said, "laser top: off, read back\n");
    assert_has(fixture->said, "lamps bank: off, read back\n");
    assert_has(fixture->said, "axis turntable: stands, read back\n");
    assert_has(fixture->said, "axis arc: stands, read back\n");
    assert_has(fixture->said, "axis sweep: stands, read back\n");
    assert_has(fixture->said, "lamps and lasers are off, axes stand\n");
}

/* `mesorigd --safe-state` gives up after five seconds. Such tests have rigs of their own, and run
 * at the same time. */
#define N_TOGETHER 3

struct unsafe {
    void (*begin)(struct fixture *fixture, enum line line);
    void (*check)(struct fixture *fixture, enum line line, int code);
    enum line line;
    gboolean serial_laser;
};

static void run_together(const struct unsafe *tests, int n) {
    for (int first = 0; first < n; first += N_TOGETHER) {
        struct fixture fixtures[N_TOGETHER] = {0};
        const int last = MIN(first + N_TOGETHER, n);
        for (int i = first; i < last; i++) {
            struct fixture *fixture = &fixtures[i - first];
            (tests[i].serial_laser ? set_up_serial_laser : set_up)(fixture, NULL);
            tests[i].begin(fixture, tests[i].line);
            begin_safe_state(fixture);
        }
        for (int i = first; i < last; i++) {
            struct fixture *fixture = &fixtures[i - first];
            tests[i].check(fixture, tests[i].line, end_safe_state(fixture));
        }
        for (int i = first; i < last; i++)
            tear_down(&fixtures[i - first], NULL);
    }
}

static void begin_gone(struct fixture *fixture, enum line gone) {
    /* Not where it was: another test may have a device there by now. */
    g_autofree char *bus =
        g_strdup_printf("bus = %s\n", virtual_modbus_bus(fixture->lines.devices[gone]));
    replace(fixture, bus, lines_is_axis(gone) ? "bus = /dev/gone\n" : "bus = tcp:127.0.0.1:1\n");
    write_lit_rig(fixture);
}

/* What a device's end says of it, and that nothing else is kept from being safe. */
static void check_gone(struct fixture *fixture, enum line gone, int code) {
    static const char *const names[N_DEVICES] = {"laser top",      "lamps bank", "",
                                                 "axis turntable", "axis arc",   "axis sweep"};
    g_autofree char *unsafe = g_strconcat(names[gone], ": NOT safe: ", NULL);
    g_assert_cmpint(code, ==, gone == DOOR ? 0 : 1);
    g_assert_true(gone == LASER || !lines_has_light(fixture->lines.devices[LASER]));
    g_assert_true(gone == BANK || !lines_has_light(fixture->lines.devices[BANK]));
    for (int i = 0; i < N_DEVICES; i++) {
        g_autofree char *good = g_strdup_printf("%s: %s, read back\n", names[i],
                                                lines_is_axis((enum line)i) ? "stands" : "off");
        if (i != (int)gone && i != DOOR)
            assert_has(fixture->said, good);
    }
    if (gone != DOOR) {
        assert_has(fixture->said, unsafe);
        assert_has(fixture->said, "the rig is NOT safe");
        assert_says_not(fixture, "lamps and lasers are off, axes stand");
    }
}

static void test_gone(void) {
    struct unsafe tests[N_DEVICES];
    for (int i = 0; i < N_DEVICES; i++)
        tests[i] = (struct unsafe){begin_gone, check_gone, (enum line)i, FALSE};
    run_together(tests, N_DEVICES);
}

/* Of other devices, and in keys that do not say which device it is. */
static void test_mistakes(struct fixture *fixture, gconstpointer data) {
    static const char *const mistakes[][3] = {
        {"width = 32", "widht = 32", ""},
        {"[camera cam30]", "[camera cam30", "left out: "},
        {"[camera cam30]", "camera cam30]", "left out: "},
        {"response = 6000", "response 6000", "left out: "},
        {"response = 6000", "focal_px = 333", "left out: "},
        {"response = 6000", "response = \xff\x01", "left out: "},
        {"# Für", "# F\xfcr", ""},
        {"clock = real", "clock = virtual", ""},
        {"[rig]", "", "left out: "},
        {"input = 0", "output = 0", ""},
        {"bank = bank", "bank = benk", ""},
        {"[lamps bank]", "[lamp bank]", ""},
        {"[laser top]", "[laser top", "left out: "},
        {"[laser top]", "[lazer top]", ""},
        {"[laser top]", "", "laser lamp30: off, read back"},
        {"theta_deg = 30\ndistance_mm = 480", "", ""},
        {"warm_up_s = 0.1", "warm_up_s = soon", "is not a number"},
        {"sweep = sweep", "sweep = swep", ""},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(mistakes); i++) {
        lines_write(&fixture->lines);
        replace(fixture, mistakes[i][0], mistakes[i][1]);
        write_lit_rig(fixture);
        const int code = safe_state(fixture);
        if (code != 0 || !is_dark(fixture))
            g_error("“%s”: %d, %s", mistakes[i][1], code, fixture->said);
        assert_has(fixture->said, mistakes[i][2]);
    }
}

/* The laser is switched off where its section points, but that may not be where it is. */
static void test_doubts(struct fixture *fixture, gconstpointer data) {
    static const struct {
        const char *what, *with, *words;
        gboolean dark; /* it is where the rest says, all the same */
    } cases[] = {
        {"coil = 3", "coul = 3", "did you mean coil", FALSE},
        {"coil = 3", "coil = three", "is not a whole number", FALSE},
        {"coil = 3", "coil 3", "neither", FALSE},
        {"unit = 1\nsweep", "unity = 1\nsweep", "did you mean unit", TRUE},
        {"driver = modbus-laser", "driver = modbus-lazer", "there is no driver", FALSE},
        {"driver = modbus-laser\n", "", "must be given", FALSE},
        {"[lamps bank]\n", "", "driver: was given before", TRUE},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        lines_write(&fixture->lines);
        replace(fixture, cases[i].what, cases[i].with);
        write_lit_rig(fixture);
        g_assert_cmpint(safe_state(fixture), ==, 1);
        g_assert_true(lines_has_light(fixture->lines.devices[LASER]) != cases[i].dark);
        g_assert_false(lines_has_light(fixture->lines.devices[BANK]));
        assert_has(fixture->said, *cases[i].with ? "laser top: NOT safe: " : ": NOT safe: ");
        assert_has(fixture->said, cases[i].words);
        assert_says_not(fixture, "lamps and lasers are off, axes stand");
    }
}

/* An unknown key next to all that says which coil it is. */
static void test_unknown_key(struct fixture *fixture, gconstpointer data) {
    replace(fixture, "coil = 3", "coil = 3\ncolour = red");
    write_lit_rig(fixture);
    g_assert_cmpint(safe_state(fixture), ==, 0);
    g_assert_true(is_dark(fixture));
    assert_has(fixture->said, "[laser top] colour: there is no such key");
}

static void begin_deaf(struct fixture *fixture, enum line line) {
    const struct virtual_modbus_faults deaf = {.deaf = TRUE};
    write_lit_rig(fixture);
    virtual_modbus_fail(fixture->lines.devices[line], &deaf);
}

static void check_deaf(struct fixture *fixture, enum line line, int code) {
    g_assert_cmpint(code, ==, 1);
    g_assert_false(lines_has_light(fixture->lines.devices[BANK]));
    assert_has(fixture->said, "laser top: NOT safe: ");
    assert_has(fixture->said, "lamps bank: off, read back\n");
}

static gboolean is_held(VirtualModbus *device) {
    const int fd = open(virtual_modbus_bus(device), O_RDWR | O_NOCTTY | O_CLOEXEC);
    g_assert_cmpint(fd, >=, 0);
    const gboolean held = flock(fd, LOCK_EX | LOCK_NB) < 0;
    close(fd);
    return held;
}

/* As by another program that takes the line for itself, for a time. */
static GPid hold(VirtualModbus *device, double seconds) {
    const pid_t pid = fork();
    g_assert_cmpint(pid, >=, 0);
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        const int fd = open(virtual_modbus_bus(device), O_RDWR | O_NOCTTY | O_CLOEXEC);
        /* is_held() takes the lock for an instant. */
        if (fd < 0 || flock(fd, LOCK_EX) < 0)
            _exit(1);
        g_usleep((gulong)(seconds * 1e6));
        _exit(0);
    }
    while (!is_held(device))
        g_usleep(1000);
    return pid;
}

static void begin_held(struct fixture *fixture, enum line which) {
    write_lit_rig(fixture);
    fixture->holder = hold(fixture->lines.devices[which], WAIT_S);
}

static void check_held(struct fixture *fixture, enum line which, int code) {
    const GPid pid = fixture->holder;
    g_assert_cmpint(code, ==, 1);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    g_assert_false(lines_has_light(fixture->lines.devices[BANK]));
    g_assert_true(lines_has_light(fixture->lines.devices[LASER]) == (which == LASER));
    assert_has(fixture->said, which == LASER ? "laser top: NOT safe: " : "axis arc: NOT safe: ");
    g_autofree char *holder = g_strdup_printf("(process %d) uses it", pid);
    assert_has(fixture->said, holder);
    assert_has(fixture->said, "lamps bank: off, read back\n");
}

static void test_held_or_deaf(void) {
    static const struct unsafe tests[] = {{begin_deaf, check_deaf, LASER, FALSE},
                                          {begin_held, check_held, ARC, FALSE},
                                          {begin_held, check_held, LASER, TRUE}};
    run_together(tests, G_N_ELEMENTS(tests));
}

static void test_held_for_a_while(struct fixture *fixture, gconstpointer data) {
    write_lit_rig(fixture);
    const GPid pid = hold(fixture->lines.devices[LASER], 2);
    g_assert_cmpint(safe_state(fixture), ==, 0);
    waitpid(pid, NULL, 0);
    g_assert_true(is_dark(fixture));
}

/* Set off by a daemon that has died since; 90° take it 45 s. */
static void start_axis(VirtualModbus *device) {
    const guint16 target[] = {0, 9000};
    modbus_t *line = modbus_new_rtu(virtual_modbus_bus(device), 115200, 'N', 8, 1);
    modbus_set_slave(line, 1);
    g_assert_cmpint(modbus_connect(line), ==, 0);
    g_assert_cmpint(modbus_write_registers(line, 0, 2, target), ==, 2);
    g_assert_cmpint(modbus_write_register(line, 2, 1), ==, 1);
    modbus_close(line);
    modbus_free(line);
}

static void test_moving(struct fixture *fixture, gconstpointer data) {
    struct virtual_modbus_state state;
    write_rig(fixture);
    start_axis(fixture->lines.devices[ARC]);
    virtual_modbus_state(fixture->lines.devices[ARC], &state);
    g_assert_true(state.moving);
    g_assert_cmpint(safe_state(fixture), ==, 0);
    virtual_modbus_state(fixture->lines.devices[ARC], &state);
    g_assert_false(state.moving);
    g_assert_cmpfloat(state.position_steps, <, 8000);
    assert_has(fixture->said, "axis arc: stands, read back\n");
}

static void test_no_file(struct fixture *fixture, gconstpointer data) {
    g_assert_cmpint(safe_state(fixture), ==, 1);
    assert_has(fixture->said, "NOT safe: ");
    g_assert_true(g_file_set_contents(fixture->rig, "[camera c]\ndriver = v4l2\n", -1, NULL));
    g_assert_cmpint(safe_state(fixture), ==, 1);
    assert_has(fixture->said, "names no laser, no lamps and no axis");
}

static void run_daemon(struct fixture *fixture) {
    g_autofree char *address = g_strdup_printf("unix:path=%s", fixture->socket);
    g_autofree char *log = g_build_filename(fixture->folder, "log", NULL);
    g_unlink(fixture->socket);
    /* What the guardian prints of each device is for the log as well. */
    fixture->daemon =
        process_start(G_SUBPROCESS_FLAGS_NONE, log,
                      (const char *[]){"/bin/sh", "-c", "exec \"$@\" >&2", "sh", MESORIGD,
                                       "--listen", address, "--rig", fixture->rig, NULL});
}

static void read_log(struct fixture *fixture) {
    g_autofree char *log = g_build_filename(fixture->folder, "log", NULL);
    g_clear_pointer(&fixture->said, g_free);
    g_assert_true(g_file_get_contents(log, &fixture->said, NULL, NULL));
}

static void start_daemon(struct fixture *fixture) {
    write_rig(fixture);
    run_daemon(fixture);
    UNTIL (g_file_test(fixture->socket, G_FILE_TEST_EXISTS)) {
        g_main_context_iteration(NULL, FALSE);
        read_log(fixture);
        if (!g_subprocess_get_identifier(fixture->daemon))
            g_error("the daemon has ended: %s", fixture->said);
        g_usleep(10000);
    }
    g_assert_cmpint(find_guardian(fixture->rig), !=, 0);
}

/* The daemon or the guardian says it in the end. */
static void wait_said(struct fixture *fixture, const char *words) {
    read_log(fixture);
    UNTIL (strstr(fixture->said, words)) {
        g_usleep(20000);
        read_log(fixture);
    }
}

static gint64 wait_for_dark(struct fixture *fixture) {
    const gint64 began = g_get_monotonic_time();
    UNTIL (is_dark(fixture))
        g_usleep(2000);
    return g_get_monotonic_time() - began;
}

static void wait_for_guardian_end(struct fixture *fixture) {
    UNTIL (!find_guardian(fixture->rig))
        g_usleep(10000);
}

/* A daemon that has ended is noticed by that, and only one that hangs by its silence. */
static void check_cause(struct fixture *fixture, gboolean hangs) {
    static const char silent[] = "no heartbeat from the daemon for 4.5 s: killing it";
    read_log(fixture);
    assert_has(fixture->said,
               "the daemon has ended and has not reported that it left the rig safe");
    if (hangs)
        assert_has(fixture->said, silent);
    else
        assert_says_not(fixture, "no heartbeat");
}

/* Only the whole matrix, which has the computer for itself, asserts how long it takes. */
static void check_time(gint64 took_us, int max_s) {
    if (g_getenv("MESORIG_MATRIX"))
        g_assert_cmpint(took_us, <, max_s * G_USEC_PER_SEC + SLACK_US);
}

static void test_death(struct fixture *fixture, gconstpointer data) {
    const int how = GPOINTER_TO_INT(data);
    start_daemon(fixture);
    light_up(fixture);
    g_subprocess_send_signal(fixture->daemon, how);
    const gint64 took_us = wait_for_dark(fixture);
    g_test_message("dark after %.3f s", (double)took_us / 1e6);
    check_time(took_us, how == SIGSTOP ? 5 : 1);
    g_assert_true(how != SIGSTOP || took_us > 2 * G_USEC_PER_SEC); /* not at the first silence */
    wait_for_guardian_end(fixture);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    g_assert_true(g_subprocess_get_if_signaled(fixture->daemon));
    check_cause(fixture, how == SIGSTOP);
    assert_says_not(fixture, "NOT safe");
}

/* With a device gone at the same time, and with signals to all of the daemon's group. */
static void test_death_and_gone(struct fixture *fixture, gconstpointer data) {
    const enum line gone = (enum line)GPOINTER_TO_INT(data);
    start_daemon(fixture);
    light_up(fixture);
    g_clear_pointer(&fixture->lines.devices[gone], virtual_modbus_free);
    kill(find_guardian(fixture->rig), SIGTERM);
    g_subprocess_send_signal(fixture->daemon, SIGKILL);
    const gint64 took_us = wait_for_dark(fixture);
    g_test_message("dark after %.3f s", (double)took_us / 1e6);
    check_time(took_us, 1);
    check_cause(fixture, FALSE);
    if (gone == DOOR)
        wait_for_guardian_end(fixture);
    else
        wait_said(fixture, "is still trying");
}

/* Stops guardian and daemon STALLS times, and lets the guardian go on first. Returns the longest
 * time for which only the daemon was stopped, which is longer on a busy computer. */
static gint64 stall(struct fixture *fixture, pid_t guardian) {
    gint64 longest_us = 0;
    for (int i = 0; i < STALLS; i++) {
        g_subprocess_send_signal(fixture->daemon, SIGSTOP);
        kill(guardian, SIGSTOP);
        g_usleep(STALL_US);
        const gint64 alone_us = g_get_monotonic_time();
        kill(guardian, SIGCONT);
        g_usleep(ALONE_US);
        g_subprocess_send_signal(fixture->daemon, SIGCONT);
        longest_us = MAX(longest_us, g_get_monotonic_time() - alone_us);
        g_usleep(G_USEC_PER_SEC * 3 / 2);
    }
    return longest_us;
}

/* A computer that stands still for a while holds guardian and daemon up alike. */
static void test_stalled(struct fixture *fixture, gconstpointer data) {
    pid_t guardian = 0;
    gboolean alike = FALSE;
    UNTIL (alike) {
        if (guardian !=
            0) { /* the daemon may have been stopped alone for long enough to be killed */
            tear_down(fixture, NULL);
            *fixture = (struct fixture){0};
            set_up(fixture, NULL);
        }
        start_daemon(fixture);
        guardian = find_guardian(fixture->rig);
        alike = stall(fixture, guardian) < 4 * ALONE_US;
    }
    read_log(fixture);
    assert_says_not(fixture, "no heartbeat");
    g_assert_nonnull(g_subprocess_get_identifier(fixture->daemon));
    g_assert_cmpint(find_guardian(fixture->rig), ==, guardian);
    light_up(fixture);
    g_subprocess_send_signal(fixture->daemon, SIGSTOP); /* and a hang is one still */
    check_time(wait_for_dark(fixture), 5);
    wait_for_guardian_end(fixture);
    check_cause(fixture, TRUE);
}

/* Ends of daemon and guardian. In the last one both live on. */
enum end {
    KILLED,
    ABORTED,
    STOPPED,
    GUARDIAN_FIRST,  /* the guardian is killed, and then the daemon */
    GUARDIAN_TWICE,  /* two guardians within 10 s, and then the daemon */
    GUARDIAN_FROZEN, /* the guardian is stopped, and the daemon is killed when it has another one */
    ALIVE,
    N_ENDS
};
static const char *const end_names[N_ENDS] = {"kill -9",        "SIGABRT",        "SIGSTOP",
                                              "guardian first", "guardian twice", "guardian frozen",
                                              "alive"};
static const int end_signals[N_ENDS] = {SIGKILL, SIGABRT, SIGSTOP, SIGKILL, SIGKILL, SIGKILL, 0};

/* Only a command that the daemon gives can be lost: without LOST nothing fails that lives on. */
static gboolean is_cell(enum end end, enum line_failure failure) {
    return end != ALIVE || failure == LOST;
}

/* Ends the guardian, and waits until the daemon has started another one. */
static void end_one_guardian(struct fixture *fixture, int how) {
    const pid_t first = find_guardian(fixture->rig);
    pid_t now = first;
    g_assert_cmpint(first, !=, 0);
    kill(first, how);
    UNTIL (now != first && now != 0) {
        g_usleep(5000);
        now = find_guardian(fixture->rig);
    }
}

static void end_guardians(struct fixture *fixture, enum end end) {
    if (end == GUARDIAN_FIRST || end == GUARDIAN_TWICE)
        end_one_guardian(fixture, SIGKILL);
    if (end == GUARDIAN_TWICE)
        end_one_guardian(fixture, SIGKILL);
    if (end == GUARDIAN_FROZEN)
        end_one_guardian(fixture, SIGSTOP);
}

/* Through the bus, by a client that stays. */
static void ask_for_light(struct fixture *fixture, enum line which) {
    g_autofree char *address = g_strdup_printf("unix:path=%s", fixture->socket);
    /* The socket exists shortly before the daemon listens to it. */
    UNTIL ((fixture->client = g_dbus_connection_new_for_address_sync(
                address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, NULL)))
        g_usleep(2000);
    g_dbus_connection_call(fixture->client, NULL, BUS_PATH, BUS_NAME,
                           which == LASER ? "SetLaser" : "SetLamp",
                           g_variant_new("(sbd)", which == LASER ? "top" : "lamp30", TRUE, 60.0),
                           NULL, G_DBUS_CALL_FLAGS_NONE, -1, NULL, NULL, NULL);
}

/* The device carries out the command and then says nothing. */
static void lose_answer(struct fixture *fixture, enum line which) {
    ask_for_light(fixture, which);
    UNTIL (lines_usable_us(&fixture->lines, which) != 0)
        g_usleep(2000);
    g_assert_true(lines_has_light(fixture->lines.devices[which]));
}

/* Returns when the light of the device is off. */
static gint64 wait_for_one(struct fixture *fixture, enum line which) {
    UNTIL (!lines_has_light(fixture->lines.devices[which]))
        g_usleep(2000);
    return g_get_monotonic_time();
}

static void check_log(struct fixture *fixture, enum line which) {
    read_log(fixture);
    for (int i = 0; i < N_DEVICES; i++) {
        g_autofree char *good = g_strdup_printf("%s: %s, read back\n", lines_names[i],
                                                lines_is_axis((enum line)i) ? "stands" : "off");
        if (i != (int)which && i != DOOR)
            assert_has(fixture->said, good);
    }
}

/* The failed device is named, and nothing is called safe that was not read back. The guardian goes
 * on until the line works again. Returns when that is. */
static gint64 check_failed(struct fixture *fixture, enum line which, enum line_failure failure) {
    g_autofree char *unsafe = g_strconcat(lines_names[which], ": NOT safe: ", NULL);
    wait_said(fixture, "is still trying");
    assert_has(fixture->said, unsafe);
    assert_has(fixture->said, "the rig is NOT safe");
    assert_says_not(fixture, "lamps and lasers are off, axes stand");
    g_assert_cmpint(find_guardian(fixture->rig), !=, 0);
    const gint64 usable_us = g_get_monotonic_time();
    if (failure != GONE)
        lines_repair(&fixture->lines, which);
    return usable_us;
}

/* One end, one device, one failure of it: all other lights go off in time, and that of the device
 * within a second of the time at which its line is usable. */
static void check_cell(struct fixture *fixture, enum end end, enum line which,
                       enum line_failure failure) {
    gint64 took_us = 0, late_us = 0;
    start_daemon(fixture);
    end_guardians(fixture, end);
    if (end != ALIVE)
        light_up(fixture);
    lines_fail(&fixture->lines, which, failure);
    if (failure == LOST)
        lose_answer(fixture, which);
    const gint64 began_us = g_get_monotonic_time();
    if (end != ALIVE)
        g_subprocess_send_signal(fixture->daemon, end_signals[end]);
    for (int i = LASER; i <= BANK; i++)
        if (i != (int)which)
            took_us = MAX(took_us, wait_for_one(fixture, (enum line)i) - began_us);
    if (failure == LOST) {
        const gint64 hung_us = began_us + (end == STOPPED ? 5 * G_USEC_PER_SEC : 0);
        const gint64 usable_us = lines_usable_us(&fixture->lines, which);
        late_us = wait_for_one(fixture, which) - MAX(usable_us, hung_us);
    } else if (which != DOOR) {
        const gint64 usable_us = check_failed(fixture, which, failure);
        if (which <= BANK && failure != GONE)
            late_us = wait_for_one(fixture, which) - usable_us;
    }
    if (end == ALIVE) {
        wait_said(fixture, "confirmed off again");
        g_subprocess_send_signal(fixture->daemon, SIGTERM);
    } else if (failure != GONE || which == DOOR) {
        wait_said(fixture, "lamps and lasers are off, axes stand");
        wait_for_guardian_end(fixture);
    }
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    if (end != ALIVE) {
        check_log(fixture, which);
        check_cause(fixture, end == STOPPED);
    }
    g_test_message(
        "%s %s, %s: the other lights are off after %.2f s, its own %.2f s after its line "
        "is usable",
        lines_names[which], lines_failures[failure], end_names[end], (double)took_us / 1e6,
        (double)late_us / 1e6);
    check_time(took_us, end == STOPPED ? 5 : 1);
    check_time(late_us, 1);
}

static void run_cell(enum end end, enum line which, enum line_failure failure) {
    struct fixture fixture = {0};
    set_up(&fixture, NULL);
    check_cell(&fixture, end, which, failure);
    tear_down(&fixture, NULL);
}

/* Every device, every failure of it, every end; without MESORIG_MATRIX in the environment four of
 * these cells. */
static void test_matrix(void) {
    const gboolean all = g_getenv("MESORIG_MATRIX") != NULL;
    int cells = 0, run = 0;
    for (int end = 0; end < N_ENDS; end++)
        for (int which = 0; which < N_DEVICES; which++)
            for (int how = 0; how < lines_n_failures((enum line)which); how++) {
                if (!is_cell((enum end)end, (enum line_failure)how) ||
                    (cells++ % FEW_CELLS != 0 && !all))
                    continue;
                run_cell((enum end)end, (enum line)which, (enum line_failure)how);
                run++;
            }
    g_test_message("%d of %d cells", run, cells);
}

/* The laser's "on" is carried out, its answer lost, and its line dead for 5 s: by the guardian if
 * the daemon is killed meanwhile, and by the daemon if it lives. */
static void test_answer_lost(gconstpointer data) {
    run_cell((enum end)GPOINTER_TO_INT(data), LASER, LOST);
}

static void test_normal_end(struct fixture *fixture, gconstpointer data) {
    start_daemon(fixture);
    light_up(fixture);
    g_subprocess_send_signal(fixture->daemon, SIGTERM);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(fixture->daemon), ==, 0);
    g_assert_true(is_dark(fixture));
    wait_for_guardian_end(fixture);
    read_log(fixture);
    assert_has(fixture->said, "mesorigd: the rig is safe\n");
    assert_says_not(fixture, "** ");
    assert_says_not(fixture, "guardian");
    g_autofree char *ready =
        g_strdup_printf("mesorigd: ready: the rig %s is open; listening at ", fixture->rig);
    assert_has(fixture->said, ready);
}

/* The laser does not listen any more when the daemon is asked to end. */
static void test_end_not_safe(struct fixture *fixture, gconstpointer data) {
    const struct virtual_modbus_faults deaf = {.deaf = TRUE}, none = {0};
    start_daemon(fixture);
    light_up(fixture);
    virtual_modbus_fail(fixture->lines.devices[LASER], &deaf);
    g_subprocess_send_signal(fixture->daemon, SIGTERM);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(fixture->daemon), ==, 1);
    read_log(fixture);
    assert_has(fixture->said, "the rig is NOT safe: ");
    assert_says_not(fixture, "the rig is safe");
    virtual_modbus_fail(fixture->lines.devices[LASER], &none);
    wait_for_dark(fixture); /* by the guardian, which was not told to go */
    wait_for_guardian_end(fixture);
}

/* A rig is not closed while a device does not confirm: the bus goes on showing what may shine. */
static void test_close_not_safe(struct fixture *fixture, gconstpointer data) {
    const struct virtual_modbus_faults deaf = {.deaf = TRUE}, none = {0};
    g_autofree char *address = g_strdup_printf("unix:path=%s", fixture->socket);
    g_autoptr(GError) error = NULL;
    start_daemon(fixture);
    light_up(fixture);
    /* The socket exists shortly before the daemon listens to it. */
    UNTIL ((fixture->client = g_dbus_connection_new_for_address_sync(
                address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, NULL)))
        g_usleep(2000);
    virtual_modbus_fail(fixture->lines.devices[LASER], &deaf);
    g_assert_null(g_dbus_connection_call_sync(fixture->client, NULL, BUS_PATH, BUS_NAME, "CloseRig",
                                              NULL, NULL, G_DBUS_CALL_FLAGS_NONE, -1, NULL,
                                              &error));
    assert_has(error->message, "org.mesorig.Error.Busy");
    assert_has(error->message, "the rig stays open");
    assert_has(error->message, "laser top");
    g_autoptr(GVariant) answer = g_dbus_connection_call_sync(
        fixture->client, NULL, BUS_PATH, "org.freedesktop.DBus.Properties", "Get",
        g_variant_new("(ss)", BUS_NAME, "Unsafe"), NULL, G_DBUS_CALL_FLAGS_NONE, -1, NULL, NULL);
    g_autofree char *unsafe = g_variant_print(answer, FALSE);
    assert_has(unsafe, "laser top");
    virtual_modbus_fail(fixture->lines.devices[LASER], &none);
    wait_for_dark(fixture);
    for (gboolean closed = FALSE; !closed; g_usleep(50 * 1000)) {
        g_autoptr(GVariant) done =
            g_dbus_connection_call_sync(fixture->client, NULL, BUS_PATH, BUS_NAME, "CloseRig", NULL,
                                        NULL, G_DBUS_CALL_FLAGS_NONE, -1, NULL, NULL);
        closed = done != NULL;
    }
    wait_for_guardian_end(fixture);
}

/* The daemon is stopped while it ends, and a device does not answer: its guardian does not wait. */
static void test_stopped_at_its_end(struct fixture *fixture, gconstpointer data) {
    write_rig(fixture);
    start_daemon(fixture);
    light_up(fixture);
    lines_fail(&fixture->lines, LASER, SILENT);
    g_subprocess_send_signal(fixture->daemon, SIGTERM);
    wait_said(fixture, "NOT safe");
    g_subprocess_send_signal(fixture->daemon, SIGSTOP);
    lines_repair(&fixture->lines, LASER);
    wait_for_dark(fixture);
    wait_for_guardian_end(fixture);
}

/* The rig cannot be opened, because the laser, which shines, does not answer: the guardian switches
 * all else off, and the laser as soon as it can. */
static void test_not_opened(struct fixture *fixture, gconstpointer data) {
    write_lit_rig(fixture);
    lines_fail(&fixture->lines, LASER, SILENT);
    run_daemon(fixture);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(fixture->daemon), ==, 1);
    wait_for_one(fixture, BANK);
    wait_said(fixture, "laser top: NOT safe: ");
    lines_repair(&fixture->lines, LASER);
    wait_for_one(fixture, LASER);
    wait_for_guardian_end(fixture);
    read_log(fixture);
    assert_has(fixture->said, "laser top: off, read back\n");
    assert_says_not(fixture, "lamps bank"); /* which was never unsafe */
}

/* A service that starts again while a device does not answer: the new daemon does not open the rig,
 * its guardian takes the work over from the first one, and there is one guardian all the time. */
static void test_started_again(struct fixture *fixture, gconstpointer data) {
    start_daemon(fixture);
    light_up(fixture);
    lines_fail(&fixture->lines, LASER, SILENT);
    g_subprocess_send_signal(fixture->daemon, SIGKILL);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    wait_said(fixture, "is still trying");
    const pid_t first = find_guardian(fixture->rig);
    g_clear_object(&fixture->daemon);
    run_daemon(fixture);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(fixture->daemon), ==, 1);
    read_log(fixture);
    assert_has(fixture->said, "it has not been safe since an earlier mesorigd ended");
    const pid_t second = find_guardian(fixture->rig);
    g_assert_cmpint(second, !=, 0);
    g_assert_cmpint(second, !=, first);
    g_assert_cmpint(kill(first, 0), !=, 0);
    lines_repair(&fixture->lines, LASER);
    wait_for_dark(fixture);
    wait_for_guardian_end(fixture);
    g_clear_object(&fixture->daemon);
    start_daemon(fixture);
}

/* Returns the only child of the guardian that does not wait for its parent to notice its end, or 0
 * if it has none or several. */
static pid_t find_line_process(const struct fixture *fixture) {
    const pid_t guardian = find_guardian(fixture->rig);
    g_autofree char *path = g_strdup_printf("/proc/%d/task/%d/children", guardian, guardian);
    g_autofree char *text = NULL;
    if (guardian == 0 || !g_file_get_contents(path, &text, NULL, NULL))
        return 0;
    g_auto(GStrv) children = g_strsplit(g_strstrip(text), " ", -1);
    const pid_t child = (pid_t)g_ascii_strtoll(children[0] ? children[0] : "0", NULL, 10);
    g_autofree char *status = g_strdup_printf("/proc/%d/status", child);
    g_autofree char *state = NULL;
    if (g_strv_length(children) != 1 || !g_file_get_contents(status, &state, NULL, NULL) ||
        strstr(state, "State:\tZ"))
        return 0;
    return child;
}

static void on_printed(GObject *process, GAsyncResult *result, gpointer data) {
    struct fixture *fixture = data;
    ok(g_subprocess_communicate_utf8_finish(G_SUBPROCESS(process), result, &fixture->said, NULL,
                                            ERR));
}

/* ExecStopPost leaves a guardian to what is not safe. The guardian and its processes let the pipe
 * go, at which this program waits, while they go on: the laser's process is not a new one. */
static void test_service(struct fixture *fixture, gconstpointer data) {
    pid_t last = 0;
    write_lit_rig(fixture);
    lines_fail(&fixture->lines, LASER, SILENT);
    g_setenv("SERVICE_RESULT", "signal", TRUE);
    g_autoptr(GSubprocess) process =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_PIPE | G_SUBPROCESS_FLAGS_STDERR_MERGE, NULL,
                      (const char *[]){MESORIGD, "--safe-state", fixture->rig, NULL});
    g_unsetenv("SERVICE_RESULT");
    g_subprocess_communicate_utf8_async(process, NULL, NULL, on_printed, fixture);
    UNTIL (fixture->said) {
        const pid_t child = find_line_process(fixture);
        last = child ? child : last;
        g_main_context_iteration(NULL, FALSE);
        g_usleep(10000);
    }
    g_subprocess_wait(process, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(process), ==, 1);
    g_assert_false(lines_has_light(fixture->lines.devices[BANK]));
    assert_has(fixture->said, "is still trying");
    g_assert_cmpint(last, !=, 0);
    g_assert_cmpint(find_line_process(fixture), ==, last);
    lines_repair(&fixture->lines, LASER);
    wait_for_dark(fixture);
    wait_for_guardian_end(fixture);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
#define ADD(path, func, data)                                                                      \
    g_test_add(path, struct fixture, GINT_TO_POINTER(data), set_up, func, tear_down)
    ADD("/safe-state/well", test_well, 0);
    g_test_add_func("/safe-state/gone", test_gone);
    ADD("/safe-state/mistakes", test_mistakes, 0);
    ADD("/safe-state/doubts", test_doubts, 0);
    ADD("/safe-state/unknown-key", test_unknown_key, 0);
    g_test_add_func("/safe-state/held-or-deaf", test_held_or_deaf);
    g_test_add("/safe-state/laser-held-for-a-while", struct fixture, NULL, set_up_serial_laser,
               test_held_for_a_while, tear_down);
    ADD("/safe-state/moving", test_moving, 0);
    ADD("/safe-state/no-file", test_no_file, 0);
    ADD("/safe-state/service", test_service, 0);
    ADD("/guardian/killed", test_death, SIGKILL);
    ADD("/guardian/aborted", test_death, SIGABRT);
    ADD("/guardian/hung", test_death, SIGSTOP);
    ADD("/guardian/killed-interlock-gone", test_death_and_gone, DOOR);
    ADD("/guardian/killed-axis-gone", test_death_and_gone, TURNTABLE);
    ADD("/guardian/stalled", test_stalled, 0);
    g_test_add_func("/guardian/matrix", test_matrix);
    ADD("/guardian/normal-end", test_normal_end, 0);
    ADD("/guardian/end-not-safe", test_end_not_safe, 0);
    ADD("/guardian/close-not-safe", test_close_not_safe, 0);
    ADD("/guardian/stopped-at-its-end", test_stopped_at_its_end, 0);
    ADD("/guardian/not-opened", test_not_opened, 0);
    ADD("/guardian/started-again", test_started_again, 0);
    g_test_add_data_func("/guardian/answer-lost", GINT_TO_POINTER(KILLED), test_answer_lost);
    g_test_add_data_func("/guardian/answer-lost-alive", GINT_TO_POINTER(ALIVE), test_answer_lost);
    return g_test_run();
}
