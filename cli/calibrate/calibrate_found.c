/* Writes the page of --found (calibrate.h). */
#include "calibrate.h"

#include "base/png_bytes.h"
#include "base/srgb.h"
#include "common/page.h"
#include "exr/exr.h"

#include <math.h>
#include <string.h>

#define MAX_SIDE    640  /* maximum width and height of a picture on the page */
#define MAX_EMPTY   8    /* maximum number of pictures without a mark */
#define MAX_REASONS 3    /* maximum number of reasons below a picture */
#define MAX_MARKS   400  /* maximum number of marks that are drawn in a picture */
#define WHITE       0.99 /* Share of the pixels that are darker than the white of the page. */
/* Length that a typical line should have, relative to the width of a picture. */
#define LINE_SHARE 0.03

char *calibrate_found;

/* A picture of the page. */
struct shown {
    const struct calibrate_frame *frame;
    GArray *marks; /* of struct found_mark */
    double rms_px; /* RMS error of the marks that were used */
    int used, left_out;
};

void calibrate_found_add(struct calibrate_job *job, const struct found_mark *mark) {
    if (job->found)
        g_array_append_vals(job->marks, mark, 1);
}

static void clear_shown(gpointer data) {
    g_array_unref(((struct shown *)data)->marks);
}

/* Pictures in which nothing was found come first, then those with the largest errors. */
static gint by_errors(gconstpointer a, gconstpointer b) {
    const struct shown *x = a, *y = b;
    if ((x->used == 0) != (y->used == 0))
        return x->used == 0 ? -1 : 1;
    return (x->rms_px < y->rms_px) - (x->rms_px > y->rms_px);
}

/* Sorts the marks into the pictures, as a GArray of struct shown. Free it with g_array_unref(). */
static GArray *sort_pictures(const struct calibrate_job *job) {
    GArray *all = g_array_new(FALSE, TRUE, sizeof(struct shown));
    g_array_set_clear_func(all, clear_shown);
    for (guint i = 0; i < job->frames->len; i++) {
        const struct shown shown = {.frame = job->frames->pdata[i],
                                    .marks = g_array_new(FALSE, FALSE, sizeof(struct found_mark))};
        g_array_append_val(all, shown);
    }
    for (guint i = 0; i < job->marks->len; i++) {
        const struct found_mark *mark = &g_array_index(job->marks, struct found_mark, i);
        struct shown *to = &g_array_index(all, struct shown, mark->frame);
        g_array_append_vals(to->marks, mark, 1);
        if (mark->is_left_out) {
            to->left_out++;
            continue;
        }
        to->used++;
        to->rms_px += mark->dx_px * mark->dx_px + mark->dy_px * mark->dy_px;
    }
    for (guint i = 0; i < all->len; i++) {
        struct shown *shown = &g_array_index(all, struct shown, i);
        shown->rms_px = sqrt(shown->rms_px / MAX(shown->used, 1));
    }
    g_array_sort(all, by_errors);
    return all;
}

/* Reads a frame as a picture. The picture of a sweep shows the time at which the line passed each
 * pixel. */
static struct picture *read_frame(const struct calibrate_frame *frame, GError **error) {
    if (frame->laser < 0)
        return calibrate_read(frame, error);
    g_autoptr(ExrPart) part = exr_read_part(frame->path, "sweep", error);
    const float *peak = part ? exr_part_plane(part, "peak") : NULL;
    if (!peak)
        return NULL;
    struct picture *picture = picture_new(frame->path, frame->sha256, part->width, part->height);
    memcpy(picture->values, peak, sizeof(float) * (gsize)part->width * (gsize)part->height);
    return picture;
}

static int by_value(gconstpointer a, gconstpointer b) {
    const float *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

/* Returns a picture as PNG. Its width and height are divided by the whole number *ret_reduced. */
static GBytes *draw(const struct picture *picture, int *ret_reduced, GError **error) {
    const int by = (MAX(picture->width, picture->height) + MAX_SIDE - 1) / MAX_SIDE;
    const int width = picture->width / by, height = picture->height / by, n = width * height;
    g_autofree float *grey = g_new0(float, n), *sorted = g_new(float, n);
    g_autofree guint8 *rgb = g_new(guint8, 3 * (gsize)n);
    for (int y = 0; y < height * by; y++)
        for (int x = 0; x < width * by; x++) {
            const float value = picture->values[(gsize)y * (gsize)picture->width + (gsize)x];
            if (value > 0) /* not for NaN, nor for −1, which is no peak */
                grey[y / by * width + x / by] += value / (float)(by * by);
        }
    memcpy(sorted, grey, sizeof *grey * (gsize)n);
    qsort(sorted, (gsize)n, sizeof *sorted, by_value);
    const double white = MAX((double)sorted[(int)(WHITE * (n - 1))], 1e-9);
    for (int i = 0; i < n; i++) {
        const double linear = CLAMP((double)grey[i] / white, 0, 1);
        memset(rgb + 3 * (gsize)i, (int)lround(255 * srgb_encode(linear)), 3);
    }
    *ret_reduced = by;
    return png_bytes(rgb, width, height, error);
}

/* Returns the factor 1, 2, 5, 10, … by which the lines are drawn longer, so that typical lines are
 * visible. */
static int find_stretch(const GArray *all) {
    double sum = 0, width_px = 0;
    int n = 0, stretch = 1;
    for (guint i = 0; i < all->len; i++) {
        const struct shown *shown = &g_array_index(all, struct shown, i);
        sum += shown->used * shown->rms_px * shown->rms_px;
        n += shown->used;
        for (guint k = 0; k < shown->marks->len; k++)
            width_px = MAX(width_px, g_array_index(shown->marks, struct found_mark, k).x_px);
    }
    const double rms_px = sqrt(sum / MAX(n, 1));
    for (int i = 0; rms_px > 0 && i < 9 && stretch * rms_px < LINE_SHARE * width_px; i++)
        stretch = stretch * (i % 3 == 1 ? 5 : 4) / 2;
    return stretch;
}

static void add_marks(GString *to, const struct shown *shown, int width, int stretch) {
    const double r = MAX(width, 64) / 120.0;
    const guint every = shown->marks->len / MAX_MARKS + 1;
    for (guint i = 0; i < shown->marks->len; i += every) {
        const struct found_mark *mark = &g_array_index(shown->marks, struct found_mark, i);
        const double x = mark->x_px + 0.5, y = mark->y_px + 0.5;
        if (mark->is_left_out)
            page_add(to, "<path class=\"out\" d=\"M%.1f %.1fl%.1f %.1fm0 %.1fl%.1f %.1f\"/>", x - r,
                     y - r, 2 * r, 2 * r, -2 * r, -2 * r, 2 * r);
        else
            page_add(to,
                     "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/><path d=\"M%.1f %.1fl%.2f "
                     "%.2f\"/>",
                     x, y, r, x, y, mark->dx_px * stretch, mark->dy_px * stretch);
    }
}

/* Appends the reasons why a picture, or a part of it, was left out. */
static void add_reasons(GString *to, const GPtrArray *reasons, const char *path) {
    const gsize length = strlen(path);
    int n = 0;
    for (guint i = 0; i < reasons->len; i++) {
        const char *line = reasons->pdata[i];
        if (strncmp(line, path, length) != 0 || strncmp(line + length, ": ", 2) != 0)
            continue;
        if (n++ < MAX_REASONS)
            page_add(to, "<br>%s", line + length + 2);
    }
    if (n > MAX_REASONS)
        page_add(to, "<br>and %d more", n - MAX_REASONS);
}

static gboolean add_picture(GString *to, const struct calibrate_job *job, const struct shown *shown,
                            const GPtrArray *reasons, int stretch, GError **error) {
    const struct calibrate_frame *frame = shown->frame;
    const struct rig *rig = &job->calibration->rig;
    g_autoptr(Picture) picture = read_frame(frame, error);
    int reduced;
    g_autoptr(GBytes) png = picture ? draw(picture, &reduced, error) : NULL;
    if (!png)
        return FALSE;
    gsize size;
    const guint8 *bytes = g_bytes_get_data(png, &size);
    g_autofree char *base64 = g_base64_encode(bytes, size);
    g_autoptr(GString) name = g_string_new(rig->cameras[frame->camera].name);
    if (frame->lamp >= 0 && frame->lamp < rig->n_lamps)
        g_string_append_printf(name, " under %s", rig->lamps[frame->lamp].name);
    if (frame->laser >= 0 && frame->laser < rig->n_lasers)
        g_string_append_printf(name, ", sweep of %s", rig->lasers[frame->laser].name);
    g_string_append_printf(name, ", turntable at %.4g°", frame->turntable_deg);
    if (frame->arc_deg != 0)
        g_string_append_printf(name, ", arc at %.4g°", frame->arc_deg);
    page_add(to,
             "<figure class=\"found\"><svg viewBox=\"0 0 %d %d\" role=\"img\" "
             "aria-label=\"%s: %d marks\"><image width=\"%d\" height=\"%d\" "
             "href=\"data:image/png;base64,%s\"/>",
             picture->width, picture->height, name->str, shown->used,
             picture->width / reduced * reduced, picture->height / reduced * reduced, base64);
    add_marks(to, shown, picture->width, stretch);
    page_add(to, "</svg><figcaption><b>%s</b><br>", name->str);
    if (shown->used > 0 && !job->is_outline)
        page_add(to, "%d found", shown->used);
    else if (shown->used == 0)
        g_string_append(to, "<span class=\"failure\">nothing found</span>");
    if (shown->rms_px > 0)
        page_add(to, ", %.3f px RMS", shown->rms_px);
    if (shown->left_out > 0)
        page_add(to, ", <span class=\"warning\">%d left out</span>", shown->left_out);
    add_reasons(to, reasons, frame->path);
    g_string_append(to, "</figcaption></figure>\n");
    return TRUE;
}

/* Appends the part of the page that precedes the pictures. */
static void add_head(GString *to, const struct calibrate_job *job, const GArray *all, int shown,
                     int stretch) {
    int used = 0, left_out = 0, empty = 0;
    for (guint i = 0; i < all->len; i++) {
        const struct shown *at = &g_array_index(all, struct shown, i);
        used += at->used;
        left_out += at->left_out;
        empty += at->used == 0;
    }
    if (!job->is_outline)
        page_add(to, "<p>%d places were found in %u pictures, and %d left out.</p>\n", used,
                 all->len, left_out);
    if (empty > 0)
        page_add(to, "<p class=\"warning\">In %d pictures nothing was found.</p>\n", empty);
    if (job->marks_say)
        page_add(to, "<p>%s</p>\n", job->marks_say);
    else
        page_add(to,
                 "<p>A circle is where something was seen. Its line points to where the "
                 "calibration expects it, and is drawn %d times as long as the error. A cross did "
                 "not fit the others.</p>\n",
                 stretch);
    if (shown < (int)all->len)
        page_add(to, "<p class=\"faint\">%d of %u pictures are shown, the worst first.</p>\n",
                 shown, all->len);
}

gboolean calibrate_found_write(struct calibrate_job *job, const GError *why, GError **error) {
    g_autofree char *title = g_strdup_printf("Calibration of %s: what was found", job->part);
    g_autoptr(GArray) all = sort_pictures(job);
    g_autoptr(GString) pictures = g_string_new(NULL);
    const int stretch = find_stretch(all);
    const GPtrArray *reasons = job->rejected;
    int n = 0, empty = 0;
    for (int i = 0; !why && i < CALIBRATION_PARTS; i++)
        if (strcmp(calibration_part_name((enum calibration_kind)i), job->part) == 0)
            reasons = job->calibration->parts[i].rejected;
    for (guint i = 0; job->calibration && i < all->len && n < CALIBRATE_FOUND_PICTURES; i++) {
        const struct shown *shown = &g_array_index(all, struct shown, i);
        g_autoptr(GError) unread = NULL;
        if (!why && shown->used == 0 && empty++ >= MAX_EMPTY)
            continue;
        if (!add_picture(pictures, job, shown, reasons, stretch, &unread))
            page_add(pictures, "<p class=\"failure\">%s</p>\n", unread->message);
        n++;
    }
    GString *page = page_begin(title);
    g_string_append(
        page,
        "<style>h1{font-size:1.4em}.all{display:grid;grid-template-columns:repeat(auto-fill,minmax("
        "min(16em,100%),1fr));gap:1em}.all figure{margin:0}.found "
        "svg{display:block;width:100%;height:auto;"
        "background:#000}.found circle,.found path{fill:none;stroke:#3ddc84;"
        "stroke-width:1.5px;vector-effect:non-scaling-stroke}"
        ".found .out{stroke:#ff5c66}</style>\n");
    page_add(page, "<h1>%s</h1>\n", title);
    if (why)
        page_add(page, "<p class=\"failure\">%s</p>\n", why->message);
    else
        add_head(page, job, all, n, stretch);
    g_string_append_printf(page, "<div class=\"all\">%s</div>\n", pictures->str);
    g_autofree char *text = page_end(page);
    return output_file_put(job->found, text, strlen(text), error);
}
