#include "compare_lights.h"

#include "base/plural.h"
#include "common/work.h"
#include "relighting/relighting.h"

#include <gio/gio.h>
#include <math.h>

/* RBF and kriging are measured at three sizes: that of PTM (18 numbers per pixel), that of HSH with
 * 9 terms (27), and with all pictures. */
static const struct relighting_model models[] = {
    {.basis = RELIGHTING_PTM},
    {.basis = RELIGHTING_HSH, .n_terms = 4},
    {.basis = RELIGHTING_HSH, .n_terms = 9},
    {.basis = RELIGHTING_HSH, .n_terms = 16},
    {.basis = RELIGHTING_RBF, .planes = 18},
    {.basis = RELIGHTING_RBF, .planes = 27},
    {.basis = RELIGHTING_RBF},
    {.basis = RELIGHTING_KRIGING, .planes = 18},
    {.basis = RELIGHTING_KRIGING, .planes = 27},
    {.basis = RELIGHTING_KRIGING},
};

/* The errors of a model. */
struct row {
    struct relighting_model model;
    struct relighting_errors errors;
    double sigma, seconds;
    double *light_db; /* PSNR of each light */
    char *impossible; /* why the model cannot predict these lights; NULL if it can */
};

struct lights {
    const char *session;
    Relighting *relighting;
    GArray *rows; /* of struct row */
};

static void clear_row(gpointer data) {
    struct row *row = data;
    g_free(row->light_db);
    g_free(row->impossible);
}

/* Measures a model. If the lights do not determine the model, its row says so. */
static gboolean measure(struct lights *lights, const struct relighting_model *model,
                        const float *pictures, float *predicted, const struct work *work,
                        GError **error) {
    const int n = lights->relighting->n_lights;
    const gint64 begun_us = g_get_monotonic_time();
    struct row row = {.model = *model, .light_db = g_new0(double, n)};
    GError *found = NULL;
    if (relighting_leave_out(lights->relighting, model, work, predicted, &row.sigma, &found)) {
        row.seconds = (double)(g_get_monotonic_time() - begun_us) * 1e-6;
        relighting_compare(lights->relighting, pictures, predicted, &row.errors, row.light_db);
    } else if (g_error_matches(found, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_free(row.light_db);
        g_propagate_error(error, found);
        return FALSE;
    } else {
        row.impossible = g_strdup(found->message);
        g_error_free(found);
    }
    g_array_append_val(lights->rows, row);
    return TRUE;
}

static gboolean work_lights(const struct work *work, gpointer data, GError **error) {
    struct lights *lights = data;
    lights->relighting = relighting_read(lights->session, work, error);
    if (!lights->relighting)
        return FALSE;
    const Relighting *r = lights->relighting;
    g_autofree float *pictures = relighting_pictures(r);
    g_autofree float *predicted =
        g_new(float, 3 * (gsize)r->width * (gsize)r->height * (gsize)r->n_lights);
    for (int near = 0; near < (r->near->lamp_mm ? 2 : 1); near++)
        for (gsize i = 0; i < G_N_ELEMENTS(models); i++) {
            struct relighting_model model = models[i];
            model.near = near;
            if (model.planes < 3 * (r->n_lights - 1) &&
                !measure(lights, &model, pictures, predicted, work, error))
                return FALSE;
        }
    return TRUE;
}

static void tell_row(Record *to, const struct row *row, int n_lights) {
    g_autofree char *name = relighting_model_name(&row->model);
    record_begin(to, NULL);
    record_say(to, "%-10s{basis} %-8s{light} %12d{numbers}", name,
               row->model.near ? "near" : "distant",
               relighting_model_numbers(&row->model, n_lights));
    if (row->impossible) {
        record_say(to, "  %s{impossible}\n", row->impossible);
    } else {
        record_say(to, "  %7.2f{psnr_db}", row->errors.psnr_db);
        record_say_if(to, !isnan(row->errors.ssim), "  %6.4f{ssim}", row->errors.ssim);
        if (isnan(row->errors.ssim))
            record_say(to, "  %6s", "–");
        record_say(to, "  %6.4f{flip}  %6.2f{real_s}\n", row->errors.flip, row->seconds);
        if (row->model.basis == RELIGHTING_RBF)
            record_double(to, "sigma", row->sigma);
        record_doubles(to, "lights_psnr_db", row->light_db, n_lights);
    }
    record_end(to);
}

static void tell(Record *to, const struct lights *lights) {
    const Relighting *r = lights->relighting;
    record_say(to, "%s{session}: %d{lights} %s, %d{width} × %d{height} texels\n", lights->session,
               PLURAL(r->n_lights, "light"), r->width, r->height);
    record_boolean(to, "near", r->near->lamp_mm != NULL);
    record_say_if(to, !r->near->lamp_mm,
                  "The positions of the lamps are not known, so only distant light is "
                  "compared.\n");
    record_say(to, "Each picture is predicted from the pictures under all other lights.\n");
    record_say(to, "\n%-10s %-8s %12s  %7s  %6s  %6s  %6s\n", "basis", "light", "numbers/texel",
               "PSNR/dB", "SSIM", "FLIP", "s");
    record_begin_list(to, "bases");
    for (guint i = 0; i < lights->rows->len; i++)
        tell_row(to, &g_array_index(lights->rows, struct row, i), r->n_lights);
    record_end(to);
}

gboolean compare_lights(const char *session, Record *to, GError **error) {
    struct lights lights = {.session = session,
                            .rows = g_array_new(FALSE, FALSE, sizeof(struct row))};
    g_array_set_clear_func(lights.rows, clear_row);
    const gboolean ok = cli_work_run(work_lights, &lights, NULL, error);
    if (ok)
        tell(to, &lights);
    g_array_unref(lights.rows);
    relighting_free(lights.relighting);
    return ok;
}
