/* Pictures of local PCAs of logarithms against a plain evaluation of the formula, pixel by pixel.
 */
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/lpca_revised.h"
#include "drawing/methods/lpca_view.h"
#include "lib/lpca_scene.h"

/* What random numbers are as logarithms: from a hundredth to about white. */
static void make_log(struct lpca *lpca) {
    const gsize size = 3 * lpca->layout.views.n * lpca->layout.lights.n;
    lpca->colours = LPCA_LOG;
    for (int k = 0; k < lpca->n_clusters; k++)
        for (gsize i = 0; i < size; i += 3) {
            float *mean = lpca->brdfs + size * (lpca->n_components + 1) * k + i;
            mean[0] = 8 * mean[0] - 6;
            mean[1] -= 0.5F;
            mean[2] -= 0.5F;
        }
}

static void check_log(int n_components, gboolean nearest, double ambient) {
    g_autoptr(GError) error = NULL;
    struct lpca *lpca = lpca_scene_lpca(4, n_components);
    make_log(lpca);
    lpca_scene_check(lpca, nearest, ambient, 0);
    g_assert_null(lpca_grid_new(&lpca, 1, 4, &error));
    g_assert_nonnull(strstr(error->message, "--method lpca"));
    g_clear_error(&error);
    g_assert_null(lpca_revised_new(&lpca, 1, 4, &error));
    g_assert_nonnull(strstr(error->message, "--method lpca"));
    lpca_free(lpca);
}

GPU_TEST(formula) {
    check_log(5, TRUE, 0);
    check_log(2, FALSE, 0);
    check_log(6, FALSE, 0.4);
    check_log(1, TRUE, 0.2);
}

GPU_TEST(levels) {
    g_autoptr(GError) error = NULL;
    struct lpca *levels[3];
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    for (int k = 0; k < 3; k++) {
        levels[k] = lpca_scene_level(k, 4 - k, k == 1 ? 2 : 3);
        make_log(levels[k]);
    }
    viewer_set_method(view, &method_lpca, lpca_view_new(levels, 3, &error), &error);
    g_assert_no_error(error);
    lpca_scene_check_levels(view, levels, 18);
    lpca_scene_check_levels(view, levels, 33);
    levels[1]->colours = LPCA_RGB;
    g_assert_null(lpca_view_new(levels, 3, &error));
    g_assert_nonnull(strstr(error->message, "mip level 1"));
    for (int k = 0; k < 3; k++)
        lpca_free(levels[k]);
}
