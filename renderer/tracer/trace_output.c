#include "trace_output.h"

#include "base/output_file.h"
#include "base/png_bytes.h"
#include "base/srgb.h"
#include "exr/exr.h"

#include <string.h>

gboolean trace_write_exr(const TracePicture *picture, const struct trace_options *options,
                         const char *path, GError **error) {
    static const char *const colours[] = {"B", "G", "R", NULL}, *const luminance[] = {"Y", NULL};
    const gsize n = (gsize)picture->width * (gsize)picture->height;
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *part =
        exr_part_new("picture", picture->width, picture->height, colours, EXR_FLOAT);
    struct exr_part *variance =
        exr_part_new("variance", picture->width, picture->height, luminance, EXR_FLOAT);
    exr_file_add(file, part);
    exr_file_add(file, variance);
    exr_set_string(part, "mesorig.kind", "trace");
    exr_set_int(part, "samples", options->samples);
    exr_set_int(part, "depth", options->depth);
    for (int c = 0; c < 3; c++)
        for (gsize k = 0; k < n; k++)
            part->planes[2 - c][k] = picture->rgb[3 * k + (gsize)c];
    memcpy(variance->planes[0], picture->variance, n * sizeof(float));
    return exr_write(path, file, EXR_ZIP, FALSE, error);
}

static guint8 shown(double x) {
    if (!(x > 0.0))
        return 0;
    if (x > 0.8)
        x = 1.0 - 0.2 * exp((0.8 - x) / 0.2);
    return (guint8)CLAMP(lround(255.0 * srgb_encode(x)), 0, 255);
}

gboolean trace_write_png(const TracePicture *picture, double exposure_ev, const char *path,
                         GError **error) {
    const gsize n = 3 * (gsize)picture->width * (gsize)picture->height;
    const double exposure = 0.8 * exp2(exposure_ev);
    g_autofree guint8 *rgb = g_new(guint8, n);
    for (gsize k = 0; k < n; k++)
        rgb[k] = shown(exposure * (double)picture->rgb[k]);
    g_autoptr(GBytes) png = png_bytes(rgb, picture->width, picture->height, error);
    gsize size;
    const char *bytes = png != NULL ? g_bytes_get_data(png, &size) : NULL;
    return bytes != NULL && output_file_write(path, bytes, size, error);
}
