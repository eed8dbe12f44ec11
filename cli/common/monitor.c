#include "monitor.h"

#include "cli.h"
#include "plan/report.h"
#include "progress.h"
#include "watching.h"

#include <gio/gio.h>
#include <glib-unix.h>
#include <signal.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

#define JSON_INTERVAL_US (1 * G_USEC_PER_SEC)

struct Monitor {
    Link *link;
    gboolean control, patient;
    GMainLoop *loop;
    Progress *progress;
    Watching *watching; /* NULL to show only the bar */
    enum monitor_end end;
    gboolean ended;
    int interrupts;
    gboolean faulty; /* an error was printed since the capture last ran */
    /* session whose processing the monitor waits for; NULL if it watches the capture */
    const char *processed;
    gboolean processing_failed;
    char *shown_state, *reason;
    char *left_out; /* set by monitor_leave_out() */
    enum monitor_answer answer;
    char *prompt;   /* the last printed prompt; empty if there is none */
    guint enter_id; /* source that waits for the Enter key */
    gint64 begun_us, json_us;
    gint64 frames_before; /* number of frames when monitor_run() began */
    guint signal_ids[3], check_id;
};

static double real_s(const Monitor *monitor) {
    return (double)(g_get_monotonic_time() - monitor->begun_us) / G_USEC_PER_SEC;
}

static double frames_per_s(const Monitor *monitor) {
    const double seconds = real_s(monitor);
    const gint64 frames = bus_rig1_get_frames(link_rig(monitor->link)) - monitor->frames_before;
    return seconds > 0.05 && frames > 0 ? (double)frames / seconds : 0;
}

static double fraction(BusRig1 *rig) {
    const int shots = bus_rig1_get_shots(rig);
    return shots > 0 ? (double)bus_rig1_get_shots_done(rig) / shots : 0;
}

void monitor_status(Record *to, BusRig1 *rig) {
    record_add(to, "%s{state} %s{reason} %s{prompt} %s{doing} %s{rig}", bus_rig1_get_state(rig),
               bus_rig1_get_reason(rig), bus_rig1_get_prompt(rig), bus_rig1_get_doing(rig),
               bus_rig1_get_rig_path(rig));
    record_boolean(to, "simulated", bus_rig1_get_simulated(rig));
    record_add(to, "%s{session} %d{shots} %d{shots_done} %g{percent}", bus_rig1_get_session(rig),
               bus_rig1_get_shots(rig), bus_rig1_get_shots_done(rig), 100 * fraction(rig));
    record_add(
        to, "%" G_GINT64_FORMAT "{frames} %" G_GINT64_FORMAT "{retakes} %g{elapsed_s} %g{left_s}",
        bus_rig1_get_frames(rig), bus_rig1_get_retakes(rig), bus_rig1_get_elapsed(rig),
        bus_rig1_get_left(rig));
    record_add(to,
               "%" G_GINT64_FORMAT "{predicted_end} %" G_GINT64_FORMAT
               "{bytes_stored} %" G_GINT64_FORMAT "{bytes_expected}",
               (gint64)bus_rig1_get_predicted_end(rig), (gint64)bus_rig1_get_bytes_stored(rig),
               (gint64)bus_rig1_get_bytes_expected(rig));
    g_autofree char *pose = watching_pose(rig);
    record_string(to, "pose", pose);
}

static char *retakes_text(BusRig1 *rig) {
    const gint64 retakes = bus_rig1_get_retakes(rig);
    return retakes == 0   ? g_strdup("no retakes")
           : retakes == 1 ? g_strdup("1 retake")
                          : g_strdup_printf("%" G_GINT64_FORMAT " retakes", retakes);
}

static char *time_text(const Monitor *monitor) {
    BusRig1 *rig = link_rig(monitor->link);
    g_autofree char *elapsed = report_duration(bus_rig1_get_elapsed(rig));
    g_autofree char *real = report_duration(real_s(monitor));
    return bus_rig1_get_simulated(rig) ? g_strdup_printf("%s simulated in %s", elapsed, real)
                                       : g_steal_pointer(&elapsed);
}

static char *progress_text(const Monitor *monitor) {
    BusRig1 *rig = link_rig(monitor->link);
    const char *state = bus_rig1_get_state(rig), *reason = bus_rig1_get_reason(rig);
    const guint64 end = bus_rig1_get_predicted_end(rig);
    g_autofree char *retakes = retakes_text(rig);
    g_autofree char *times = time_text(monitor);
    GString *text = g_string_new(NULL);
    g_string_append_printf(text, "%d/%d shots", bus_rig1_get_shots_done(rig),
                           bus_rig1_get_shots(rig));
    if (strcmp(state, "paused") == 0) {
        g_string_append_printf(text, ", paused: %s", reason);
    } else {
        /* The most important parts come first, because a narrow terminal cuts off the end. */
        if (strcmp(state, "homing") == 0)
            g_string_append_printf(text, ", %s", bus_rig1_get_doing(rig));
        else if (strcmp(state, "running") != 0)
            g_string_append_printf(text, ", %s", state);
        if (end) {
            const double left_s = (double)end - (double)g_get_real_time() / G_USEC_PER_SEC;
            g_autofree char *left = report_duration(MAX(0.0, left_s));
            g_string_append_printf(text, ", %s left", left);
        }
        g_string_append_printf(text, ", %.0f frames/s, %s, %s", frames_per_s(monitor), retakes,
                               times);
    }
    return g_string_free(text, FALSE);
}

static void show(Monitor *monitor) {
    BusRig1 *rig = link_rig(monitor->link);
    const char *state = bus_rig1_get_state(rig);
    const gboolean news = g_strcmp0(state, monitor->shown_state) != 0;
    const gint64 now_us = g_get_monotonic_time();
    g_free(monitor->shown_state);
    monitor->shown_state = g_strdup(state);
    if (cli_json && (news || now_us >= monitor->json_us + JSON_INTERVAL_US)) {
        monitor->json_us = now_us;
        g_autoptr(Record) record = record_new();
        monitor_status(record, rig);
        record_add(record, "%g{real_s} %g{frames_per_s}", real_s(monitor), frames_per_s(monitor));
        record_print(record, TRUE);
    } else if (bus_rig1_get_shots(rig) > 0) {
        g_autofree char *text = progress_text(monitor);
        if (monitor->watching)
            watching_show(monitor->watching);
        progress_show(monitor->progress, fraction(rig), text, news);
    }
}

static void finish(Monitor *monitor, enum monitor_end end) {
    if (monitor->ended)
        return;
    monitor->ended = TRUE;
    monitor->end = end;
    g_main_loop_quit(monitor->loop);
}

static gboolean confirm(Monitor *monitor) {
    g_autoptr(GError) error = NULL;
    if (bus_rig1_call_continue_sync(link_rig(monitor->link), NULL, &error))
        return TRUE;
    g_dbus_error_strip_remote_error(error);
    progress_line(monitor->progress, "the capture cannot continue: %s", error->message);
    return FALSE;
}

static gboolean on_enter(gint fd, GIOCondition condition, gpointer data) {
    Monitor *monitor = data;
    char typed[256];
    const gssize n = read(fd, typed, sizeof(typed));
    if (n > 0 && (!memchr(typed, '\n', (gsize)n) || !confirm(monitor)))
        return G_SOURCE_CONTINUE;
    monitor->enter_id = 0;
    return G_SOURCE_REMOVE;
}

/* Prints, once for each manual step, how to confirm it. An event has already described the step. */
static void check_prompt(Monitor *monitor) {
    BusRig1 *rig = link_rig(monitor->link);
    const char *prompt = bus_rig1_get_prompt(rig);
    if (g_strcmp0(prompt, monitor->prompt) == 0)
        return;
    g_clear_handle_id(&monitor->enter_id, g_source_remove);
    g_free(monitor->prompt);
    monitor->prompt = g_strdup(prompt);
    if (!prompt || !*prompt)
        return;
    /* A background job would be stopped if it used its terminal. */
    const gboolean has_enter = isatty(STDIN_FILENO) && tcgetpgrp(STDIN_FILENO) == getpgrp();
    if (monitor->answer == ANSWER_AT_ONCE) {
        confirm(monitor);
    } else if (monitor->answer == ANSWER_ENTER && has_enter) {
        tcflush(STDIN_FILENO, TCIFLUSH); /* discards earlier key presses */
        monitor->enter_id =
            g_unix_fd_add(STDIN_FILENO, G_IO_IN | G_IO_HUP | G_IO_ERR, on_enter, monitor);
        progress_line(monitor->progress, "press Enter when it is done");
    } else {
        g_autofree char *again = link_again(monitor->link);
        progress_line(monitor->progress, "to answer: mesorig continue %s%s",
                      bus_rig1_get_session(rig), again);
    }
}

static void check(Monitor *monitor) {
    BusRig1 *rig = link_rig(monitor->link);
    if (link_is_lost(monitor->link) || monitor->ended) {
        finish(monitor, MONITOR_LOST);
        return;
    }
    if (monitor->processed) {
        const char *const *directories = bus_rig1_get_processing(rig);
        if (!directories || !g_strv_contains(directories, monitor->processed))
            finish(monitor, monitor->processing_failed ? MONITOR_FAULT : MONITOR_DONE);
        return;
    }
    const char *state = bus_rig1_get_state(rig);
    /* The daemon sends the event of a fault before it changes the state, and another property may
     * change in between. "running" therefore ends the fault only if another state than "running"
     * was shown since the fault. */
    if (strcmp(state, "running") == 0 && g_strcmp0(monitor->shown_state, state) != 0)
        monitor->faulty = FALSE;
    show(monitor);
    check_prompt(monitor);
    if (strcmp(state, "done") == 0) {
        finish(monitor, MONITOR_DONE);
    } else if (strcmp(state, "paused") == 0) {
        g_free(monitor->reason);
        monitor->reason = g_strdup(bus_rig1_get_reason(rig));
        if (monitor->interrupts > 0)
            finish(monitor, MONITOR_PAUSED);
        else if (monitor->faulty && !monitor->patient)
            finish(monitor, MONITOR_FAULT);
    } else if (strcmp(state, "aborted") == 0 || strcmp(state, "idle") == 0 ||
               strcmp(state, "closed") == 0) {
        finish(monitor, MONITOR_ABORTED);
    }
}

static void on_properties(GDBusProxy *proxy, GVariant *properties, GStrv invalidated,
                          gpointer data) {
    Monitor *monitor = data;
    if (g_main_loop_is_running(monitor->loop))
        check(monitor);
}

static void on_event(BusRig1 *rig, const char *level, const char *source, const char *message,
                     gpointer data) {
    Monitor *monitor = data;
    if (strcmp(level, "error") == 0)
        monitor->faulty = TRUE;
    if (strcmp(source, "process") == 0)
        monitor->processing_failed = TRUE;
    if (cli_json) {
        g_autoptr(Record) record = record_new();
        record_add(record, "%s{event} %s{level} %s{source}", message, level, source);
        record_print(record, TRUE);
    } else if (strcmp(level, "info") == 0 && g_strcmp0(source, monitor->left_out) == 0) {
        return;
    } else if (strcmp(level, "info") == 0) {
        progress_line(monitor->progress, "%s: %s", source, message);
    } else {
        progress_line(monitor->progress, "%s: %s: %s", level, source, message);
    }
}

static void on_closed(GDBusConnection *connection, gboolean by_peer, GError *error, gpointer data) {
    finish(data, MONITOR_LOST);
}

static void on_owner(GDBusProxy *proxy, GParamSpec *spec, gpointer data) {
    Monitor *monitor = data;
    if (link_is_lost(monitor->link))
        finish(monitor, MONITOR_LOST);
}

static gboolean check_idle(gpointer data) {
    Monitor *monitor = data;
    monitor->check_id = 0;
    check(monitor);
    return G_SOURCE_REMOVE;
}

/* If monitor->control is TRUE, the first Ctrl-C pauses after the shot under way, and the second
 * aborts immediately. Otherwise Ctrl-C ends the watching.
 *
 * When the daemon answers to Pause, changes of its state may still be queued here, even the change
 * to "running". An idle source therefore reads the state after these changes. */
static gboolean on_interrupt(gpointer data) {
    Monitor *monitor = data;
    g_autoptr(GError) error = NULL;
    if (!monitor->control || monitor->processed) {
        finish(monitor, MONITOR_DETACHED);
        return G_SOURCE_CONTINUE;
    }
    if (monitor->interrupts++ == 0) {
        progress_line(monitor->progress,
                      "pausing after the shot under way; Ctrl-C once more stops immediately");
        if (!bus_rig1_call_pause_sync(link_rig(monitor->link), NULL, &error))
            finish(monitor, MONITOR_PAUSED);
        else if (!monitor->check_id)
            monitor->check_id = g_idle_add(check_idle, monitor);
    } else {
        bus_rig1_call_abort_sync(link_rig(monitor->link), NULL, NULL);
        finish(monitor, MONITOR_ABORTED);
    }
    return G_SOURCE_CONTINUE;
}

Monitor *monitor_new(Link *link, gboolean control) {
    const int signals[] = {SIGINT, SIGTERM, SIGHUP};
    Monitor *monitor = g_new0(Monitor, 1);
    monitor->link = link;
    monitor->control = control;
    monitor->loop = g_main_loop_new(NULL, FALSE);
    monitor->progress = progress_new("capture");
    BusRig1 *rig = link_rig(link);
    /* connected after the proxy's own handler, which forgets the old values of arrays */
    g_signal_connect_after(rig, "g-properties-changed", G_CALLBACK(on_properties), monitor);
    g_signal_connect(rig, "event", G_CALLBACK(on_event), monitor);
    g_signal_connect(rig, "notify::g-name-owner", G_CALLBACK(on_owner), monitor);
    g_signal_connect(g_dbus_proxy_get_connection(G_DBUS_PROXY(rig)), "closed",
                     G_CALLBACK(on_closed), monitor);
    for (gsize i = 0; i < G_N_ELEMENTS(signals); i++)
        monitor->signal_ids[i] = g_unix_signal_add(signals[i], on_interrupt, monitor);
    return monitor;
}

void monitor_free(Monitor *monitor) {
    if (!monitor)
        return;
    BusRig1 *rig = link_rig(monitor->link);
    g_signal_handlers_disconnect_by_data(rig, monitor);
    g_signal_handlers_disconnect_by_data(g_dbus_proxy_get_connection(G_DBUS_PROXY(rig)), monitor);
    for (gsize i = 0; i < G_N_ELEMENTS(monitor->signal_ids); i++)
        g_source_remove(monitor->signal_ids[i]);
    g_clear_handle_id(&monitor->enter_id, g_source_remove);
    g_clear_handle_id(&monitor->check_id, g_source_remove);
    watching_free(monitor->watching);
    progress_free(monitor->progress);
    g_main_loop_unref(monitor->loop);
    g_free(monitor->shown_state);
    g_free(monitor->left_out);
    g_free(monitor->reason);
    g_free(monitor->prompt);
    g_free(monitor);
}

void monitor_watch(Monitor *monitor, gboolean pictures) {
    monitor->watching = watching_new(link_rig(monitor->link), monitor->progress, pictures);
}

void monitor_leave_out(Monitor *monitor, const char *source) {
    g_free(monitor->left_out);
    monitor->left_out = g_strdup(source);
}

void monitor_set_answer(Monitor *monitor, enum monitor_answer answer) {
    monitor->answer = answer;
}

enum monitor_end monitor_run(Monitor *monitor, gboolean patient) {
    monitor->patient = patient;
    monitor->begun_us = g_get_monotonic_time();
    /* Handle the changes that the daemon sent before its answer to our last call, because they are
     * still queued. */
    while (g_main_context_iteration(NULL, FALSE))
        ;
    monitor->frames_before = bus_rig1_get_frames(link_rig(monitor->link));
    check(monitor);
    if (!monitor->ended)
        g_main_loop_run(monitor->loop);
    progress_end(monitor->progress);
    return monitor->end;
}

enum monitor_end monitor_run_processing(Monitor *monitor, const char *directory) {
    monitor->processed = directory;
    monitor->ended = FALSE;
    if (!cli_json)
        g_print("processing %s; Ctrl-C ends only this program\n", directory);
    check(monitor);
    if (!monitor->ended)
        g_main_loop_run(monitor->loop);
    return monitor->end;
}

const char *monitor_reason(const Monitor *monitor) {
    return monitor->reason ? monitor->reason : "";
}

char *monitor_summary(const Monitor *monitor) {
    BusRig1 *rig = link_rig(monitor->link);
    g_autofree char *retakes = retakes_text(rig);
    g_autofree char *times = time_text(monitor);
    return g_strdup_printf("%d of %d shots, %" G_GINT64_FORMAT " camera frames in this run, %s, %s",
                           bus_rig1_get_shots_done(rig), bus_rig1_get_shots(rig),
                           bus_rig1_get_frames(rig), retakes, times);
}
