/* BDI is copied view by view; FMF and DFMF are factored by local PCA with one cluster. */
#include "export.h"

#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "btf/btf.h"
#include "codecs/lpca/lpca.h"
#include "exr/exr.h"
#include "exr/exr_half.h"

#define COLOURS 3

static const char *const channels[] = {"R", "G", "B"};

/* The properties that all views of a session's BTF share. */
struct source {
    struct session_grid grid;
    GPtrArray *paths; /* files of the views, in order */
    struct bonn_header header;
};

static gboolean direction(const struct exr_part *part, const char *of, const char *path,
                          float *ret_theta_deg, float *ret_phi_deg, GError **error) {
    return btf_direction(part, of, ret_theta_deg, ret_phi_deg) ||
           data_error_fail(path, 0, error,
                           "in part %s the attribute %s.theta_deg or %s.phi_deg is missing or not "
                           "a finite number" BTF_AGAIN,
                           part->name, of, of);
}

/* Reads the directions of all views, and the lights of the first view. */
static gboolean read_directions(struct source *source, GError **error) {
    struct bonn_header *header = &source->header;
    const int n = header->n_views = (int)source->paths->len;
    gboolean ok = TRUE;
    header->view_theta_deg = g_new0(float, n);
    header->view_phi_deg = g_new0(float, n);
    for (int v = 0; ok && v < n; v++) {
        const char *path = source->paths->pdata[v];
        g_autoptr(ExrFile) file = exr_read_headers(path, error);
        ok = file &&
             (file->parts->len > 0 ||
              data_error_fail(path, 0, error, "the file of this view has no pictures" BTF_AGAIN)) &&
             direction(file->parts->pdata[0], "view", path, &header->view_theta_deg[v],
                       &header->view_phi_deg[v], error);
        if (ok && v == 0) {
            header->n_lights = (int)file->parts->len;
            header->light_theta_deg = g_new0(float, header->n_lights);
            header->light_phi_deg = g_new0(float, header->n_lights);
        }
        for (int l = 0; ok && v == 0 && l < header->n_lights; l++)
            ok = direction(file->parts->pdata[l], "light", path, &header->light_theta_deg[l],
                           &header->light_phi_deg[l], error);
    }
    return ok;
}

static gboolean open_source(struct source *source, const char *path, enum bonn_kind kind,
                            GError **error) {
    *source = (struct source){.header = {.kind = kind, .rgb_scale = {1, 1, 1}, .cosine = TRUE}};
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    if (!session || !session_grid(session, &source->grid, error))
        return FALSE;
    source->paths = session_btf_files(session, error);
    if (!source->paths || !read_directions(source, error))
        return FALSE;
    source->header.setup = g_strdup("mesorig " MESORIG_VERSION);
    source->header.xml = g_strdup("");
    source->header.width = source->grid.width;
    source->header.height = source->grid.height;
    source->header.texels_a_mm = source->grid.width / source->grid.width_mm;
    return TRUE;
}

/* maximum memory, in bytes, of the views that are read together (as half floats) */
#define VIEWS_MEMORY ((gsize)576 << 20)
#define MAX_TOGETHER 16
#define PICTURES     16 /* number of pictures of a view that are read at a time */

/* Views that are written together. */
struct views {
    int n;
    guint16 *halves; /* n_texels × n × n_lights × 3 */
};

static gboolean check_picture(const struct source *source, const struct exr_part *part, int light,
                              const char *path, GError **error) {
    const struct bonn_header *header = &source->header;
    float theta, phi;
    if (part->width != header->width || part->height != header->height)
        return data_error_fail(
            path, 0, error,
            "part %s has %d × %d texels, but the session's grid has %d × %d" BTF_AGAIN, part->name,
            part->width, part->height, header->width, header->height);
    for (gsize c = 0; c < COLOURS; c++)
        if (!exr_part_plane(part, channels[c]))
            return data_error_fail(path, 0, error, "part %s lacks channel %s" BTF_AGAIN, part->name,
                                   channels[c]);
    if (!direction(part, "light", path, &theta, &phi, error))
        return FALSE;
    if (theta != header->light_theta_deg[light] || phi != header->light_phi_deg[light])
        return data_error_fail(
            path, 0, error,
            "the light of part %s is at θ %g°, φ %g°, but at θ %g°, φ %g° in the first "
            "view" BTF_AGAIN,
            part->name, (double)theta, (double)phi, (double)header->light_theta_deg[light],
            (double)header->light_phi_deg[light]);
    return TRUE;
}

/* Copies pictures to view i of `to`. The pictures are those of the lights `light`, `light` + 1,
 * …. */
static gboolean take_pictures(const struct source *source, const struct exr_file *file, int light,
                              const struct views *to, int i, const char *path, GError **error) {
    const struct bonn_header *header = &source->header;
    const gsize n = (gsize)header->width * (gsize)header->height, some = file->parts->len * COLOURS;
    const gsize row = (gsize)header->n_lights * COLOURS;
    const float *planes[PICTURES * COLOURS];
    float values[PICTURES * COLOURS];
    for (guint k = 0; k < file->parts->len; k++) {
        const struct exr_part *part = file->parts->pdata[k];
        if (!check_picture(source, part, light + (int)k, path, error))
            return FALSE;
        for (gsize c = 0; c < COLOURS; c++)
            planes[k * COLOURS + c] = exr_part_plane(part, channels[c]);
    }
    guint16 *at = to->halves + (gsize)i * row + (gsize)light * COLOURS;
    for (gsize texel = 0; texel < n; texel++, at += (gsize)to->n * row) {
        for (gsize k = 0; k < some; k++)
            values[k] = planes[k][texel];
        exr_half_from_floats(at, values, some);
    }
    return TRUE;
}

/* Reads the file of a view into view i of `to`. */
static gboolean read_view(const struct source *source, const char *path, const struct views *to,
                          int i, int n_threads, GError **error) {
    const struct bonn_header *header = &source->header;
    g_autoptr(ExrReader) reader = exr_reader_new(path, error);
    if (!reader)
        return FALSE;
    if (exr_reader_parts(reader) != header->n_lights)
        return data_error_fail(
            path, 0, error,
            "the file has %d lights, but the file of the first view has %d" BTF_AGAIN,
            exr_reader_parts(reader), header->n_lights);
    for (int light = 0; light < header->n_lights; light += PICTURES) {
        g_autoptr(ExrFile) file = exr_reader_next(reader, PICTURES, n_threads, error);
        if (!file || !take_pictures(source, file, light, to, i, path, error))
            return FALSE;
    }
    return TRUE;
}

static gboolean write_views(const struct source *source, const char *file, const struct work *work,
                            GError **error) {
    const struct bonn_header *header = &source->header;
    const gint64 begun_us = g_get_monotonic_time();
    const int threads = work ? work->n_threads : 0;
    const gsize n =
        (gsize)header->width * (gsize)header->height * (gsize)header->n_lights * COLOURS;
    const int together = (int)CLAMP(VIEWS_MEMORY / MAX(n * sizeof(guint16), 1), 1, MAX_TOGETHER);
    struct views views = {.n = MIN(together, header->n_views)};
    g_autofree guint16 *halves = views.halves = g_new(guint16, n * (gsize)views.n);
    g_autoptr(BonnWriter) writer = bonn_writer_new(file, header, NULL, error);
    if (!writer)
        return FALSE;
    for (int first = 0; first < header->n_views; first += views.n) {
        views.n = MIN(views.n, header->n_views - first);
        for (int i = 0; i < views.n; i++)
            if (!read_view(source, source->paths->pdata[first + i], &views, i, threads, error) ||
                !work_tell(work, "export", first + i + 1, header->n_views, begun_us, error))
                return FALSE;
        if (!bonn_writer_views(writer, first, views.n, halves, threads, error))
            return FALSE;
    }
    return bonn_writer_finish(writer, error);
}

/* Writes a DFMF. The three matrices of the colours have the same S V, the weights of the texels,
 * because the channels were factored together. */
static gboolean write_split(const char *file, const struct bonn_header *header,
                            const struct bonn_factors *all, GError **error) {
    const gsize k = (gsize)all->n_components, rows = (gsize)all->n_rows / COLOURS;
    g_autofree float *u = g_new(float, rows *k *COLOURS);
    struct bonn_factors factors[COLOURS];
    for (gsize c = 0; c < COLOURS; c++) {
        float *own = u + c * rows * k;
        for (gsize row = 0; row < rows; row++)
            memcpy(own + row * k, all->u + (row * COLOURS + c) * k, sizeof *own * k);
        factors[c] = *all;
        factors[c].n_rows = (int)rows;
        factors[c].u = own;
    }
    return bonn_write_factors(file, header, factors, error);
}

static gboolean write_lpca(const char *file, const struct bonn_header *header,
                           const struct lpca *lpca, GError **error) {
    const gsize k = (gsize)lpca->n_components + 1, n = btf_layout_texels(&lpca->layout);
    const gsize d = btf_layout_values(&lpca->layout);
    /* u is d × k. The first of the k components is the mean, which has the weight 1 for every
     * texel. */
    g_autofree float *s = g_new(float, k), *u = g_new(float, d *k), *sv = g_new(float, n *k);
    for (gsize i = 0; i < k; i++) {
        double squares = 0;
        for (gsize j = 0; j < d; j++)
            u[j * k + i] = lpca->brdfs[i * d + j];
        for (gsize t = 0; t < n; t++) {
            sv[t * k + i] = i == 0 ? 1 : lpca->weights[t * (k - 1) + i - 1];
            squares += (double)sv[t * k + i] * (double)sv[t * k + i];
        }
        s[i] = (float)sqrt(squares);
    }
    const struct bonn_factors all = {(int)k, (int)d, (int)n, s, u, sv};
    return header->kind == BONN_FMF ? bonn_write_factors(file, header, &all, error)
                                    : write_split(file, header, &all, error);
}

gboolean export_bonn(const char *session, const char *file, enum bonn_kind kind, int n_components,
                     const struct work *work, struct export_bonn_result *ret, GError **error) {
    struct source source;
    *ret = (struct export_bonn_result){0};
    gboolean ok = open_source(&source, session, kind, error);
    if (ok && (kind == BONN_BDI || kind == BONN_BDI_SPARSE)) {
        ok = write_views(&source, file, work, error);
    } else if (ok) {
        const struct lpca_options options = {
            .n_clusters = 1, .n_components = n_components, .work = *work};
        struct btf_matrix *btf = btf_matrix_read(session, work, error);
        struct lpca *lpca = btf ? lpca_compute(btf, &options, error) : NULL;
        if (lpca)
            ret->error = lpca_error(lpca, btf, 0);
        btf_matrix_free(btf);
        ok = lpca && write_lpca(file, &source.header, lpca, error);
        lpca_free(lpca);
    }
    ret->n_views = source.header.n_views;
    ret->n_lights = source.header.n_lights;
    ret->width = source.header.width;
    ret->height = source.header.height;
    g_clear_pointer(&source.paths, g_ptr_array_unref);
    bonn_header_clear(&source.header);
    return ok;
}
