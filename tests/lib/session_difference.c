#include "session_difference.h"

/* With holes, values below 0 mean that there is no value, as in the MDF. */
static void difference_planes(const float *a, const float *b, gsize n, gboolean holes,
                              struct difference_sums *sums) {
    for (gsize i = 0; i < n; i++) {
        gboolean has_a = !holes || a[i] >= 0, has_b = !holes || b[i] >= 0;
        sums->all++;
        sums->unequal += has_a != has_b;
        if (!has_a || !has_b || !isfinite(a[i]) || !isfinite(b[i]))
            continue;
        double d = (double)b[i] - (double)a[i];
        sums->n++;
        sums->sum += d;
        sums->reference_sum += (double)a[i];
        sums->squares += d * d;
        sums->reference += (double)a[i] * (double)a[i];
    }
}

/* Returns whether a channel contains flags. Such a channel exists only if a texel has a flag, which
 * depends on the noise. */
static gboolean is_mark(const char *channel) {
    return strcmp(channel, "mark") == 0 || strcmp(channel, "saturated") == 0;
}

/* Returns FALSE if the parts of the files do not match. */
static gboolean difference_files(const char *path_a, const char *path_b, gboolean holes,
                                 struct difference_sums *sums, GError **error) {
    struct exr_file *a = exr_read(path_a, error), *b = a ? exr_read(path_b, error) : NULL;
    gboolean same = a && b && a->parts->len == b->parts->len;
    for (guint i = 0; same && i < a->parts->len; i++) {
        const struct exr_part *x = a->parts->pdata[i], *y = b->parts->pdata[i];
        same = x->width == y->width && x->height == y->height;
        for (int c = 0; same && c < x->n_channels; c++) {
            const float *other = exr_part_plane(y, x->channels[c]);
            if (is_mark(x->channels[c]))
                continue;
            same = other != NULL;
            if (same)
                difference_planes(x->planes[c], other, (gsize)x->width * (gsize)x->height, holes,
                                  sums);
        }
    }
    if (a && b && !same)
        g_set_error(error, EXR_ERROR, EXR_ERROR_FORMAT, "%s and %s have different parts", path_a,
                    path_b);
    exr_file_free(a);
    exr_file_free(b);
    return same;
}

gboolean difference_folder(const char *session_a, const char *session_b, const char *folder,
                           gboolean holes, struct difference *ret, GError **error) {
    g_autofree char *in_a = g_build_filename(session_a, folder, NULL);
    g_autofree char *in_b = g_build_filename(session_b, folder, NULL);
    g_autoptr(GDir) dir = g_dir_open(in_a, 0, error);
    struct difference_sums sums = {0};
    const char *name;
    *ret = (struct difference){0};
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *a = g_build_filename(in_a, name, NULL);
        g_autofree char *b = g_build_filename(in_b, name, NULL);
        if (!g_str_has_suffix(name, ".exr") || (holes && !g_str_equal(name, "mdf.exr")))
            continue;
        if (!difference_files(a, b, holes, &sums, error))
            return FALSE;
        ret->n_files++;
    }
    if (!dir)
        return FALSE;
    ret->n_values = sums.n;
    ret->rms = sqrt(sums.squares / MAX(sums.reference, 1e-300));
    ret->systematic = sums.reference_sum != 0 ? sums.sum / sums.reference_sum : 0;
    ret->seen_differently = sums.all ? (double)sums.unequal / (double)sums.all : 0;
    return TRUE;
}
