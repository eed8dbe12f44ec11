/* Every end of the service's daemon, with every device failing at that moment in every way, under
 * systemd and in the sandbox of the unit: lights go off and axes stand. For the container of
 * tests/nspawn/run, as its root. Without MESORIG_MATRIX in the environment: two cells. */
#include "bus/bus.h"
#include "lib/find_guardian.h"
#include "lib/lines.h"
#include "lib/process.h"
#include "lib/wait.h"

#include <gio/gio.h>
#include <pwd.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define RIG      "/etc/mesorig/rig.conf"
#define WORLD    "/etc/mesorig/world.conf"
#define FAR_DEG  80.0                     /* 40 s from home */
#define SLACK_US (G_USEC_PER_SEC * 3 / 2) /* a machine with more to do than this */
#define SAFE     "lamps and lasers are off, axes stand"

enum end {
    KILLED,
    ABORTED,
    STOPPED,
    BOTH,            /* daemon and guardian are killed together: ExecStopPost remains */
    GUARDIAN_FIRST,  /* the guardian is killed, and then the daemon */
    GUARDIAN_TWICE,  /* two guardians within 10 s, and then the daemon */
    GUARDIAN_FROZEN, /* the guardian is stopped, and the daemon killed: ExecStopPost remains */
    ALIVE,           /* neither */
    N_ENDS
};
static const char *const end_names[N_ENDS] = {"kill -9",
                                              "SIGABRT",
                                              "SIGSTOP",
                                              "kill -9 of daemon and guardian",
                                              "guardian killed first",
                                              "guardian killed twice",
                                              "guardian frozen",
                                              "alive"};
static const int end_signals[N_ENDS] = {SIGKILL, SIGABRT, SIGSTOP, SIGKILL,
                                        SIGKILL, SIGKILL, SIGKILL, 0};

struct cell {
    enum end end;
    enum line line;
    enum line_failure failure;
    double dark_s, stand_s; /* after the end, of all devices but the failed one */
    double late_s;          /* after its line was usable again, of the failed one */
};

static char *run_line(const char *line) {
    g_auto(GStrv) argv = g_strsplit(line, " ", -1);
    char *text = process_text(0, (const char *const *)argv);
    return g_strchomp(text);
}

static void order(const char *line) {
    g_free(run_line(line));
}

static void assert_is(const char *line, const char *wanted) {
    g_autofree char *text = run_line(line);
    if (strcmp(text, wanted) != 0)
        g_error("%s: “%s” instead of “%s”", line, text, wanted);
}

static void assert_sandboxed(pid_t pid) {
    g_autofree char *path = g_strdup_printf("/proc/%d/status", (int)pid);
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    assert_has(text, "NoNewPrivs:\t1\n");
    assert_has(text, "Seccomp:\t2\n");
    assert_has(text, "CapEff:\t0000000000000000\n");
}

static void call(GDBusConnection *bus, const char *method, GVariant *parameters) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) answer =
        g_dbus_connection_call_sync(bus, BUS_NAME, BUS_PATH, BUS_NAME, method, parameters, NULL,
                                    G_DBUS_CALL_FLAGS_NONE, WAIT_S * 1000, NULL, &error);
    g_assert_no_error(error);
}

static gboolean all_move(const struct lines *lines) {
    gboolean all = TRUE;
    for (int i = TURNTABLE; i <= SWEEP; i++) {
        struct virtual_modbus_state state;
        virtual_modbus_state(lines->devices[i], &state);
        all &= state.moving;
    }
    return all;
}

/* Of all devices but the one that has failed. */
static gboolean is_dark_but(const struct lines *lines, enum line failed) {
    gboolean dark = TRUE;
    for (int i = LASER; i <= BANK; i++)
        dark &= i == (int)failed || !lines_has_light(lines->devices[i]);
    return dark;
}

static gboolean stands_but(const struct lines *lines, enum line failed) {
    gboolean stands = TRUE;
    for (int i = TURNTABLE; i <= SWEEP; i++) {
        struct virtual_modbus_state state = {0};
        if (i != (int)failed)
            virtual_modbus_state(lines->devices[i], &state);
        stands &= !state.moving;
    }
    return stands;
}

/* Whose answer to the command that switches it on is lost. */
static void light_up(struct lines *lines, GDBusConnection *bus, enum line line, gboolean lost) {
    const char *method = line == LASER ? "SetLaser" : "SetLamp";
    GVariant *parameters = g_variant_new("(sbd)", line == LASER ? "top" : "lamp30", TRUE, 60.0);
    if (!lost) {
        call(bus, method, parameters);
        return;
    }
    lines_fail(lines, line, LOST);
    g_dbus_connection_call(bus, BUS_NAME, BUS_PATH, BUS_NAME, method, parameters, NULL,
                           G_DBUS_CALL_FLAGS_NONE, -1, NULL, NULL, NULL);
    UNTIL (lines_usable_us(lines, line) != 0)
        g_usleep(2000);
}

/* A rig in which everything shines and moves, by the daemon's own doing. Returns the daemon. The
 * line that loses an answer comes last: the daemon makes the whole rig safe when it hears nothing.
 */
static pid_t start_service(struct lines *lines, GDBusConnection *bus, const struct cell *cell) {
    static const char *const axes[] = {"turntable", "arc", "sweep"};
    const struct passwd *user = getpwnam("mesorig");
    g_assert_nonnull(user);
    for (int i = 0; i < N_DEVICES; i++)
        if (lines_is_axis((enum line)i))
            g_assert_cmpint(chown(virtual_modbus_bus(lines->devices[i]), user->pw_uid, (gid_t)-1),
                            ==, 0);
    g_assert_true(g_file_set_contents_full(RIG, lines->text->str, -1,
                                           G_FILE_SET_CONTENTS_CONSISTENT, 0644, NULL));
    /* Its starts are counted. A unit that systemd does not have in memory has no count. */
    const char *const reset[] = {"systemctl", "--quiet", "reset-failed", "mesorigd", NULL};
    g_autofree char *refused = NULL;
    process_run(reset, NULL, &refused);
    order("systemctl start mesorigd");
    assert_is("systemctl show mesorigd -P WatchdogUSec", "30s");
    g_autofree char *main_pid = run_line("systemctl show mesorigd -P MainPID");
    const pid_t daemon = (pid_t)g_ascii_strtoll(main_pid, NULL, 10);
    const pid_t guardian = find_guardian(RIG);
    g_assert_cmpint(daemon, >, 0);
    g_assert_cmpint(guardian, >, 0);
    assert_sandboxed(daemon);
    assert_sandboxed(guardian);
    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++)
        call(bus, "HomeAxis", g_variant_new("(s)", axes[i]));
    for (int i = LASER; i <= BANK; i++)
        if (cell->failure != LOST || i != (int)cell->line)
            light_up(lines, bus, (enum line)i, FALSE);
    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++)
        g_dbus_connection_call(bus, BUS_NAME, BUS_PATH, BUS_NAME, "MoveAxis",
                               g_variant_new("(sd)", axes[i], FAR_DEG), NULL,
                               G_DBUS_CALL_FLAGS_NONE, -1, NULL, NULL, NULL);
    UNTIL (all_move(lines))
        g_usleep(2000);
    if (cell->failure == LOST)
        light_up(lines, bus, cell->line, TRUE);
    g_assert_true(lines_has_light(lines->devices[LASER]));
    g_assert_true(lines_has_light(lines->devices[BANK]));
    return daemon;
}

static void wait_safe(const struct lines *lines, struct cell *cell) {
    const gint64 began_us = g_get_monotonic_time();
    cell->dark_s = cell->stand_s = -1;
    UNTIL (cell->dark_s >= 0 && cell->stand_s >= 0) {
        const gint64 took_us = g_get_monotonic_time() - began_us;
        if (cell->dark_s < 0 && is_dark_but(lines, cell->line))
            cell->dark_s = (double)took_us / 1e6;
        if (cell->stand_s < 0 && stands_but(lines, cell->line))
            cell->stand_s = (double)took_us / 1e6;
        g_usleep(2000);
    }
}

/* ExecStopPost has ended then, and the next start has not begun. */
static void wait_for_unit(void) {
    g_autofree char *state = NULL;
    UNTIL (g_strcmp0(state, "auto-restart") == 0) {
        g_usleep(50000);
        g_free(state);
        state = run_line("systemctl show mesorigd -P SubState");
    }
}

static int count(const char *text, const char *words) {
    int n = 0;
    for (const char *at = text; (at = strstr(at, words)); at += strlen(words))
        n++;
    return n;
}

/* Ends the guardian, and waits until the daemon has started another one. */
static void end_one_guardian(void) {
    const pid_t first = find_guardian(RIG);
    pid_t now = first;
    g_assert_cmpint(first, >, 0);
    kill(first, SIGKILL);
    UNTIL (now != first && now != 0) {
        g_usleep(5000);
        now = find_guardian(RIG);
    }
}

static void end_guardians(enum end end) {
    if (end == BOTH)
        kill(find_guardian(RIG), SIGKILL);
    if (end == GUARDIAN_FIRST || end == GUARDIAN_TWICE)
        end_one_guardian();
    if (end == GUARDIAN_TWICE)
        end_one_guardian();
    if (end == GUARDIAN_FROZEN)
        kill(find_guardian(RIG), SIGSTOP);
}

static char *read_journal(const char *mark) {
    order("journalctl --sync");
    const char *const journal[] = {"journalctl",     "--quiet",          "--no-pager",
                                   "--output=cat",   "--unit",           "mesorigd",
                                   "--after-cursor", strstr(mark, "s="), NULL};
    return process_text(0, journal);
}

/* The guardian and ExecStopPost each tell of every device what they have read back. */
static void check_journal(const struct cell *cell, const char *said) {
    const int reports = cell->end == BOTH || cell->end == GUARDIAN_FROZEN ? 1 : 2;
    const gboolean fails = cell->line != DOOR && cell->failure != LOST;
    for (int i = 0; i < N_DEVICES; i++) {
        g_autofree char *safe = g_strdup_printf("%s: %s, read back\n", lines_names[i],
                                                lines_is_axis((enum line)i) ? "stands" : "off");
        g_autofree char *unsafe = g_strconcat(lines_names[i], ": NOT safe: ", NULL);
        const gboolean failed = fails && i == (int)cell->line;
        const int n = count(said, failed ? unsafe : safe);
        /* ExecStopPost has left a guardian, which may have named it as well. */
        const gboolean left = failed && reports == 1 && n == 2;
        if (i != DOOR && n != reports && !left)
            g_error("not %d times “%s” in: %s", reports, failed ? unsafe : safe, said);
    }
    if (count(said, SAFE) != (fails ? 0 : reports))
        g_error("“" SAFE "”, although not all was read back, or not although it was: %s", said);
}

/* Returns when the light of a device is off. */
static gint64 wait_for_one(const struct lines *lines, enum line line) {
    UNTIL (!lines_has_light(lines->devices[line]))
        g_usleep(2000);
    return g_get_monotonic_time();
}

static double after_s(gint64 us, gint64 from_us) {
    return (double)MAX(us - from_us, 0) / 1e6;
}

/* The unit is stopped, and its line works again: the guardian, or one that ExecStopPost has left,
 * switches the light off and ends. */
static void repair(struct lines *lines, struct cell *cell) {
    const gint64 began_us = g_get_monotonic_time();
    if (cell->failure == GONE) {
        end_guardian(RIG);
        return;
    }
    g_assert_cmpint(find_guardian(RIG), >, 0);
    lines_repair(lines, cell->line);
    if (cell->line <= BANK)
        cell->late_s = after_s(wait_for_one(lines, cell->line), began_us);
    UNTIL (find_guardian(RIG) == 0)
        g_usleep(5000);
}

/* Until the unit has ended, and the guardian, unless it goes on. */
static void follow_end(struct lines *lines, struct cell *cell, pid_t guardian, gint64 began_us) {
    if (cell->end != ALIVE) /* the others stay on: their client lives, too */
        wait_safe(lines, cell);
    if (cell->failure == LOST) {
        const gint64 hung_us = began_us + (cell->end == STOPPED ? 5 * G_USEC_PER_SEC : 0);
        const gint64 usable_us = lines_usable_us(lines, cell->line);
        cell->late_s = after_s(wait_for_one(lines, cell->line), MAX(usable_us, hung_us));
    }
    if (cell->end == ALIVE)
        return;
    /* ExecStopPost may have been the first to reach the line. */
    UNTIL (cell->failure != LOST || cell->end == GUARDIAN_FROZEN || guardian <= 0 ||
           kill(guardian, 0) != 0)
        g_usleep(5000);
    wait_for_unit();
    g_assert_true(is_dark_but(lines, cell->line));
    g_assert_true(stands_but(lines, cell->line));
    /* An abort leaves a core dump where the machine's limits let it. */
    g_autofree char *result = run_line("systemctl show mesorigd -P Result");
    g_assert_true(strcmp(result, "signal") == 0 ||
                  (cell->end == ABORTED && strcmp(result, "core-dump") == 0));
}

static void run_cell(struct cell *cell, GDBusConnection *bus) {
    struct lines lines = {0};
    lines_open(&lines, WORLD);
    g_autofree char *mark = run_line("journalctl -n 0 --show-cursor");
    const pid_t daemon = start_service(&lines, bus, cell);

    if (cell->failure != LOST)
        lines_fail(&lines, cell->line, cell->failure);
    end_guardians(cell->end);
    const pid_t guardian = find_guardian(RIG);
    const gint64 began_us = g_get_monotonic_time();
    if (cell->end != ALIVE)
        kill(daemon, end_signals[cell->end]);
    follow_end(&lines, cell, guardian, began_us);
    if (cell->end != ALIVE) {
        g_autofree char *said = read_journal(mark);
        check_journal(cell, said);
    }
    order("systemctl stop mesorigd");
    if (cell->failure != LOST && cell->line != DOOR)
        repair(&lines, cell);
    lines_close(&lines);

    const gint64 max_us = (cell->end == STOPPED ? 5 : 1) * G_USEC_PER_SEC + SLACK_US;
    printf("%s %s, %s: dark after %.2f s, axes stand after %.2f s; its own light %.2f s after its "
           "line is usable\n",
           lines_names[cell->line], lines_failures[cell->failure], end_names[cell->end],
           cell->dark_s, cell->stand_s, cell->late_s);
    fflush(stdout);
    if (g_getenv("MESORIG_MATRIX")) { /* which has the computer for itself */
        g_assert_cmpfloat(cell->dark_s, <, (double)max_us / 1e6);
        g_assert_cmpfloat(cell->stand_s, <, (double)max_us / 1e6);
        g_assert_cmpfloat(cell->late_s, <, (double)(G_USEC_PER_SEC + SLACK_US) / 1e6);
    }
}

/* In the short form: the daemon is killed while the laser is silent, and while it loses an answer
 * and the guardian is frozen. */
static gboolean is_few(const struct cell *cell) {
    return cell->line == LASER && ((cell->end == KILLED && cell->failure == SILENT) ||
                                   (cell->end == GUARDIAN_FROZEN && cell->failure == LOST));
}

int main(void) {
    const gboolean all = g_getenv("MESORIG_MATRIX") != NULL;
    g_autoptr(GError) error = NULL;
    g_autoptr(GDBusConnection) bus = g_bus_get_sync(G_BUS_TYPE_SYSTEM, NULL, &error);
    g_assert_no_error(error);
    assert_is("systemctl show mesorigd -P Type", "notify");
    assert_is("systemctl show mesorigd -P ProtectSystem", "strict");

    int n_all = 0;
    for (int end = 0; end < N_ENDS; end++) {
        double dark_s = 0, stand_s = 0, late_s = 0;
        int n = 0;
        for (int line = 0; line < N_DEVICES; line++)
            for (int how = 0; how < lines_n_failures((enum line)line); how++) {
                struct cell cell = {
                    (enum end)end, (enum line)line, (enum line_failure)how, 0, 0, 0};
                if ((!all && !is_few(&cell)) || (end == ALIVE && how != LOST))
                    continue;
                run_cell(&cell, bus);
                dark_s = MAX(dark_s, cell.dark_s);
                stand_s = MAX(stand_s, cell.stand_s);
                late_s = MAX(late_s, cell.late_s);
                n++;
            }
        if (n > 0)
            printf("%s: %d cells, dark after %.2f s at most, axes stand after %.2f s at most, the "
                   "failed light is off %.2f s at most after its line is usable\n",
                   end_names[end], n, dark_s, stand_s, late_s);
        n_all += n;
    }
    printf("%d cells\n", n_all);
    return 0;
}
