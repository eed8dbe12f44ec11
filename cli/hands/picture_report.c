#include "picture_report.h"

#include <gio/gio.h>
#include <math.h>

#include "base/output_file.h"
#include "base/png_bytes.h"
#include "capture/thumbnail.h"
#include "exr/exr.h"

/* Draws a histogram as bars. Their heights are proportional to the square roots of the counts, so
 * that small bins stay visible. */
static char *histogram_text(const guint bins[PICTURE_BINS]) {
    static const char *const bars[] = {" ", "▁", "▂", "▃", "▄", "▅", "▆", "▇", "█"};
    GString *text = g_string_new(NULL);
    guint most = 1;
    for (int i = 0; i < PICTURE_BINS; i++)
        most = MAX(most, bins[i]);
    for (int i = 0; i < PICTURE_BINS; i++)
        g_string_append(text, bars[(int)ceil(8 * sqrt((double)bins[i] / most))]);
    return g_string_free(text, FALSE);
}

void picture_report_tell(Record *to, const char *camera, const Frame *frame,
                         const struct picture_values *report) {
    g_autofree char *bars = histogram_text(report->bins);
    const int top = (1 << frame->bits) - 1;
    double bins[PICTURE_BINS];
    for (int i = 0; i < PICTURE_BINS; i++)
        bins[i] = report->bins[i];
    record_say(to,
               "%s{camera}  %d{width} × %d{height} pixels of %d{bits} bits (%s{cfa}), exposed for "
               "%" G_GINT64_FORMAT "{exposure_us} µs\n",
               camera, frame->width, frame->height, frame->bits, cfa_name(frame->cfa),
               frame->exposure_us);
    record_say(to,
               "mean %.0f{mean_dn} DN of %d, brightest %.0f{max_dn}; %.2f{saturated_pct} %% "
               "saturated, %.2f{dark_pct} %% dark; ",
               report->mean_dn, top, report->max_dn, 100 * report->saturated, 100 * report->dark);
    record_say_if(to, report->focus > 0, "focus %.4f{focus}\n", report->focus);
    if (report->focus <= 0)
        record_say(to, "too dark to tell the focus\n");
    record_doubles(to, "histogram", bins, PICTURE_BINS);
    record_say(to, "0 %s %d\n", bars, top);
}

static gboolean write_png(const char *path, const Frame *frame, GError **error) {
    int width = 0, height = 0;
    gsize length = 0;
    g_autofree guint8 *rgb = NULL;
    thumbnail_make_sized(frame, G_MAXINT16, &width, &height, &rgb);
    g_autoptr(GBytes) png = png_bytes(rgb, width, height, error);
    const char *bytes = png ? g_bytes_get_data(png, &length) : NULL;
    return png && output_file_write(path, bytes, length, error);
}

static gboolean write_exr(const char *path, const char *camera, const Frame *frame,
                          GError **error) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part = exr_part_new("frame", frame->width, frame->height, channels, EXR_FLOAT);
    g_autoptr(ExrFile) file = exr_file_new();
    exr_set_string(part, "mesorig.kind", "snap");
    exr_set_string(part, "mesorig.camera", camera);
    exr_set_string(part, "mesorig.cfa", cfa_name(frame->cfa));
    exr_set_double(part, "mesorig.exposure_us", (double)frame->exposure_us);
    exr_set_int(part, "mesorig.bits", frame->bits);
    exr_set_double(part, "mesorig.black_dn", frame->black_level);
    exr_set_string(part, "mesorig.unit", "DN");
    for (gsize i = 0; i < (gsize)part->width * (gsize)part->height; i++)
        part->planes[0][i] = frame->pixels[i];
    exr_file_add(file, part);
    return exr_write(path, file, EXR_PIZ, FALSE, error);
}

gboolean picture_write(const char *path, const char *camera, const Frame *frame, GError **error) {
    if (g_str_has_suffix(path, ".png"))
        return write_png(path, frame, error);
    if (g_str_has_suffix(path, ".exr"))
        return write_exr(path, camera, frame, error);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_FILENAME,
                "%s: pictures are written as PNG or OpenEXR; give a name that ends in .png or .exr",
                path);
    return FALSE;
}
