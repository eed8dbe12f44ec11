#include "unattended.h"

#include <string.h>

#include "plan/report.h"

/* A session, with the values that the daemon shows about it. */
struct shown {
    guint number;
    const char *state, *name, *directory, *prompt, *message;
    double predicted_s;
    guint64 bytes;
    gint64 begun_at_s, ended_at_s;
};

static struct shown read_shown(GVariant *item) {
    struct shown ret = {.state = "", .name = "", .directory = "", .prompt = "", .message = ""};
    g_variant_lookup(item, "number", "u", &ret.number);
    g_variant_lookup(item, "state", "&s", &ret.state);
    g_variant_lookup(item, "name", "&s", &ret.name);
    g_variant_lookup(item, "directory", "&s", &ret.directory);
    g_variant_lookup(item, "prompt", "&s", &ret.prompt);
    g_variant_lookup(item, "message", "&s", &ret.message);
    g_variant_lookup(item, "predicted_s", "d", &ret.predicted_s);
    g_variant_lookup(item, "bytes", "t", &ret.bytes);
    g_variant_lookup(item, "begun_at", "x", &ret.begun_at_s);
    g_variant_lookup(item, "ended_at", "x", &ret.ended_at_s);
    return ret;
}

static gboolean has_ended(const struct shown *shown) {
    return strcmp(shown->state, "done") == 0 || strcmp(shown->state, "stopped") == 0;
}

/* Returns a time as text: "21:40" for a time of today, "Tue 06:10" for another day, or "-" if at_s
 * is 0 because the time is not known. Free it with g_free(). */
static char *clock_text(gint64 at_s) {
    g_autoptr(GDateTime) time = g_date_time_new_from_unix_local(at_s);
    g_autoptr(GDateTime) now = g_date_time_new_now_local();
    if (!time || at_s <= 0)
        return g_strdup("-");
    const gboolean today = g_date_time_get_day_of_year(time) == g_date_time_get_day_of_year(now) &&
                           g_date_time_get_year(time) == g_date_time_get_year(now);
    return g_date_time_format(time, today ? "%H:%M" : "%a %H:%M");
}

/* Estimates when a session begins and ends. Call it for all sessions in the order of the queue.
 * *at_s is the time at which the previous session ends, and is set to the time at which this one
 * ends. A session that has ended gets its actual times, and *at_s does not change.
 *
 * A time is 0 if it is not known because the queue is paused. The start of a session that is being
 * captured is always known. */
static void estimate(const struct shown *shown, BusRig1 *rig, double *at_s, gint64 *ret_start_s,
                     gint64 *ret_end_s) {
    const guint64 predicted_end = bus_rig1_get_predicted_end(rig);
    *ret_start_s = shown->begun_at_s;
    *ret_end_s = shown->ended_at_s;
    if (has_ended(shown))
        return;
    const gboolean runs = strcmp(shown->state, "begun") == 0;
    if (runs && predicted_end > 0)
        *at_s = (double)predicted_end;
    else if (*at_s > 0)
        *at_s += shown->predicted_s;
    *ret_start_s = runs ? shown->begun_at_s : *at_s > 0 ? (gint64)(*at_s - shown->predicted_s) : 0;
    *ret_end_s = (gint64)*at_s;
}

static void tell_item(Record *to, const struct shown *shown, gint64 start_s, gint64 end_s,
                      gboolean list) {
    g_autofree char *start = clock_text(start_s), *end = clock_text(end_s);
    g_autofree char *takes = report_duration(shown->predicted_s);
    record_begin(to, NULL);
    record_add(to, "%u{number} %s{state} %s{name} %s{directory} %s{prompt} %s{message}",
               shown->number, shown->state, shown->name, shown->directory, shown->prompt,
               shown->message);
    record_add(to,
               "%g{predicted_s} %" G_GINT64_FORMAT "{bytes} %" G_GINT64_FORMAT
               "{start} %" G_GINT64_FORMAT "{end}",
               shown->predicted_s, (gint64)shown->bytes, start_s, end_s);
    record_end(to);
    if (!list)
        return;
    record_say(to, "%6u  %-8s %-10s %-10s %-12s %s\n", shown->number, shown->state, start, end,
               takes, shown->directory);
    if (*shown->message)
        record_say(to, "        %s\n", shown->message);
    if (*shown->prompt && !has_ended(shown) && strcmp(shown->state, "begun") != 0)
        record_say(to, "        before it: %s\n", shown->prompt);
}

/* Prints the state of the queue in one sentence. */
static void tell_state(Record *to, BusRig1 *rig, guint n_waiting, gboolean list) {
    const char *state = bus_rig1_get_queue_state(rig), *reason = bus_rig1_get_queue_reason(rig);
    const char *head = list ? "the queue is " : "queue      ";
    const char *sessions = n_waiting == 1 ? "session waits" : "sessions wait";
    if (strcmp(state, "none") == 0)
        return;
    if (strcmp(state, "empty") == 0)
        record_say(to, "%sempty%s%s\n", head, *reason ? ": " : "", reason);
    else if (strcmp(state, "paused") == 0)
        record_say(to, "%spaused, %u %s: %s\n", head, n_waiting, sessions, reason);
    else if (strcmp(state, "hands") == 0)
        record_say(to, "%swaiting for somebody, %u %s: %s (then mesorig continue)\n", head,
                   n_waiting, sessions, bus_rig1_get_prompt(rig));
    else
        record_say(to, "%s%s, %u %s\n", head,
                   strcmp(state, "waiting") == 0 ? "waiting for the rig" : "at work", n_waiting,
                   sessions);
}

void unattended_tell(Record *to, BusRig1 *rig, gboolean list) {
    GVariant *items = bus_rig1_get_queue(rig);
    const char *state = bus_rig1_get_queue_state(rig);
    guint n_waiting = 0;
    if (!items || !state) /* the daemon has ended during the call */
        return;
    const gboolean stands = strcmp(state, "paused") == 0;
    double at_s = stands ? 0 : (double)g_get_real_time() / G_USEC_PER_SEC;
    record_add(to, "%s{queue_state} %s{queue_reason}", state, bus_rig1_get_queue_reason(rig));
    record_begin_list(to, "queue");
    if (list && g_variant_n_children(items) > 0)
        record_say(to, "NUMBER  %-8s %-10s %-10s %-12s %s\n", "STATE", "BEGINS", "ENDS", "TAKES",
                   "DIRECTORY");
    for (gsize i = 0; i < g_variant_n_children(items); i++) {
        g_autoptr(GVariant) item = g_variant_get_child_value(items, i);
        const struct shown shown = read_shown(item);
        gint64 start_s, end_s;
        estimate(&shown, rig, &at_s, &start_s, &end_s);
        n_waiting += !has_ended(&shown) && strcmp(shown.state, "begun") != 0;
        tell_item(to, &shown, start_s, end_s, list);
    }
    record_end(to);
    if (list && bus_rig1_get_simulated(rig) && n_waiting > 0)
        record_say(to, "The rig is simulated: its sessions may take less time than predicted.\n");
    tell_state(to, rig, n_waiting, list);
}
