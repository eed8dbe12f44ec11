#include "test_report.h"

#include "base/plural.h"
#include "base/png_bytes.h"
#include "capture/thumbnail.h"
#include "common/page.h"
#include "drivers/recording.h"

#include <math.h>
#include <string.h>
#include <sys/utsname.h>

#define PICTURE_SIDE 480 /* maximum width and height of a picture on the page in pixels */
/* Minimum length in bytes of a path or address that is hidden. A shorter text could be part of any
 * word. */
#define MIN_PLACE 4

static void result_free(gpointer data) {
    struct test_result *result = data;
    g_array_unref(result->moves);
    g_free(result->class_name);
    g_free(result->name);
    g_free(result->driver);
    g_free(result->said);
    g_free(result);
}

static void picture_free(gpointer data) {
    struct test_picture *picture = data;
    frame_unref(picture->frame);
    g_free(picture->camera);
    g_free(picture->light);
    g_free(picture);
}

void test_report_init(struct test_report *report) {
    *report = (struct test_report){.results = g_ptr_array_new_with_free_func(result_free),
                                   .pictures = g_ptr_array_new_with_free_func(picture_free)};
}

void test_report_clear(struct test_report *report) {
    g_ptr_array_unref(report->results);
    g_ptr_array_unref(report->pictures);
    g_free(report->rig);
    g_free(report->recording);
}

struct test_result *test_report_add(struct test_report *report, const char *class_name,
                                    const char *name, const char *driver) {
    struct test_result *result = g_new0(struct test_result, 1);
    *result = (struct test_result){.class_name = g_strdup(class_name),
                                   .name = g_strdup(name),
                                   .driver = g_strdup(driver),
                                   .moves = g_array_new(FALSE, FALSE, sizeof(struct test_move)),
                                   .on_s = NAN,
                                   .off_s = NAN,
                                   .rise_dn = NAN};
    g_ptr_array_add(report->results, result);
    return result;
}

struct test_picture *test_report_add_picture(struct test_report *report, const char *camera,
                                             const char *light, Frame *frame) {
    struct test_picture *picture = NULL;
    for (guint i = 0; i < report->pictures->len && !picture; i++) {
        struct test_picture *other = report->pictures->pdata[i];
        picture = strcmp(other->camera, camera) == 0 ? other : NULL;
    }
    if (!picture) {
        picture = g_new0(struct test_picture, 1);
        picture->camera = g_strdup(camera);
        picture->noise_dn = NAN;
        g_ptr_array_add(report->pictures, picture);
    }
    g_clear_pointer(&picture->frame, frame_unref);
    g_free(picture->light);
    picture->light = g_strdup(light);
    picture->frame = frame_ref(frame);
    picture->report = picture_values(frame);
    return picture;
}

double test_noise_dn(const Frame *a, const Frame *b) {
    const gsize n = (gsize)a->width * (gsize)a->height;
    double sum = 0, squares = 0;
    if (a->width != b->width || a->height != b->height)
        return NAN;
    for (gsize i = 0; i < n; i++) {
        const double difference = (double)a->pixels[i] - b->pixels[i];
        sum += difference;
        squares += difference * difference;
    }
    const double mean = sum / (double)n;
    return sqrt(MAX(squares / (double)n - mean * mean, 0) / 2);
}

static gboolean is_good(const struct test_report *report) {
    gboolean good = !report->failed && report->results->len > 0;
    for (guint i = 0; i < report->results->len; i++)
        good &= ((const struct test_result *)report->results->pdata[i])->good;
    return good;
}

static void add_verdict(GString *to, gboolean good) {
    page_add(to, "<td class=\"%s\">%s</td>", good ? "pass" : "failure", good ? "pass" : "failure");
}

static void add_number(GString *to, const char *format, double value) {
    g_autofree char *text = isfinite(value) ? g_strdup_printf(format, value) : g_strdup("–");
    page_add(to, "<td class=\"n\">%s</td>", text);
}

/* Returns whether a line of a recording is "TIME [DEVICE] …", and not a message. */
static gboolean is_device_line(const char *line) {
    while (*line == ' ' || g_ascii_isdigit(*line))
        line++;
    return *line == '[';
}

/* Adds a row for each device of a recording. The row has the text that the device gave as `result`.
 * For "opened" and the axis "turntable", this is the text after "[axis turntable] = opened: ". */
static void add_said(GString *to, const char *recording, const char *result) {
    g_autofree char *mark = g_strdup_printf("] = %s: ", result);
    g_auto(GStrv) lines = g_strsplit(recording, "\n", -1);
    for (char **line = lines; *line; line++) {
        const char *name = strchr(*line, '['), *said = name ? strstr(name, mark) : NULL;
        if (!said || !is_device_line(*line))
            continue;
        g_autofree char *device = g_strndup(name + 1, (gsize)(said - name - 1));
        page_add_row(to, device, said + strlen(mark));
    }
}

void test_report_hide_places(struct test_report *report, const char *rig) {
    g_autoptr(Config) config = config_load(rig, NULL);
    gsize n = 0;
    const struct config_section *sections = config ? config_sections(config, &n) : NULL;
    for (gsize i = 0; i < n; i++)
        for (const char *const *key = config_keys(&sections[i]); *key; key++) {
            const char *value = config_value(&sections[i], *key, NULL);
            if (!recording_is_place(*key) || strlen(value) < MIN_PLACE)
                continue;
            for (guint k = 0; k < report->results->len; k++) {
                struct test_result *result = report->results->pdata[k];
                g_autoptr(GString) said = g_string_new(result->said);
                g_string_replace(said, value, "…", 0);
                g_free(result->said);
                result->said = g_strdup(said->str);
            }
        }
}

static void add_facts(GString *to, const struct test_report *report) {
    struct utsname system = {0};
    g_autoptr(GDateTime) now = g_date_time_new_now_utc();
    g_autofree char *date = g_date_time_format(now, "%Y-%m-%d");
    uname(&system);
    g_autofree char *kernel =
        g_strdup_printf("%s %s %s", system.sysname, system.release, system.machine);
    int good = 0;
    for (guint i = 0; i < report->results->len; i++)
        good += ((const struct test_result *)report->results->pdata[i])->good;
    g_autofree char *devices =
        g_strdup_printf("%d of %u as they should be", good, report->results->len);
    g_string_append(to, "<table>\n");
    page_add_row(to, "Devices", devices);
    page_add_row(to, "Date", date);
    page_add_row(to, "Program", "mesorig " MESORIG_VERSION);
    page_add_row(to, "Kernel", kernel);
    if (report->failed)
        add_said(to, report->recording, "failed");
    g_string_append(to, "</table>\n");
}

static void add_checks(GString *to, const struct test_report *report) {
    if (report->results->len == 0)
        return;
    g_string_append(to, "<h2>Checks</h2>\n<div class=\"wide\"><table><tr><th>result</th>"
                        "<th>device</th><th style=\"min-width:12em\">found</th>"
                        "<th class=\"n\">s</th><th>driver</th></tr>\n");
    for (guint i = 0; i < report->results->len; i++) {
        const struct test_result *result = report->results->pdata[i];
        g_string_append(to, "<tr>");
        add_verdict(to, result->good);
        page_add(to, "<th>%s %s</th><td>%s</td>", result->class_name, result->name, result->said);
        add_number(to, "%.1f", result->seconds);
        page_add(to, "<td>%s</td></tr>\n", result->driver);
    }
    g_string_append(to, "</table></div>\n");
}

static void add_moves(GString *to, const struct test_report *report) {
    gboolean any = FALSE;
    for (guint i = 0; i < report->results->len; i++) {
        const struct test_result *result = report->results->pdata[i];
        for (guint k = 0; k < result->moves->len; k++) {
            const struct test_move *move = &g_array_index(result->moves, struct test_move, k);
            if (!any)
                g_string_append(to, "<h2>Positions</h2>\n<div class=\"wide\"><table><tr>"
                                    "<th>axis</th><th class=\"n\">commanded</th>"
                                    "<th class=\"n\">reached</th><th class=\"n\">difference</th>"
                                    "<th class=\"n\">s</th></tr>\n");
            any = TRUE;
            page_add(to, "<tr><th>%s</th>", result->name);
            if (move->homes)
                g_string_append(to, "<td class=\"n\">reference</td>");
            else
                add_number(to, "%.4f°", move->target_deg);
            add_number(to, "%.4f°", move->reached_deg);
            add_number(to, "%+.4f°", move->homes ? NAN : move->reached_deg - move->target_deg);
            add_number(to, "%.2f", move->seconds);
            g_string_append(to, "</tr>\n");
        }
    }
    if (any)
        g_string_append(to, "</table></div>\n");
}

static void add_lights(GString *to, const struct test_report *report) {
    gboolean any = FALSE;
    for (guint i = 0; i < report->results->len; i++) {
        const struct test_result *result = report->results->pdata[i];
        if (!result->confirmed)
            continue;
        if (!any)
            g_string_append(to, "<h2>Lights</h2>\n<p class=\"faint\">The time until the device has "
                                "confirmed a command, with the warm-up, and how much brighter the "
                                "light has made the picture of a camera.</p>\n<div "
                                "class=\"wide\"><table><tr><th>light</th><th class=\"n\">on, s</th>"
                                "<th class=\"n\">off, s</th><th>confirmed</th>"
                                "<th class=\"n\">brighter, DN</th></tr>\n");
        any = TRUE;
        page_add(to, "<tr><th>%s %s</th>", result->class_name, result->name);
        add_number(to, "%.2f", result->on_s);
        add_number(to, "%.2f", result->off_s);
        page_add(to, "<td>%s</td>", result->confirmed);
        add_number(to, "%.1f", result->rise_dn);
        g_string_append(to, "</tr>\n");
    }
    if (any)
        g_string_append(to, "</table></div>\n");
}

/* Adds the histogram as a drawing. The heights of its bars are proportional to the square roots of
 * the counts, so that small bins stay visible. */
static void add_histogram(GString *to, const struct test_picture *picture) {
    const int width = 8, height = 100;
    guint most = 1;
    for (int i = 0; i < PICTURE_BINS; i++)
        most = MAX(most, picture->report.bins[i]);
    page_add(to,
             "<figure><svg role=\"img\" aria-label=\"Histogram of %s\" viewBox=\"0 0 %d %d\" "
             "width=\"%d\" style=\"max-width:100%%;display:block\"><rect width=\"100%%\" "
             "height=\"100%%\" fill=\"none\" stroke=\"currentColor\" stroke-opacity=\".3\"/>",
             picture->camera, PICTURE_BINS * width, height, PICTURE_BINS * 5);
    for (int i = 0; i < PICTURE_BINS; i++) {
        const int bar = (int)ceil(height * sqrt((double)picture->report.bins[i] / most));
        if (bar > 0)
            page_add(to,
                     "<rect x=\"%d\" y=\"%d\" width=\"%d\" height=\"%d\" fill=\"currentColor\"/>",
                     i * width, height - bar, width - 1, bar);
    }
    page_add(to,
             "</svg><figcaption>Histogram from 0 to %d DN, heights as square roots</figcaption>"
             "</figure>\n",
             (1 << picture->frame->bits) - 1);
}

static void add_picture(GString *to, const struct test_picture *picture) {
    const Frame *frame = picture->frame;
    const struct picture_values *report = &picture->report;
    int width, height;
    g_autofree guint8 *rgb = NULL;
    thumbnail_make_sized(frame, PICTURE_SIDE, &width, &height, &rgb);
    g_autoptr(GBytes) png = png_bytes(rgb, width, height, NULL);
    g_autofree char *caption =
        g_strdup_printf("%s%s%s, %" G_GINT64_FORMAT " µs; white is the 99th percentile, %.0f DN",
                        picture->camera, picture->light ? " under " : " in the dark",
                        picture->light ? picture->light : "", frame->exposure_us, report->high_dn);
    g_autofree char *size = g_strdup_printf("%d × %d pixels of %d bits, %s", frame->width,
                                            frame->height, frame->bits, cfa_name(frame->cfa));
    g_autofree char *exposure = g_strdup_printf("%" G_GINT64_FORMAT " µs", frame->exposure_us);
    g_autofree char *values = g_strdup_printf("mean %.1f DN, brightest %.0f DN, black %.1f DN",
                                              report->mean_dn, report->max_dn, frame->black_level);
    g_autofree char *shares = g_strdup_printf("%.2f %% saturated, %.2f %% dark",
                                              100 * report->saturated, 100 * report->dark);
    g_autofree char *noise =
        isfinite(picture->noise_dn)
            ? g_strdup_printf("%.2f DN RMS in the dark, from two pictures", picture->noise_dn)
            : NULL;
    page_add(to, "<h3>%s</h3>\n", picture->camera);
    if (png)
        page_add_picture(to, png, caption);
    add_histogram(to, picture);
    g_string_append(to, "<table>\n");
    page_add_row(to, "Size", size);
    page_add_row(to, "Exposure", exposure);
    page_add_row(to, "Values", values);
    page_add_row(to, "Shares", shares);
    page_add_row(to, "Noise", noise);
    g_string_append(to, "</table>\n");
}

/* Adds what the devices call themselves. */
static void add_identities(GString *to, const char *recording) {
    g_autoptr(GString) rows = g_string_new(NULL);
    add_said(rows, recording, "opened");
    if (rows->len > 0)
        g_string_append_printf(
            to, "<h2>Devices, as they call themselves</h2>\n<table>\n%s</table>\n", rows->str);
}

char *test_report_page(const struct test_report *report) {
    const gboolean good = is_good(report);
    g_autofree char *title = g_strdup_printf("Test of the rig %s", report->rig);
    GString *to = page_begin(title);
    page_add(to, "<h1>%s</h1>\n<p>All devices together: <span class=\"%s\">%s</span></p>\n", title,
             good ? "pass" : "failure", good ? "pass" : "failure");
    add_facts(to, report);
    add_checks(to, report);
    if (report->recording)
        add_identities(to, report->recording);
    add_moves(to, report);
    add_lights(to, report);
    if (report->pictures->len > 0)
        g_string_append(to, "<h2>Cameras</h2>\n");
    for (guint i = 0; i < report->pictures->len; i++)
        add_picture(to, report->pictures->pdata[i]);
    if (report->recording)
        page_add(to,
                 "<h2>Recording</h2>\n<p>What the devices said on their buses. To replay it, copy "
                 "the text into a file.</p>\n<details><summary>Text of the recording</summary>\n"
                 "<pre style=\"overflow-x:auto;font-size:12px\">%s</pre></details>\n",
                 report->recording);
    return page_end(to);
}
