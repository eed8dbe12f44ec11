#include "hsh.h"

#include <math.h>
#include <string.h>

#include "codecs/codec/texel_model.h"
#include "exr/exr.h"

#define COLOURS 3

static const char *const hsh_colours[COLOURS] = {"R", "G", "B"};

static char *term_name(int term) {
    return g_strdup_printf("term%d", term);
}

static gsize pixels(const struct hsh *hsh) {
    return hsh->layout.views.n * btf_layout_texels(&hsh->layout);
}

static struct exr_part *term_part(const struct hsh *hsh, int term) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    g_autofree char *name = term_name(term);
    struct exr_part *part = exr_part_new(
        name, hsh->layout.width, hsh->layout.views.n * hsh->layout.height, channels, EXR_HALF);
    for (int c = 0; c < COLOURS; c++) {
        float *plane = exr_part_plane(part, hsh_colours[c]);
        for (gsize i = 0; i < pixels(hsh); i++)
            plane[i] = hsh->values[(i * (gsize)hsh->n_terms + (gsize)term) * COLOURS + (gsize)c];
    }
    return part;
}

gboolean hsh_write(const char *path, const struct hsh *hsh, GError **error) {
    struct exr_file *file = exr_file_new();
    for (int term = 0; term < hsh->n_terms; term++)
        exr_file_add(file, term_part(hsh, term));
    const struct texel_model_head head = {
        .kind = "hsh",
        .name = hsh->name,
        .names = {"mesorig.terms", "mesorig.views"},
        .numbers = {hsh->n_terms, (int)hsh->layout.views.n},
        .error = hsh->error,
        .luminance_error = hsh->luminance_error,
        .exact_error = hsh->exact_error,
    };
    texel_model_write_head(&head, &hsh->layout, file);
    const gboolean ok = exr_write(path, file, EXR_PIZ, TRUE, error);
    exr_file_free(file);
    return ok;
}

static gboolean format_error(const char *path, GError **error, const char *what) {
    g_set_error(
        error, EXR_ERROR, EXR_ERROR_FORMAT,
        "%s: this is not a valid file of hemispherical harmonics: %s; compress the BTF again", path,
        what);
    return FALSE;
}

static gboolean read_head(struct hsh *hsh, const struct exr_file *file, const char *path,
                          GError **error) {
    struct texel_model_head head = {.names = {"mesorig.terms", "mesorig.views"}};
    const char *what = NULL;
    if (g_strcmp0(texel_model_kind(file), "hsh") != 0)
        return format_error(path, error, "mesorig.kind of the first part is not hsh");
    if (!texel_model_read_head(path, file, &head, &hsh->layout, &what, error))
        return what && format_error(path, error, what);
    hsh->name = g_strdup(head.name);
    hsh->n_terms = head.numbers[0];
    hsh->error = head.error;
    hsh->luminance_error = head.luminance_error;
    hsh->exact_error = head.exact_error;
    if (hsh->n_terms != 4 && hsh->n_terms != 9 && hsh->n_terms != 16)
        return format_error(path, error, "mesorig.terms is not 4, 9 or 16");
    if (head.numbers[1] < 1 || (gsize)head.numbers[1] != hsh->layout.views.n)
        return format_error(path, error,
                            "mesorig.views is not the number of views in the part “views”");
    return TRUE;
}

/* Reads a part. Returns NULL on success, otherwise a clause about the part that says what is wrong
 * with it. */
static const char *read_term(struct hsh *hsh, const struct exr_file *file, int term) {
    g_autofree char *name = term_name(term);
    const struct exr_part *part = exr_file_part(file, name);
    if (!part)
        return "is missing";
    if ((gsize)part->width != hsh->layout.width ||
        (gsize)part->height != hsh->layout.views.n * hsh->layout.height)
        return "does not have the size that mesorig.views, mesorig.width and mesorig.height state";
    for (int c = 0; c < COLOURS; c++) {
        const float *plane = exr_part_plane(part, hsh_colours[c]);
        if (!plane)
            return "lacks channel R, G or B";
        if (!exr_all_finite(plane, pixels(hsh)))
            return "has a value that is not finite";
        for (gsize i = 0; i < pixels(hsh); i++)
            hsh->values[(i * (gsize)hsh->n_terms + (gsize)term) * COLOURS + (gsize)c] = plane[i];
    }
    return NULL;
}

static gboolean read_values(struct hsh *hsh, const struct exr_file *file, const char *path,
                            GError **error) {
    hsh->values = g_try_new(float, pixels(hsh) * (gsize)hsh->n_terms * COLOURS);
    if (!hsh->values) {
        g_set_error(error, EXR_ERROR, EXR_ERROR_TOO_LARGE,
                    "%s: there is no memory for its %zu pixels of %d terms; open it on a computer "
                    "with more memory",
                    path, pixels(hsh), hsh->n_terms);
        return FALSE;
    }
    for (int term = 0; term < hsh->n_terms; term++) {
        const char *wrong = read_term(hsh, file, term);
        if (wrong) {
            g_autofree char *what = g_strdup_printf("part term%d %s", term, wrong);
            return format_error(path, error, what);
        }
    }
    return TRUE;
}

struct hsh *hsh_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct hsh *hsh = g_new0(struct hsh, 1);
    if (!file || !read_head(hsh, file, path, error) || !read_values(hsh, file, path, error))
        g_clear_pointer(&hsh, hsh_free);
    exr_file_free(file);
    return hsh;
}
