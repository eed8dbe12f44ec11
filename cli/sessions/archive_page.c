/* Writes an archive as a page: one file that a browser shows without a network. */
#include "archive.h"
#include "base/plural.h"
#include "common/page.h"

#include "plan/report.h"

#include <math.h>
#include <string.h>

#define MAX_EVENTS   200
#define MAX_PRODUCTS 40

/* Returns a text such as "2 h 05 min, the plan said 2 h 01 min". */
static char *compared(double found, double planned, char *(*print)(double)) {
    g_autofree char *a = isfinite(found) ? print(found) : g_strdup("not known");
    g_autofree char *b = isfinite(planned) ? print(planned) : NULL;
    return b ? g_strdup_printf("%s, the plan said %s", a, b) : g_steal_pointer(&a);
}

static char *size_text(double bytes) {
    return g_format_size((guint64)MAX(bytes, 0));
}

static void add_facts(GString *to, const struct archive *archive) {
    const struct session_grid *grid = &archive->grid;
    g_autofree char *texels =
        g_strdup_printf("%g × %g mm, %d × %d texels, reference plane at %g mm", grid->width_mm,
                        grid->height_mm, grid->width, grid->height, grid->reference_mm);
    g_autofree char *directions =
        g_strdup_printf("%d %s, %d %s, %d laser %s", PLURAL(archive->views, "view"),
                        PLURAL(archive->lights, "light"), PLURAL(archive->lasers, "position"));
    g_autofree char *shots = g_strdup_printf(
        "%d of %d done, %d skipped, %d not needed; %d frames, %d retakes", archive->done,
        archive->planned + archive->done + archive->skipped + archive->unneeded, archive->skipped,
        archive->unneeded, archive->frames, archive->retakes);
    g_autofree char *time = compared(archive->clock_s, archive->predicted_s, report_duration);
    g_autofree char *disk =
        compared((double)archive->frame_bytes, archive->predicted_bytes, size_text);
    /* A text such as "2026-01-31 12:00:00 UTC". */
    g_autofree char *created =
        g_strdup_printf("%.10s %.8s UTC", archive->created,
                        strlen(archive->created) > 18 ? archive->created + 11 : "");
    g_autofree char *products = size_text((double)archive->product_bytes);
    g_autofree char *processing =
        isfinite(archive->processing_s) ? report_duration(archive->processing_s) : NULL;
    const char *const rows[][2] = {
        {"Sample", archive->sample},
        {"Operator", archive->operator_name},
        {"Notes", archive->notes},
        {"Licence", archive->license},
        {"Imported from", archive->imported},
        {"Planned", created},
        {"State", archive->state},
        {"Size", texels},
        {"Directions", directions},
        {"Exposures chosen", archive->chosen},
        {"Shots", shots},
        {"Capture", archive->imported ? NULL : time},
        {"Frames on disk", disk},
        {"Products on disk", products},
        {"Processing", processing},
        {"Rig", archive->calibration ? archive->calibration->rig.id : NULL},
        {"Calibration", archive->imported ? NULL : archive->calibrated.where},
        {"Captured by", archive->program},
        {"Reported by", "mesorig " MESORIG_VERSION}};
    g_string_append(to, "<table>\n");
    for (gsize i = 0; i < G_N_ELEMENTS(rows); i++)
        page_add_row(to, rows[i][0], rows[i][1]);
    g_string_append(to, "</table>\n");
}

static void add_checks(GString *to, const struct archive *archive) {
    g_string_append(to, "<h2>Checks</h2>\n<table>\n");
    for (guint i = 0; i < archive->checks->len; i++) {
        const struct archive_check *check = archive->checks->pdata[i];
        const char *verdict = archive_verdict_name(check->verdict);
        page_add(to, "<tr><td class=\"%s\">%s</td><th>%s</th><td>%s</td></tr>\n", verdict, verdict,
                 check->name, check->said);
    }
    g_string_append(to, "</table>\n");
}

static void add_share(GString *to, double share) {
    if (isfinite(share))
        page_add(to, "<td class=\"n\">%.3g %%</td>", 100 * share);
    else
        g_string_append(to, "<td class=\"n faint\">–</td>");
}

static void add_rings(GString *to, const struct archive *archive) {
    g_string_append(
        to, "<h2>Coverage and error bars</h2>\n<p>By the angle of the view from the normal. Holes, "
            "lower "
            "bounds (saturated), values of only shorter exposures and predicted values are shares "
            "of the BTF’s values; σ is the median standard error of a value. The surface is "
            "measured where the view itself sees it, and supplied where other views do.</p>\n<div "
            "class=\"wide\"><table><tr><th class=\"n\">θ</th><th class=\"n\">views</th><th "
            "class=\"n\">pictures</th><th class=\"n\">holes</th><th class=\"n\">bounds</th><th "
            "class=\"n\">shorter</th><th class=\"n\">predicted</th><th class=\"n\">σ</th><th "
            "class=\"n\">surface measured</th><th class=\"n\">supplied</th></tr>\n");
    for (guint i = 0; i < archive->rings->len; i++) {
        const struct archive_ring *ring = &g_array_index(archive->rings, struct archive_ring, i);
        const double shares[] = {ring->holes, ring->bounds,   ring->shorter, ring->predicted,
                                 ring->sigma, ring->measured, ring->supplied};
        page_add(to, "<tr><td class=\"n\">%.0f°</td><td class=\"n\">%d</td><td class=\"n\">%d</td>",
                 ring->theta_deg, ring->views, ring->pictures);
        for (gsize k = 0; k < G_N_ELEMENTS(shares); k++)
            add_share(to, shares[k]);
        g_string_append(to, "</tr>\n");
    }
    g_string_append(to, "</table></div>\n");
}

static void add_images(GString *to, const struct archive *archive) {
    if (archive->pictures->len > 0)
        g_string_append(to, "<h2>Pictures</h2>\n<p class=\"faint\">The camera’s own colours; each "
                            "group has one scale.</p>\n");
    for (guint i = 0; i < archive->pictures->len; i++) {
        const struct archive_picture *picture = archive->pictures->pdata[i];
        page_add_picture(to, picture->png, picture->caption);
    }
}

static void add_calibration(GString *to, const struct archive *archive) {
    const struct calibration *calibration = archive->calibration;
    if (!calibration)
        return;
    page_add(to, "<h2>Calibration</h2>\n<p>The products were made with: %s%s.</p>\n",
             archive->calibrated.where,
             archive->calibrated.own
                 ? ", as the session was captured"
                 : ", given to mesorig process -c; the session was captured with "
                   "another");
    g_string_append(to, "<div class=\"wide\"><table><tr><th>part</th>"
                        "<th>date</th><th>method</th><th class=\"n\">pictures</th>"
                        "<th class=\"n\">rejected</th><th class=\"n\">residual</th></tr>\n");
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        const struct calibration_part *part = &calibration->parts[i];
        const char *name = calibration_part_name((enum calibration_kind)i);
        if (part->done)
            page_add(
                to,
                "<tr><th>%s</th><td>%s</td><td>%s</td><td class=\"n\">%d</td><td class=\"n\">%u"
                "</td><td class=\"n\">%.3g %s</td></tr>\n",
                name, part->date, part->method, part->pictures, part->rejected->len,
                part->residual_rms, part->residual_unit);
        else
            page_add(to, "<tr><th>%s</th><td colspan=\"5\">not calibrated: nominal</td></tr>\n",
                     name);
    }
    g_string_append(to, "</table></div>\n");
}

static void add_devices(GString *to, const struct archive *archive) {
    if (archive->devices->len == 0)
        return;
    g_string_append(to, "<h2>Rig</h2>\n<details><summary>Sections of its file</summary>\n<table>"
                        "<tr><th>section</th><th>driver</th><th>device</th></tr>\n");
    for (guint i = 0; i < archive->devices->len; i++) {
        const struct archive_device *device = archive->devices->pdata[i];
        page_add(to, "<tr><td>%s</td><td>%s</td><td>%s</td></tr>\n", device->section,
                 device->driver, device->address);
    }
    g_string_append(to, "</table></details>\n");
}

static void add_events(GString *to, const struct archive *archive) {
    guint shown = 0;
    g_string_append(to, "<h2>Events</h2>\n<details><summary>What happened</summary>\n<table>\n");
    for (guint i = 0; i < archive->events->len && shown < MAX_EVENTS; i++, shown++) {
        const struct session_event *event = archive->events->pdata[i];
        const char *verdict = g_str_equal(event->level, "error")     ? "failure"
                              : g_str_equal(event->level, "warning") ? "warning"
                                                                     : "faint";
        page_add(
            to,
            "<tr><td class=\"n\">%.0f s</td><td class=\"%s\">%s</td><td>%s</td><td>%s</td></tr>\n",
            event->time_s, verdict, event->level, event->source, event->message);
    }
    g_string_append(to, "</table>\n");
    if (shown < archive->events->len)
        page_add(to, "<p>… and %u more: mesorig info --json</p>\n", archive->events->len - shown);
    g_string_append(to, "</details>\n");
}

/* Adds the list of products. There are too many views of the BTF to list them, so only their number
 * and size are given. */
static void add_products(GString *to, const struct archive *archive) {
    int shown = 0, views = 0;
    gint64 view_bytes = 0;
    g_string_append(to, "<h2>Products</h2>\n<div class=\"wide\"><table><tr><th>file</th>"
                        "<th class=\"n\">size</th><th>SHA-256</th></tr>\n");
    for (guint i = 0; i < archive->products->len; i++) {
        const struct session_product *product = archive->products->pdata[i];
        g_autofree char *size = size_text((double)product->bytes);
        if (g_str_has_prefix(product->path, "products/btf/")) {
            views++;
            view_bytes += product->bytes;
        } else if (shown++ < MAX_PRODUCTS) {
            page_add(to, "<tr><td>%s</td><td class=\"n\">%s</td><td><code>%s</code></td></tr>\n",
                     product->path, size, product->sha256);
        }
    }
    g_autofree char *size = size_text((double)view_bytes);
    if (views > 0)
        page_add(to,
                 "<tr><td>products/btf, %d %s</td><td class=\"n\">%s</td><td class=\"faint\">in "
                 "session.db</td></tr>\n",
                 PLURAL(views, "view"), size);
    g_string_append(to, "</table></div>\n");
}

char *archive_page(const struct archive *archive, const char *history) {
    GString *to = page_begin(archive->name);
    const enum archive_verdict verdict = archive_verdict(archive);
    const char *name = archive_verdict_name(verdict);
    page_add(to, "<h1>%s</h1>\n<p>%s <span class=\"%s\">%s</span></p>\n", archive->name,
             "All checks together:", name, name);
    add_facts(to, archive);
    add_checks(to, archive);
    add_images(to, archive);
    if (history)
        g_string_append_printf(to, "<h2>Capture</h2>\n<div class=\"history\">%s</div>\n", history);
    add_rings(to, archive);
    add_calibration(to, archive);
    add_devices(to, archive);
    add_events(to, archive);
    add_products(to, archive);
    return page_end(to);
}
