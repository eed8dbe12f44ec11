/* snap and live: show the picture of a camera. */
#include <gio/gio.h>
#include <glib-unix.h>
#include <signal.h>
#include <stdio.h>
#include <unistd.h>

#include "capture/thumbnail.h"
#include "common/picture.h"
#include "hand_link.h"
#include "hands.h"
#include "picture_report.h"

#define EXPOSURE_US 10000
#define TEXT_LINES  5 /* number of lines of text below the picture */
#define PAUSE_MS    100

static char *output, *lamp, *laser;
static gint64 exposure_us;
static int count;

#define SHARED_ENTRIES                                                                               \
    {                                                                                                \
        "exposure-us", 'e', 0, G_OPTION_ARG_INT64, &exposure_us, "Exposure time in µs (10000)",      \
        "US"},                                                                                       \
        {"lamp", 'l', 0, G_OPTION_ARG_STRING, &lamp, "Switch this lamp on for the picture", "LAMP"}, \
        {"laser", 0, 0, G_OPTION_ARG_STRING, &laser, "Switch this laser on for the picture",         \
         "LASER"},                                                                                   \
        HAND_RIG_ENTRY

static const GOptionEntry snap_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "Write the picture: .png to look at, .exr with the raw values of the sensor", "FILE"},
    SHARED_ENTRIES,
    {NULL},
};

static const GOptionEntry live_entries[] = {
    {"count", 'n', 0, G_OPTION_ARG_INT, &count, "End after this number of pictures", "N"},
    SHARED_ENTRIES,
    {NULL},
};

static gboolean set_lights(Link *link, gboolean on, GError **error) {
    return (!lamp || hand_light(link, FALSE, lamp, on, error)) &&
           (!laser || hand_light(link, TRUE, laser, on, error));
}

/* Finds a daemon with the rig and switches the requested lights on. After a failure, returns NULL
 * and frees the link, so that the lights go off. */
static Link *look_begin(const struct call *call, GError **error) {
    if (exposure_us == 0)
        exposure_us = EXPOSURE_US;
    if (exposure_us < 0) {
        cli_usage(call->command, "--exposure-us=%" G_GINT64_FORMAT ": give a number of µs above 0",
                  exposure_us);
        return NULL;
    }
    g_autoptr(Link) link = hand_link(error);
    return link && set_lights(link, TRUE, error) ? g_steal_pointer(&link) : NULL;
}

static void show(const Frame *frame, enum picture_way way) {
    int columns, lines, width = 0, height = 0;
    g_autofree guint8 *rgb = NULL;
    picture_terminal_size(STDOUT_FILENO, &columns, &lines);
    thumbnail_make_sized(frame, G_MAXINT16, &width, &height, &rgb);
    g_autofree char *text =
        picture_text(rgb, width, height, way, columns, lines - TEXT_LINES, NULL, NULL);
    fputs(text, stdout); /* g_print() would replace control characters */
}

static gboolean snap_write(OutputFile *to, const char *camera, const Frame *frame, GError **error) {
    const char *path = output_file_path(to, error);
    return path && output_file_end(to, picture_write(path, camera, frame, error), error);
}

static int run_snap(const struct call *call, GError **error) {
    const char *camera = call->arguments[0];
    g_autoptr(OutputFile) to = NULL;
    if (output && !(to = cli_output(output, "snap", error)))
        return CLI_FAILED;
    g_autoptr(Link) link = look_begin(call, error);
    if (!link)
        return error && *error ? CLI_FAILED : CLI_USAGE;
    g_autoptr(Frame) frame = hand_snap(link, camera, exposure_us, 0, error);
    if (!frame || !set_lights(link, FALSE, error) || (to && !snap_write(to, camera, frame, error)))
        return CLI_FAILED;
    const struct picture_values report = picture_values(frame);
    if (!cli_json)
        show(frame, picture_way(STDOUT_FILENO));
    picture_report_tell(call->record, camera, frame, &report);
    if (!lamp && !laser && report.focus <= 0)
        record_say(call->record,
                   "the picture is dark: --lamp NAME switches a lamp on for the picture\n");
    if (output) {
        const gboolean halved = frame->cfa != CFA_MONO && g_str_has_suffix(output, ".png");
        record_say(call->record, "%s{file}%s\n", output,
                   halved ? ": a pixel for each 2 × 2 of the colour filter" : "");
        cli_tell_output(call->record, to);
    }
    return CLI_DONE;
}

static gboolean on_signal(gpointer data) {
    *(gboolean *)data = TRUE;
    return G_SOURCE_CONTINUE;
}

/* Takes and shows the next picture. On a terminal, the picture is drawn over the previous one.
 * Elsewhere, each picture is described in a few lines of text or, with --json, in one line of
 * JSON. */
static gboolean show_next(Link *link, const char *camera, enum picture_way way, gboolean first,
                          GError **error) {
    g_autoptr(Frame) frame = hand_snap(link, camera, exposure_us, 0, error);
    if (!frame)
        return FALSE;
    const struct picture_values report = picture_values(frame);
    g_autoptr(Record) record = record_new();
    picture_report_tell(record, camera, frame, &report);
    if (way != PICTURE_NOT && !cli_json) {
        fputs(first ? "\033[2J\033[H" : "\033[H", stdout);
        show(frame, way);
        fputs("\033[J", stdout);
    }
    record_print(record, cli_json);
    fflush(stdout);
    return TRUE;
}

static int run_live(const struct call *call, GError **error) {
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    g_autoptr(Link) link = look_begin(call, error);
    if (!link)
        return error && *error ? CLI_FAILED : CLI_USAGE;
    const enum picture_way way = cli_json ? PICTURE_NOT : picture_way(STDOUT_FILENO);
    gboolean ended = FALSE, good = TRUE;
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_unix_signal_add(numbers[i], on_signal, &ended);
    for (int i = 0; good && !ended && (count < 1 || i < count); i++) {
        good = show_next(link, call->arguments[0], way, i == 0, error);
        const gint64 until_us = g_get_monotonic_time() + (gint64)PAUSE_MS * 1000;
        do
            g_main_context_iteration(NULL, FALSE);
        while (!ended && g_get_monotonic_time() < until_us && (g_usleep(5000), TRUE));
    }
    return good && set_lights(link, FALSE, error) ? CLI_DONE : CLI_FAILED;
}

const struct command hands_snap = {
    .name = "snap",
    .arguments = "CAMERA",
    .examples = "  mesorig snap cam45 --lamp lamp30\n"
                "  mesorig snap cam45 -e 2000 -o cam45.png\n",
    .help = "Take a picture, and measure it. Shows the picture with its histogram, saturation and "
            "focus. Not possible during a capture.",
    .options = snap_entries,
    .daemon = TRUE,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run_snap};
const struct command hands_live = {
    .name = "live",
    .arguments = "CAMERA",
    .examples = "  mesorig live cam45 --lamp lamp30\n",
    .help = "Take and show pictures until Ctrl-C, to point and focus a camera.",
    .options = live_entries,
    .daemon = TRUE,
    .min = 1,
    .max = 1,
    .run = run_live};
