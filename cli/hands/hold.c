/* lamp, laser, move, home: use one device by hand. */
#include <gio/gio.h>
#include <glib-unix.h>
#include <math.h>
#include <signal.h>
#include <string.h>

#include "hand_link.h"
#include "hands.h"

/* While this program keeps a light on, the lease of the light is LEASE_S seconds and is renewed
 * every RENEW_MS. If this program is stopped or its connection hangs, the light goes off when the
 * lease ends. */
#define LEASE_S  10
#define RENEW_MS 3000

static double seconds;

static const GOptionEntry light_entries[] = {
    {"for", 0, 0, G_OPTION_ARG_DOUBLE, &seconds,
     "Switch it off after this time in seconds; default: only Ctrl-C switches it off", "S"},
    HAND_RIG_ENTRY,
    {NULL},
};
static const GOptionEntry axis_entries[] = {HAND_RIG_ENTRY, {NULL}};

struct waiting {
    GMainLoop *loop;
    Link *link;
    gint64 until_us; /* the end of --for; 0 if there is none */
    int n_open;      /* number of open interlocks at the start */
    char *fault;     /* the fault that has ended the waiting, or NULL */
};

static gboolean on_end(gpointer data) {
    g_main_loop_quit(((struct waiting *)data)->loop);
    return G_SOURCE_CONTINUE;
}

/* Renews the lease of the light. With --for, the lease ends no later than the given time. The
 * daemon then switches the light off even if this program hangs. */
static gboolean on_renew(gpointer data) {
    struct waiting *waiting = data;
    const double left_s = waiting->until_us == 0
                              ? LEASE_S
                              : (double)(waiting->until_us - g_get_monotonic_time()) * 1e-6;
    if (left_s > 0)
        hand_renew(waiting->link, MIN(left_s, LEASE_S));
    return G_SOURCE_CONTINUE;
}

static void on_event(BusRig1 *rig, const char *level, const char *source, const char *message,
                     gpointer data) {
    struct waiting *waiting = data;
    if (strcmp(level, "error") != 0)
        return;
    g_free(waiting->fault);
    waiting->fault = g_strdup_printf("%s: %s", source, message);
    on_end(waiting);
}

static int count_open(BusRig1 *rig) {
    GVariant *devices = bus_rig1_get_devices(rig);
    const char *class_name, *name, *driver, *health;
    GVariantIter iter;
    int n = 0;
    if (!devices)
        return 0;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        n += strcmp(class_name, "interlock") == 0 && strcmp(health, "closed") != 0;
    return n;
}

static void on_devices(GObject *object, GParamSpec *spec, gpointer data) {
    struct waiting *waiting = data;
    if (count_open(BUS_RIG1(object)) <= waiting->n_open)
        return;
    g_free(waiting->fault);
    waiting->fault = g_strdup(
        "an interlock has opened, which has ended all use of devices by hand: close the interlock, "
        "then run the command again");
    on_end(waiting);
}

/* Waits for a signal, the end of the given time, or a fault. Returns the fault, to be freed with
 * g_free(), or NULL. */
static char *wait_for_end(Link *link) {
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    guint ids[G_N_ELEMENTS(numbers)];
    BusRig1 *rig = link_rig(link);
    struct waiting waiting = {
        .loop = g_main_loop_new(NULL, FALSE), .link = link, .n_open = count_open(rig)};
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        ids[i] = g_unix_signal_add(numbers[i], on_end, &waiting);
    const double for_s = MIN(seconds, 1e6);
    guint timer = 0;
    if (for_s > 0) {
        waiting.until_us = g_get_monotonic_time() + (gint64)(for_s * 1e6);
        timer = g_timeout_add((guint)ceil(for_s * 1000), on_end, &waiting);
    }
    on_renew(&waiting);
    const guint renew = g_timeout_add(RENEW_MS, on_renew, &waiting);
    const gulong event = g_signal_connect(rig, "event", G_CALLBACK(on_event), &waiting);
    const gulong changed =
        g_signal_connect(rig, "notify::devices", G_CALLBACK(on_devices), &waiting);
    g_main_loop_run(waiting.loop);
    g_signal_handler_disconnect(rig, event);
    g_signal_handler_disconnect(rig, changed);
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_source_remove(ids[i]);
    if (timer)
        g_source_remove(timer);
    g_source_remove(renew);
    g_main_loop_unref(waiting.loop);
    return waiting.fault;
}

static int run_light(const struct call *call, gboolean laser, GError **error) {
    const char *name = call->arguments[0];
    if (seconds < 0 || !isfinite(seconds))
        return cli_usage(call->command, "--for=%g: give a positive number of seconds", seconds);
    g_autoptr(Link) link = hand_link(error);
    /* While the light warms up, its lease is LEASE_S even if --for is shorter, because a short
     * lease would end if a renewal were late. */
    if (!link || !hand_light_for(link, laser, name, LEASE_S, error))
        return CLI_FAILED;
    const char *rig = bus_rig1_get_rig_path(link_rig(link));
    if (!cli_json && seconds > 0)
        g_print("%s is on for %g s (rig %s)\n", name, seconds, rig);
    else if (!cli_json)
        g_print("%s is on (rig %s); Ctrl-C switches it off\n", name, rig);
    g_autofree char *fault = wait_for_end(link);
    if (fault)
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_FAILED, fault);
    if (fault || !hand_light(link, laser, name, FALSE, error))
        return CLI_FAILED;
    record_string(call->record, laser ? "laser" : "lamp", name);
    record_boolean(call->record, "on", FALSE);
    record_say(call->record, "%s is off (rig %s{rig})\n", name, rig);
    return CLI_DONE;
}

static int run_lamp(const struct call *call, GError **error) {
    return run_light(call, FALSE, error);
}

static int run_laser(const struct call *call, GError **error) {
    return run_light(call, TRUE, error);
}

static void tell_axis(Record *to, Link *link, const char *axis, double deg) {
    const char *rig = bus_rig1_get_rig_path(link_rig(link));
    record_say(to, "%s{axis} stands at %g{position_deg}° (rig %s{rig})\n", axis, deg, rig);
}

static int run_move(const struct call *call, GError **error) {
    const char *axis = call->arguments[0], *text = call->arguments[1];
    char *end;
    const double to = g_ascii_strtod(text, &end);
    double deg;
    if (*end || end == text || !isfinite(to))
        return cli_usage(call->command, "“%s” is not an angle in degrees", text);
    g_autoptr(Link) link = hand_link(error);
    if (!link)
        return CLI_FAILED;
    /* If the rig was opened for this call, its axes are not homed yet. */
    if (hand_rig && link_is_private(link) && !hand_home(link, axis, &deg, error))
        return CLI_FAILED;
    if (!hand_move(link, axis, to, &deg, error)) {
        if (g_error_matches(*error, G_IO_ERROR, G_IO_ERROR_CLOSED))
            g_prefix_error(error, "%s: ", axis);
        return CLI_FAILED;
    }
    tell_axis(call->record, link, axis, deg);
    return CLI_DONE;
}

static int run_home(const struct call *call, GError **error) {
    double deg;
    g_autoptr(Link) link = hand_link(error);
    if (!link || !hand_home(link, call->arguments[0], &deg, error))
        return CLI_FAILED;
    tell_axis(call->record, link, call->arguments[0], deg);
    return CLI_DONE;
}

const struct command hands_lamp = {.name = "lamp",
                                   .arguments = "LAMP",
                                   .examples = "  mesorig lamp lamp30\n"
                                               "  mesorig lamp lamp30 --for 5\n",
                                   .help = "Switch a lamp on until Ctrl-C.",
                                   .options = light_entries,
                                   .daemon = TRUE,
                                   .min = 1,
                                   .max = 1,
                                   .run = run_lamp};
const struct command hands_laser = {
    .name = "laser",
    .arguments = "LASER",
    .examples = "  mesorig laser laser45 --for 2\n",
    .help = "Switch a laser on until Ctrl-C or until an interlock opens. Mind your eyes.",
    .options = light_entries,
    .daemon = TRUE,
    .min = 1,
    .max = 1,
    .run = run_laser};
const struct command hands_move = {
    .name = "move",
    .arguments = "AXIS DEGREES",
    .examples = "  mesorig move turntable 90\n"
                "  mesorig move -- arc -15\n",
    .help = "Move an axis to an angle. Home it first. Ctrl-C stops it. Write -- before a negative "
            "angle.",
    .options = axis_entries,
    .daemon = TRUE,
    .min = 2,
    .max = 2,
    .run = run_move};
const struct command hands_home = {.name = "home",
                                   .arguments = "AXIS",
                                   .examples = "  mesorig home turntable\n",
                                   .help =
                                       "Move an axis to its reference position. Ctrl-C stops it.",
                                   .options = axis_entries,
                                   .daemon = TRUE,
                                   .min = 1,
                                   .max = 1,
                                   .run = run_home};
