#include "silhouettes_fixture.h"
#include "lib/mdf_file.h"
#include "lib/ok.h"

/* Returns a diffuser: one term, which is cos θ at three lights. */
static struct eigenmaps *silhouettes_grey(void) {
    struct eigenmaps *m = g_new0(struct eigenmaps, 1);
    m->name = g_strdup("grey");
    m->layout.width = m->layout.height = m->n_terms = m->layout.views.n = 1;
    m->layout.texel_mm = 1.0;
    m->layout.lights.n = 3;
    m->layout.views.theta_deg = g_new0(float, 1);
    m->layout.views.phi_deg = g_new0(float, 1);
    m->layout.lights.theta_deg = g_new(float, 3);
    m->layout.lights.phi_deg = g_new(float, 3);
    m->weights = g_new(float, 1);
    m->maps = g_new(float, 9);
    m->weights[0] = 1.0f;
    for (int k = 0; k < 3; k++) {
        m->layout.lights.theta_deg[k] = 60.0f;
        m->layout.lights.phi_deg[k] = 120.0f * k;
        for (int c = 0; c < 3; c++)
            m->maps[3 * k + c] = 0.5f;
    }
    return m;
}

Viewer *silhouettes_view(const struct mesh *mesh, const struct mdf_table *mdf) {
    g_autoptr(GError) error = NULL;
    struct eigenmaps *material = silhouettes_grey();
    Viewer *view = ok(viewer_new(material, ERR));
    eigenmaps_free(material);
    ok(viewer_set_mesh(view, mesh, ERR));
    if (mdf != NULL)
        viewer_set_mdf(view, &(struct mdf_source){.table = mdf}, &error);
    g_assert_no_error(error);
    return view;
}

int silhouettes_differ(const float *a, const float *b, int n, float tolerance) {
    int differ = 0;
    for (int k = 0; k < n; k++)
        differ += fabsf(a[k] - b[k]) > tolerance;
    return differ;
}

char *silhouettes_write_truth_rings(World *world, const struct truth_grid *grid, int first_camera,
                                    const double *theta_deg, int n_theta, int n_phi) {
    struct exr_file *file = exr_file_new();
    for (int k = 0; k < n_theta * n_phi; k++) {
        const int ring = k / n_phi, camera = first_camera + ring;
        double phi = 360.0 / n_phi * (k % n_phi), centre[3];
        struct exr_part *part = mdf_file_add_view(
            file, k, grid->width, grid->height, theta_deg[ring], phi, grid->width_mm / grid->width);
        truth_mdf(world, camera, -phi, grid, part->planes[0], NULL);
        truth_view_centre_mm(world, camera, -phi, centre);
        exr_set_v3d(part, "view.centre_mm", centre[0], centre[1], centre[2]);
        exr_set_double(part, "reference_mm", grid->reference_mm);
    }
    char *path = g_build_filename(world_fixture_folder(), "mdf.exr", NULL);
    ok(exr_write(path, file, EXR_PIZ, FALSE, ERR));
    exr_file_free(file);
    return path;
}

char *silhouettes_write_truth(World *world, const struct truth_grid *grid) {
    static const double theta_deg[N_THETA] = {15, 30, 45, 60, 75};
    return silhouettes_write_truth_rings(world, grid, 0, theta_deg, N_THETA, N_PHI);
}

World *silhouettes_world(const char *kind, double relief_mm) {
    g_autoptr(GString) text = g_string_new("[world]\nnoise=no\ngather_rays=0\n");
    g_string_append_printf(text,
                           "[sample]\nkind=%s\nseed=3\nwidth_mm=50\nheight_mm=50\nbase_mm=0.4\n"
                           "relief_mm=%g\ntop_mm=5\nperiod_mm=6.25\ngrid=160\n",
                           kind, relief_mm);
    for (int k = 0; k < N_THETA; k++)
        g_string_append_printf(text, "[camera c%d]\ntheta_deg=%d\ndistance_mm=650\n", k,
                               15 * (k + 1));
    return world_fixture_new(text->str);
}
